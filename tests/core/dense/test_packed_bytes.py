"""Bytes without a type, packed: all come back, texts shrink, the rest costs a byte more at most."""

import json
import random
import struct
from collections.abc import Callable
from typing import Any, Final

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.dense.stream.packedbytes import PackedBytesCodec
from zacoustic.core.values.dense.text.spelling import spelled, unspelled
from zacoustic.core.values.dense.text.text import LONGEST_BYTES
from zacoustic.core.values.payload import PayloadError

CODEC: Final = PackedBytesCodec()
WORDS = st.text(max_size=9)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(1 << 40), 1 << 40) | st.floats() | WORDS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS, inner, max_size=4),
    max_leaves=8,
)


def packed(octets: bytes) -> bytes:
    """The payload of bytes, which must come back."""
    payload = CODEC.encode(octets)
    assert CODEC.decode(payload) == octets
    assert len(payload) <= len(octets) + 1
    return payload


@given(st.binary(max_size=60))
def test_any_bytes_come_back(octets: bytes) -> None:
    packed(octets)


@given(VALUES, st.sampled_from((None, (",", ":"))))
def test_json_and_cbor_come_back(value: Any, separators: tuple[str, str] | None) -> None:
    packed(json.dumps(value, separators=separators).encode())
    packed(cbor2.dumps(value))


@given(st.text(max_size=80))
def test_text_comes_back(text: str) -> None:
    packed(text.encode())


@given(st.floats(), st.floats(width=32), st.binary(max_size=12))
def test_floats_within_bytes_are_spelled_and_read_again(
    double: float, single: float, tail: bytes
) -> None:
    octets = b"\xfb" + struct.pack(">d", double) + b"\xfa" + struct.pack(">f", single) + tail
    for cut in range(len(octets) + 1):
        assert unspelled(spelled(octets[:cut])) == octets[:cut]


@given(st.binary(max_size=40))
def test_what_is_read_as_spelled_is_what_is_spelled_so(text: bytes) -> None:
    for head in (b"", b"\xfb", b"\xfa"):
        try:
            octets = unspelled(head + text)
        except PayloadError:
            continue
        assert spelled(octets) == head + text


def test_largest_single_is_spelled() -> None:
    octets = b"\xfa" + struct.pack(">I", 0x7F7FFFFF)
    assert unspelled(spelled(octets)) == octets
    assert spelled(octets) == b"\xfa3.4028235e+38\n"


@pytest.mark.parametrize("size", [0, 1, 2, 40, 300, LONGEST_BYTES, LONGEST_BYTES + 1, 5000])
def test_what_does_not_shrink_costs_a_byte_more_at_most(size: int) -> None:
    octets = random.Random(size).randbytes(size)
    assert len(packed(octets)) >= size
    for first in (0, 0x7B, 0xBF, 0xC0, 0xFF):
        packed(bytes((first,)) + octets)
    packed(b" " * size)


def test_texts_and_telemetry_shrink() -> None:
    value = {"lat": 54.318204, "lon": 10.151733, "depth": 18.6, "heading": 201.4, "speed": 1.13}
    texts: list[tuple[bytes, float]] = [
        (b"WRN battery low: 22.4 V, 11 %", 0.35),
        (b"The vehicle will return to the recovery point when the survey is finished.", 0.5),
        (json.dumps(value).encode(), 0.3),
        (json.dumps(value, separators=(",", ":")).encode(), 0.3),
        (cbor2.dumps(value), 0.3),
        (b'{"zorblax":12.5,"quibble":-3.25,"fnord":[1,2,3]}', 0.65),
    ]
    for octets, share in texts:
        assert len(packed(octets)) <= share * len(octets), (octets, len(packed(octets)))


def test_a_mark_in_front_of_what_needs_none_is_refused() -> None:
    for payload in (b"\0", b"\0{}", b"\0\xbf"):
        with pytest.raises(PayloadError):
            CODEC.decode(payload)


def test_random_payloads_are_read_or_refused(count: Callable[[int], int]) -> None:
    rng = random.Random(11)
    texts = [CODEC.encode(b"INF dvl: bottom lock"), CODEC.encode(b'{"lat":54.3}')]
    for _ in range(count(100_000)):
        payload = bytearray(rng.choice(texts) if rng.random() < 0.5 else b"")
        payload += rng.randbytes(rng.randint(0, 30))
        if payload:
            payload[0] |= 0xC0
            payload[rng.randrange(len(payload))] ^= 1 << rng.randrange(8)
        try:
            octets = CODEC.decode(bytes(payload))
        except PayloadError:
            continue
        assert len(octets) <= max(LONGEST_BYTES, len(payload))


def test_codec_of_a_stream_without_a_type_follows_its_word_and_is_in_the_digest() -> None:
    tables = [
        StreamTable([TopicSpec(stream_id=7, name="log", codec=word)])
        for word in ("cbor", "packed", "dense")
    ]
    line = b"INF mission completed"
    sizes = [len(table.by_id(7).codec.encode(line)) for table in tables]
    assert sizes[0] == len(line)
    assert sizes[1] == sizes[2] < len(line) / 2
    assert len({table.digest for table in tables}) == 3
