"""What the pages look like: their width, and the order of the glossary."""

import re
from collections.abc import Iterator
from typing import Final

import pytest

from tests.pages.blocks import PAGES, ROOT

COLUMNS: Final = 100
ORDINARY: Final = {
    *("exchange", "gate", "kept", "lives", "news", "orders", "places", "post", "standing"),
    *("demand", "desk", "letters", "stories", "tally", "telling", "water", "wishes"),
}
"""Retired names that are also words of everyday English."""
OTHERS: Final = ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "examples/auv/README.md")
GLOSSARY: Final = ROOT / "docs" / "glossary.md"

_FENCE: Final = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
_TARGET: Final = re.compile(r"\]\([^)]*\)")
_ANCHOR: Final = re.compile(r"\]\((?!http)([^)#]*)#([^)]+)\)")
_URL: Final = re.compile(r"https?://\S+")
_CODE: Final = re.compile(r"`[^`]*`")
_TERM: Final = re.compile(r"^\*\*(.+?)\*\*", re.MULTILINE)
_SOURCE: Final = re.compile(r"\s\*[^*]+\*$")
_RETIRED: Final = "## Words that are no longer used"


def prose_lines(text: str) -> Iterator[tuple[int, str]]:
    """Number and text of each line outside of code blocks, targets of links left out."""
    blank = _FENCE.sub(lambda found: "\n" * found[0].count("\n"), text)
    for number, line in enumerate(blank.splitlines(), start=1):
        yield number, _URL.sub("", _TARGET.sub("]()", line))


@pytest.mark.parametrize("page", [*PAGES, *OTHERS])
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
    terms = {term.casefold() for term in _TERM.findall(GLOSSARY.read_text(encoding="utf-8"))}
    assert len(retired_words()) > 20
    assert terms & retired_words() == {"exchange"}  # retired for another thing only
    assert retired_words() >= ORDINARY


@pytest.mark.parametrize("page", sorted({*PAGES} - {"docs/glossary.md"}))
def test_a_page_does_without_retired_words(page: str) -> None:
    """Identifiers, which stand in code font, may still have them."""
    word = re.compile(rf"\b({'|'.join(map(re.escape, retired_words() - ORDINARY))})\b")
    found = {
        number: word.findall(_CODE.sub("", line))
        for number, line in prose_lines((ROOT / page).read_text(encoding="utf-8"))
    }
    assert {number: words for number, words in found.items() if words} == {}


def retired_words() -> set[str]:
    """The words of the glossary's appendix, without the remarks behind them."""
    table = GLOSSARY.read_text(encoding="utf-8").partition(_RETIRED)[2]
    rows = re.findall(r"^\| ([^|`-][^|]*?) \|", table, re.MULTILINE)[1:]
    return {re.sub(r" \(.*", "", word.strip()) for row in rows for word in row.split(",")}
