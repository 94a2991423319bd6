"""Services: a call ends in exactly one answer, and runs at most once."""

import pytest

from tests.core.calling import (
    answer,
    call,
    ends,
    failures,
    fleet,
    requests,
    responses,
    to_nobody,
)
from tests.core.rig import Rig
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.events import CallFailure, ResponseReceived
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello
from zacoustic.errors import PayloadInvalidError, PayloadTooLargeError, QueueFullError


def test_answer_finds_its_call() -> None:
    rig = ends()
    call_id = call(rig, {"n": 3}, stream_id=21)
    rig.exchange()
    assert [(event.value, event.call.client) for event in requests(rig)] == [({"n": 3}, 1)]
    assert requests(rig)[0].deadline_at == seconds_to_ns(10)
    assert answer(rig, {"n": 4})
    assert not answer(rig, {"n": 5})
    rig.exchange()
    assert [(e.call_id, e.value) for e in rig[1].got(ResponseReceived)] == [(call_id, {"n": 4})]
    rig.run(60)
    assert failures(rig) == []


def test_error_of_the_handler_reaches_the_caller_with_its_text() -> None:
    rig = ends()
    call_id = call(rig)
    rig.exchange()
    text = "no arm: " + "ä" * 60
    rig[2].engine.reply_error(requests(rig)[0].call, CallFailure.HANDLER, text, rig.now)
    rig.exchange()
    assert failures(rig) == [(call_id, CallFailure.HANDLER, text[: 8 + 20])]


def test_response_that_cannot_be_sent_is_an_error_of_the_service() -> None:
    rig = ends()
    call(rig, {"n": 1}, stream_id=21)
    rig.exchange()
    with pytest.raises(PayloadInvalidError):
        answer(rig, {"n": 99})
    rig.exchange()
    ((_, failure, text),) = failures(rig)
    assert failure is CallFailure.HANDLER
    assert text.startswith("N.n is 99")


def test_lost_request_times_out_and_is_not_sent_any_more() -> None:
    rig = ends()
    call_id = call(rig, timeout_s=5)
    rig.run(4.99, to_nobody)
    assert failures(rig) == []
    assert 10 < len(rig.frames) < 250
    rig.run(0.02)
    assert failures(rig) == [(call_id, CallFailure.TIMED_OUT, "no answer before the deadline")]
    assert rig[1].engine.poll_timeout() is None


def test_request_that_still_waits_at_its_deadline_is_never_sent() -> None:
    rig = ends()
    rig[1].engine.handle_carrier(True, 0)
    call(rig, timeout_s=0.0001)
    assert rig[1].engine.pending(20) == 1
    rig.now = seconds_to_ns(1)
    rig[1].engine.handle_timeout(rig.now)
    rig[1].engine.handle_carrier(False, rig.now)
    assert rig[1].engine.pending(20) == 0
    assert rig.run(1) == []


def test_cancelled_call_is_not_sent_and_says_nothing() -> None:
    rig = ends()
    call_id = call(rig)
    rig[1].engine.cancel(call_id, rig.now)
    rig[1].engine.cancel(call_id, rig.now)
    assert rig.run(60) == []
    assert rig[1].events[1:] == []


def test_answer_to_a_cancelled_call_is_counted_and_dropped() -> None:
    rig = ends()
    call_id = call(rig)
    rig.exchange()
    rig[1].engine.cancel(call_id, rig.now)
    answer(rig)
    rig.exchange()
    assert rig[1].engine.stats.dropped == {"unexpected_answer": 1}
    assert rig[1].got(ResponseReceived) == []


def test_repeated_request_runs_once_and_is_answered_again() -> None:
    rig = ends()
    call(rig)
    rig.exchange()
    request = next(sent for source, sent in rig.frames if source == 1)
    rig.now += 1_000_000
    rig.deliver(1, request)
    assert len(requests(rig)) == 1
    answer(rig)
    rig.exchange(to_nobody)
    rig.now += 1_000_000
    rig.deliver(1, request)
    rig.exchange()
    assert len(requests(rig)) == 1
    assert len(rig[1].got(ResponseReceived)) == 1
    assert rig[2].engine.stats.dropped == {"repeated_request": 2}


