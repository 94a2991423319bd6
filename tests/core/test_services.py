"""Services: a call ends in exactly one answer, and runs at most once."""

import pytest

from tests.core.rig import Rig, link
from zacoustic.core.calls import CALL_NUMBERS, WINDOW
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.events import (
    CallFailed,
    CallFailure,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.frame import Hello
from zacoustic.core.linktypes import LinkState, Transmission
from zacoustic.core.streams import StreamTable
from zacoustic.core.streamspecs import ServiceSpec, TopicSpec
from zacoustic.core.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import PayloadInvalidError, PayloadTooLargeError, QueueFullError

NODES = {1: "shore", 2: "auv"}
TYPES = TypeTable([TypeSpec(name="N", fields=(FieldSpec(name="n", type="uint8", range=(0, 9)),))])


def fleet(server: int = 2, *, journal: bool = True, name: str = "arm") -> StreamTable:
    return StreamTable(
        [
            ServiceSpec(stream_id=20, name=name, server=server, timeout_s=10, journal=journal),
            ServiceSpec(
                stream_id=21,
                name="count",
                server=2,
                request_type="N",
                response_type="N",
                timeout_s=10,
            ),
            TopicSpec(stream_id=1, name="a"),
        ],
        types=TYPES,
        nodes=NODES,
    )


def ends(**settings: float) -> Rig:
    return Rig({1: fleet(), 2: fleet()}, capabilities=link(**settings))


def acquainted() -> Rig:
    """Return two ends that have confirmed each other."""
    rig = ends()
    rig.publish(1, 1, b"a")
    rig.publish(2, 1, b"b")
    rig.run(1)
    rig.publish(1, 1, b"a")
    rig.publish(2, 1, b"b")
    rig.run(1)
    assert rig[1].engine.peers() == {2: True}
    assert rig[2].engine.peers() == {1: True}
    rig.frames.clear()
    return rig


def call(rig: Rig, value: object = b"please", *, stream_id: int = 20, **settings: float) -> int:
    return rig[1].engine.call(stream_id, value, rig.now, **settings)


def requests(rig: Rig) -> list[RequestReceived]:
    return rig[2].got(RequestReceived)


def answer(rig: Rig, value: object = b"done", number: int = -1) -> bool:
    return rig[2].engine.reply(requests(rig)[number].call, value, rig.now)


def failures(rig: Rig) -> list[tuple[int, CallFailure, str]]:
    return [(event.call_id, event.failure, event.text) for event in rig[1].got(CallFailed)]


def entries(rig: Rig) -> list[str]:
    return [name for name in rig[2].journal if name.startswith("call/")]


def responses(rig: Rig) -> list[tuple[int, object]]:
    return [(event.call_id, event.value) for event in rig[1].got(ResponseReceived)]


def sent_by(rig: Rig, address: int) -> list[bytes]:
    return [sent.frame_bytes for source, sent in rig.frames if source == address]


def to_nobody(source: int, node: int, transmission: Transmission) -> bool:
    return False


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
    assert 10 < len(rig.frames) < 200
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
    rig[2].hear(Hello(1, 1, fleet().digest).encode() + records, 0, source=1)
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
        (b"\x14\x00request", 3, {"not_subscriber": 1}),
        (b"\x14\x40answer", 3, {"not_publisher": 1}),
        (b"\x14\xc0", 3, {"not_publisher": 1}),
    ],
)
def test_record_that_is_no_answer_is_counted(
    records: bytes, source: int, dropped: dict[str, int]
) -> None:
    rig = ends()
    rig[1].hear(Hello(1, 1, fleet().digest).encode() + records, 0, source=source)
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
    rig[1].hear(Hello(1, 1, fleet().digest).encode() + b"\x15\x00\x41" + payload, 1, source=2)
    ((failed, failure, _),) = failures(rig)
    assert (failed, failure) == (call_id, CallFailure.BAD_RESPONSE)


