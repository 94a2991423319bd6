"""No friction of first use is open: each is tried as in `make frictions`."""

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

from tests.pages.blocks import ROOT


def script() -> Any:
    """Load the script as a module."""
    spec = importlib.util.spec_from_file_location("frictions", ROOT / ".ci" / "frictions.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FRICTIONS = script()


@pytest.mark.parametrize("check", FRICTIONS.CHECKS, ids=lambda check: check.__name__)
def test_a_friction_of_first_use_is_gone(check: Any, tmp_path: Path) -> None:
    assert check(tmp_path)


def test_the_script_prints_a_line_for_each_and_fails_while_one_is_open(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def still_there(folder: Path) -> str:
        raise AssertionError("it is still there\nand more")

    def gone(folder: Path) -> str:
        return "nothing left"

    monkeypatch.setattr(FRICTIONS, "CHECKS", (still_there, gone))
    assert FRICTIONS.main() == 1
    first, second = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"OPEN  still there  +\d\.\d s  it is still there", first)
    assert re.fullmatch(r"ok    gone  +\d\.\d s  nothing left", second)
    monkeypatch.setattr(FRICTIONS, "CHECKS", (gone,))
    assert FRICTIONS.main() == 0
