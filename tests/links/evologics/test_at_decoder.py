"""What a modem says is read whatever its payloads look like, and damage costs what it touches."""

import random
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.links.evologics.cutting import at_random, decoded, one_by_one
from tests.links.evologics.strategies import NASTY_PIECES, NOTIFICATIONS
from zacoustic_evologics import AtDecoder, Framing, encode_message
from zacoustic_evologics.at.decoder import HELD_LIMIT_BYTES, LINE_LIMIT_BYTES
from zacoustic_evologics.at.framing import BODY_LIMIT_BYTES, PAYLOAD_LIMIT_BYTES
from zacoustic_evologics.at.messages import Message, Noise, RawData, Reply, Unrecognised
from zacoustic_evologics.at.notifications import (
    AsyncError,
    CanceledIm,
    Delivered,
    DeliveredIm,
    Extension,
    Failed,
    FailedIm,
    FaultKind,
    ImFlag,
    PhyOff,
    Recv,
    RecvEnd,
    RecvIm,
    RecvIms,
    RecvStart,
    SendStart,
)
from zacoustic_evologics.at.usbl import UsblPhyP


def im(payload: bytes, length: int | None = None) -> bytes:
    length = len(payload) if length is None else length
    return b"RECVIM,%d,2,1,ack,204800,-45,133,0.0458,%s\r\n" % (length, payload)


def an_im(payload: bytes) -> RecvIm:
    return RecvIm(
        payload=payload, source=2, destination=1, flag=ImFlag.ACK, duration_us=204800,
        rssi_db=-45, integrity=133, velocity_m_s=0.0458,
    )  # fmt: skip


def wrapped(body: bytes, name: bytes = b"") -> bytes:
    return b"+++AT%s:%d:%s\r\n" % (name, len(body), body)


@pytest.mark.parametrize(
    "payload",
    [
        b"\r\nDELIVEREDIM,3\r\n",
        b"\r\n+++AT:13:DELIVEREDIM,3\r\n",
        b"+++AT",
        b",,,,,,,,,,,,",
        b"\r",
        b"\n",
        b"\r\n\r\n",
        b"\x00\x01\xff",
        b"OK\r\nERROR EFAULT\r\n",
        b"",
        bytes(range(64)),
        bytes(range(192, 256)),
    ],
)
@pytest.mark.parametrize("framing", Framing)
def test_payload_that_looks_like_the_grammar_is_only_a_payload(
    payload: bytes, framing: Framing
) -> None:
    record = im(payload)
    stream = record + b"FAILEDIM,9\r\n"
    if framing is Framing.PACKETS:
        stream = wrapped(record.removesuffix(b"\r\n")) + wrapped(b"FAILEDIM,9")
    expected = [an_im(payload), FailedIm(9)]
    assert AtDecoder(framing).feed(stream) == expected
    assert decoded(AtDecoder(framing), one_by_one(stream)) == expected


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"FAILED", Reply("FAILED")),
        (b"FAILED,766,2", Failed(counter=766, destination=2)),
        (b"DELIVERED", Reply("DELIVERED")),
        (b"DELIVERED,765,2", Delivered(counter=765, destination=2)),
        (b"DELIVEREDIM,2", DeliveredIm(2)),
        (b"DELIVERING", Reply("DELIVERING")),
        (b"RECV", Unrecognised(b"RECV")),
        (b"RECVJRB,8,01020304", Unrecognised(b"RECVJRB,8,01020304")),
        (b"USBLNEW,1", Unrecognised(b"USBLNEW,1")),
        (b"NOISE,8,1,2", Unrecognised(b"NOISE,8,1,2")),
        (b"RECVSTART", RecvStart()),
        (b"RECVSTARTS", Unrecognised(b"RECVSTARTS")),
        (b"PHYOFF", PhyOff()),
        (b"CANCELEDIM,2", CanceledIm(2)),
        (b"CANCELLEDIM,2", CanceledIm(2)),
        (b"ERROR EFAULT", AsyncError(FaultKind.EFAULT)),
        (b"ERROR OVERLOAD", AsyncError(FaultKind.OVERLOAD)),
        (b"ERROR EFAULTS", Reply("ERROR EFAULTS")),
        (b"%SYNC,3,10", Extension("SYNC", "3,10")),
        (b"%RESET", Extension("RESET")),
        (b"%", Unrecognised(b"%")),
        (b"", Reply("")),
        (b"DELIVEREDIM,", Unrecognised(b"DELIVEREDIM,")),
        (b"DELIVEREDIM,256", Unrecognised(b"DELIVEREDIM,256")),
        (b"DELIVEREDIM,3x", Unrecognised(b"DELIVEREDIM,3x")),
        (b"SENDSTART,3,im,182272", Unrecognised(b"SENDSTART,3,im,182272")),
        (b"RECVEND,1,2,nan,4", Unrecognised(b"RECVEND,1,2,nan,4")),
        (b"RECVEND,1,2,-3,4_0", Unrecognised(b"RECVEND,1,2,-3,4_0")),
        (b"RECVIM,5,2,1,ack,204800", Unrecognised(b"RECVIM,5,2,1,ack,204800")),
        (b"RECVIM,5,2,1,perhaps,9,-4,1,0.1,hello", Unrecognised),
        (b"RECVIM,5,2,1,ack,9,-4,1,0.1,hell", Unrecognised),
        (b"RECVIM,65,2,1,ack,9,-4,1,0.1," + bytes(65), Unrecognised),
        (b"RECVIM,p8,5,2,1,ack,9,-4,1,0.1,hello", Unrecognised),
        (b"RECVIM,p,5,2,1,ack,9,-4,1,0.1,hello", Unrecognised),
        (b"RECVIM,-1,2,1,ack,9,-4,1,0.1,", Unrecognised),
        (b"OK\xff", Unrecognised(b"OK\xff")),
        (b"\x00" * 40, Unrecognised(b"\x00" * 40)),
    ],
)
@pytest.mark.parametrize("framing", Framing)
def test_line_is_told_from_what_it_resembles(
    line: bytes, message: Message | type[Unrecognised], framing: Framing
) -> None:
    stream = line + b"\r\n" if framing is Framing.LINES else wrapped(line)
    found = AtDecoder(framing).feed(stream + (stream if framing is Framing.PACKETS else b"A\r\n"))
    first = found[0]
    if isinstance(message, Reply) and framing is Framing.PACKETS:
        message = Reply(message.text, "")
    assert first == message or (message is Unrecognised and isinstance(first, Unrecognised))


