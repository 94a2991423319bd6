"""The bytes of routes: the vectors of docs/wire.md, section 16, and anything else."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.pages.blocks import ROOT
from zacoustic.app.tools.inspect.decode.decoder import decode_frame
from zacoustic.core.wire.relay import (
    HopAcks,
    Number,
    Probe,
    RelayContent,
    Relayed,
    decode,
    decode_probe,
    is_relayed,
)

VECTORS: dict[str, RelayContent] = {
    "bf 01 3f 0d 01 17": Relayed(Number(1, False, 63), b"\x01\x17", age=13),
    "bf c2 00 ff 01 17": Relayed(Number(2, True, 0), b"\x01\x17", more=True),
    "bf 21 05 ff 02": Relayed(Number(1, False, 5), b"\x02", is_urgent=True),
    "bf 00 01 3f 82 07": HopAcks((Number(1, False, 63), Number(2, True, 7))),
    "bf 40 01 3f": HopAcks((Number(1, False, 63),), more=True),
}


@pytest.mark.parametrize("encoded", VECTORS)
def test_vectors_of_the_page(encoded: str) -> None:
    content, bytes_of = VECTORS[encoded], bytes.fromhex(encoded)
    assert f"| `{encoded}` |" in (ROOT / "docs/wire.md").read_text(encoding="utf-8")
    assert content.encode() == bytes_of
    assert is_relayed(bytes_of)
    assert decode(bytes_of) == content


numbers = st.builds(Number, st.integers(1, 31), st.booleans(), st.integers(0, 255))


@given(numbers, st.binary(min_size=1, max_size=80), st.booleans(), st.booleans())
def test_frames_are_what_they_were(
    number: Number, content: bytes, more: bool, is_urgent: bool
) -> None:
    relayed = Relayed(number, content, more, is_urgent)
    assert decode(relayed.encode()) == relayed


@given(st.lists(numbers, min_size=1, max_size=30), st.booleans())
def test_acknowledgements_are_what_they_were(some: list[Number], more: bool) -> None:
    acks = HopAcks(tuple(some), more)
    assert decode(acks.encode()) == acks


@given(st.binary(max_size=80))
def test_any_bytes_are_decoded_to_themselves_or_refused(tail: bytes) -> None:
    content = b"\xbf" + tail
    decoded = decode(content)
    assert decoded is None or decoded.encode() == content
    assert decode_frame(content)


def test_a_probe_is_no_frame_of_a_route() -> None:
    encoded = bytes.fromhex("bf 20 07 02")
    assert "| `bf 20 07 02` |" in (ROOT / "docs/wire.md").read_text(encoding="utf-8")
    assert Probe(7, 2).encode() == encoded
    assert decode_probe(encoded) == Probe(7, 2)
    assert decode(encoded) is None
    assert [each.text for each in decode_frame(encoded)] == ["RELAY probe 2 of run 7"]


@pytest.mark.parametrize("other", ["bf 20 07", "bf 20 07 20", "bf 20 07 02 00", "bf 00 01 3f"])
def test_what_is_no_probe_is_not_read_as_one(other: str) -> None:
    assert decode_probe(bytes.fromhex(other)) is None


@pytest.mark.parametrize(
    "cut", ["bf", "bf 01", "bf 01 3f", "bf 01 3f 00", "bf 00", "bf 00 01", "bf 00 00 07"]
)
def test_what_is_cut_off_is_refused(cut: str) -> None:
    assert decode(bytes.fromhex(cut)) is None


def test_frames_of_routes_in_words() -> None:
    items = decode_frame(bytes.fromhex("bf813f0d02"))
    assert [each.kind for each in items] == ["relay", "record"]
    assert items[0].text == "RELAY 63 of route 1 to its first node, 1.3 s old"
    (acks,) = decode_frame(bytes.fromhex("bf 40 01 3f 82 07"))
    assert acks.text == (
        "RELAY hop acknowledgement of 63 of route 1 to its last node, 7 of route 2 to its first "
        "node; a relayed frame follows"
    )