def test_repeated_answer_is_dropped() -> None:
    rig = ends()
    call(rig)
    rig.exchange()
    answer(rig)
    rig.exchange()
    reply = next(sent for source, sent in rig.frames[::-1] if source == 2)
    rig.now += 1_000_000
    rig.deliver(2, reply)
    assert len(rig[1].got(ResponseReceived)) == 1


def test_late_answer_to_a_former_life_is_not_taken_for_a_new_call() -> None:
    rig = ends()
    call(rig, b"first life")
    rig.exchange()
    rig.run(1)
    rig.restart(1, fleet())
    second = call(rig, b"second life")
    rig.exchange(to_nobody)
    # Node 2 introduces itself, and answers the call that nobody waits for any more.
    rig.publish(2, 1, b"hello")
    rig.exchange()
    answer(rig, b"to the first life")
    rig.exchange()
    assert rig[1].got(ResponseReceived) == []
    rig.run(1)
    third = call(rig, b"third")
    rig.exchange()
    assert answer(rig, b"to the third")
    rig.exchange()
    assert [(e.call_id, e.value) for e in rig[1].got(ResponseReceived)] == [
        (third, b"to the third")
    ]
    rig.run(20)
    assert [each[0] for each in failures(rig)] == [second]


def test_answer_that_waits_when_the_client_restarts_is_not_sent() -> None:
    rig = ends()
    call(rig)
    rig.exchange()
    rig[2].engine.handle_carrier(True, rig.now)
    answer(rig)
    rig.restart(1, fleet())
    rig.publish(1, 1, b"I am back")
    rig.exchange()
    assert rig[2].engine.pending(20) == 0
    assert not answer(rig)


def test_short_time_out_does_not_recycle_a_number_while_the_server_may_still_answer() -> None:
    rig = ends()
    call(rig, b"slow", timeout_s=0.01)
    rig.exchange()
    rig.run(1)
    for _ in range(70):
        try:
            call(rig, b"next", timeout_s=0.05)
        except QueueFullError:
            break
        rig.exchange()
    answer(rig, b"late answer to slow", number=0)
    rig.exchange()
    assert rig[1].got(ResponseReceived) == []


def test_call_to_a_service_that_differs_fails_at_once() -> None:
    rig = Rig({1: fleet(), 2: fleet(server=3)})
    first = call(rig)
    rig.run(1)
    text = "node 2 defines stream 20 in another way"
    assert failures(rig) == [(first, CallFailure.TABLE_MISMATCH, text)]
    frames = len(rig.frames)
    second = call(rig)
    rig[1].settle()
    assert failures(rig)[1:] == [(second, CallFailure.TABLE_MISMATCH, text)]
    rig.exchange()
    assert len(rig.frames) == frames
    assert requests(rig) == []


@pytest.mark.parametrize(
    ("records", "dropped"),
    [
        (b"\x14", {"payload": 1}),
        (b"\x15\x00\x18\xff", {"payload": 1}),
        (b"\x15\x00", {"payload": 1}),
        (b"\x14\x40answer", {"not_publisher": 1}),
        (b"\x14\x80\x01error", {"not_publisher": 1}),
        (b"\x14\xc0", {}),
    ],
)
def test_record_that_is_no_request_is_counted(records: bytes, dropped: dict[str, int]) -> None:
    rig = ends()
    rig[2].hear(Hello(WIRE_VERSION, 1, fleet().digest).encode() + records, 0, source=1)
    assert rig[2].engine.stats.dropped == dropped
    assert requests(rig) == []