@pytest.mark.parametrize("payload", [b"", b"\x00", b"\x63odd", b"\x01\xff\xff"])
def test_error_that_does_not_decode_is_an_error_without_text(payload: bytes) -> None:
    rig = ends()
    call_id = call(rig)
    rig.exchange()
    rig[1].hear(Hello(1, 1, fleet().digest).encode() + b"\x14\x00\x81" + payload, 1, source=2)
    assert failures(rig) == [(call_id, CallFailure.HANDLER, "")]


# Repetition


def test_request_is_repeated_until_the_server_has_confirmed_it() -> None:
    rig = acquainted()
    call(rig)
    rig.run(0.1, to_nobody)
    assert len(sent_by(rig, 1)) > 2
    rig.run(0.5)
    assert sent_by(rig, 2) == [b"\x14\xc0"]
    rig.frames.clear()
    rig.run(5)
    assert rig.frames == []
    answer(rig)
    rig.exchange()
    assert len(responses(rig)) == len(requests(rig)) == 1


def test_answer_is_repeated_until_the_client_has_confirmed_it() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.exchange()
    answer(rig)
    rig.run(0.1, lambda source, node, transmission: source == 2)
    repeated = [sent for sent in sent_by(rig, 2) if sent != b"\x14\xc0"]
    assert len(repeated) > 3
    assert set(repeated) == {b"\x14\x40done"}
    assert set(sent_by(rig, 1)[1:]) == {b"\x14\xc0"}
    assert responses(rig) == [(call_id, b"done")]
    rig.run(0.5)
    rig.frames.clear()
    rig.run(60)
    assert rig.frames == []
    assert rig[1].engine.is_idle
    assert rig[2].engine.is_idle


def test_calls_that_are_due_together_share_frames() -> None:
    rig = acquainted()
    for number in range(WINDOW):
        call(rig, b"%d" % number)
    rig.run(0.5)
    assert len(sent_by(rig, 1)) == 2
    for number in range(WINDOW):
        answer(rig, b"re %d" % number, number=number)
    rig.run(1)
    assert [value for _, value in responses(rig)] == [b"re %d" % each for each in range(WINDOW)]
    assert len(rig.frames) < 16


def test_cancelled_request_is_not_repeated() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.run(0.05, to_nobody)
    rig[1].engine.cancel(call_id, rig.now)
    rig.frames.clear()
    rig.run(60)
    assert rig.frames == []
    assert rig[1].got(CallFailed) == []


def test_record_that_does_not_fit_a_new_link_is_not_repeated() -> None:
    rig = acquainted()
    call_id = call(rig, b"x" * 50)
    rig.exchange(to_nobody)
    rig[1].engine.handle_link_state(LinkState.UP, rig.now, link(mtu_bytes=32))
    rig[1].capabilities = link(mtu_bytes=32)
    rig.run(20)
    assert failures(rig) == [(call_id, CallFailure.TIMED_OUT, "no answer before the deadline")]


# Several


def test_several_clients_have_the_same_numbers() -> None:
    rig = Rig({address: fleet() for address in (1, 2, 3)})
    for client in (1, 3):
        rig[client].engine.call(20, b"from %d" % client, rig.now)
    rig.exchange()
    assert [(each.call.client, each.value) for each in requests(rig)] == [
        (1, b"from 1"),
        (3, b"from 3"),
    ]
    for request in requests(rig):
        rig[2].engine.reply(request.call, b"re " + request.value, rig.now)
    rig.run(1)
    for client in (1, 3):
        assert [e.value for e in rig[client].got(ResponseReceived)] == [b"re from %d" % client]


