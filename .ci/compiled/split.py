"""Split a module for mypyc: what stays Python goes into a twin beside it.

mypyc makes a class of its own kind from every class, except from those with a metaclass, and it
drops the keywords of these: of `class Nav(msgspec.Struct, frozen=True)` it would make a record that
can be changed. So a module with records, enums or exceptions is split in two:

========================  ==========================================================================
``records_MODULE.py``     the module as it is; its records, enums and exceptions are used by all
``MODULE.py``, compiled   everything else; it imports these classes from the twin, and gives the
                          twin its own functions and classes, so that each exists once
========================  ==========================================================================

A constant that is made by a call, such as ``NO_OVERRIDE = Override()``, may be the default of a
field, and is compared by identity elsewhere: the twin's is used by both.
"""

import ast
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec

PREFIX: Final = "records_"
_ROOTS: Final = frozenset(
    ("msgspec.Struct", "Exception", "NamedTuple", "Protocol", "TypedDict", "dict", "int", "str")
)
"""Classes whose heirs stay Python, beside those that end with Error or Enum."""


class Module(msgspec.Struct, frozen=True, eq=False):
    """A module of the tree."""

    path: Path
    """Its file."""
    name: str
    """Its dotted name."""
    source: str
    """Its text."""
    tree: ast.Module
    """The same, parsed."""

    @property
    def classes(self) -> list[ast.ClassDef]:
        """Its classes, without nested ones."""
        return [node for node in self.tree.body if isinstance(node, ast.ClassDef)]

    @property
    def imported(self) -> dict[str, set[str]]:
        """By name of what it imports, the modules that have it: two classes may share a name."""
        found: dict[str, set[str]] = {}
        for node in self.tree.body:
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                for each in node.names:
                    found.setdefault(each.name, set()).add(node.module)
        return found


def read(root: Path, paths: Iterable[Path]) -> list[Module]:
    """Return the modules in files below `root`."""
    found = []
    for path in paths:
        parts = path.relative_to(root).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        source = path.read_text(encoding="utf-8")
        found.append(Module(path, name, source, ast.parse(source)))
    return found


def split(modules: list[Module]) -> list[Path]:
    """Split modules in their place.

    Returns:
        The files to compile; a module that has nothing to compile is not among them.
    """
    kept = _kept(modules)
    found = []
    for module in modules:
        records = [each for each in module.classes if (module.name, each.name) in kept]
        rest = [
            node.name
            for node in module.tree.body
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
            and node not in records
        ]
        if not rest:
            continue
        if records:
            _split(module, records, rest)
        found.append(module.path)
    return found


def compiled_classes(modules: list[Module]) -> set[str]:
    """Return the names of the classes that will be compiled: nothing else may inherit from them."""
    kept = _kept(modules)
    return {
        each.name
        for module in modules
        for each in module.classes
        if (module.name, each.name) not in kept
    }


def _split(module: Module, records: list[ast.ClassDef], rest: list[str]) -> None:
    """Write the twin of a module, and the module without what the twin has."""
    is_package = module.path.name == "__init__.py"
    twin = module.path.with_name(f"{PREFIX}{'init' if is_package else module.path.stem}.py")
    twin.write_text(module.source, encoding="utf-8")
    package = module.name if is_package else module.name.rpartition(".")[0]
    lines = module.source.splitlines(keepends=True)

    def take(node: ast.stmt, first: int, names: list[str]) -> None:
        assert node.end_lineno is not None
        for line in range(first - 1, node.end_lineno):
            lines[line] = ""
        lines[first - 1] = "".join(
            f"from {package}.{twin.stem} import {name} as {name}\n" for name in names
        )

    for record in records:
        take(
            record, min([record.lineno, *(d.lineno for d in record.decorator_list)]), [record.name]
        )
    for node in module.tree.body:
        names = _made_by_a_call(node, rest)
        if names:
            take(node, node.lineno, names)
    lines.append(f"\nimport {package}.{twin.stem} as _twin\n")
    lines += [f"setattr(_twin, {name!r}, {name})\n" for name in rest]
    module.path.write_text("".join(lines), encoding="utf-8")


def _made_by_a_call(node: ast.stmt, rest: list[str]) -> list[str]:
    """Return the names of a constant that is made by a call to nothing that is compiled."""
    if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
        return []
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    inner = list(ast.walk(node.value))
    used = {each.id for each in inner if isinstance(each, ast.Name)}
    is_made = any(isinstance(each, ast.Call) for each in inner)
    if not is_made or used & {*rest, "TypeVar", "ParamSpec"}:
        return []
    return [each.id for each in targets if isinstance(each, ast.Name)]


def _kept(modules: list[Module]) -> set[tuple[str, str]]:
    """Return module and name of each class that stays Python."""
    places: dict[str, set[str]] = {}
    for module in modules:
        for each in module.classes:
            places.setdefault(each.name, set()).add(module.name)
    kept: set[tuple[str, str]] = set()

    def stays(module: Module, base: ast.expr) -> bool:
        name = ast.unparse(base.value if isinstance(base, ast.Subscript) else base)
        if name in _ROOTS or name.endswith(("Error", "Enum")):
            return True
        last = name.rpartition(".")[2]
        homes = places.get(last, set())
        home = {module.name, *module.imported.get(last, ())} & homes
        return any((each, last) in kept for each in home or homes)

    before = -1
    while len(kept) > before:
        before = len(kept)
        for module in modules:
            kept |= {
                (module.name, each.name)
                for each in module.classes
                if each.keywords or any(stays(module, base) for base in each.bases)
            }
    return kept
