"""What comes in pieces, damaged or made up: an engine takes what it can, and goes on."""

import itertools
import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.core.rmw_desert.peer import SAMPLE, Heard, Peer, packet
from tests.core.rmw_desert.vectors import read_vectors
from tests.core.rmw_desert.vehicle import (
    ADD,
    COMMAND,
    NOTE,
    SHORE,
    TWIST,
    VEHICLE,
    hear,
    node,
    said,
    samples,
)
from zacoustic.core.base.stats import Cause
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import LinkState, TransmitOutcome
from zacoustic.errors import (
    PayloadTooLargeError,
)

VECTORS = {vector.name: vector for vector in read_vectors()}


def test_a_packet_longer_than_the_link_takes_goes_in_pieces_and_alone() -> None:
    shore, vehicle = node(SHORE), Peer()
    shore.engine.publish(NOTE, {"data": "x" * 127}, 0)
    shore.engine.publish(NOTE, {"data": "y"}, 0)
    sizes, heard = [], []
    while (transmission := shore.send(0)) is not None:
        sizes.append(len(transmission.frame_bytes))
        heard += vehicle.hear(transmission.frame_bytes)
    assert sizes == [64, 64, 8, 9]
    assert [each.items for each in heard] == [["x" * 127], ["y"]]


def test_a_piece_that_was_lost_takes_the_rest_of_its_packet_with_it() -> None:
    shore = node(SHORE)
    shore.engine.publish(NOTE, {"data": "x" * 127}, 0)
    shore.engine.publish(NOTE, {"data": "y"}, 0)
    piece = shore.poll(0)
    assert piece is not None
    shore.report(piece, TransmitOutcome.ABORTED)
    assert Peer().hear(said(shore, 0)) == [Heard(SAMPLE, NOTE, ["y"])]


def test_a_link_with_frames_carries_the_message_alone() -> None:
    shore = node(SHORE, framed=True)
    vehicle = node(VEHICLE, framed=True)
    shore.engine.publish(COMMAND, TWIST, 0)
    message = VECTORS["twist_id4"].payload
    assert said(shore, 0) == message
    hear(vehicle, message)
    hear(vehicle, message)  # a second one that says the same is no echo
    assert [value["linear"]["x"] for _, value in samples(vehicle)] == [2.0, 2.0]
    with pytest.raises(PayloadTooLargeError, match="room for 64"):
        shore.engine.publish(NOTE, {"data": "x" * 127}, 0)


def test_the_ledger_has_every_byte() -> None:
    shore = node(SHORE)
    shore.engine.publish(COMMAND, TWIST, 0)
    shore.engine.publish(NOTE, {"data": "x" * 127}, 0)
    shore.engine.call(ADD, {"a": 1, "b": 2}, 0)
    data = said(shore, 0)
    ledger = shore.engine.stats.ledger()
    assert sum(each.transmitted_bytes for each in ledger) == len(data)
    assert {each.cause for each in ledger} == {Cause.PAYLOAD, Cause.HEADER, Cause.ENVELOPE}


def test_pieces_and_merges_of_the_stream_make_no_difference() -> None:
    packets = [packet(SAMPLE, NOTE, f"{number}" * 40) for number in range(10)]
    stream = b"".join(packets)
    for cut in (1, 2, 3, 17, 64, len(stream)):
        shore = node(SHORE)
        for at in range(0, len(stream), cut):
            hear(shore, stream[at : at + cut])
        assert [value["data"][0] for _, value in samples(shore)] == [str(n) for n in range(10)]
        assert shore.engine.stats.dropped == {}


def test_half_a_packet_is_given_up_after_a_silence_and_hides_nothing() -> None:
    shore = node(SHORE)
    good = packet(SAMPLE, NOTE, "good")
    hear(shore, b"\x99\x99\xf0" + good, now=NS_PER_S)
    assert samples(shore) == []
    due_at = shore.engine.poll_timeout()
    assert due_at is not None
    shore.now = due_at
    shore.engine.handle_timeout(due_at)
    shore.settle()
    assert samples(shore) == [(NOTE, {"data": "good"})]
    assert shore.engine.stats.dropped == {"no_packet": 1}
    assert shore.engine.is_idle


def test_a_new_connection_begins_with_nothing() -> None:
    shore = node(SHORE)
    good = packet(SAMPLE, NOTE, "good")
    hear(shore, good[:5])
    shore.engine.handle_link_state(LinkState.DOWN, 0)
    shore.engine.handle_link_state(LinkState.UP, 0, shore.capabilities)
    hear(shore, good)
    assert samples(shore) == [(NOTE, {"data": "good"})]


# What its sender can put on the socket, and what a broken channel makes of it.

CRASHERS = (
    "999903010a0755",  # kind 1
    "999902031455",  # a response without its sequence id
    "999907000a1affffffff55",  # a sequence of 2**32-1 elements
    "99990500caf5f5f555",  # booleans, too few
    "999907000a64fffe999955",  # not UTF-8
    "99990400186fc055",  # a tag
    "99990f00c89bffffffffffffffff0102030455",  # an array of 2**64-1
    "999900",
    "99990055",
    "9999015555",
)


@pytest.mark.parametrize("data", CRASHERS)
def test_what_crashes_its_receiver_is_counted_here(data: str) -> None:
    shore = node(SHORE)
    hear(shore, bytes.fromhex(data))
    shore.engine.handle_timeout(NS_PER_S)
    shore.settle()
    assert samples(shore) == []
    assert sum(shore.engine.stats.dropped.values()) >= 1


ALL_PACKETS = [vector.packet for vector in VECTORS.values()]


@given(
    st.lists(
        st.one_of(
            st.binary(max_size=80),
            st.sampled_from(ALL_PACKETS),
            st.sampled_from([b"\x99", b"\x99\x99", b"\x55", b"\x99\x99\xff"]),
        ),
        max_size=20,
    ),
    st.lists(st.integers(0, 5000), max_size=10),
)
def test_no_bytes_harm_an_engine(parts: list[bytes], cuts: list[int]) -> None:
    ends = (node(SHORE), node(VEHICLE))
    stream = b"".join(parts)
    edges = sorted({0, len(stream), *(cut % (len(stream) + 1) for cut in cuts)})
    for end in ends:
        for start, stop in itertools.pairwise(edges):
            hear(end, stream[start:stop])
        end.now = 3600 * NS_PER_S
        end.engine.handle_timeout(end.now)
        end.settle()
        hear(end, packet(SAMPLE, NOTE, "after"), end.now)
        assert samples(end)[-1] == (NOTE, {"data": "after"})


def test_flipped_bits_never_raise_and_are_mostly_dropped(count: Callable[[int], int]) -> None:
    dice = random.Random(1)
    accepted = 0
    tries = count(10_000)
    for _ in range(tries):
        end = node(VEHICLE)
        data = bytearray(VECTORS["twist_id4"].packet)
        bit = dice.randrange(len(data) * 8)
        data[bit // 8] ^= 1 << bit % 8
        hear(end, bytes(data))
        end.engine.handle_timeout(NS_PER_S)
        end.settle()
        accepted += len(samples(end))
    assert 0 < accepted < tries
