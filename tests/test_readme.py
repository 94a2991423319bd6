"""What README.md and docs/links.md show does work: every file is read, every command is run.

A block that begins with a comment naming a file is that file. The blocks of `sh` are run in a
folder with those files, on ports that are free.
"""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from zacoustic.cli import BUILT_IN
from zacoustic.tools.demo.islands import free_ports

ROOT: Final = Path(__file__).parents[1]
LIMIT_S: Final = 90.0

_BLOCK: Final = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_NAME: Final = re.compile(r"(?://|#) ([\w.]+)\n")
_LINK: Final = re.compile(r"\]\(((?!http)[^)#]+)\)")


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return [block for found, block in _BLOCK.findall(text) if found == language]


def write_files(page: str, folder: Path) -> None:
    """Write the files of a page; every configuration and program on it must name its file."""
    for language in ("json5", "python"):
        for block in blocks(page, language):
            named = _NAME.match(block)
            assert named is not None, block
            (folder / named[1]).write_text(block, encoding="utf-8")


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    scripts = Path(sys.executable).parent
    return subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ.get('PATH', '')}"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )


def shell(script: str, folder: Path) -> str:
    """Run a script with everything that it starts in the background; gives its output."""
    scripts = Path(sys.executable).parent
    process = subprocess.Popen(
        ["sh", "-e", "-c", script],
        cwd=folder,
        env={**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ.get('PATH', '')}"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        code = process.wait(LIMIT_S)
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        output, errors = process.communicate(timeout=LIMIT_S)
    assert code == 0, errors
    return output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_files("README.md", tmp_path)
    return tmp_path


def moved(text: str, port: int) -> str:
    return text.replace("127.0.0.1:7000", f"127.0.0.1:{port}")


def test_the_targets_of_make_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    commands = [line.split("#")[0].split() for line in blocks("README.md", "sh")[0].splitlines()]
    for program, target in commands:
        assert program == "make"
        assert f"\n{target}:" in makefile


def test_the_router_file_is_valid_for_both_gateways(folder: Path) -> None:
    commands = [
        shlex.split(line, comments=True) for line in blocks("README.md", "sh")[1].splitlines()
    ]
    check, *gateways = commands
    assert check[:2] == ["zacoustic", "check"]
    for command in (check, *(["zacoustic", "check", *each[2:]] for each in gateways)):
        process = run(command, folder)
        assert process.returncode == 0, process.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="a script of sh")
def test_pub_and_sub_meet_on_a_simulated_link(folder: Path) -> None:
    (port,) = free_ports(1)
    script = moved(blocks("README.md", "sh")[2], port)
    output = shell(f"{script}\n", folder)
    assert "12.3" in output


@pytest.mark.skipif(sys.platform == "win32", reason="a script of sh")
def test_the_python_program_runs(folder: Path) -> None:
    (port,) = free_ports(1)
    program = folder / "depth.py"
    program.write_text(moved(program.read_text(encoding="utf-8"), port), encoding="utf-8")
    medium = f"zacoustic medium water.json5 --listen 127.0.0.1:{port} &"
    output = shell(f"{medium}\npython depth.py\n", folder)
    assert "auv1/depth 12.3 from node 2" in output


def test_the_link_of_the_page_passes_the_conformance_battery(tmp_path: Path) -> None:
    write_files("docs/links.md", tmp_path)
    process = run([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "."], tmp_path)
    assert process.returncode == 0, process.stdout


def test_the_example_of_the_plan_does_not_fit_and_says_why(tmp_path: Path) -> None:
    write_files("docs/plan.md", tmp_path)
    process = run(["zacoustic", "plan", "water.json5", "--hours", "0.5"], tmp_path)
    assert process.returncode == 1, process.stderr
    assert "auv1/status alone takes" in process.stdout
    assert 'it would fit with: auv1/status: codec: "packed"' in process.stdout


def test_every_verb_is_in_the_table() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    table = text.partition("## Commands")[2].partition("## ")[0]
    for verb in (*BUILT_IN, "medium"):
        assert re.search(rf"`(zacoustic )?{verb}\b", table), verb


@pytest.mark.parametrize(
    "page",
    [
        "README.md",
        "docs/links.md",
        "docs/design.md",
        "docs/rmw_desert.md",
        "docs/plan.md",
        "docs/doctor.md",
    ],
)
def test_what_a_page_links_to_is_there(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    folder = (ROOT / page).parent
    absent = [target for target in _LINK.findall(text) if not (folder / target).exists()]
    assert absent == []
