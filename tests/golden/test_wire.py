"""The wire vectors: what the engines make today is what docs/wire.md promises."""

import re
from pathlib import Path

import msgspec
import pytest

from tests.golden.vectors import VECTORS, Vector, text, vectors
from zacoustic.core.values.encoding import ENCODINGS

WIRE_PAGE = Path(__file__).parents[2] / "docs" / "wire.md"
PROMISED = {
    each.name: each for each in msgspec.json.decode(VECTORS.read_bytes(), type=list[Vector])
}
MADE = {each.name: each for each in vectors()}


@pytest.mark.parametrize("name", sorted(PROMISED))
def test_vector_is_made_as_promised(name: str) -> None:
    assert MADE[name] == PROMISED[name]


def test_every_vector_is_promised() -> None:
    assert set(MADE) == set(PROMISED)


def test_file_is_written_as_the_script_writes_it() -> None:
    assert VECTORS.read_text(encoding="utf-8") == text(MADE.values())


def test_every_vector_says_what_is_in_it() -> None:
    assert [each.name for each in MADE.values() if not each.fields or not each.table] == []


def test_vectors_on_the_wire_page_are_those_of_the_file() -> None:
    shown = re.findall(r"^(\w+)\n    ([0-9a-f]+)\n    (.+)$", page_section(14), re.MULTILINE)
    assert len(shown) > 25
    assert shown == [(name, PROMISED[name].hex, PROMISED[name].meaning) for name, *_ in shown]


def test_every_file_of_vectors_is_on_the_wire_page() -> None:
    shown = set(re.findall(r"`(\w+\.json)`", page_section(14)))
    assert shown == {path.name for path in VECTORS.parent.glob("*.json")}
    shown = set(re.findall(r"`(\w+)`", page_section(14).partition("| conversation |")[2]))
    assert shown >= {path.stem for path in VECTORS.parent.glob("conversations/*.json")}


def page_section(number: int) -> str:
    text = WIRE_PAGE.read_text(encoding="utf-8")
    return text.partition(f"\n## {number}. ")[2].partition(f"\n## {number + 1}. ")[0]


def test_opaque_sample_costs_one_byte_beside_its_payload() -> None:
    assert bytes.fromhex(PROMISED["sample_opaque"].hex) == b"\x0b" + b"hello"


def test_list_of_encodings_is_on_the_wire_page_in_its_order() -> None:
    page = WIRE_PAGE.read_text()
    positions = [page.index(f"| {number} | `{each}` |") for number, each in enumerate(ENCODINGS)]
    assert positions == sorted(positions)
