"""Annexes A to C of docs/wire.md: the engine makes their vectors, and the page has them."""

import json
import re
from typing import Any

import pytest

from tests.golden.arithmetic import VECTORS, text
from tests.golden.test_wire import WIRE_PAGE

FILE: dict[str, Any] = json.loads(VECTORS.read_text(encoding="utf-8"))
PAGE = WIRE_PAGE.read_text(encoding="utf-8")
ANNEXES = {letter: PAGE.partition(f"\n## Annex {letter}. ")[2] for letter in "ABC"}
_SYMBOL = re.compile(r"^ .+?(\d+)  ([0-9a-f]{12}) +(\d+)$", re.MULTILINE)


def test_file_is_written_as_the_script_writes_it() -> None:
    """The script gives each refused block to the engine, and stops if that reads it."""
    assert VECTORS.read_text(encoding="utf-8") == text()


@pytest.mark.parametrize(
    ("annex", "examples"), [("B", [FILE["text"]]), ("C", FILE["dense"]["blocks"][:2])]
)
def test_examples_of_the_page_are_those_of_the_file(
    annex: str, examples: list[dict[str, Any]]
) -> None:
    symbols = [symbol for example in examples for symbol in example["steps"]]
    own = ANNEXES[annex].partition("\n## Annex")[0]
    assert _SYMBOL.findall(own) == [
        (str(value), width, str(count)) for _, _, value, width, count in symbols
    ]
    assert [example["block"] in own for example in examples] == [True] * len(examples)


def test_digests_on_the_page_are_those_of_the_file() -> None:
    assert FILE["digests"]["lists of the curves"] in ANNEXES["A"]
    block = FILE["dense"]["blocks"][0]
    assert f"`{block['digest']}`" in ANNEXES["C"]
    assert f"mark `{block['mark']}`" in ANNEXES["C"]
