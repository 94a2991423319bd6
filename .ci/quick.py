"""The fast loop: what `make quick` runs after a change, in about a minute on two warm cores.

    python .ci/quick.py [--base REV] [--seconds N] [--list]

Format and lint of the whole tree come first, since they take a second. Then two things run side by
side: types and import contracts, and the tests of what changed. A test file belongs to a changed
module if it imports it, directly or over at most `DEPTH` modules; the import graph says so, no
table. A file that is no module belongs to the test files that name it. Nearest test files run
first, until their recorded durations fill `--seconds`; the output names the others.

Exit code: 0 all passed, 1 something failed, 2 the command line or the repository is not usable.
"""

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Final

import grimp
import msgspec

ROOT: Final = Path(__file__).parents[1]
PACKAGES: Final = (
    "zacoustic",
    *sorted(path.name for path in (ROOT / "links").glob("zacoustic_*")),
    "tests",
    "examples.auv",
)
DEPTH: Final = 4
"""Imports between a test file and a changed module, at most; everything imports everything in the
end."""
TESTS_S: Final = 40.0
"""Sum of the durations of the chosen test files, s; two at a time run."""
UNKNOWN_S: Final = 2.0
"""Assumed duration of a test file that has not run here yet, s."""
LONG_S: Final = 200.0
"""The same of those in `LONG`, s."""
LONG: Final = {
    "tests/test_compiled.py",
    "tests/test_examples.py",
    "tests/test_packaging.py",
    "tests/pages/test_pages.py",
}
DURATIONS: Final = ROOT / ".pytest_cache" / "v" / "zacoustic" / "durations"
"""Seconds by test file, kept by tests/durations.py."""
ORACLE: Final = "tests/oracle/test_runs.py"
PROSE: Final = "tests/pages/test_prose.py"
NOTHING_RAN: Final = 5
"""Exit code of pytest when all chosen tests are for a soak only."""
_SHOWN: Final = 12
_CONFTEST: Final = "conftest.py"

Graph = Mapping[str, Collection[str]]
"""Modules, each with those that it imports."""


class Near(msgspec.Struct, frozen=True, order=True):
    """A test file and its distance from what changed."""

    distance: int
    """Imports in between; 0: the file itself changed."""
    is_elsewhere: bool
    """Whether no changed room has the name of its folder."""
    others: int
    """Number of its other imports: a test of one module comes before a test of many."""
    path: str


class Choice(msgspec.Struct, frozen=True):
    """Test files that run, and those that do not."""

    run: list[Near] = []
    left: list[Near] = []


