"""Leaves out of the wheel what nobody reads there: docstrings and comments of internal modules.

A third of the wheel would be prose about the inside, which belongs to the repository. What a user
can ask for stays: the docstrings of modules that list or define public names (`__all__`), and of
the rooms named below, but for their private parts. Lines keep their numbers, so a traceback leads
to the right place of the repository. The source distribution and an editable install have
everything.
"""

import ast
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any, Final

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

KEPT: Final = (
    "zacoustic/app/cli/", "zacoustic/config/", "zacoustic/core/relay/relay.py",
    "zacoustic/core/streams/", "zacoustic/link/", "zacoustic/ros/",
)  # fmt: skip
"""Rooms whose docstrings programs show: the help, the reference of keys, the contract of links."""

Span = tuple[int, int, int, int]
"""First line, column in it, last line, column behind; columns in characters."""


class LeanHook(BuildHookInterface[Any]):
    """Puts leaner copies of the modules into the wheel."""

    PLUGIN_NAME = "lean"
    _copies: "TemporaryDirectory[str] | None" = None
    """Where the copies are; made for a wheel only, gone at the latest with the process."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Replace files of the wheel; an editable install has none."""
        if version != "standard":
            return
        self._copies = TemporaryDirectory(prefix="lean-")
        root, copies = Path(self.root), Path(self._copies.name)
        included = build_data["force_include"]
        places: dict[str, Path] = {}
        for package in self.build_config.packages:
            folder = root / package
            for path in sorted(folder.rglob("*.py")):
                places[path.relative_to(folder.parent).as_posix()] = path
        sources = {place: path.read_text(encoding="utf-8") for place, path in places.items()}
        explained = explained_modules(sources)
        for place, source in sources.items():
            copy = copies / place
            copy.parent.mkdir(parents=True, exist_ok=True)
            keeps = place in explained or place.startswith(KEPT)
            copy.write_text(lean(source, keeps=keeps), encoding="utf-8", newline="\n")
            included[str(copy)] = place

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the copies."""
        if self._copies is not None:
            self._copies.cleanup()


def explained_modules(sources: dict[str, str]) -> set[str]:
    """Return the files that list public names, and those where these are defined."""
    found: set[str] = set()
    for place, source in sources.items():
        tree = ast.parse(source)
        public = {
            str(name.value)
            for node in tree.body
            if isinstance(node, ast.Assign | ast.AnnAssign) and _assigns_all(node)
            for name in ast.walk(node)
            if isinstance(name, ast.Constant)
        }
        if public:
            found |= {place} | _defining(tree, public, place)
    return found & {*sources}


def lean(source: str, *, keeps: bool = False) -> str:
    """Return a module without its docstrings and lines of comments; the lines keep their numbers.

    Args:
        source: The module.
        keeps: Only private functions and classes lose their docstrings.
    """
    lines, tree = source.splitlines(keepends=True), ast.parse(source)
    if not keeps:
        for number in _comments(lines, tree):
            lines[number] = "\n"
    for span, filler in sorted(_strings(tree, lines, private=keeps), reverse=True):
        first, column, last, behind = span
        blank = ["\n"] * (last - first)
        head, tail = lines[first - 1][:column] + filler, lines[last - 1][behind:]
        if not head.strip() and not tail.strip():
            lines[first - 1 : last] = ["\n", *blank]
        else:
            lines[first - 1 : last] = [head + tail, *blank]
    return "".join(lines)


# Below the functions above


def _assigns_all(node: ast.Assign | ast.AnnAssign) -> bool:
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    return any(isinstance(each, ast.Name) and each.id == "__all__" for each in targets)


def _defining(tree: ast.Module, public: set[str], place: str) -> set[str]:
    """Return the files from which a module imports public names."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            if public & {each.asname or each.name for each in node.names}:
                file = PurePosixPath(*node.module.split("."))
                found |= {f"{file}.py", f"{file}/__init__.py"}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and "." in node.value:
            # Names that are imported when somebody asks for them: a table of name and module.
            file = PurePosixPath(*node.value.split("."))
            found |= {f"{file}.py", f"{file}/__init__.py"}
    return found


def _comments(lines: list[str], tree: ast.Module) -> Iterator[int]:
    """Yield the indices of lines that are a comment: a sign of number within a text is none."""
    texts = {
        number
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant | ast.JoinedStr) and node.end_lineno
        for number in range(node.lineno, node.end_lineno)
    }
    for index, line in enumerate(lines):
        if line.lstrip().startswith("#") and index not in texts:
            yield index


def _strings(tree: ast.Module, lines: list[str], *, private: bool) -> Iterator[tuple[Span, str]]:
    """Yield the statements that are only a text, and what a body needs in their place."""
    for node in _private_parts(tree) if private else ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        texts = [each for each in body if _is_text(each)]
        for each in texts:
            last = each.end_lineno or each.lineno
            start = len(lines[each.lineno - 1].encode()[: each.col_offset].decode())
            behind = len(lines[last - 1].encode()[: each.end_col_offset].decode())
            is_all = len(texts) == len(body) and each is body[0] and node is not tree
            yield (each.lineno, start, last, behind), "..." if is_all else ""


def _private_parts(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield private functions and classes, and all that is in them."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        name = getattr(node, "name", None) or ""
        if name.startswith("_") and not name.endswith("__"):
            yield from ast.walk(node)
        else:
            waiting += ast.iter_child_nodes(node)


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
