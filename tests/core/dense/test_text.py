"""Texts: any text comes back, what was seen before is cheap, nothing is dearer than plainly."""

import json
import random

import cbor2
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.values.dense import DenseCodec, DenseSample, Listener, Speaker
from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.text.lines import LINES
from zacoustic.core.values.dense.text.text import TextModel
from zacoustic.core.values.payload import PackedCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec

MODEL = TextModel(line.encode() for line in LINES)


def cost(line: str, recent: tuple[bytes, ...] = ()) -> int:
    """Bits of a line, which must come back."""
    writer = Writer()
    MODEL.code(writer, line.encode(), recent, None)
    bits = writer.bits
    reader = Reader(writer.finish(1, 0))
    assert MODEL.code(reader, b"", recent, None).decode() == line
    return bits


@given(st.text(max_size=40), st.lists(st.text(max_size=20), max_size=3))
def test_any_text_comes_back(line: str, recent: list[str]) -> None:
    cost(line, tuple(each.encode() for each in recent))


def test_a_known_line_costs_little_and_an_unknown_one_no_more_than_its_letters() -> None:
    known = "INF battery: 26.3 V, 3.4 A, 82 %"
    assert cost(known) < 2 * len(known)
    other = "WRN battery low: 20.9 V, 11 %"
    assert cost(other) < 3.5 * len(other)
    fresh = "Xylophon quartz vexes jumbled glyph"
    assert cost(fresh) < 9 * len(fresh)


def test_a_line_like_the_last_ones_is_cheaper() -> None:
    line = "zq: 14 kHz ping 0047 heard"
    assert cost(line, (b"zq: 14 kHz ping 0046 heard",)) < cost(line) // 2


OPAQUE = TypeSpec(name="Opaque", fields=(FieldSpec(name="payload", type="bytes"),))


def sizes(payloads: list[bytes]) -> list[int]:
    """Bytes of a frame for each payload, which must come back."""
    codec = DenseCodec({9: OPAQUE})
    speaker, listener, found = Speaker(codec), Listener(codec), []
    for tick, payload in enumerate(payloads):
        encoded = speaker.encode([DenseSample(9, {"payload": payload}, tick)], 1 << 16, {1})
        assert encoded is not None
        speaker.sent(encoded)
        found.append(len(encoded.frame))
        decoded = listener.decode(encoded.frame)
        assert decoded.samples == ((9, {"payload": payload}),)
        speaker.acknowledged(1, decoded.snapshot.mark)
    return found


def test_payloads_without_a_type_shrink_by_the_names_that_are_usual() -> None:
    values = [
        {"lat": 43.165, "lon": 15.18 + n / 1000, "depth": 35.4, "heading": 12 + n, "mode": "survey"}
        for n in range(12)
    ]
    as_json = [json.dumps(value, separators=(",", ":")).encode() for value in values]
    as_cbor = [cbor2.dumps(value) for value in values]
    # Half of the CBOR payload is the digits of doubles, which no dictionary knows.
    for payloads, share in ((as_json, 0.85), (as_cbor, 0.97)):
        found = sizes(payloads)
        assert found[0] < share * len(payloads[0])
        assert found[-1] < 0.3 * len(payloads[-1])


def test_opaque_bytes_cost_two_bytes_more_at_most() -> None:
    rng = random.Random(1)
    payloads = [rng.randbytes(size) for size in (1, 2, 7, 40, 300, 1024, 1025, 2000)]
    packed = PackedCodec(OPAQUE)
    for size, payload in zip(sizes(payloads), payloads, strict=True):
        assert size <= len(packed.encode({"payload": payload})) + 2