def main() -> int:
    """Do what the arguments say; returns the exit code."""
    parser = argparse.ArgumentParser(prog="make quick", description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--base", default="", metavar="REV", help="all since this commit counts as changed")
    add("--seconds", type=float, default=TESTS_S, metavar="N", help="durations of tests in sum")
    add("--list", action="store_true", help="name all test files, run nothing")
    arguments = parser.parse_args()
    try:
        base, why = base_of(arguments.base)
        files = changed_since(base)
    except subprocess.CalledProcessError as error:
        print(f"quick: {error.stderr.strip()}", file=sys.stderr)
        print("quick: BASE names a commit of this repository, such as main or HEAD~3",
              file=sys.stderr)  # fmt: skip
        return 2
    print(f"changed since {why}: {len(files)} files")
    if not files:
        print("nothing changed: nothing to test; BASE=REV looks farther back")
        return 0
    graph = imports()
    known = durations()
    choice = choose(nearest(files, graph, named_by(files)), known, arguments.seconds)
    sees = oracle_sees(files, graph)
    tell(choice, known, sees=sees, everything=arguments.list)
    tests = [each.path for each in choice.run] + ([ORACLE] if sees else [])
    return 0 if arguments.list else run(files, tests)


# What changed


def base_of(given: str) -> tuple[str, str]:
    """Return a commit to compare with, and how to call it.

    That is the commit where the branch left `main` or its upstream. On `main` itself it is HEAD if
    something is not committed, otherwise the commit before.
    """
    if given:
        return git("rev-parse", "--verify", f"{given}^{{commit}}").strip(), given
    head = git("rev-parse", "HEAD").strip()
    for name in ("main", "@{upstream}"):
        try:
            base = git("merge-base", "HEAD", name).strip()
        except subprocess.CalledProcessError:
            continue
        if base != head:
            return base, f"the branch left {name}, {base[:8]}"
    if changed_since(head):
        return head, f"HEAD, {head[:8]}"
    return git("rev-parse", "HEAD~").strip(), "the commit before HEAD"


def changed_since(base: str) -> list[str]:
    """Return the files that differ from a commit, or that git does not know yet."""
    differing = git("diff", "--name-only", "--no-renames", base).splitlines()
    new = git("ls-files", "--others", "--exclude-standard").splitlines()
    return sorted({*differing, *new})


def git(*arguments: str) -> str:
    """Return what git prints.

    Raises:
        subprocess.CalledProcessError: It failed; `stderr` has the reason.
    """
    return subprocess.run(
        ["git", "-C", str(ROOT), *arguments], check=True, capture_output=True, text=True
    ).stdout


# Which tests


def imports() -> Graph:
    """Return what each module of the checkout imports of the others."""
    everywhere = sys.path[:]
    # `tests` has no `__init__.py`, so another checkout on the path would be part of it.
    sys.path[:] = [str(ROOT), str(ROOT / "links")]
    try:
        built = grimp.build_graph(*PACKAGES, cache_dir=str(ROOT / ".import_linter_cache"))
    finally:
        sys.path[:] = everywhere
    return {module: built.find_modules_directly_imported_by(module) for module in built.modules}


def module_of(path: str) -> str:
    """Return the module of a file: `zacoustic.core.engine` for its `__init__.py`; empty: none."""
    if not path.endswith(".py"):
        return ""
    name = path.removesuffix(".py").removesuffix("/__init__").removeprefix("links/")
    return name.replace("/", ".")


def path_of(module: str) -> str:
    """Return the file of a module of tests/."""
    return module.replace(".", "/") + ".py"


def is_test(module: str) -> bool:
    """Tell whether pytest takes a module for a test file."""
    return module.startswith("tests.") and module.rpartition(".")[2].startswith("test_")


def nearest(files: Iterable[str], graph: Graph, named: Iterable[str] = ()) -> list[Near]:
    """Return the test files of changed files, nearest first.

    Args:
        files: The changed files.
        graph: The imports.
        named: Test files that name one of the changed files in their text.
    """
    files = [*files]
    importers: dict[str, set[str]] = {}
    for module, imported in graph.items():
        for each in imported:
            importers.setdefault(each, set()).add(module)
    tests = {module for module in graph if is_test(module)}
    folders = tuple(each.removesuffix(_CONFTEST) for each in files if each.endswith(_CONFTEST))
    beside = {each for each in tests if path_of(each) in named or path_of(each).startswith(folders)}
    at = dict.fromkeys(beside, 1)
    for module in map(module_of, files):
        found = around(module, importers, tests)
        if module in graph and not found and not module.startswith("tests."):
            # Links and verbs are imported by name, which the graph does not see.
            found = dict.fromkeys(of_room(module, tests), DEPTH)
            found |= dict.fromkeys(namesakes(module, tests), 1)
        at |= {each: min(steps, at.get(each, steps)) for each, steps in found.items()}
    rooms = {room for each in files for room in Path(each).parts[:-1]} - {"tests"}
    near = []
    for module, steps in at.items():
        path = path_of(module)
        is_elsewhere = rooms.isdisjoint(Path(path).parts)
        near.append(Near(steps, is_elsewhere, len(graph[module]), path))
    return sorted(near)


def around(module: str, importers: Mapping[str, set[str]], tests: set[str]) -> dict[str, int]:
    """Return the tests that import a module, and over how many imports.

    At most `DEPTH`, or as many as it takes to find one.
    """
    at = {module: 0}
    ring, distance = {module}, 0
    while ring and (distance < DEPTH or tests.isdisjoint(at)):
        distance += 1
        ring = {one for each in ring for one in importers.get(each, ())} - at.keys()
        at |= dict.fromkeys(ring, distance)
    return {each: steps for each, steps in at.items() if each in tests}


def namesakes(module: str, tests: Iterable[str]) -> set[str]:
    """Return the tests with the name of a module or of its package: `test_udp`."""
    words = {f"test_{each.removeprefix('zacoustic_')}" for each in module.split(".")[-2:]}
    return {each for each in tests if each.rpartition(".")[2] in words}


def of_room(module: str, tests: Iterable[str]) -> set[str]:
    """Return the tests in the folder of the innermost room that has one: `tests/cli`."""
    for room in reversed(module.split(".")[:-1]):
        if found := {each for each in tests if each.startswith(f"tests.{room}.")}:
            return found
    return set()


def named_by(files: Iterable[str]) -> set[str]:
    """Return the test files whose text names a changed file that is no module, or its folder.

    Pages also have the test of prose.
    """
    outside = [Path(each) for each in files if not _is_imported(each)]
    found = {PROSE} if any(each.suffix == ".md" for each in outside) else set()
    texts = {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in (ROOT / "tests").rglob("test_*.py")
        if outside
    }
    for each in outside:
        for name in (each.name, f'"{each.parent.name}"'):
            if naming := {path for path, text in texts.items() if name in text}:
                found |= naming
                if each.suffix != ".py":  # a script may also be run as one of its folder
                    break
    return found


def _is_imported(path: str) -> bool:
    return path.endswith(".py") and path.startswith(("zacoustic/", "links/", "tests/"))


def oracle_sees(files: Iterable[str], graph: Graph) -> bool:
    """Tell whether the recorded runs go through a changed module."""
    seen = {module_of(ORACLE)}
    todo = [*seen]
    while todo:
        more = {*graph.get(todo.pop(), ())} - seen
        seen |= more
        todo += more
    return any(module_of(each) in seen for each in files) or any(
        each.startswith("tests/oracle/") for each in files
    )


def choose(near: Iterable[Near], known: Mapping[str, float], most_s: float) -> Choice:
    """Choose test files until their time is full; a changed test file runs in any case.

    Args:
        near: Test files, nearest first.
        known: Durations of test files, s.
        most_s: Their sum, s.
    """
    choice, sum_s = Choice(), 0.0
    for each in near:
        if each.path == ORACLE:
            continue
        takes_s = taken_s(each, known)
        if each.distance and sum_s + takes_s > most_s:
            choice.left.append(each)
        else:
            choice.run.append(each)
            sum_s += takes_s
    return choice


def taken_s(near: Near, known: Mapping[str, float]) -> float:
    """Return the duration of a test file, s, assumed if it has not run here."""
    return known.get(near.path, LONG_S if near.path in LONG else UNKNOWN_S)


def durations() -> dict[str, float]:
    """Return the duration of each test file that has run here, s."""
    try:
        return msgspec.json.decode(DURATIONS.read_bytes(), type=dict[str, float])
    except (OSError, msgspec.DecodeError):
        return {}


def tell(
    choice: Choice, known: Mapping[str, float], *, sees: bool, everything: bool = False
) -> None:
    """Print which tests run and which do not."""

    def names(near: list[Near]) -> str:
        shown = near if everything else near[:_SHOWN]
        lines = [f"  {each.path}" for each in shown]
        if len(near) > len(shown):
            lines.append(f"  and {len(near) - len(shown)} more: make quick ARGS=--list")
        return "\n".join(lines)

    def sum_s(near: list[Near]) -> str:
        new = sum(each.path not in known for each in near)
        doubt = f", {new} of them never timed here" if new else ""
        return f"{sum(taken_s(each, known) for each in near):.0f} s in sum{doubt}"

    if choice.run:
        print(f"tests: {len(choice.run)} files, {sum_s(choice.run)}\n{names(choice.run)}")
    else:
        print(
            "tests: none " + ("fits the time" if choice.left else "imports or names what changed")
        )
    if choice.left:
        farthest = max(each.distance for each in choice.left)
        print(f"left out: {len(choice.left)} test files up to {farthest} imports away, "
              f"{sum_s(choice.left)}; make test runs them\n{names(choice.left)}")  # fmt: skip
    print("oracle: " + ("a share of its runs" if sees else "not run, no run goes through this"))


# The steps


def run(files: Iterable[str], tests: list[str]) -> int:
    """Run all steps, also after one that failed; returns the exit code."""
    began_s = time.monotonic()
    python = [sys.executable, "-m"]
    passed = {
        "ruff format --check": step("ruff format --check", [*python, "ruff", "format", "--check"]),
        "ruff check": step("ruff check", [*python, "ruff", "check"]),
    }
    slow: dict[str, list[str]] = {}
    if any(each.endswith(".py") or each == "pyproject.toml" for each in files):
        slow["mypy --strict"] = [*python, "mypy"]
    if any(each.startswith(("zacoustic/", "links/", "pyproject.toml")) for each in files):
        contracts = Path(sys.executable).with_name("lint-imports")
        slow["lint-imports"] = [str(contracts), "--no-logo"]

    def beside() -> None:
        for name, command in slow.items():
            passed[name] = step(name, command, is_quiet=True)

    other = threading.Thread(target=beside)
    other.start()
    if tests:
        options = ["-p", "tests.durations", "-n", "2", "--dist", "worksteal"]
        passed["pytest"] = step("pytest", [*python, "pytest", *options, *tests])
    other.join()
    failed = [name for name, is_ok in passed.items() if not is_ok]
    verdict = f"FAILED: {', '.join(failed)}" if failed else "every step passed"
    print(f"\nmake quick: {verdict}, {time.monotonic() - began_s:.0f} s", flush=True)
    return 1 if failed else 0


def step(name: str, command: list[str], *, is_quiet: bool = False) -> bool:
    """Run one step and tell its duration; returns whether it passed.

    Args:
        name: What it is called on the screen.
        command: What runs.
        is_quiet: Its output is shown at its end, in one piece, and only if it failed.
    """
    began_s = time.monotonic()
    if not is_quiet:
        print(f"\n== {name}", flush=True)
    ended = subprocess.run(
        command,
        check=False,
        cwd=ROOT,
        env={**os.environ, "ZACOUSTIC_SOAK": ""},
        stdout=subprocess.PIPE if is_quiet else None,
        stderr=subprocess.STDOUT if is_quiet else None,
    )
    is_ok = ended.returncode == 0 or (name == "pytest" and ended.returncode == NOTHING_RAN)
    said = ended.stdout.decode(errors="replace") if is_quiet and not is_ok else ""
    verdict = "passed" if is_ok else "FAILED"
    print(f"{said}== {name}: {verdict}, {time.monotonic() - began_s:.0f} s", flush=True)
    return is_ok


if __name__ == "__main__":
    sys.exit(main())
