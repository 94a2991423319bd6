"""The bytes of bonds: the vectors of docs/wire.md, section 17, and anything else."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.pages.blocks import ROOT
from zacoustic.app.tools.inspect.decode.decoder import FrameDecoder
from zacoustic.core.wire.bond import (
    MOST_ANSWERS,
    Bonded,
    bond_of,
    decode,
    decode_answers,
    encode_answers,
)
from zacoustic.core.wire.relay import is_relayed

VECTORS = {
    "bf 5f 07 00 01 17": Bonded(31, 7, b"\x01\x17", wants_answer=True, age=0),
    "bf 1f 07 15 01 17": Bonded(31, 7, b"\x01\x17", age=21),
    "bf 5f 08": Bonded(31, 8, b"", wants_answer=True),
}


@pytest.mark.parametrize("encoded", VECTORS)
def test_vectors_of_the_page(encoded: str) -> None:
    bonded, bytes_of = VECTORS[encoded], bytes.fromhex(encoded)
    assert f"| `{encoded}` |" in (ROOT / "docs/wire.md").read_text(encoding="utf-8")
    assert bonded.encode() == bytes_of
    assert is_relayed(bytes_of)
    assert bond_of(bytes_of) == 31
    assert decode(bytes_of) == bonded


def test_the_answer_of_the_page() -> None:
    assert "| `b2 03 ff 00 07` |" in (ROOT / "docs/wire.md").read_text(encoding="utf-8")
    assert encode_answers([(0, 7)]) == bytes.fromhex("b203ff0007")


@given(st.integers(1, 31), st.integers(0, 255), st.binary(max_size=80), st.booleans())
def test_frames_are_what_they_were(number: int, seq: int, content: bytes, wants: bool) -> None:
    bonded = Bonded(number, seq, content, wants or not content)
    assert decode(bonded.encode()) == bonded


@given(st.lists(st.tuples(st.integers(0, 255), st.integers(0, 255)), min_size=1, max_size=16))
def test_answers_are_what_they_were(answers: list[tuple[int, int]]) -> None:
    assert decode_answers(encode_answers(answers)[3:]) == tuple(answers)


@given(st.binary(max_size=80))
def test_any_bytes_are_decoded_to_themselves_or_refused(tail: bytes) -> None:
    content = b"\xbf" + tail
    decoded = decode(content)
    assert decoded is None or decoded.encode() == content
    assert FrameDecoder(bonds=range(1, 32)).decode(content)
    answers = decode_answers(tail)
    assert answers is None or encode_answers(answers)[3:] == tail


@pytest.mark.parametrize(
    "cut", ["bf", "bf 5f", "bf 1f 07", "bf 1f 07 01", "bf 40 07 00 01", "bf 9f 07 00 01"]
)
def test_what_is_cut_off_is_refused(cut: str) -> None:
    assert decode(bytes.fromhex(cut)) is None


def test_an_answer_has_so_many_at_most() -> None:
    assert decode_answers(bytes(2 * MOST_ANSWERS + 2)) is None
    assert decode_answers(b"") is None


def test_frames_of_bonds_in_words() -> None:
    items = FrameDecoder(bonds=[31]).decode(bytes.fromhex("bf5f070002"))
    assert [each.kind for each in items] == ["relay", "record"]
    assert items[0].text == "RELAY 7 of bond 31, 0 s old; its receivers answer"
    (question,) = FrameDecoder(bonds=[31]).decode(bytes.fromhex("bf5f08"))
    assert question.text == "RELAY 8 of bond 31; its receivers answer"
