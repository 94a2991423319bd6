"""The split of a module for the compiled wheel leaves one of each class, function and constant."""

import ast
import importlib
import importlib.util
import random
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.tap import PARTS
from zacoustic.core.streams.table import StreamTable

ROOT = Path(__file__).parents[1]
SPLIT = ROOT / ".ci" / "compiled" / "split.py"
BUILD = ROOT / ".ci" / "compiled" / "build.py"
MODULE = '''
"""A module."""

import enum

import msgspec


class Kind(enum.Enum):
    ONE = 1


class Rule(msgspec.Struct, frozen=True, kw_only=True):
    kind: Kind = Kind.ONE

    def keeper(self) -> "Keeper":
        return Keeper(double(2))


NO_RULE = Rule()
LIMITS = (1, 2)


class Named(msgspec.Struct, frozen=True):
    rule: Rule = NO_RULE


class Keeper:
    def __init__(self, count: int) -> None:
        self.count = count


class Heir(Keeper):
    pass


def double(count: int) -> int:
    return 2 * count
'''
USER = """
from splitted.rules import Keeper, Rule


class Stricter(Rule, frozen=True, kw_only=True):
    more: int = 1


class Closer(Keeper):
    pass


def make() -> Keeper:
    return Stricter().keeper()
"""
NAMESAKE = """
import msgspec


class Keeper(msgspec.Struct):
    count: int = 0
"""


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"compiled_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def splitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """The names of the files to compile, of a package that can be imported."""
    package = tmp_path / "splitted"
    package.mkdir()
    sources = {"__init__": "", "rules": MODULE, "user": USER, "records": "X = 1\n"}
    sources["other"] = NAMESAKE
    for name, source in sources.items():
        (package / f"{name}.py").write_text(source, encoding="utf-8")
    split = load(SPLIT)
    compiled = split.split(split.read(tmp_path, sorted(package.glob("*.py"))))
    monkeypatch.syspath_prepend(str(tmp_path))
    yield [path.name for path in compiled]
    for name in [each for each in sys.modules if each.startswith("splitted")]:
        del sys.modules[name]


def test_what_has_nothing_to_compile_stays_as_it_is(splitted: list[str]) -> None:
    assert splitted == ["rules.py", "user.py"]


def test_records_and_enums_come_from_the_twin_and_all_else_exists_once(
    splitted: list[str],
) -> None:
    rules, twin = (importlib.import_module(f"splitted.{each}") for each in
                   ("rules", "records_rules"))  # fmt: skip
    for name in ("Kind", "Rule", "Named", "NO_RULE", "Keeper", "Heir", "double"):
        assert getattr(rules, name) is getattr(twin, name), name
    assert [rules.Rule.__module__, rules.Keeper.__module__] == [twin.__name__, rules.__name__]
    assert rules.Named().rule is rules.NO_RULE
    assert isinstance(rules.Rule().keeper(), rules.Keeper)


def test_heirs_of_records_in_other_modules_stay_records(splitted: list[str]) -> None:
    user = importlib.import_module("splitted.user")
    assert user.Stricter.__module__ == "splitted.records_user"
    assert user.make().count == 4
    with pytest.raises(AttributeError, match="immutable"):
        user.Stricter().more = 2


def test_class_of_the_same_name_in_another_module_is_another_one(splitted: list[str]) -> None:
    user = importlib.import_module("splitted.user")
    assert user.Closer.__module__ == "splitted.user"


def test_rooms_and_plain_files_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SPLIT.parent))
    build = load(BUILD)
    assert all((ROOT / each).exists() for each in (*build.ROOMS, *build.PLAIN))


def test_nothing_that_stays_plain_inherits_from_what_is_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(str(SPLIT.parent))
    build, split = load(BUILD), load(SPLIT)
    modules = build.modules_in(ROOT)
    compiled = split.compiled_classes(modules)
    inside = {each.path for each in modules}
    places = [ROOT / each for each in ("zacoustic", "links", "examples", "tests")]
    outside = {path for place in places for path in place.rglob("*.py")} - inside
    found = [
        f"{path.relative_to(ROOT)}: {name} inherits from {base}"
        for path in sorted(outside)
        for name, base in bases_in(path)
        if base in compiled
    ]
    assert found == []


def bases_in(path: Path) -> Iterator[tuple[str, str]]:
    """Name and base of each class that inherits from a class of another file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    own = {each.name for each in classes}
    for each in classes:
        for base in each.bases:
            text = ast.unparse(base.value if isinstance(base, ast.Subscript) else base)
            name = text.rpartition(".")[2]
            if name not in own:
                yield each.name, name


