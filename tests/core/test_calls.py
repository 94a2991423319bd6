"""Calls: 64 numbers, each used once until no answer to its last use can arrive."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.calls import (
    CALL_NUMBERS,
    LONGEST_ERROR_TEXT_BYTES,
    Answer,
    CallKind,
    ClientCalls,
    ServerCalls,
    decode_call_byte,
    decode_error,
    encode_call_byte,
    encode_error,
)
from zacoustic.core.events import CallFailure, CallKey
from zacoustic.errors import QueueFullError

ANSWER = Answer(CallKind.RESPONSE, b"done")
KEY = CallKey(client=1, epoch=1, stream_id=20, number=0)


def begin(
    calls: ClientCalls, now: int = 0, *, wait: int = 100, served: int = 100
) -> tuple[int, int]:
    return calls.begin(20, 2, deadline_at=now + wait, served_ns=served, now=now)


def test_call_byte_holds_kind_and_number() -> None:
    seen = set()
    for kind in CallKind:
        for number in range(CALL_NUMBERS):
            byte = encode_call_byte(kind, number)
            assert decode_call_byte(byte) == (kind, number)
            seen.add(byte)
    assert seen == set(range(256))


@given(st.sampled_from(CallFailure), st.text())
def test_error_text_is_cut_at_a_character(failure: CallFailure, text: str) -> None:
    payload = encode_error(failure, text)
    assert len(payload) <= 1 + LONGEST_ERROR_TEXT_BYTES
    decoded = decode_error(payload)
    assert decoded is not None
    assert decoded[0] is failure
    assert text.startswith(decoded[1])


@pytest.mark.parametrize("payload", [b"", b"\x00text", b"\x08text", b"\x01\xff"])
def test_payload_that_is_no_error_is_none(payload: bytes) -> None:
    assert decode_error(payload) is None


def test_64_calls_have_64_numbers_and_the_next_is_refused() -> None:
    calls = ClientCalls()
    assert sorted(begin(calls)[1] for _ in range(CALL_NUMBERS)) == list(range(CALL_NUMBERS))
    with pytest.raises(QueueFullError, match="all 64 call numbers to node 2 are in use"):
        begin(calls)
    calls.begin(21, 2, deadline_at=9, served_ns=9, now=0)
    calls.begin(20, 3, deadline_at=9, served_ns=9, now=0)


def test_lives_in_a_row_begin_with_numbers_of_their_own() -> None:
    assert begin(ClientCalls(first_number=40))[1] == 40
    calls = ClientCalls(first_number=63)
    assert [begin(calls)[1] for _ in range(3)] == [63, 0, 1]


def test_number_of_an_answered_call_rests_for_two_settling_times() -> None:
    calls = ClientCalls()
    first, *_ = [begin(calls)[0] for _ in range(CALL_NUMBERS)]
    calls.respond(first, "value", now=10, settling_ns=5)
    with pytest.raises(QueueFullError):
        begin(calls, 19)
    assert begin(calls, 20)[1] == 0


@pytest.mark.parametrize("failure", [CallFailure.TIMED_OUT, CallFailure.CANCELLED])
def test_number_of_an_unanswered_call_rests_until_the_server_has_given_it_up(
    failure: CallFailure,
) -> None:
    calls = ClientCalls()
    # The caller waits for 10 only; the server, by its own definition, works for 100.
    first, *_ = [begin(calls, wait=10)[0] for _ in range(CALL_NUMBERS)]
    calls.fail(first, failure, "", now=10, settling_ns=5)
    with pytest.raises(QueueFullError):
        begin(calls, 10 + 100 + 2 * 5 - 1)
    assert begin(calls, 10 + 100 + 2 * 5)[1] == 0


def test_answer_finds_its_call_by_server_stream_and_number() -> None:
    calls = ClientCalls()
    call_id, number = begin(calls)
    assert calls.find(2, 20, number) == call_id
    assert calls.find(3, 20, number) is None
    assert calls.find(2, 21, number) is None
    assert calls.locate(call_id) == (20, 2, number)
    calls.respond(call_id, None, now=1, settling_ns=1)
    assert calls.find(2, 20, number) is None
    assert calls.locate(call_id) is None


def test_deadlines_come_in_their_order() -> None:
    calls = ClientCalls()
    late, soon = begin(calls, wait=100)[0], begin(calls, wait=10)[0]
    assert calls.next_deadline_at() == 10
    assert calls.due(9) == []
    assert calls.due(10) == [soon]
    assert calls.due(100) == [late, soon]


def test_repeated_request_runs_once_and_gets_the_first_answer_again() -> None:
    calls = ServerCalls()
    assert calls.take(KEY, timeout_ns=100, now=0) is True
    assert calls.take(KEY, timeout_ns=100, now=1) is False
    assert calls.answer(KEY, ANSWER, now=2, settling_ns=10) == 100
    assert calls.take(KEY, timeout_ns=100, now=3) == ANSWER
    assert calls.answer(KEY, ANSWER, now=3, settling_ns=10) is None


def test_answered_call_is_forgotten_after_the_settling_time() -> None:
    calls = ServerCalls()
    calls.take(KEY, timeout_ns=100, now=0)
    calls.answer(KEY, ANSWER, now=2, settling_ns=10)
    assert calls.take(KEY, timeout_ns=100, now=11) == ANSWER
    assert calls.take(KEY, timeout_ns=100, now=12) is True


def test_answer_after_the_deadline_is_worthless() -> None:
    calls = ServerCalls()
    calls.take(KEY, timeout_ns=100, now=0)
    assert calls.answer(KEY, ANSWER, now=100, settling_ns=10) is None


def test_calls_of_a_former_life_are_given_up_and_never_run_again() -> None:
    calls = ServerCalls()
    new = CallKey(client=1, epoch=2, stream_id=20, number=0)
    other = CallKey(client=3, epoch=1, stream_id=20, number=0)
    for key in (KEY, other, new):
        assert calls.take(key, timeout_ns=100, now=0) is True
    assert calls.abandon(1, 2, now=1, settling_ns=10) == [KEY]
    assert calls.answer(KEY, ANSWER, now=2, settling_ns=10) is None
    assert calls.take(KEY, timeout_ns=100, now=3) is False
    assert calls.answer(new, ANSWER, now=2, settling_ns=10) == 100
    assert calls.answer(other, ANSWER, now=2, settling_ns=10) == 100


def test_one_client_holds_a_bounded_number_of_calls_whatever_epochs_it_claims() -> None:
    calls = ServerCalls()
    taken = [
        calls.take(CallKey(1, epoch, 20, epoch % 64), timeout_ns=10**9, now=epoch)
        for epoch in range(5000)
    ]
    assert sum(each is True for each in taken) == 2 * CALL_NUMBERS
    assert calls.take(CallKey(2, 1, 20, 0), timeout_ns=100, now=5000) is True
