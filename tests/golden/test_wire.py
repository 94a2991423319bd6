"""The wire vectors: what the engines make today is what docs/wire.md promises."""

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
    assert VECTORS.read_text(encoding="utf-8") == text()


def test_every_vector_says_what_is_in_it() -> None:
    assert [each.name for each in MADE.values() if not each.fields or not each.table] == []


@pytest.mark.parametrize("name", sorted(PROMISED))
def test_vector_is_on_the_wire_page(name: str) -> None:
    vector = PROMISED[name]
    assert f"\n{name}\n    {vector.hex}\n    {vector.meaning}\n" in WIRE_PAGE.read_text()


def test_opaque_sample_costs_one_byte_beside_its_payload() -> None:
    assert bytes.fromhex(PROMISED["sample_opaque"].hex) == b"\x0b" + b"hello"


def test_list_of_encodings_is_on_the_wire_page_in_its_order() -> None:
    page = WIRE_PAGE.read_text()
    positions = [page.index(f"| {number} | `{each}` |") for number, each in enumerate(ENCODINGS)]
    assert positions == sorted(positions)
