"""What holds for every file of the packages, whoever wrote it."""

import ast
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).parents[1]
LINKS: Final = sorted(path.name for path in (ROOT / "links").glob("zacoustic_*") if path.is_dir())
PACKAGES: Final = [ROOT / "zacoustic", *(ROOT / "links" / name for name in LINKS)]
SOURCES: Final = sorted(path for package in PACKAGES for path in package.rglob("*.py"))

LINES_MAX: Final = 750
"""Lines of a file; a longer one has two nouns in it. One noun is not cut by a ruler."""
REFUSED_NAMES: Final = {
    "common", "helper", "helpers", "manager", "managers", "misc", "util", "utils",
}  # fmt: skip
"""Names of modules that say nothing about what is inside."""

# Imports the core and everything in it while nothing can be imported but the standard library,
# msgspec and cbor2.
IMPORT_BARE_CORE: Final = """
import importlib, pkgutil, sys

ALLOWED = {*sys.stdlib_module_names, "zacoustic", "msgspec", "cbor2", "_cbor2"}


class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in ALLOWED:
            raise ModuleNotFoundError(f"not there in this test: {name}", name=name)


sys.meta_path.insert(0, Absent())
core = importlib.import_module("zacoustic.core")
for module in pkgutil.walk_packages(core.__path__, "zacoustic.core."):
    importlib.import_module(module.name)
print(*sorted(sys.modules))
"""


def test_imports_keep_to_the_layers() -> None:
    linter = Path(sys.executable).parent / "lint-imports"
    process = run([str(linter), "--no-logo", "--no-cache"])
    assert process.returncode == 0, process.stdout + process.stderr


def test_core_imports_with_nothing_but_msgspec_and_cbor2() -> None:
    process = run([sys.executable, "-c", IMPORT_BARE_CORE])
    assert process.returncode == 0, process.stderr
    assert "zacoustic.core.clock" in process.stdout.split()


def test_every_link_has_its_place_in_pyproject() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    linter = settings["tool"]["importlinter"]
    assert wheel == ["zacoustic", *(f"links/{name}" for name in LINKS)]
    assert linter["root_packages"] == ["zacoustic", *LINKS]
    assert [
        modules
        for contract in linter["contracts"]
        for modules in contract_modules(contract)
        if "zacoustic_sim" in modules
    ] == [LINKS] * 3


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_every_package_is_typed_and_complete(package: Path) -> None:
    directories = {path.parent for path in package.rglob("*.py")}
    missing = [
        str((directory / name).relative_to(ROOT))
        for directory in sorted(directories)
        for name in ("__init__.py", "py.typed")
        if not (directory / name).exists()
    ]
    assert missing == [], "\n".join(missing)


def test_every_module_has_a_docstring() -> None:
    assert [named(path) for path in SOURCES if ast.get_docstring(parsed(path)) is None] == []


def test_who_catches_everything_says_why_or_raises_it_again() -> None:
    silent = []
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        lines = text.splitlines()
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.ExceptHandler):
                continue
            caught = "" if node.type is None else ast.unparse(node.type)
            is_raised = any(isinstance(each, ast.Raise) for each in ast.walk(node))
            has_reason = "#" in lines[node.lineno - 1]
            if caught in ("", "Exception", "BaseException") and not (is_raised or has_reason):
                silent.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert silent == []


def test_no_file_is_too_long() -> None:
    lengths = {named(path): len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES}
    too_long = [f"{name}: {lines}" for name, lines in lengths.items() if lines > LINES_MAX]
    assert too_long == [], "\n".join(too_long)


def test_every_module_is_named_for_what_is_in_it() -> None:
    tested = [path for folder in ("tests", "examples") for path in (ROOT / folder).rglob("*.py")]
    names = {named(path): {path.stem, path.parent.name} for path in [*SOURCES, *tested]}
    assert [path for path, words in names.items() if words & REFUSED_NAMES] == []


def contract_modules(contract: dict[str, Any]) -> list[list[str]]:
    """Give the lists of a contract in which links are named."""
    return [
        contract[key]
        for key in ("source_modules", "forbidden_modules", "modules")
        if key in contract
    ]


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """Run a command on the packages of this checkout, whether they are installed or not."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "links")])
    return subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()
