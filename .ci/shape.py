"""The shape of the source: what `make shape` prints, so that a rise gets a sentence.

A room is a module or package directly below `zacoustic`, a layer of `zacoustic.core` or a link. A
ring is a set of entries of a folder, or of files, that import each other in a circle. An upward
import goes from a layer to one above it, by the layers contracts in pyproject.toml. Code lines are
lines without docstrings, comments and blanks. Counts say where to look; they are no verdict.
"""

import ast
import io
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import grimp

ROOT: Final = Path(__file__).parents[1]
PACKAGES: Final = ["zacoustic", *sorted(path.name for path in (ROOT / "links").glob("zacoustic_*"))]
PARAMETERS_MAX: Final = 7
"""A constructor with more of them lacks an object."""
LINES_MAX: Final = 40
"""A function with more code lines is to be looked at."""
ENTRIES_MAX: Final = 9
"""A folder with more entries is to be looked at."""

Graph = dict[str, set[str]]


def main() -> None:
    """Print rings, upward imports, code lines, entries, constructors and functions."""
    graph = imports()
    show_rings("entries of one folder in a ring", folder_rings(graph))
    show_rings("files in a ring", rings(graph))
    show("upward imports", list(upward(graph)))
    show("code lines by room", code_lines())
    show(f"folders with more than {ENTRIES_MAX} entries", entries())
    show(f"constructors with more than {PARAMETERS_MAX} parameters", constructors())
    show(f"functions with more than {LINES_MAX} code lines", functions())


# Imports


def imports() -> Graph:
    """Return what each module imports of these packages."""
    built = grimp.build_graph(*PACKAGES, cache_dir=None)
    return {
        module: set(built.find_modules_directly_imported_by(module)) for module in built.modules
    }


def rooms_of(graph: Graph, container: str) -> Graph:
    """Return the imports between the modules and packages directly below a container."""
    depth = container.count(".") + 2
    found: Graph = {}
    for module, imported in graph.items():
        if module.startswith(container + "."):
            room = ".".join(module.split(".")[:depth])
            found.setdefault(room, set()).update(
                ".".join(name.split(".")[:depth])
                for name in imported
                if name.startswith(container + ".")
            )
    return {room: imported - {room} for room, imported in found.items()}


def folder_rings(graph: Graph) -> list[list[str]]:
    """Return the rings between modules and packages that lie in one folder."""
    containers = {name.rpartition(".")[0] for name in graph} - {""}
    found = [ring for each in sorted(containers) for ring in rings(rooms_of(graph, each))]
    files = rings(graph)  # those are told of as files
    return [ring for ring in found if ring not in files]


def rings(graph: Graph) -> list[list[str]]:
    """Return the strongly connected components of more than one member (Tarjan)."""
    index: dict[str, int] = {}
    lowest: dict[str, int] = {}
    path: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = lowest[node] = len(index)
        path.append(node)
        for below in sorted(graph.get(node, ())):
            if below not in index:
                visit(below)
                lowest[node] = min(lowest[node], lowest[below])
            elif below in path:
                lowest[node] = min(lowest[node], index[below])
        if lowest[node] == index[node]:
            place = path.index(node)
            members = sorted(path[place:])
            del path[place:]
            if len(members) > 1:
                found.append(members)

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return sorted(found, key=len, reverse=True)


def upward(graph: Graph) -> Iterator[str]:
    """Yield the imports that go from a layer to a higher one of the same contract."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for contract in settings["tool"]["importlinter"]["contracts"]:
        for container in contract.get("containers", ()):
            floors = {
                f"{container}.{room.strip(' ()')}": floor
                for floor, layer in enumerate(reversed(contract["layers"]))
                for room in layer.replace(":", "|").split("|")
            }
            depth = container.count(".") + 2
            for module, imported in sorted(graph.items()):
                own = floors.get(".".join(module.split(".")[:depth]))
                for name in sorted(imported):
                    other = floors.get(".".join(name.split(".")[:depth]))
                    if own is not None and other is not None and other > own:
                        yield f"{module} -> {name}"


# Sources


def sources() -> Iterator[Path]:
    """Yield the files of the packages."""
    for package in PACKAGES:
        folder = ROOT / package if package == "zacoustic" else ROOT / "links" / package
        yield from sorted(folder.rglob("*.py"))


def module_of(path: Path) -> str:
    """Return the dotted name of a file."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[1:] if parts[0] == "links" else parts).removesuffix(".__init__")