def test_hundreds_of_calls_go_round_the_numbers() -> None:
    rig = acquainted()
    for number in range(5 * CALL_NUMBERS):
        call(rig, b"%d" % number)
        rig.run(0.5)
        assert answer(rig, b"re %d" % number)
        rig.run(0.5)
    assert [value for _, value in responses(rig)] == [
        b"re %d" % number for number in range(5 * CALL_NUMBERS)
    ]
    assert len(requests(rig)) == 5 * CALL_NUMBERS
    assert len(entries(rig)) <= CALL_NUMBERS
    assert rig[1].engine.epoch == 1


def test_client_begins_an_epoch_when_no_number_is_proved_free() -> None:
    rig = acquainted()
    for _ in range(CALL_NUMBERS):
        call(rig, timeout_s=0.01)
        rig.run(0.1, to_nobody)
    assert rig[1].engine.epoch == 1
    assert len(failures(rig)) == CALL_NUMBERS
    call_id = call(rig)
    assert rig[1].engine.epoch == 2
    rig.exchange()
    assert answer(rig)
    rig.run(1)
    assert responses(rig) == [(call_id, b"done")]
    assert requests(rig)[-1].call.epoch == 2


def test_number_that_is_not_proved_free_is_refused_while_another_call_is_under_way() -> None:
    rig = acquainted()
    call(rig, {"n": 1}, stream_id=21)
    for _ in range(CALL_NUMBERS):
        call(rig, timeout_s=0.01)
        rig.run(0.1, to_nobody)
    with pytest.raises(QueueFullError, match="no number is proved free"):
        call(rig)


# Lives


def test_first_answer_of_a_life_names_it_and_later_ones_do_not() -> None:
    rig = ends()
    call(rig)
    rig.exchange()
    answer(rig)
    rig.exchange()
    assert sent_by(rig, 2)[-1].endswith(b"\x14\x00\x41done")
    rig.run(1)
    rig.frames.clear()
    call(rig)
    rig.exchange()
    answer(rig, b"fine")
    rig.run(1)
    assert b"\x14\x41fine" in sent_by(rig, 2)
    assert [value for _, value in responses(rig)] == [b"done", b"fine"]


def test_answer_is_named_anew_when_the_request_comes_again_so() -> None:
    rig = acquainted()
    call(rig)
    rig.exchange()
    answer(rig)
    rig.exchange(to_nobody)
    assert sent_by(rig, 2)[-1] == b"\x14\x40done"
    rig[2].hear(Hello(1, 1, fleet().digest).encode() + b"\x14\x00please", rig.now, source=1)
    rig.exchange()
    assert sent_by(rig, 2)[-1].endswith(b"\x14\x00\x41done")
    assert len(requests(rig)) == len(responses(rig)) == 1


@pytest.mark.parametrize("number", range(CALL_NUMBERS))
def test_no_answer_to_a_former_life_is_taken_whatever_the_number(number: int) -> None:
    rig = acquainted()
    rig.restart(1, fleet())
    call(rig, b"second life")
    rig.exchange(to_nobody)
    # The server has not heard of the second life. It introduces itself, as to any stranger.
    records = bytes((0x14, 0x40 | number)) + b"to the first"
    rig[1].hear(Hello(1, 1, fleet().digest).encode() + records, rig.now, source=2)
    rig.now += seconds_to_ns(1)
    for kind in (0x40, 0x80, 0xC0):
        rig[1].hear(bytes((0x14, kind | number)) + b"\x01", rig.now, source=2)
        rig[1].hear(bytes((0x14, number, kind | 1)) + b"\x01", rig.now, source=2)
    assert rig[1].got(ResponseReceived) == []
    assert rig[1].got(CallFailed) == []
    assert rig[1].engine.stats.dropped["unexpected_answer"] == 7


def test_late_introduction_of_a_former_life_ends_no_call() -> None:
    rig = ends()
    first = Hello(1, 1, fleet().digest).encode()
    rig[2].hear(first + b"\x14\x00first life", 0, source=1)
    rig.restart(1, fleet())
    call_id = call(rig)
    rig.exchange()
    rig[2].hear(first + b"\x14\x00first life", rig.now, source=1)
    answer(rig, b"too early")
    rig.run(9)
    assert [each.value for each in requests(rig)] == [b"first life", b"please"]
    assert responses(rig) == [(call_id, b"too early")]


