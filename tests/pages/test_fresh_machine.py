"""A machine that has nothing yet: it is told what is missing, sees work, and keeps no traces."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests.pages.blocks import ROOT

AT_WORK: Final = ROOT / ".ci" / "atwork.py"
IN_TERMINAL: Final = """
import os, pty, sys
pid, fd = pty.fork()
if not pid:
    os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
said = b""
try:
    while data := os.read(fd, 1 << 16):
        said += data
except OSError:
    pass
sys.stdout.buffer.write(said)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""

pytestmark = pytest.mark.skipif(os.name == "nt", reason="make, sh, pseudo-terminals")


def at_work(program: str, *, terminal: bool = False, silent_s: float = 0.05) -> tuple[int, str]:
    """Run a line of Python that is watched; returns its exit code, and what was seen."""
    start = f"import runpy, sys; sys.argv = ['', 'W', sys.executable, '-c', {program!r}]; "
    start += f"watch = runpy.run_path({str(AT_WORK)!r}); main = watch['main']; "
    start += f"main.__globals__['SILENT_S'] = {silent_s}; sys.exit(main(*sys.argv[1:]))"
    around = ["-c", IN_TERMINAL] if terminal else []
    process = subprocess.run(
        [sys.executable, *around, "-c", start], capture_output=True, text=True, check=False
    )
    assert process.stderr == ""
    return process.returncode, process.stdout


def test_what_is_silent_says_that_it_is_at_work() -> None:
    code, seen = at_work("import sys, threading; threading.Event().wait(0.4); sys.exit(3)")
    assert code == 3
    assert re.match(r"W … \d+ s\n", seen)


def test_what_speaks_is_passed_on_and_nothing_else() -> None:
    program = "import sys; print('a'); print('b', file=sys.stderr)"
    code, seen = at_work(program, silent_s=60)
    assert (code, sorted(seen)) == (0, sorted("a\nb\n"))


def test_on_a_terminal_the_note_goes_when_the_command_speaks_again() -> None:
    program = "import sys, threading; threading.Event().wait(0.4); print(sys.stdout.isatty())"
    code, seen = at_work(program, terminal=True)
    assert code == 0
    assert re.search("\x1b\\[KW … \\d+ s\n\x1b\\[KTrue", seen)  # text mode: \\r is \\n


def test_tests_have_a_home_of_their_own() -> None:
    assert Path.home().name.startswith("zacoustic-home-")
    assert Path(os.environ["PIP_CACHE_DIR"]).name == "pip"


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_an_engine_for_containers_that_is_absent_is_named() -> None:
    done = subprocess.run(
        ["make", "container", "ENGINE=no-such-engine"], cwd=ROOT, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "make container: ENGINE=no-such-engine is not here: install it, or" in done.stderr
