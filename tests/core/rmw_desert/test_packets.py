import random
from collections.abc import Callable

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.links.desert.byte_pieces import BYTES, SIZES, cut, damaged, is_subsequence
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.values.rmw_desert.packets import (
    OVERHEAD_BYTES,
    PAYLOAD_LIMIT_BYTES,
    RECEIVED_LIMIT_BYTES,
    PacketDecoder,
    encode_packet,
)
from zacoustic.core.wire.envelope import Damaged as Refused
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic_desert.config import DesertConfig

LONGEST = RECEIVED_LIMIT_BYTES + OVERHEAD_BYTES


def long_packet(payload: bytes) -> bytes:
    """Return a packet as rmw_desert sends it, whatever its length."""
    return b"\x99\x99" + bytes((len(payload) % 256,)) + payload + b"\x55"


def decode(stream: bytes, sizes: list[int], *, flush: bool = True) -> tuple[list[bytes], int]:
    decoder = PacketDecoder()
    payloads = [payload for piece in cut(stream, sizes) for payload in decoder.feed(piece)]
    if flush:
        payloads += decoder.flush()
    return payloads, decoder.discarded_bytes


@given(st.binary(min_size=1, max_size=PAYLOAD_LIMIT_BYTES), SIZES)
def test_payload_survives_whatever_is_in_it(payload: bytes, sizes: list[int]) -> None:
    assert decode(encode_packet(payload), sizes, flush=False) == ([payload], 0)


@pytest.mark.parametrize("length", [1, 2, 254, 255])
def test_limits_of_the_length(length: int) -> None:
    packet = encode_packet(bytes(length))
    assert packet == b"\x99\x99" + bytes((length,)) + bytes(length) + b"\x55"


@pytest.mark.parametrize("length", [0, 256, 512])
def test_payload_that_the_length_cannot_tell_is_refused(length: int) -> None:
    with pytest.raises(ValueError, match=f"payload of {length} bytes; allowed: 1..255"):
        encode_packet(bytes(length))


def test_measured_packets_are_understood() -> None:
    assert decode(bytes.fromhex("999903000a0055"), [1])[0] == [bytes.fromhex("000a00")]
    assert decode(bytes.fromhex("9999020002559999030a020155"), [64]) == (
        [bytes.fromhex("0002"), bytes.fromhex("0a0201")],
        0,
    )


@given(st.binary(min_size=256, max_size=RECEIVED_LIMIT_BYTES), SIZES)
def test_long_payloads_of_rmw_desert_are_received(payload: bytes, sizes: list[int]) -> None:
    payload = payload.replace(b"\x55", b"\x54")  # an end marker in the wrong place cuts it there
    payload = payload.replace(b"\x99", b"\x98")
    packets = long_packet(payload) + encode_packet(b"next")
    assert decode(packets, sizes, flush=False) == ([payload, b"next"], 0)


@given(
    st.binary(max_size=1500)
    | st.lists(st.sampled_from([0x99, 0x55, 2, 0]), max_size=700).map(bytes),
    SIZES,
)
def test_pieces_make_no_difference(stream: bytes, sizes: list[int]) -> None:
    whole = decode(stream, [max(1, len(stream))])
    assert decode(stream, [1]) == whole
    assert decode(stream, sizes) == whole
    payloads, discarded = whole
    assert sum(map(len, payloads)) + OVERHEAD_BYTES * len(payloads) + discarded == len(stream)


# Without a check, markers inside payloads may make damage look like packets.
PLAIN = st.integers(0, 0x54)


PAYLOADS = st.lists(st.lists(PLAIN, min_size=4, max_size=60).map(bytes), min_size=1, max_size=20)


@given(st.data(), PAYLOADS, SIZES)
def test_damage_costs_the_packets_that_it_touches(
    data: st.DataObject, payloads: list[bytes], sizes: list[int]
) -> None:
    packets = [encode_packet(payload) for payload in payloads]
    left = data.draw(damaged(packets, PLAIN))
    found, _ = decode(left.stream, sizes)
    # A truncated packet whose length, by chance, leads to the end of another one: see `framing`.
    assume(not any(b"\x99\x99" in payload for payload in found))
    assert is_subsequence([payloads[at] for at in left.untouched], found)


def test_stray_marker_delays_packets_and_a_silence_frees_them() -> None:
    decoder = PacketDecoder()
    packets = b"".join(encode_packet(bytes((at, 1, 2))) for at in range(5))
    assert decoder.feed(b"\x99" + packets) == []
    assert decoder.is_waiting
    assert decoder.flush() == [bytes((at, 1, 2)) for at in range(5)]
    assert not decoder.is_waiting
    assert decoder.discarded_bytes == 1


def test_lost_length_hides_no_packet_behind_it() -> None:
    stream = b"\x99\x99" + bytes((200, 7, 7)) + encode_packet(b"one") * 100
    found, _ = decode(stream, [64], flush=False)
    assert found[:1] == [b"one"]
    assert len(found) >= 100 - LONGEST // len(encode_packet(b"one"))


def test_random_bytes_neither_raise_nor_fill_the_memory(count: Callable[[int], int]) -> None:
    rng = random.Random(3)
    decoder = PacketDecoder()
    envelope = Envelope(DesertConfig().capabilities(), 1)
    left = count(1_000_000)
    while left:
        piece = rng.randbytes(min(left, rng.randint(1, 900)))
        if rng.randrange(4) == 0:
            piece = piece.replace(piece[:1], b"\x99").replace(piece[-1:], b"\x55")
        left -= len(piece)
        for payload in decoder.feed(piece):
            assert 1 <= len(payload) <= RECEIVED_LIMIT_BYTES
        assert len(decoder._buffer) < LONGEST
        for result in envelope.open(ReceivedFrame(frame_bytes=piece, received_at=0)):
            assert isinstance(result, Refused)
    decoder.flush()
    assert not decoder.is_waiting


RECORDS = [bytes((at, *range(20))) for at in range(50)]


@given(st.data(), SIZES)
def test_damage_to_the_byte_stream_costs_the_frames_that_it_touches(
    data: st.DataObject, sizes: list[int]
) -> None:
    """The native wire: the link passes the stream on as it comes, the core delimits and checks."""
    capabilities = DesertConfig().capabilities()
    sender, receiver = Envelope(capabilities, 1), Envelope(capabilities, 2)
    frames = [sender.wrap(records, 2) for records in RECORDS]
    assert {len(frame) for frame in frames} == {30}
    left = data.draw(damaged(frames, BYTES))
    results = [
        result
        for piece in cut(left.stream, sizes)
        for result in receiver.open(ReceivedFrame(frame_bytes=piece, received_at=0))
    ]
    opened = [each.records for each in results if isinstance(each, Opened)]
    assert is_subsequence([RECORDS[at] for at in left.untouched], opened)
    assert set(opened) <= set(RECORDS)
