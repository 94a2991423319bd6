"""What needs no Zenoh works where it is not installed; what needs it says what to install."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.pages.blocks import files_of
from zacoustic.config import read_config
from zacoustic.json5 import parse_json5

TEXTS = (
    "{ b: 1, a: [1.5, .5, 0x10, 1e308, -0, +3], c: 'x\\'y', }",
    '{"a": null, "t": true, "s": "µ–\U0001f916", "e": "\\u00b5"} // end',
    "/* c */ [[], {}, NaN, Infinity, -Infinity]",
    "{ a: 1, a: 2, b: { z: 1, y: [ { d: 1, c: 2 } ] } }",
)


@pytest.fixture
def bare(tmp_path: Path) -> dict[str, str]:
    """The environment of a process that finds no Zenoh."""
    folder = tmp_path / "bare"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text("import sys\nsys.modules['zenoh'] = None\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


def run(bare: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], env=bare, capture_output=True, text=True, check=False, timeout=120
    )


def test_check_reads_a_file_without_zenoh_and_finds_the_same_table(
    bare: dict[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "fleet.json5"
    path.write_text(files_of("docs/plan.md")["fleet.json5"], encoding="utf-8")
    process = run(bare, "-m", "zacoustic", "config", "check", str(path), "--json", "--address", "1")
    assert process.returncode == 0, process.stderr
    report = json.loads(process.stdout)
    assert report["digest"] == read_config(path, address=1).table.digest.hex()
    assert any("pip install eclipse-zenoh" in note for note in report["notes"])
    path.write_text("{ plugins: { acoustic: { address: 1, } } ]", encoding="utf-8")
    process = run(bare, "-m", "zacoustic", "config", "check", str(path))
    assert process.returncode == 2
    assert process.stderr.startswith(f"zacoustic config check: {path}:1:")


def test_who_needs_zenoh_names_the_package_that_brings_it(bare: dict[str, str]) -> None:
    process = run(bare, "-m", "zacoustic", "topic", "list")
    assert (process.returncode, process.stderr) == (
        1,
        "zacoustic topic list: needs zenoh, which is not installed (pip install eclipse-zenoh)\n",
    )
    script = "import asyncio, zacoustic\nasyncio.run(zacoustic.Node('shore').open())"
    process = run(bare, "-c", script)
    assert "zacoustic.errors.SessionError: a node without link needs zenoh" in process.stderr
    assert "pip install eclipse-zenoh" in process.stderr


def test_both_parsers_read_the_same(bare: dict[str, str]) -> None:
    script = (
        "import json, sys; from zacoustic.json5 import parse_json5\n"
        "print(json.dumps([parse_json5(each, source='') for each in json.loads(sys.argv[1])]))"
    )
    process = run(bare, "-c", script, json.dumps(TEXTS))
    assert process.returncode == 0, process.stderr
    assert json.loads(process.stdout) == [parse_json5(each, source="") for each in TEXTS]
