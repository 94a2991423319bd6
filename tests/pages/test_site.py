"""What the site shows besides the walks: its programs run, its API is complete, its pages short."""

import ast
import contextlib
import importlib.util
import io
import re
from pathlib import Path
from types import ModuleType
from typing import Final

import pytest

import zacoustic
from tests.pages.blocks import PAGES, ROOT, blocks_of
from tests.test_public_api import LINK_AUTHORS_MODULES, public_modules

API: Final = ROOT / "docs" / "api"
HOWTOS: Final = sorted((ROOT / "docs" / "howto").glob("*.md"))
DEEPER: Final = {"08_ros2.py", "expedition.py", "rosspeech.py", "virtual.py"}
"""They speak as rmw_zenoh does, start processes as `run demo` does, drive engines by hand."""
EXAMPLES: Final = sorted(
    path
    for folder in (ROOT / "examples", ROOT / "examples" / "auv")
    for path in folder.glob("*.py")
    if path.name not in DEEPER
)
WORDS_MOST: Final = 600

_REFERENCE: Final = re.compile(r"^::: ([\w.]+)$", re.MULTILINE)
_NAVIGATED: Final = re.compile(r"[\w/-]+\.md")


def programs() -> list[object]:
    """Every block of Python that is whole, by page."""
    return [
        pytest.param(page, block.text, id=f"{page.removesuffix('.md')}-{number}")
        for page in PAGES
        if page.startswith(("docs/api/", "docs/howto/"))
        for number, block in enumerate(blocks_of(page))
        if block.language == "python"
    ]


@pytest.mark.parametrize(("page", "text"), programs())
def test_a_program_of_the_site_runs(page: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "snippet.py"
    for block in blocks_of(page):
        if block.name is not None:
            (tmp_path / block.name).write_text(block.text, encoding="utf-8")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.chdir(tmp_path):
        exec(compile(text, str(path), "exec"), {"__name__": "__main__"})


def reference() -> set[str]:
    """What the reference shows: names, and modules with all that they list."""
    return {name for page in API.glob("*.md") for name in _REFERENCE.findall(page.read_text())}


def test_every_public_name_is_in_the_reference() -> None:
    """A name that two modules list stands there once."""
    shown = [importlib.import_module(each) for each in reference() if is_module(each)]
    objects = {id(getattr(module, name)) for module in shown for name in names_of(module)}
    objects |= {id(getattr(zacoustic, name)) for name in zacoustic.__all__}
    absent = [
        f"{module}.{name}"
        for module, names in public_modules().items()
        for name in names
        if f"{module}.{name}" not in reference()
        if id(getattr(importlib.import_module(module), name)) not in objects
    ]
    assert absent == []
    assert {f"zacoustic.{name}" for name in zacoustic.__all__} - reference() == set()


def is_module(name: str) -> bool:
    return importlib.util.find_spec(name) is not None


def names_of(module: ModuleType) -> list[str]:
    return list(getattr(module, "__all__", [name for name in vars(module) if name[0] != "_"]))


def test_whatever_a_link_or_a_transport_imports_is_in_the_reference() -> None:
    wanted = {*LINK_AUTHORS_MODULES, "zacoustic.core.transport.contract"} - {"zacoustic.errors"}
    assert wanted - reference() == set()


@pytest.mark.parametrize("page", PAGES)
def test_a_program_of_a_page_needs_nothing_that_the_reference_lacks(page: str) -> None:
    programs = [block.text for block in blocks_of(page) if block.language == "python"]
    assert sorted(set().union(*map(unshown, programs))) == []


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_an_example_needs_nothing_that_the_reference_lacks(path: Path) -> None:
    """A link, a transport, a console, tests: nothing private is needed for them."""
    assert sorted(unshown(path.read_text(encoding="utf-8"))) == []


def unshown(program: str) -> set[str]:
    """What a program imports of ours and the reference does not show."""
    shown = reference()
    found = set()
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.ImportFrom) and is_ours(node.module or ""):
            names = {f"{node.module}.{each.name}" for each in node.names}
            is_shown = node.module in {"zacoustic", "zacoustic.errors"} | shown
            found |= set() if is_shown else names - shown
        elif isinstance(node, ast.Import):
            found |= {each.name for each in node.names if is_ours(each.name)} - shown
    return found - {"zacoustic"}


def is_ours(module: str) -> bool:
    """Whether it is of the project, and not the reader's own link of docs/links.md."""
    packages = {"zacoustic", *(path.name for path in (ROOT / "links").glob("zacoustic_*"))}
    return module.partition(".")[0] in packages


@pytest.mark.parametrize("page", HOWTOS, ids=lambda page: page.stem)
def test_a_how_to_is_short_and_shows_what_a_test_runs(page: Path) -> None:
    assert len(page.read_text(encoding="utf-8").split()) <= WORDS_MOST
    if page.stem != "index":
        languages = {block.language for block in blocks_of(str(page.relative_to(ROOT)))}
        assert languages & {"python", "sh"}


def test_every_page_is_in_the_navigation_once() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    named = sorted(f"docs/{name}" for name in _NAVIGATED.findall(text))
    assert named == sorted({*PAGES} - {"README.md"})
