"""What the pages look like: their width, and the order of the glossary."""

import re
from collections.abc import Iterator
from typing import Final

import pytest

from tests.pages.blocks import PAGES, ROOT

COLUMNS: Final = 100
GLOSSARY: Final = ROOT / "docs" / "glossary.md"

_FENCE: Final = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
_TARGET: Final = re.compile(r"\]\([^)]*\)")
_ANCHOR: Final = re.compile(r"\]\((?!http)([^)#]*)#([^)]+)\)")
_URL: Final = re.compile(r"https?://\S+")
_TERM: Final = re.compile(r"^\*\*(.+?)\*\*", re.MULTILINE)
_SOURCE: Final = re.compile(r"\s\*[^*]+\*$")
_RETIRED: Final = "## Words that are no longer used"


def prose_lines(text: str) -> Iterator[tuple[int, str]]:
    """Number and text of each line outside of code blocks, targets of links left out."""
    blank = _FENCE.sub(lambda found: "\n" * found[0].count("\n"), text)
    for number, line in enumerate(blank.splitlines(), start=1):
        yield number, _URL.sub("", _TARGET.sub("]()", line))


@pytest.mark.parametrize("page", [*PAGES, "CHANGELOG.md", "examples/auv/README.md"])
def test_a_page_keeps_to_its_columns(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    wide = [number for number, line in prose_lines(text) if len(line) > COLUMNS]
    assert wide == [], f"lines of {page} are longer than {COLUMNS} columns"


@pytest.mark.parametrize("page", PAGES)
def test_a_link_into_a_page_finds_its_heading(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    absent = []
    for target, anchor in _ANCHOR.findall(_FENCE.sub("", text)):
        path = (ROOT / page).parent / target if target else ROOT / page
        if anchor not in anchors(path.read_text(encoding="utf-8")):
            absent.append(f"{target}#{anchor}")
    assert absent == []


def anchors(text: str) -> set[str]:
    """The anchors that a page's headings have on the usual viewers."""
    headings = re.findall(r"^#+ (.+)$", _FENCE.sub("", text), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.replace(" ", "-") for heading in plain}


def test_lines_of_code_and_targets_of_links_may_be_wide() -> None:
    wide = "x" * (COLUMNS + 1)
    text = f"a [link]({wide})\n```sh\n{wide}\n```\n{wide}\n"
    assert [number for number, line in prose_lines(text) if len(line) > COLUMNS] == [5]


def test_terms_of_the_glossary_stand_once_and_in_order() -> None:
    terms = _TERM.findall(GLOSSARY.read_text(encoding="utf-8").partition(_RETIRED)[0])
    keys = [term.casefold() for term in terms]
    assert len(keys) > 50
    assert keys == sorted(set(keys))


def test_every_term_of_the_glossary_names_its_source() -> None:
    terms = GLOSSARY.read_text(encoding="utf-8").partition(_RETIRED)[0].split("\n\n")
    without = [each for each in terms if each.startswith("**") and not _SOURCE.search(each)]
    assert without == []


def test_a_retired_word_has_one_row_and_is_no_term() -> None:
    text = GLOSSARY.read_text(encoding="utf-8")
    terms = {term.casefold() for term in _TERM.findall(text)}
    rows = re.findall(r"^\| ([^|`-][^|]*?) \|", text.partition(_RETIRED)[2], re.MULTILINE)
    words = [word.strip() for row in rows[1:] for word in row.split(",")]
    assert len(words) == len(set(words)) > 20
    assert not terms & set(words)
