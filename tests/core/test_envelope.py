"""Envelope: what goes around the records, for every kind of link."""

import itertools
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.linktypes import BROADCAST, LinkCapabilities, ReceivedFrame
from zacoustic.core.wire.envelope import Damaged, Envelope, Opened, stuff, unstuff

COMBINATIONS = [
    {"addressed": addressed, "checked": checked, "framed": framed}
    for addressed, checked, framed in itertools.product((True, False), repeat=3)
]
MTUS = (17, 32, 64, 255, 256, 257, 258, 512)
LIMITS = (8, *MTUS)


def envelope(address: int, mtu_bytes: int = 64, **settings: Any) -> Envelope:
    return Envelope(LinkCapabilities(mtu_bytes=mtu_bytes, bit_rate_bps=1, **settings), address)


def received(piece: bytes, source: int = 1, destination: int = BROADCAST) -> ReceivedFrame:
    return ReceivedFrame(frame_bytes=piece, received_at=0, source=source, destination=destination)


def stream(receiver: Envelope, pieces: list[bytes]) -> list[Opened | Damaged]:
    return [result for piece in pieces for result in receiver.open(received(piece))]


def random_split(rng: random.Random, text: bytes) -> list[bytes]:
    cuts = sorted(rng.randrange(len(text) + 1) for _ in range(rng.randrange(12)))
    return [text[begin:end] for begin, end in itertools.pairwise([0, *cuts, len(text)])]


