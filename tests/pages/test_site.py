"""What the site shows besides the walks: its programs run, its API is complete, its pages short."""

import contextlib
import io
import re
from pathlib import Path
from typing import Final

import pytest

import zacoustic
from tests.pages.blocks import PAGES, ROOT, blocks_of

API: Final = ROOT / "docs" / "api"
HOWTOS: Final = sorted((ROOT / "docs" / "howto").glob("*.md"))
WORDS_MOST: Final = 600

_REFERENCE: Final = re.compile(r"^::: ([\w.]+)$", re.MULTILINE)
_NAVIGATED: Final = re.compile(r"[\w/]+\.md")


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


def test_every_public_name_is_in_the_reference() -> None:
    shown = {name for page in API.glob("*.md") for name in _REFERENCE.findall(page.read_text())}
    assert {f"zacoustic.{name}" for name in zacoustic.__all__} - shown == set()


def test_whatever_a_link_or_a_transport_imports_is_in_the_reference() -> None:
    from tests.test_public_api import LINK_AUTHORS_MODULES

    shown = {name for page in API.glob("*.md") for name in _REFERENCE.findall(page.read_text())}
    wanted = {*LINK_AUTHORS_MODULES, "zacoustic.core.transport.contract"} - {"zacoustic.errors"}
    assert wanted - shown == set()


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