def test_record_shorter_than_announced_costs_the_line_and_not_what_follows() -> None:
    stream = im(b"hel", 5) + im(b"hello") + b"DELIVEREDIM,3\r\n" + bytes(60) + b"\r\nOK\r\n"
    found = AtDecoder().feed(stream)
    assert found[0] == Unrecognised(im(b"hel", 5)[:-2])
    assert found[1:3] == [an_im(b"hello"), DeliveredIm(3)]
    assert found[-1] == Reply("OK")


def test_packet_with_a_wrong_length_is_raw_data_and_the_next_is_read() -> None:
    found = AtDecoder(Framing.PACKETS).feed(b"+++AT:5:+++AT*SENDIM:2:OK\r\n")
    assert found == [RawData(b"+++AT:5:"), Reply("OK", "*SENDIM")]


def test_raw_data_around_packets_is_kept_whole() -> None:
    raw = b"+ ++ +++ ++++ +++A +++ATx +++AT:12 +++AT::"
    stream = raw + wrapped(b"RECVSTART") + raw
    for pieces in ([stream], one_by_one(stream), at_random(stream, 7)):
        decoder = AtDecoder(Framing.PACKETS)
        assert decoded(decoder, pieces) == [RawData(raw), RecvStart(), RawData(raw)]


@pytest.mark.parametrize("tail", [b"+", b"++", b"+++", b"+++A", b"+++AT", b"+++AT?S", b"+++AT?S:1"])
def test_what_may_become_a_packet_waits(tail: bytes) -> None:
    decoder = AtDecoder(Framing.PACKETS)
    assert decoder.feed(b"data" + tail) == [RawData(b"data")]
    assert decoder.held_bytes == len(tail)
    assert decoder.flush() == [RawData(tail)]
    assert decoder.held_bytes == 0


def test_packet_tells_of_data_mode_while_lines_are_read() -> None:
    stream = b"ERROR WRONG FORMAT\r\nstale" + wrapped(b"AT", b"?MODE") + b"NET\r\n"
    expected = [
        Reply("ERROR WRONG FORMAT"), Unrecognised(b"stale"), Reply("AT", "?MODE"), Reply("NET"),
    ]  # fmt: skip
    assert AtDecoder().feed(stream) == expected
    assert decoded(AtDecoder(), one_by_one(stream)) == expected


def test_name_in_a_packet_makes_a_reply_of_what_looks_like_a_notification() -> None:
    assert AtDecoder().feed(wrapped(b"FAILED,1,2", b"?DI")) == [Reply("FAILED,1,2", "?DI")]