@pytest.mark.parametrize(
    ("records", "source", "dropped"),
    [
        (b"\x14\x00", 2, {"unexpected_answer": 1}),
        (b"\x14\x00\x42", 2, {"unexpected_answer": 1}),
        (b"\x14\x00\x01request", 2, {"unexpected_answer": 1}),
        (b"\x14\x3f\x41answer", 2, {"unexpected_answer": 1}),
        (b"\x14\x7fanswer", 2, {"unexpected_answer": 1}),
        (b"\x14\xc0", 2, {"unexpected_answer": 1}),
        (b"\x14\x00request", 3, {"stranger": 1}),
        (b"\x14\x40answer", 3, {"stranger": 1}),
        (b"\x14\xc0", 3, {"stranger": 1}),
    ],
)
def test_record_that_is_no_answer_is_counted(
    records: bytes, source: int, dropped: dict[str, int]
) -> None:
    rig = ends()
    hello = Hello(WIRE_VERSION, 1, fleet().digest).encode()
    rig[1].hear(hello + records, 0, source=source, destination=1)
    assert rig[1].engine.stats.dropped == dropped


def test_request_that_does_not_decode_is_answered_with_an_error() -> None:
    rig = ends()
    call_id = call(rig, {"n": 1}, stream_id=21)
    sent = rig[1].send(0)
    assert sent is not None
    assert sent.frame_bytes[-3:] == b"\x15\x00\x01"
    rig[2].hear(sent.frame_bytes[:-1] + b"\x18", 0, source=1, destination=2)
    rig.exchange()
    ((failed, failure, _),) = failures(rig)
    assert (failed, failure) == (call_id, CallFailure.BAD_REQUEST)


@pytest.mark.parametrize("payload", [b"", b"\x18", b"\x0a", b"\x01\x01"])
def test_response_that_does_not_decode_fails_the_call(payload: bytes) -> None:
    rig = ends()
    call_id = call(rig, {"n": 1}, stream_id=21)
    rig.exchange()
    hello = Hello(WIRE_VERSION, 1, fleet().digest).encode()
    rig[1].hear(hello + b"\x15\x00\x41" + payload, 1, source=2, destination=1)
    ((failed, failure, _),) = failures(rig)
    assert (failed, failure) == (call_id, CallFailure.BAD_RESPONSE)


@pytest.mark.parametrize("payload", [b"", b"\x00", b"\x63odd", b"\x01\xff\xff"])
def test_error_that_does_not_decode_is_an_error_without_text(payload: bytes) -> None:
    rig = ends()
    call_id = call(rig)
    rig.exchange()
    hello = Hello(WIRE_VERSION, 1, fleet().digest).encode()
    rig[1].hear(hello + b"\x14\x00\x81" + payload, 1, source=2, destination=1)
    assert failures(rig) == [(call_id, CallFailure.HANDLER, "")]


# Repetition


@pytest.mark.parametrize("mtu_bytes", [8, 9, 12, 32, 64, 255])
def test_error_fits_a_frame_whatever_its_text(mtu_bytes: int) -> None:
    rig = ends(mtu_bytes=mtu_bytes)
    call_id = call(rig, b"")
    rig.run(1)
    rig[2].engine.reply_error(requests(rig)[0].call, CallFailure.HANDLER, "x" * 100, rig.now)
    rig.run(5)
    ((failed, failure, text),) = failures(rig)
    assert (failed, failure) == (call_id, CallFailure.HANDLER)
    assert "x" * min(48, max(0, mtu_bytes - 9)) == text[: min(48, max(0, mtu_bytes - 9))]


@pytest.mark.parametrize("mtu_bytes", [8, 32, 64])
def test_largest_response_fits_a_frame(mtu_bytes: int) -> None:
    rig = ends(mtu_bytes=mtu_bytes)
    call(rig, b"")
    rig.run(1)
    largest = mtu_bytes - 3 - 3
    with pytest.raises(PayloadTooLargeError):
        answer(rig, bytes(largest + 1))
    rig.run(1)
    assert len(failures(rig)) == 1
    call(rig, b"")
    rig.run(1)
    answer(rig, bytes(largest))
    rig.run(5)
    assert [value for _, value in responses(rig)] == [bytes(largest)]
