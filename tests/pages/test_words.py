"""Words that the glossary retires stay out of identifiers."""

import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

from tests.pages.blocks import ROOT

GONE: Final = frozenset(
    {
        *("vouch", "hall", "errand", "onlooker", "sibling", "sounding", "chronicle", "doorbell"),
        *("complaint", "tuning", "obey", "audience", "island", "telling", "tally", "witness"),
        *("desk", "storie", "water"),
    }
)
"""Words of the glossary's appendix that no identifier has any more, in the singular."""
WET: Final = ("zacoustic/channel/", "tests/channel/", "examples/auv/", "tests/auv/", "bench_dive")
"""Where water is water: what sound and vehicles go through."""
ROOMS: Final = ("zacoustic", "links", "examples", "tests")

_PART: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def parts_of(identifier: str) -> set[str]:
    """Return the words that an identifier is made of, small."""
    return {part.lower() for part in _PART.findall(identifier)}


def identifiers(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and name of each identifier of a module that may have a retired word."""
    text = path.read_text(encoding="utf-8").lower()
    if not any(gone in text for gone in GONE):
        return  # most modules; to take one apart is slow
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type == tokenize.NAME:
                yield token.start[0], token.string


@cache
def retired_in(identifier: str) -> set[str]:
    """Return the retired words in an identifier."""
    words = parts_of(identifier)
    return {gone for gone in GONE if words & {gone, f"{gone}s", f"{gone}ed", f"{gone}es"}}


def test_no_identifier_has_a_retired_word() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for room in ROOMS
        for path in sorted((ROOT / room).rglob("*.py"))
        for line, name in [(1, path.stem), *identifiers(path)]
        if retired_in(name) - ({"water"} if any(wet in str(path) for wet in WET) else set())
    ]
    assert found == []


def test_retired_words_are_found_in_any_form() -> None:
    assert retired_in("GoalHall") == {"hall"}
    assert retired_in("_is_vouched") == {"vouch"}
    assert retired_in("doorbells") == {"doorbell"}
    assert not retired_in("shallow_fetchall")


def test_what_is_gone_stands_in_the_glossary() -> None:
    retired = (
        (ROOT / "docs" / "glossary.md")
        .read_text(encoding="utf-8")
        .partition("## Words that are no longer used")[2]
    )
    assert all(re.search(rf"^\| .*{word}", retired, re.MULTILINE) for word in GONE)