def test_framing_can_change_between_two_pieces() -> None:
    decoder = AtDecoder(Framing.PACKETS)
    assert decoder.feed(wrapped(b"OK", b"C") + b"+") == [Reply("OK", "C")]
    decoder.framing = Framing.LINES
    assert decoder.feed(b"++\r\nRECVSTART\r\n") == [Reply("+++"), RecvStart()]


def test_firmware_1_6_is_told_by_its_fields() -> None:
    older = b"RECVIM,5,2,1,ack,976,-45,133,120450,0.0312,hello\r\n"
    assert AtDecoder().feed(older) == [
        RecvIm(
            payload=b"hello", source=2, destination=1, flag=ImFlag.ACK, bit_rate_bps=976,
            propagation_us=120450, rssi_db=-45, integrity=133, velocity_m_s=0.0312,
        )
    ]  # fmt: skip


@pytest.mark.parametrize("payload", [b"hello", b"12", b"0.5", b"-", b"0.512345", b"1234567", b""])
def test_velocity_without_a_point_is_a_velocity_unless_another_follows(payload: bytes) -> None:
    stream = b"RECVIM,%d,2,1,ack,204800,-45,133,0,%s\r\n" % (len(payload), payload)
    for pieces in ([stream], one_by_one(stream)):
        (found,) = decoded(AtDecoder(), pieces)
        assert isinstance(found, RecvIm)
        assert (found.payload, found.velocity_m_s, found.duration_us) == (payload, 0.0, 204800)


def test_fields_that_newer_firmware_adds_are_ignored() -> None:
    found = AtDecoder().feed(b"RECVEND,3349740869,182272,-40,120,0.1000\r\n")
    assert found == [RecvEnd(clock_us=3349740869, duration_us=182272, rssi_db=-40, integrity=120)]


def test_payload_is_not_copied_into_another_record_of_the_same_prefix() -> None:
    found = AtDecoder().feed(
        b"RECVIMS,4,3,1,3349740869,196608,-40,120,0.1000,ping\r\n"
        b"RECV,5,3,1,6900,-47,141,120450,0.0312,hello\r\n"
    )
    assert isinstance(found[0], RecvIms)
    assert isinstance(found[1], Recv)


def test_noise_recording_is_read_by_its_length_in_both_framings() -> None:
    body = b"NOISE,6,250000,0,-61,\r\n+++A"
    noise = Noise(first=250000, second=0, third=-61, payload=b"\r\n+++A")
    assert AtDecoder().feed(body + b"\r\n") == [noise]
    assert AtDecoder(Framing.PACKETS).feed(wrapped(body, b"?NOISE")) == [noise]


def test_lines_of_several_arrive_one_by_one_and_in_a_packet_together() -> None:
    body = b"10    10   \n100   240  \n"
    assert AtDecoder().feed(body + b"\r\n") == [
        Reply("10    10   "), Reply("100   240  "), Reply(""),
    ]  # fmt: skip
    assert AtDecoder().feed(wrapped(body, b"?P")) == [Reply(body.decode(), "?P")]


def test_line_without_end_is_cut_at_its_limit() -> None:
    stream = b"x" * (2 * LINE_LIMIT_BYTES) + b"\r\nRECVSTART\r\n"
    expected = [
        Unrecognised(b"x" * LINE_LIMIT_BYTES),
        Unrecognised(b"x" * LINE_LIMIT_BYTES),
        Reply(""),
        RecvStart(),
    ]
    assert AtDecoder().feed(stream) == expected
    assert decoded(AtDecoder(), one_by_one(stream)) == expected


@pytest.mark.parametrize("before", range(LINE_LIMIT_BYTES - 6, LINE_LIMIT_BYTES + 2))
def test_packet_at_the_limit_of_a_line_is_read(before: int) -> None:
    stream = b"x" * before + wrapped(b"RECVSTART")
    expected = AtDecoder().feed(stream)
    assert expected[-1] == RecvStart()
    assert decoded(AtDecoder(), one_by_one(stream)) == expected


def test_packet_with_more_in_it_than_its_record_is_unrecognised() -> None:
    body = im(b"hello") + b"more"
    assert AtDecoder(Framing.PACKETS).feed(wrapped(body)) == [Unrecognised(body)]


