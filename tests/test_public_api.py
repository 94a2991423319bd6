"""The names that users build on change on purpose only, and each says what it is.

Public is what a module lists in `__all__`, and all of the modules that a link written by somebody
else imports. The snapshot is `golden/public_api.txt`; after a change that is meant::

    python tests/test_public_api.py

writes it anew. A name that disappears from it is a change that breaks somebody's program.
"""

import ast
import importlib
from functools import cache
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[1]
SNAPSHOT: Final = ROOT / "tests" / "golden" / "public_api.txt"
LINK_AUTHORS_MODULES: Final = (
    "zacoustic.bytestream",
    "zacoustic.command",
    "zacoustic.core.clock",
    "zacoustic.core.linktypes",
    "zacoustic.errors",
    "zacoustic.json5",
    "zacoustic.link",
)
"""Public as a whole, with or without `__all__`."""

Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def test_public_names_are_those_of_the_snapshot() -> None:
    if not SNAPSHOT.exists():
        pytest.skip(f"no {SNAPSHOT.name} yet: python tests/test_public_api.py")
    recorded = set(SNAPSHOT.read_text(encoding="utf-8").split())
    assert set(public_names()) == recorded, "meant? then: python tests/test_public_api.py"


def test_every_public_name_exists() -> None:
    absent = [
        f"{module}.{name}"
        for module, names in public_modules().items()
        for name in names
        if not hasattr(importlib.import_module(module), name)
    ]
    assert absent == [], "\n".join(absent)


def test_every_public_name_says_what_it_is() -> None:
    silent = [
        f"{module}.{name}"
        for module, names in public_modules().items()
        for name in names
        if not is_explained(module, name)
    ]
    assert silent == [], "\n".join(silent)


def public_names() -> list[str]:
    return sorted(
        f"{module}.{name}" for module, names in public_modules().items() for name in names
    )


@cache
def public_modules() -> dict[str, tuple[str, ...]]:
    """Give the public names of every module that has any."""
    paths = [*(ROOT / "zacoustic").rglob("*.py"), *(ROOT / "links").rglob("*.py")]
    names: dict[str, tuple[str, ...]] = {}
    for path in sorted(paths):
        module = module_of(path)
        listed = listed_names(module)
        if listed is not None:
            names[module] = listed
        elif module in LINK_AUTHORS_MODULES:
            names[module] = tuple(name for name in definitions(module) if name[0] != "_")
    return names


def listed_names(module: str) -> tuple[str, ...] | None:
    """Give `__all__`, None when there is none; it must be a literal, as type checkers want it."""
    for statement in tree(module).body:
        if "__all__" in assigned_names(statement):
            assert isinstance(statement, ast.Assign | ast.AnnAssign)
            assert statement.value is not None
            return tuple(ast.literal_eval(statement.value))
    return None


def is_explained(module: str, name: str) -> bool:
    """Tell whether a definition has a docstring; a value may have a comment instead."""
    statement = definitions(module).get(name)
    if isinstance(statement, Definition):
        return ast.get_docstring(statement) is not None
    if statement is not None:
        return has_text(module, statement)
    origin = imported_names(module).get(name)
    if origin is None:  # a submodule
        return is_module(f"{module}.{name}") and is_explained_module(f"{module}.{name}")
    source, original = origin
    if is_module(f"{source}.{original}"):
        return is_explained_module(f"{source}.{original}")
    return not is_module(source) or is_explained(source, original)


def is_explained_module(module: str) -> bool:
    return ast.get_docstring(tree(module)) is not None


def has_text(module: str, statement: ast.stmt) -> bool:
    lines = path_of(module).read_text(encoding="utf-8").splitlines()
    following = (lines[statement.end_lineno :] if statement.end_lineno else []) or [""]
    comment_above = lines[statement.lineno - 2].lstrip().startswith("#")
    comment_behind = "  # " in lines[statement.lineno - 1]
    return following[0].startswith(('"""', "#:")) or comment_above or comment_behind


@cache
def definitions(module: str) -> dict[str, ast.stmt]:
    """Give what a module defines on its top level, by name."""
    found: dict[str, ast.stmt] = {}
    for statement in tree(module).body:
        names = [statement.name] if isinstance(statement, Definition) else assigned_names(statement)
        found.update(dict.fromkeys(names, statement))
    return found


def assigned_names(statement: ast.stmt) -> list[str]:
    targets: list[ast.expr] = []
    if isinstance(statement, ast.Assign):
        targets = statement.targets
    elif isinstance(statement, ast.AnnAssign):
        targets = [statement.target]
    return [target.id for target in targets if isinstance(target, ast.Name)]


@cache
def imported_names(module: str) -> dict[str, tuple[str, str]]:
    """Give where each imported name comes from: its module, and its name there."""
    return {
        alias.asname or alias.name: (node.module, alias.name)
        for node in ast.walk(tree(module))
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }


@cache
def tree(module: str) -> ast.Module:
    return ast.parse(path_of(module).read_text(encoding="utf-8"))


def module_of(path: Path) -> str:
    root = ROOT / "links" if (ROOT / "links") in path.parents else ROOT
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def path_of(module: str) -> Path:
    root = ROOT / "links" if module.startswith("zacoustic_") else ROOT
    path = root.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def is_module(module: str) -> bool:
    return module.startswith("zacoustic") and path_of(module).is_file()


if __name__ == "__main__":
    SNAPSHOT.parent.mkdir(exist_ok=True)
    SNAPSHOT.write_text("\n".join(public_names()) + "\n", encoding="utf-8")
    print(f"{len(public_names())} public names in {SNAPSHOT.relative_to(ROOT)}")
