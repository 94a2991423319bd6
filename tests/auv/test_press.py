"""A press of STOP in the browser, without a browser: offline, reloaded, given twice, dismissed."""

import functools
import json
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import pytest

HERE: Final = Path(__file__).parent
SOURCE: Final = HERE.parents[1] / "examples" / "auv" / "press.js"
GONE: Final = True
KEPT: Final = "kept until the page server is back"
NOT_TAKEN: Final = "the page server has not taken it"


def run(*steps: tuple[Any, ...]) -> list[str]:
    node = _node()
    if node is None:
        pytest.skip("NOT RUN: no node that starts, of the system or of playwright")
    command = [node, str(HERE / "press.mjs"), str(SOURCE), json.dumps(steps)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    found: list[str] = json.loads(done.stdout)
    return found


@functools.cache
def _node() -> str | None:
    """Return a node that starts: on a bare Debian 13 playwright's one lacks a library."""
    found = [shutil.which("node")]
    spec = find_spec("playwright")
    if spec is not None and spec.origin is not None:
        found.append(str(Path(spec.origin).parent / "driver" / "node"))
    return next((each for each in found if each and _starts(each)), None)


def _starts(program: str) -> bool:
    try:
        done = subprocess.run([program, "--version"], check=False, capture_output=True)
    except OSError:
        return False
    return done.returncode == 0


def test_a_press_is_given_at_once_and_forgotten_when_it_is_taken() -> None:
    assert run(
        ("press", "a", False), ("look", "a", False), ("taken", "press 1"), ("look", "a", False),
        ("wait", 60), ("look", "a", False), ("look", "a", GONE),
    ) == [
        "a gives press 1 of 0 s ago", "a says nothing", "a says nothing", "a says nothing",
        "a says nothing",
    ]  # fmt: skip


@pytest.mark.parametrize("away_s", [1, 6, 15, 45])
def test_a_press_while_the_server_is_gone_outlives_the_reload(away_s: int) -> None:
    assert run(
        ("press", "a", GONE), ("wait", away_s), ("look", "a", GONE), ("reload", "a"),
        ("look", "a", False), ("wait", 0.2), ("look", "a", False), ("wait", 3),
        ("look", "a", False), ("taken", "press 1"), ("look", "a", False), ("reload", "a"),
        ("look", "a", False),
    ) == [
        f"a says {away_s} s: {KEPT}",
        f"a gives press 1 of {away_s} s ago",
        *([f"a says {away_s} s: {NOT_TAKEN}"] if away_s > 2 else ["a says nothing"]),
        *([f"a says {away_s + 0.2} s: {NOT_TAKEN}"] if away_s > 2 else ["a says nothing"]),
        f"a gives press 1 of {away_s + 3.2} s ago",
        f"a says {away_s + 3.2} s: {NOT_TAKEN}",
        "a says nothing",
        "a says nothing",
    ]  # fmt: skip


def test_the_pages_of_a_browser_have_one_press_and_the_newest_counts() -> None:
    assert run(
        ("press", "a", GONE), ("wait", 5), ("press", "b", GONE), ("look", "a", GONE),
        ("look", "a", False), ("look", "b", False), ("taken", "press 1"), ("look", "b", False),
        ("look", "a", False),
    ) == [
        f"a says 0 s: {KEPT}", "a gives press 1 of 0 s ago", "a says nothing",
        "b gives press 1 of 0 s ago", "b says nothing", "b says nothing", "a says nothing",
    ]  # fmt: skip


def test_a_press_is_dismissed_by_a_person_only() -> None:
    assert run(
        ("press", "a", GONE), ("wait", 86400), ("look", "a", GONE), ("look", "a", False),
        ("dismiss", "a"), ("look", "a", False), ("look", "b", False),
    ) == [
        "a says 86400 s: press it again",
        "a says 86400 s: press it again",  # not given: the dive may be another one
        "a says nothing",
        "b says nothing",
    ]  # fmt: skip


@pytest.mark.parametrize("text", ["{}", "null", "[1]", '{"id": 3, "at": 4}', "{", '{"id": "x"}'])
def test_what_is_no_press_in_the_store_is_none(text: str) -> None:
    assert "a says nothing" in run(("spoil", text), ("look", "a", False))


def test_a_browser_without_a_store_keeps_the_press_as_long_as_the_page_lives() -> None:
    assert run(("refuse",), ("press", "a", GONE), ("wait", 9), ("look", "a", False)) == [
        "a gives press 1 of 9 s ago", f"a says 9 s: {NOT_TAKEN}",
    ]  # fmt: skip