@pytest.mark.parametrize("framing", Framing)
@pytest.mark.parametrize(
    "start",
    [
        b"RECV,%d,2,1,6900,-45,133,12,0.0458," % PAYLOAD_LIMIT_BYTES,
        b"RECVIM,64,2,1,ack,204800,-45,133,0",
        b"+++AT:%d:" % BODY_LIMIT_BYTES,
        b"junk+++AT:%d:" % BODY_LIMIT_BYTES,
        b"+++AT:99999:",
        b"RECV," + b"1" * 200,
        b"+++AT" + b"A" * 200,
        b"NOISE,99999,1,2,3,",
    ],
)
def test_what_is_held_is_bounded_and_the_stream_recovers(start: bytes, framing: Framing) -> None:
    decoder = AtDecoder(framing)
    decoder.feed(start)
    for _ in range(40):
        decoder.feed(b"\x00" * 1000)
        assert decoder.held_bytes <= HELD_LIMIT_BYTES
    decoder.feed(b"\r\n")
    end = b"DELIVEREDIM,3\r\n" if framing is Framing.LINES else wrapped(b"DELIVEREDIM,3")
    assert decoder.feed(end)[-1] == DeliveredIm(3)


@pytest.mark.parametrize("framing", Framing)
def test_flush_gives_up_the_record_under_way_and_reads_what_is_behind_it(framing: Framing) -> None:
    decoder = AtDecoder(framing)
    body = b"SENDSTART,3,im,182272,0"
    whole = body + b"\r\n" if framing is Framing.LINES else wrapped(body)
    begun = im(b"", 64) if framing is Framing.LINES else b"+++AT:900:RECVI\r\n"
    assert decoder.feed(begun + whole) == []
    found = decoder.flush()
    assert SendStart(destination=3, kind="im", duration_us=182272, delay_us=0) in found
    assert decoder.held_bytes == 0
    assert decoder.feed(whole) == found[-1:]


@given(st.lists(st.sampled_from(NASTY_PIECES) | st.binary(max_size=9), max_size=60), st.integers())
def test_any_bytes_give_the_same_messages_however_they_are_cut(
    pieces: list[bytes], seed: int
) -> None:
    stream = b"".join(pieces)
    for framing in Framing:
        whole = AtDecoder(framing)
        expected = whole.feed(stream)
        for cut in (one_by_one(stream), at_random(stream, seed)):
            decoder = AtDecoder(framing)
            assert decoded(decoder, cut) == expected
            assert decoder.held_bytes == whole.held_bytes


@given(st.lists(NOTIFICATIONS, min_size=1, max_size=4), st.data())
def test_one_damaged_byte_costs_no_more_than_what_it_touches_in_the_end(
    messages: list[Any], data: st.DataObject
) -> None:
    stream = bytearray(b"".join(encode_message(each, Framing.PACKETS) for each in messages))
    place = data.draw(st.integers(0, len(stream) - 1))
    stream[place] = data.draw(st.integers(0, 255))
    decoder = AtDecoder(Framing.PACKETS)
    decoder.feed(bytes(stream))
    decoder.flush()
    assert decoder.feed(wrapped(b"DELIVEREDIM,3")) == [DeliveredIm(3)]


def random_stream(rng: random.Random, size: int) -> bytes:
    """Give bytes that are noise in one half, and pieces of the grammar in the other."""
    made = bytearray()
    while len(made) < size:
        made += rng.randbytes(rng.randrange(40)) if rng.randrange(2) else rng.choice(NASTY_PIECES)
    return bytes(made[:size])


@pytest.mark.parametrize("framing", Framing)
def test_random_bytes_neither_raise_nor_fill_the_memory(
    framing: Framing, count: Callable[[int], int]
) -> None:
    rng = random.Random(5)
    decoder = AtDecoder(framing)
    left = count(1_000_000)
    while left > 0:
        piece = random_stream(rng, min(left, rng.choice((1, 10, 300, 2000))))
        decoder.feed(piece)
        assert decoder.held_bytes <= HELD_LIMIT_BYTES
        left -= len(piece)
    decoder.flush()
    end = b"RECVSTART\r\n" if framing is Framing.LINES else wrapped(b"RECVSTART")
    assert decoder.feed(end) == [RecvStart()]


def test_positions_of_a_geometry_without_a_solution_are_read() -> None:
    """Three hydrophones whose delays are missing give places far beyond the earth."""
    numbers = ["1.0000"] * 17 + ["-987654321012.1250"]
    line = "USBLPHYP,10446.991981,10446.534643,3,0," + ",".join(numbers)
    (found,) = AtDecoder(Framing.LINES).feed(line.encode() + b"\r\n")
    assert isinstance(found, UsblPhyP)
    assert found.positions_m[-1] == -987654321012.125
    assert encode_message(found, Framing.LINES) == line.encode() + b"\r\n"
