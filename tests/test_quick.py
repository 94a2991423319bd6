"""`make quick` finds the tests of a change by itself, and says what it leaves out."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.pages.test_repository import script

ROOT = Path(__file__).parents[1]
QUICK = ROOT / ".ci" / "quick.py"


@pytest.fixture(scope="module")
def quick() -> ModuleType:
    return script(QUICK.stem)


@pytest.fixture(scope="module")
def graph(quick: ModuleType) -> Any:
    return quick.imports()


def paths(near: list[Any]) -> list[str]:
    return [each.path for each in near]


def test_a_changed_module_has_the_tests_that_import_it_first(quick: ModuleType, graph: Any) -> None:
    near = quick.nearest(["zacoustic/core/base/timers.py"], graph)
    assert near[0].path == "tests/core/test_timers.py"
    assert [each.distance for each in near] == sorted(each.distance for each in near)
    assert near[0].distance == 1
    assert near[-1].distance <= quick.DEPTH
    assert len(near) == len({each.path for each in near})


def test_a_changed_module_of_a_link_has_the_tests_of_that_link(
    quick: ModuleType, graph: Any
) -> None:
    near = quick.nearest(["links/zacoustic_sim/link.py"], graph)
    assert "tests/links/test_sim_acknowledgement.py" in paths(near)[:3]
    # Nobody imports this one: programs find it by its entry point.
    near = quick.nearest(["links/zacoustic_udp/link.py"], graph)
    assert near[0].path == "tests/links/test_udp.py"


def test_a_changed_verb_has_the_tests_of_its_room(quick: ModuleType, graph: Any) -> None:
    """Nobody imports it by name."""
    near = quick.nearest(["zacoustic/app/cli/use/hz.py"], graph)
    assert near
    assert all(each.startswith("tests/cli/") for each in paths(near))


def test_a_changed_test_file_is_its_own_test(quick: ModuleType, graph: Any) -> None:
    path = "tests/core/test_timers.py"
    near = quick.nearest([path], graph)
    assert [(each.distance, each.path) for each in near] == [(0, path)]


def test_a_changed_fleet_of_tests_has_the_tests_that_use_it(quick: ModuleType, graph: Any) -> None:
    near = quick.nearest(["tests/virtual/mule.py"], graph)
    assert "tests/virtual/test_carry.py" in paths(near)
    assert "tests/core/test_timers.py" not in paths(near)


def test_a_changed_conftest_has_the_tests_of_its_folder(quick: ModuleType, graph: Any) -> None:
    near = paths(quick.nearest(["tests/channel/conftest.py"], graph))
    assert near
    assert all(each.startswith("tests/channel/") for each in near)


def test_a_changed_page_has_the_tests_that_name_it_and_that_of_prose(quick: ModuleType) -> None:
    assert {"tests/pages/test_design.py", quick.PROSE} <= quick.named_by(["docs/design.md"])


def test_a_changed_script_has_the_tests_that_name_it(quick: ModuleType) -> None:
    assert "tests/pages/test_fresh_machine.py" in quick.named_by([".ci/atwork.py"])


def test_oracle_sees_the_core_and_no_screen(quick: ModuleType, graph: Any) -> None:
    assert quick.oracle_sees(["zacoustic/core/base/timers.py"], graph)
    assert quick.oracle_sees(["tests/oracle/runs.json"], graph)
    assert not quick.oracle_sees(["zacoustic/app/tools/__init__.py", "docs/wire.md"], graph)


def test_nearest_tests_fill_the_time_and_a_changed_test_runs_in_any_case(
    quick: ModuleType,
) -> None:
    near = [
        quick.Near(0, False, 1, "changed"),
        quick.Near(1, False, 1, "near"),
        quick.Near(1, False, 9, "long"),
        quick.Near(2, False, 1, "far"),
    ]
    known = {"changed": 50.0, "near": 5.0, "long": 30.0, "far": 5.0}
    choice = quick.choose(near, known, 60.0)
    assert paths(choice.run) == ["changed", "near", "far"]
    assert paths(choice.left) == ["long"]
    assert paths(quick.choose(near, known, 1.0).run) == ["changed"]
    never_timed = [quick.Near(1, False, 1, "tests/test_packaging.py")]
    assert paths(quick.choose(never_timed, {}, 60.0).left) == ["tests/test_packaging.py"]


def test_what_is_left_out_is_said(quick: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    left = [quick.Near(3, True, 1, f"tests/test_{number}.py") for number in range(40)]
    quick.tell(quick.Choice([], left), {}, sees=False)
    said = capsys.readouterr().out
    assert "tests: none fits the time" in said
    assert "left out: 40 test files up to 3 imports away, 80 s in sum, 40 of them" in said
    assert "tests/test_0.py" in said
    assert "28 more" in said
    assert "oracle: not run" in said


def checkout(folder: Path) -> Path:
    """Return a repository with one commit, which has this script."""
    script = folder / ".ci" / QUICK.name
    script.parent.mkdir()
    script.write_bytes(QUICK.read_bytes())
    for arguments in (
        ("init", "--quiet", "--initial-branch", "main"),
        ("add", "."),
        ("-c", "user.name=n", "-c", "user.email=e@x", "commit", "--quiet", "--message", "first"),
    ):
        subprocess.run(["git", *arguments], cwd=folder, check=True)
    return script


def started(script: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(script), *arguments]
    env = {**os.environ, "GIT_CEILING_DIRECTORIES": str(script.parents[2])}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=env)


def test_nothing_changed_is_said(tmp_path: Path) -> None:
    ended = started(checkout(tmp_path), "--base", "HEAD")
    assert ended.returncode == 0
    assert "nothing changed" in ended.stdout


@pytest.mark.parametrize("arguments", [("--base", "no-such"), ("--seconds", "few"), ("more",)])
def test_wrong_words_end_with_2(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    ended = started(checkout(tmp_path), *arguments)
    assert ended.returncode == 2
    assert ended.stderr.startswith(("quick: ", "usage: "))


def test_outside_of_a_repository_it_ends_with_2(tmp_path: Path) -> None:
    script = tmp_path / ".ci" / QUICK.name
    script.parent.mkdir()
    script.write_bytes(QUICK.read_bytes())
    ended = started(script)
    assert ended.returncode == 2
    assert "BASE" in ended.stderr


def test_on_main_the_last_commit_counts_once_all_is_committed(
    quick: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkout(tmp_path)
    monkeypatch.setattr(quick, "ROOT", tmp_path)

    def git(*arguments: str) -> str:
        named = ("-c", "user.name=n", "-c", "user.email=e@x")
        command = ["git", *named, *arguments]
        return subprocess.run(
            command, cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout.strip()

    first = git("rev-parse", "HEAD")
    (tmp_path / "a").write_text("a")
    assert quick.base_of("")[0] == first
    assert quick.changed_since(first) == ["a"]
    git("add", "a")
    git("commit", "--quiet", "--message", "second")
    assert quick.base_of("")[0] == first  # nothing differs from HEAD: the commit before
    git("checkout", "--quiet", "-b", "branch")
    git("commit", "--quiet", "--allow-empty", "--message", "third")
    assert quick.base_of("")[0] == git("rev-parse", "main")
    assert quick.base_of("main~")[0] == first


@pytest.mark.parametrize(("words", "kept"), [((), ["test_one.py"]), (("-k", "one"), [])])
def test_durations_of_whole_files_are_kept(
    tmp_path: Path, words: tuple[str, ...], kept: list[str], quick: ModuleType
) -> None:
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "test_one.py").write_text("def test_one() -> None: pass\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.durations", *words]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run(command, cwd=tmp_path, env=env, check=True, capture_output=True)
    cached = tmp_path / quick.DURATIONS.relative_to(quick.ROOT)
    assert sorted(json.loads(cached.read_bytes()) if cached.exists() else ()) == kept


def test_all_steps_run_though_one_fails(
    quick: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: dict[str, list[str]] = {}

    def step(name: str, command: list[str], *, is_quiet: bool = False) -> bool:
        ran[name] = command
        return name != "ruff check"

    monkeypatch.setattr(quick, "step", step)
    assert quick.run(["zacoustic/link.py"], ["tests/test_quick.py"]) == 1
    assert {*ran} == {
        "ruff format --check",
        "ruff check",
        "mypy --strict",
        "lint-imports",
        "pytest",
    }
    assert ran["pytest"][-1] == "tests/test_quick.py"
    assert "make quick: FAILED: ruff check, " in capsys.readouterr().out
    ran.clear()
    quick.run(["docs/wire.md"], [])
    assert {*ran} == {"ruff format --check", "ruff check"}


@pytest.mark.parametrize(
    ("name", "code", "is_ok"),
    [("a", 0, True), ("a", 1, False), ("a", 5, False), ("pytest", 5, True)],
)
def test_a_quiet_step_shows_its_output_only_if_it_failed(
    quick: ModuleType, capsys: pytest.CaptureFixture[str], name: str, code: int, is_ok: bool
) -> None:
    command = [sys.executable, "-c", f"print('said'); raise SystemExit({code})"]
    assert quick.step(name, command, is_quiet=True) is is_ok
    shown = capsys.readouterr().out
    assert ("said" in shown) is not is_ok
    assert f"== {name}: {'passed' if is_ok else 'FAILED'}, " in shown