def test_parts_of_an_engine_are_what_a_tap_takes_them_for() -> None:
    engine = Engine(address=1, table=StreamTable([]), epoch=1, rng=random.Random(1))
    found = {name: type(getattr(engine, name)) for name in PARTS if name}
    assert {"": Engine, **found} == PARTS


def test_what_a_tap_may_replace_stays_plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SPLIT.parent))
    compiled = load(SPLIT).compiled_classes(load(BUILD).modules_in(ROOT))
    tapped = {each.__name__ for each in PARTS.values()}
    assert len(tapped) > 5
    assert not tapped & compiled


def test_no_property_takes_the_place_of_an_attribute() -> None:
    """A compiled class reads the attribute of its base there, which nothing has set."""
    classes = dict(_classes_of("zacoustic/core")) | dict(_classes_of("zacoustic/channel"))
    assert len(classes) > 300
    mistaken = [
        f"{name}.{each}: {base}"
        for name, (_, bases, properties) in classes.items()
        for base in _ancestors(bases, classes)
        for each in properties & classes[base][0]
    ]
    assert mistaken == []


def test_no_slice_is_a_value() -> None:
    """Compiled code takes whatever stands between the brackets of bytes for an index."""
    files = [*(ROOT / "zacoustic/core").rglob("*.py"), *(ROOT / "zacoustic/channel").rglob("*.py")]
    assert len(files) > 200
    made = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in files
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Name) and node.id == "slice"
    ]
    assert made == []


def _classes_of(room: str) -> Iterator[tuple[str, tuple[set[str], list[str], set[str]]]]:
    """Yield the attributes, bases and properties of each class below a room."""
    for file in (ROOT / room).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ClassDef):
                continue
            attributes = {
                target.attr
                for each in ast.walk(node)
                if isinstance(each, ast.Assign | ast.AnnAssign)
                for target in (each.targets if isinstance(each, ast.Assign) else [each.target])
                if isinstance(target, ast.Attribute)
            }
            for each in node.body:
                if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name):
                    attributes.add(each.target.id)
                elif isinstance(each, ast.Assign):
                    attributes |= {to.id for to in each.targets if isinstance(to, ast.Name)}
            bases = [each.id for each in node.bases if isinstance(each, ast.Name)]
            properties = {
                each.name
                for each in node.body
                if isinstance(each, ast.FunctionDef)
                and any(isinstance(d, ast.Name) and d.id == "property" for d in each.decorator_list)
            }
            yield node.name, (attributes, bases, properties)


def _ancestors(
    bases: list[str], classes: dict[str, tuple[set[str], list[str], set[str]]]
) -> set[str]:
    found: set[str] = set()
    for base in bases:
        if base in classes and base not in found:
            found |= {base} | _ancestors(classes[base][1], classes)
    return found


def test_the_compiler_meets_nothing_that_it_refuses_after_ten_minutes() -> None:
    """It takes no lambda as a default, and no tuple of names before a sign in a class."""
    files = [*(ROOT / "zacoustic/core").rglob("*.py"), *(ROOT / "zacoustic/channel").rglob("*.py")]
    found = [
        f"{file.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"
        for file in files
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if _is_refused(node)
    ]
    assert found == []


def _is_refused(node: ast.AST) -> bool:
    if isinstance(node, ast.FunctionDef):
        defaults = (*node.args.defaults, *node.args.kw_defaults)
        return any(isinstance(each, ast.Lambda) for each in defaults)
    if isinstance(node, ast.ClassDef):
        assigned = [
            target for each in node.body if isinstance(each, ast.Assign) for target in each.targets
        ]
        return any(isinstance(each, ast.Tuple) for each in assigned)
    return False