def room_of(module: str) -> str:
    """Return the room that a module belongs to."""
    depth = 4 if module.startswith("zacoustic.core.") else 2
    return ".".join(module.split(".")[: depth if module.startswith("zacoustic.") else 1])


def lines_of_code(text: str) -> set[int]:
    """Return the numbers of the lines that hold code: no docstring, comment or blank."""
    held: set[int] = set()
    aside = {
        tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE,
        tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER,
    }  # fmt: skip
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in aside:
            held.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        # A string that stands alone documents what is around or above it.
        match node:
            case ast.Expr(value=ast.Constant(value=str()), end_lineno=int(last)):
                held.difference_update(range(node.lineno, last + 1))
    return held


def code_lines() -> list[str]:
    """Return the code lines of each room."""
    counted: Counter[str] = Counter()
    for path in sources():
        room = room_of(module_of(path))
        held = len(lines_of_code(path.read_text(encoding="utf-8")))
        counted[room] += held
        if room.startswith("zacoustic.core"):
            counted["zacoustic.core, all of it"] += held if room != "zacoustic.core" else 0
    return [f"{lines:6,} {room}" for room, lines in counted.most_common()]


def entries() -> list[str]:
    """Return the folders that hold more than a reader takes in at once."""
    counted = Counter(path.parent for path in sources())
    for folder in list(counted):
        if folder.parent in counted:
            counted[folder.parent] += 1
    return [
        f"{number:4} {folder.relative_to(ROOT).as_posix()}"
        for folder, number in counted.most_common()
        if number > ENTRIES_MAX
    ]


def definitions() -> Iterator[tuple[str, str, ast.FunctionDef | ast.AsyncFunctionDef, str]]:
    """Yield the module, the name and the node of every function, and its file's text."""
    for path in sources():
        text = path.read_text(encoding="utf-8")
        around: list[tuple[ast.AST, str]] = [(ast.parse(text), "")]
        while around:
            outer, prefix = around.pop()
            for node in ast.iter_child_nodes(outer):
                match node:
                    case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                        yield module_of(path), prefix + name, node, text
                        around.append((node, f"{prefix}{name}."))
                    case ast.ClassDef(name=name):
                        around.append((node, f"{prefix}{name}."))
                    case _:
                        around.append((node, prefix))


def constructors() -> list[str]:
    """Return the constructors that take more parameters than a reader remembers."""
    found = []
    for module, name, node, _ in definitions():
        taken = node.args
        number = len(taken.posonlyargs) + len(taken.args) + len(taken.kwonlyargs) - 1
        if name.endswith(".__init__") and number > PARAMETERS_MAX:
            found.append((number, f"{module}:{name.removesuffix('.__init__')}"))
    return [f"{number:4} {name}" for number, name in sorted(found, reverse=True)]


def functions() -> list[str]:
    """Return the functions that are long."""
    found = []
    held_of: dict[str, set[int]] = {}
    for module, name, node, text in definitions():
        held = held_of.setdefault(module, lines_of_code(text))
        number = len(held & set(range(node.lineno, (node.end_lineno or node.lineno) + 1)))
        if number > LINES_MAX:
            found.append((number, f"{module}:{name}"))
    return [f"{number:4} {name}" for number, name in sorted(found, reverse=True)]


# Printing


def show_rings(title: str, found: list[list[str]]) -> None:
    """Print rings, a line each."""
    show(title, [f"{len(members):4} {', '.join(members)}" for members in found])


def show(title: str, rows: list[str]) -> None:
    """Print a heading with a count, and the rows."""
    print(f"{title}: {len(rows)}")
    for row in rows:
        print(f"  {row}")
    print()


if __name__ == "__main__":
    main()