@pytest.mark.parametrize("mtu_bytes", MTUS)
@pytest.mark.parametrize("settings", COMBINATIONS)
def test_frame_of_any_size_crosses_every_kind_of_link(
    settings: dict[str, bool], mtu_bytes: int
) -> None:
    rng = random.Random(mtu_bytes)
    sender, receiver = envelope(1, mtu_bytes, **settings), envelope(2, mtu_bytes, **settings)
    for size in {0, 1, sender.room_bytes // 2, sender.room_bytes - 1, sender.room_bytes}:
        for records in (bytes(size), b"\xff" * size, rng.randbytes(size)):
            frame = sender.wrap(records, 2)
            assert len(frame) <= mtu_bytes
            opened = receiver.open(received(frame, 1, 2))
            if not frame.strip(b"\x00"):
                continue  # nothing around nothing
            assert opened == [Opened(source=1, destination=2, records=records)] or not records


@pytest.mark.parametrize("mtu_bytes", LIMITS)
def test_link_that_brings_everything_costs_nothing(mtu_bytes: int) -> None:
    assert envelope(1, mtu_bytes).room_bytes == mtu_bytes
    assert envelope(1, mtu_bytes).wrap(b"abc", BROADCAST) == b"abc"


def test_each_lack_costs_what_the_wire_page_says() -> None:
    assert envelope(1, 64, addressed=False).room_bytes == 62
    assert envelope(1, 64, checked=False).room_bytes == 60
    assert envelope(1, 64, framed=False).room_bytes == 61
    assert envelope(1, 64, addressed=False, checked=False, framed=False).room_bytes == 55
    assert envelope(7, 64, addressed=False).wrap(b"x", 9) == b"\x09\x07x"
    assert envelope(7, 64, framed=False).wrap(b"x\x00", 9) == b"\x00\x02x\x01\x00"


@pytest.mark.parametrize("mtu_bytes", [11, *range(250, 266), *range(506, 520), 768, 1024])
def test_room_of_a_byte_stream_is_used_to_the_last_byte(mtu_bytes: int) -> None:
    sender = envelope(1, mtu_bytes, framed=False)
    assert len(sender.wrap(b"\xff" * sender.room_bytes, 2)) <= mtu_bytes
    assert len(sender.wrap(b"\xff" * (sender.room_bytes + 2), 2)) > mtu_bytes


@pytest.mark.parametrize("settings", [each for each in COMBINATIONS if not each["framed"]])
@pytest.mark.parametrize("seed", range(10))
def test_byte_stream_opens_the_same_however_it_is_cut(settings: dict[str, bool], seed: int) -> None:
    rng = random.Random(seed)
    sender = envelope(1, 64, **settings)
    sent = [rng.randbytes(rng.randint(1, sender.room_bytes)) for _ in range(10)]
    text = b"".join(sender.wrap(records, BROADCAST) for records in sent)
    whole = stream(envelope(2, 64, **settings), [text])
    assert [each.records for each in whole if isinstance(each, Opened)] == sent
    assert stream(envelope(2, 64, **settings), [bytes((byte,)) for byte in text]) == whole
    for _ in range(10):
        assert stream(envelope(2, 64, **settings), random_split(rng, text)) == whole


@pytest.mark.parametrize("seed", range(30))
def test_noise_between_frames_costs_only_the_frames_that_it_touches(seed: int) -> None:
    rng = random.Random(seed)
    sender = envelope(1, 64, framed=False, checked=False, addressed=False)
    receiver = envelope(2, 64, framed=False, checked=False, addressed=False)
    sent = [rng.randbytes(rng.randint(1, sender.room_bytes)) for _ in range(20)]
    text = bytearray()
    touched: set[int] = set()
    for number, records in enumerate(sent):
        frame = bytearray(sender.wrap(records, BROADCAST))
        if rng.random() < 0.3:
            frame[rng.randrange(1, len(frame) - 1)] ^= rng.randint(1, 255)
            touched.add(number)
        text += frame
        if rng.random() < 0.5:
            text += rng.randbytes(rng.randrange(200))
    results = stream(receiver, random_split(rng, bytes(text)))
    heard = [each.records for each in results if isinstance(each, Opened)]
    assert heard == [records for number, records in enumerate(sent) if number not in touched]


@pytest.mark.parametrize("settings", [each for each in COMBINATIONS if not each["checked"]])
def test_any_flipped_bit_is_noticed_by_the_check(settings: dict[str, bool]) -> None:
    sender = envelope(1, 64, **settings)
    frame = sender.wrap(b"\x0bhello\x00world", 2)
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        results = envelope(2, 64, **settings).open(received(bytes(damaged), 1, 2))
        assert not [each for each in results if isinstance(each, Opened)]


def test_check_covers_the_addresses_that_the_link_carries() -> None:
    sender, receiver = envelope(1, checked=False), envelope(3, checked=False)
    frame = sender.wrap(b"x", 2)
    for source, destination in ((1, 3), (1, BROADCAST), (4, 2)):
        assert receiver.open(received(frame, source, destination)) == [
            Damaged(reason="check", size_bytes=5)
        ]


@pytest.mark.parametrize(
    ("settings", "frame", "source", "destination", "reason"),
    [
        ({"addressed": False}, b"", 0, BROADCAST, "short"),
        ({"addressed": False}, b"\x02", 0, BROADCAST, "short"),
        ({"addressed": False}, b"\x02\x00x", 0, BROADCAST, "address"),
        ({"addressed": False}, b"\x02\xffx", 0, BROADCAST, "address"),
        ({"addressed": False}, b"\x00\x01x", 0, BROADCAST, "address"),
        ({}, b"x", 0, 2, "address"),
        ({}, b"x", 255, 2, "address"),
        ({}, b"x", 1, 0, "address"),
        ({}, b"x", 300, 2, "address"),
        ({}, b"x", 1, 256, "address"),
        ({"checked": False}, b"abc", 1, 2, "short"),
        ({"framed": False}, b"\x00\x05ab\x00", 1, 2, "stuffing"),
        ({"framed": False}, b"\x00" + b"a" * 4097 + b"\x00", 1, 2, "overlong"),
    ],
)
def test_what_is_no_frame_is_damaged_for_a_reason(
    settings: dict[str, bool], frame: bytes, source: int, destination: int, reason: str
) -> None:
    results = envelope(2, 64, **settings).open(received(frame, source, destination))
    assert [each.reason for each in results if isinstance(each, Damaged)] == [reason]
    assert len(results) == 1


def test_a_byte_stream_may_bring_longer_frames_than_this_node_sends() -> None:
    sender, receiver = envelope(1, 512, framed=False), envelope(2, 24, framed=False)
    records = bytes(range(1, 256)) + bytes(100)
    (opened,) = receiver.open(received(sender.wrap(records, 2)))
    assert isinstance(opened, Opened)
    assert opened.records == records


def test_buffer_of_a_byte_stream_never_grows_beyond_a_frame() -> None:
    receiver = envelope(2, 64, framed=False)
    for _ in range(1000):
        assert receiver.open(received(b"\xff" * 1000)) == []
    assert receiver.open(received(b"\x00\x02x\x00")) == [
        Damaged(reason="overlong", size_bytes=4096),
        Opened(source=1, destination=BROADCAST, records=b"x"),
    ]


@pytest.mark.parametrize("size", [0, 1, 2, 253, 254, 255, 256, 507, 508, 509, 762, 763])
def test_stuffing_has_no_zero_and_one_byte_more_for_each_254(size: int) -> None:
    for frame in (b"\x01" * size, bytes(size), b"\x01" * size + b"\x00", b"\x00" + b"\x01" * size):
        stuffed = stuff(frame)
        assert b"\x00" not in stuffed
        assert len(stuffed) <= len(frame) + 1 + len(frame) // 254
        assert unstuff(stuffed) == frame


@given(st.binary(max_size=800))
def test_unstuffing_undoes_stuffing(frame: bytes) -> None:
    assert unstuff(stuff(frame)) == frame


@given(st.binary(max_size=600))
def test_unstuffing_anything_gives_a_frame_or_none(stuffed: bytes) -> None:
    frame = unstuff(stuffed)
    assert frame is None or len(frame) <= len(stuffed)
