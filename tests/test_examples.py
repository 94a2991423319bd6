"""Every example runs to its end on simulated water, started as a reader would: from the root."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[1]
EXAMPLES: Final = [
    # Those of several processes take twenty seconds each; tests/gateway has shorter ways.
    pytest.param(path.name, marks=[pytest.mark.soak] if "_processes" in path.name else [])
    for path in sorted((ROOT / "examples").glob("[0-9]*.py"))
]
TIMEOUT_S: Final = 120.0


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_exits_with_0(name: str) -> None:
    scripts = Path(sys.executable).parent  # where `zacoustic` is, for an example that starts it
    process = subprocess.run(
        [sys.executable, f"examples/{name}"],
        cwd=ROOT,
        env={**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ.get('PATH', '')}"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert process.returncode == 0, f"{process.stdout}\n{process.stderr}"
