"""Walk docs/tutorial.md up to its first sample across the water, and time each step.

A fresh clone of this checkout's last commit, a fresh environment, emulated modems in real time. The
commands are those of the page, in its order, up to the mark "ten minutes"; only ports differ.

Run it: python tests/benchmarks/bench_tutorial.py
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.pages.blocks import ROOT, blocks_of, commands_of
from tests.pages.walk import Walk

PAGE: Final = "docs/tutorial.md"
MARK: Final = "<!-- ten minutes -->"
COMMANDS_MOST: Final = 12
SECONDS_MOST: Final = 600.0


def commands() -> tuple[list[str], list[str]]:
    """Return the commands that install it, and those that follow, up to the mark."""
    before, mark, _ = (ROOT / PAGE).read_text(encoding="utf-8").partition(MARK)
    assert mark, f"{PAGE} has no {MARK}"
    blocks = [block for block in blocks_of(PAGE) if block.text in before]
    install = [block.text for block in blocks if block.language == "console"]
    rest = [block.text for block in blocks if block.language == "sh"]
    return (
        # Packages of the system are there, or nothing here would run.
        [line for text in install for line in text.splitlines() if not line.startswith("sudo ")],
        [line for text in rest for line in commands_of(text)],
    )


def main() -> int:
    """Print the seconds of each step; fail when it takes too long."""
    install, rest = commands()
    count, begun = len(install) + len(rest), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        os.environ.pop("PYTHONPATH", None)
        # The page cannot name the address: what is cloned is this checkout.
        script = "\n".join(install).replace("git clone …", f"git clone --quiet '{ROOT}'")
        _timed_script(script.splitlines(), place)
        sys.executable = str(place / "zacoustic" / ".venv" / "bin" / "python")
        with Walk(PAGE, place) as walk:
            for command in rest:
                at = time.monotonic()
                walk.do(command)
                _tell(at, command)
            at = time.monotonic()
            walk.rest()
            _tell(at, "(until the sample has arrived, and everything has ended)")
    took = time.monotonic() - begun
    print(f"{count} commands, at most {COMMANDS_MOST}; {took:.0f} s, at most {SECONDS_MOST:.0f}")
    return int(count > COMMANDS_MOST or took > SECONDS_MOST)


def _timed_script(lines: list[str], folder: Path) -> None:
    """Type lines into one shell, which keeps its folder and environment from line to line."""
    shell = subprocess.Popen(
        ["sh", "-e"], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert shell.stdin is not None
    assert shell.stdout is not None
    for line in lines:
        at = time.monotonic()
        shell.stdin.write(f"{line} >&2\necho done\n")
        shell.stdin.flush()
        assert shell.stdout.readline() == "done\n", f"failed: {line}"
        _tell(at, line)
    shell.stdin.close()
    assert shell.wait() == 0
    shell.stdout.close()


def _tell(begun: float, what: str) -> None:
    print(f"{time.monotonic() - begun:7.1f} s  {what}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