# The journal


def test_nothing_runs_and_nothing_is_confirmed_before_it_is_written_down() -> None:
    rig = acquainted()
    rig[2].commits = False
    call(rig)
    rig.run(0.1)
    assert len(sent_by(rig, 1)) > 2
    assert sent_by(rig, 2) == []
    assert requests(rig) == []
    rig[2].commits = True
    rig[2].settle()
    assert len(requests(rig)) == 1
    rig[2].commits = False
    answer(rig)
    rig.run(0.1)
    assert responses(rig) == []
    rig[2].commits = True
    rig[2].settle()
    rig.exchange()
    assert len(responses(rig)) == 1


def test_request_that_is_written_down_after_its_deadline_does_not_run() -> None:
    rig = acquainted()
    rig[2].commits = False
    call(rig)
    rig.run(11)
    rig[2].commits = True
    rig[2].settle()
    rig.run(60)
    assert requests(rig) == []
    assert entries(rig) == []


def test_request_that_was_not_written_down_runs_in_the_next_life() -> None:
    rig = acquainted()
    rig[2].commits = False
    call_id = call(rig)
    rig.run(0.1)
    rig.restart(2, fleet(), keeps=True)
    rig.run(1)
    assert len(requests(rig)) == 1
    answer(rig)
    rig.run(1)
    assert responses(rig) == [(call_id, b"done")]


def test_answer_survives_the_server() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.exchange()
    answer(rig, b"from the first life")
    rig.exchange(to_nobody)
    rig.restart(2, fleet(), keeps=True)
    rig.run(1)
    assert requests(rig) == []
    assert responses(rig) == [(call_id, b"from the first life")]
    rig.run(60)
    assert entries(rig) == []


def test_call_that_ran_when_the_server_died_is_unknown() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.exchange()
    assert len(requests(rig)) == 1
    rig.restart(2, fleet(), keeps=True)
    rig.run(1)
    assert requests(rig) == []
    assert failures(rig) == [(call_id, CallFailure.UNKNOWN, "")]
    rig.run(60)
    assert entries(rig) == []
    assert rig[2].engine.is_idle


def test_stored_calls_of_a_former_life_of_the_client_do_not_reach_the_present_one() -> None:
    rig = acquainted()
    call(rig, b"first life")
    rig.exchange()
    answer(rig, b"to the first life")
    rig.restart(1, fleet())
    rig.restart(2, fleet(), keeps=True)
    for number in range(CALL_NUMBERS - 23 + 1):
        call(rig, b"%d" % number, timeout_s=0.001)
        rig.run(0.01, lambda source, node, transmission: source == 2)
    assert requests(rig) == []
    assert responses(rig) == []


def test_calls_of_a_table_that_has_changed_are_dropped() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.exchange()
    answer(rig)
    rig.exchange(to_nobody)
    assert len(entries(rig)) == 1
    rig.restart(2, fleet(name="disarm"), keeps=True)
    assert entries(rig) == []
    rig.run(20)
    assert responses(rig) == []
    assert [each[:2] for each in failures(rig)] == [(call_id, CallFailure.TIMED_OUT)]


def test_stored_call_of_a_stream_that_is_gone_is_dropped() -> None:
    rig = acquainted()
    call(rig)
    rig.exchange()
    rig.restart(2, StreamTable([TopicSpec(stream_id=1, name="a")], nodes=NODES), keeps=True)
    assert entries(rig) == []


def test_service_without_journal_writes_nothing() -> None:
    rig = Rig({1: fleet(), 2: fleet(journal=False)})
    call(rig)
    rig.exchange()
    answer(rig)
    rig.run(1)
    assert len(responses(rig)) == 1
    assert entries(rig) == []


# Small frames


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
