"""Calls: 64 numbers, each used again only when its last use is closed at the server."""

import random
from itertools import count
from typing import Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from tests.core.test_taken import Server, key
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.sizes import SIZES, Numbering
from zacoustic.core.engine.events import CallFailure
from zacoustic.core.transport.calls.calls import ClientCalls
from zacoustic.core.transport.exchanges.numbers import (
    NumberWindow,
)
from zacoustic.core.transport.exchanges.repeating import Repetition
from zacoustic.core.wire.calls import (
    CallKind,
    decode_call_byte,
    decode_error,
    decode_name,
    encode_call_byte,
    encode_error,
    encode_name,
)
from zacoustic.core.wire.exchanges import LONGEST_ERROR_TEXT_BYTES
from zacoustic.core.wire.goals import GoalFailure, GoalRefusal, decode_refusal
from zacoustic.errors import QueueFullError

SETTLING_NS = 5
WINDOW = SIZES.calls.window


def request(*, sent_at: int | None = None, on_air: bool = False) -> Repetition:
    """Return a request that was last sent then, or is just being sent."""
    repetition = Repetition((20, 1, 2), cast("Any", None), Qos(), until=1 << 60)
    repetition.tries = int(sent_at is not None or on_air)
    repetition.sent_at, repetition.on_air = sent_at or 0, int(on_air)
    return repetition


def begin(calls: ClientCalls, now: int = 0) -> tuple[int, int]:
    return calls.begin(20, 2, now)


# On the wire


def test_call_byte_holds_kind_and_number() -> None:
    seen = set()
    for kind in CallKind:
        for number in range(SIZES.calls.count):
            byte = encode_call_byte(kind, number)
            assert decode_call_byte(byte) == (kind, number)
            seen.add(byte)
    assert seen == set(range(256))


@given(st.sampled_from(CallFailure), st.text(), st.integers(-5, 60))
def test_error_text_is_cut_at_a_character(failure: CallFailure, text: str, longest: int) -> None:
    payload = encode_error(failure, text, longest)
    assert len(payload) <= 1 + max(0, min(longest, LONGEST_ERROR_TEXT_BYTES))
    decoded = decode_error(payload)
    assert decoded is not None
    assert decoded[0] is failure
    assert text.startswith(decoded[1])


@pytest.mark.parametrize("payload", [b"", b"\x00text", b"\x09text"])
def test_payload_that_is_no_error_is_none(payload: bytes) -> None:
    assert decode_error(payload) is None


def test_text_that_is_no_utf_8_leaves_the_failure() -> None:
    assert decode_error(b"\x02\xff") == (CallFailure.NO_SERVER, "")
    assert decode_refusal(b"\x09\xff") == GoalRefusal(GoalFailure.CANCEL_REFUSED, "")
    assert decode_refusal(b"\x0a\x03\xff") == GoalRefusal(GoalFailure.CANCEL_REFUSED, "", 3)


def test_text_that_is_no_unicode_is_sent_with_a_question_mark() -> None:
    """A path or an error of the operating system may have it."""
    error = encode_error(CallFailure.HANDLER, "no \udcff")
    assert decode_error(error) == (CallFailure.HANDLER, "no ?")
    refusal = GoalRefusal(GoalFailure.REJECTED, "no \udcff").encode()
    assert decode_refusal(refusal) == GoalRefusal(GoalFailure.REJECTED, "no ?")


def test_a_goal_goes_on_when_nobody_knows_which_attempt_to_cancel_is_refused() -> None:
    assert decode_refusal(b"\x0a") is None
    assert decode_refusal(b"\xee") == GoalRefusal(GoalFailure.REJECTED, "")


@given(st.sampled_from(CallKind), st.integers(0, 0xFFFF), st.integers(0, 0xFFFF), st.binary())
def test_named_answer_is_for_one_life(
    kind: CallKind, epoch: int, other: int, payload: bytes
) -> None:
    content = encode_name(kind, epoch) + payload
    assert decode_name(content, epoch) is kind
    if (epoch ^ other) & 0x3F:
        assert decode_name(content, other) is None
    assert decode_name(b"", epoch) is None


# Numbers


def test_as_many_calls_as_the_window_holds_are_under_way() -> None:
    calls = ClientCalls(1, count(1), SIZES.calls)
    assert [begin(calls)[1] for _ in range(WINDOW)] == list(range(WINDOW))
    with pytest.raises(QueueFullError, match="16 calls to node 2 are under way"):
        begin(calls)
    calls.begin(21, 2, 0)
    calls.begin(20, 3, 0)


def test_numbers_go_round() -> None:
    assert begin(ClientCalls(3, count(1), SIZES.calls))[1] == 46
    calls = ClientCalls(26, count(1), SIZES.calls)
    assert [begin(calls)[1] for _ in range(3)] == [63, 0, 1]


@pytest.mark.parametrize("numbering", [SIZES.calls, SIZES.goals])
def test_successive_epochs_begin_with_all_numbers_in_turn(numbering: Numbering) -> None:
    firsts = {numbering.first(epoch) for epoch in range(9, 9 + numbering.count)}
    assert firsts == set(range(numbering.count))


def test_window_moves_when_its_oldest_call_has_ended_and_its_request_has_settled() -> None:
    calls = ClientCalls(1, count(1), SIZES.calls)
    calls.settling_ns = SETTLING_NS
    first, second, *_ = [begin(calls)[0] for _ in range(WINDOW)]
    calls.attach(first, request(sent_at=20))
    calls.respond(second, "value")
    with pytest.raises(QueueFullError):
        begin(calls, 20)
    calls.fail(first, CallFailure.TIMED_OUT, "")
    with pytest.raises(QueueFullError):
        begin(calls, 24)
    assert begin(calls, 25)[1] == WINDOW
    assert begin(calls, 25)[1] == WINDOW + 1
    with pytest.raises(QueueFullError):
        begin(calls, 25)


def test_request_that_is_still_being_sent_holds_the_window() -> None:
    calls = ClientCalls(1, count(1), SIZES.calls)
    first, *_ = [begin(calls)[0] for _ in range(WINDOW)]
    sending = request(on_air=True)
    calls.attach(first, sending)
    calls.fail(first, CallFailure.CANCELLED, "")
    with pytest.raises(QueueFullError):
        begin(calls, 1000)
    sending.on_air = 0
    begin(calls, 1000)


def test_numbers_are_exhausted_until_an_answer_proves_that_old_ones_are_closed() -> None:
    numbers = NumberWindow(SIZES.calls, 1)
    for index in range(SIZES.calls.count):
        assert numbers.may_begin(index, 0)
        assert numbers.take()[0] == index
        numbers.ended(index, ())
    assert numbers.is_stuck
    assert not numbers.may_begin(1 << 50, 0)
    # Of index 60 the server would close 12…44: whether 0…11 are closed is not known.
    numbers.proved(60, 0)
    assert numbers.is_stuck
    numbers.proved(40, 0)
    assert not numbers.is_stuck
    for expected in range(25):
        index, number = numbers.take()
        numbers.ended(index, ())
        assert number == expected
    assert numbers.is_stuck
    numbers.proved(60, 0)
    assert not numbers.is_stuck


def after_all_numbers() -> ClientCalls:
    """Use each call number once, unsent; return the calls when number 0 is next again."""
    calls = ClientCalls(1, count(1), SIZES.calls)
    calls.settling_ns = SETTLING_NS
    for number in range(SIZES.calls.count):
        call_id, _ = begin(calls, 10)
        if number == WINDOW:
            # It closes number 0, whose answer may have been sent again just before.
            calls.proved(call_id, 10)
        calls.fail(call_id, CallFailure.CANCELLED, "")
    return calls


def test_number_is_used_again_only_when_no_answer_to_its_last_use_can_arrive() -> None:
    calls = after_all_numbers()
    with pytest.raises(QueueFullError):
        begin(calls, 10 + SETTLING_NS - 1)
    assert not calls.needs_new_epoch(20, 2)
    assert begin(calls, 10 + SETTLING_NS)[1] == 0


def test_number_is_not_used_again_while_a_confirm_of_its_last_use_is_under_way() -> None:
    calls = after_all_numbers()
    # A late answer is confirmed just before the number may be used again.
    calls.confirms(2, 20, 0, 10 + SETTLING_NS - 1)
    with pytest.raises(QueueFullError):
        begin(calls, 10 + 2 * SETTLING_NS - 2)
    assert begin(calls, 10 + 2 * SETTLING_NS - 1)[1] == 0


def test_new_epoch_frees_all_numbers_if_no_call_is_under_way() -> None:
    calls = ClientCalls(1, count(1), SIZES.calls)
    for _ in range(SIZES.calls.count):
        call_id, _ = begin(calls)
        assert not calls.needs_new_epoch(20, 2)
        calls.fail(call_id, CallFailure.TIMED_OUT, "")
    other, _ = calls.begin(20, 3, 0)
    assert not calls.needs_new_epoch(20, 2)
    calls.fail(other, CallFailure.TIMED_OUT, "")
    assert calls.needs_new_epoch(20, 2)
    calls.begin_epoch(2)
    assert begin(calls)[1] == 23


class NumbersInTheMedium(RuleBasedStateMachine):
    """One client and one server, where anything may be lost, late, or come twice.

    The server is the real one, without the forgetting by time, which only comes when nothing can
    arrive any more. Requests and answers live for the settling time after each transmission. Each
    rule is a spell of weather, since a number comes again only after dozens of calls.
    """

    def __init__(self) -> None:
        super().__init__()
        self.now = 0
        self.server = Server()
        self.open: dict[int, tuple[int, Repetition]] = {}
        """Index → number and request of the calls that have not ended."""
        self.requests: list[tuple[int, int, int]] = []
        """``(index, number, until)``: what can still arrive."""
        self.answers: list[tuple[int, int, int]] = []
        self.taken: dict[int, int] = {}
        """Number → index of what the server remembers."""
        self.executed: set[int] = set()

    @initialize(epoch=st.integers(1, SIZES.calls.count))
    def start(self, epoch: int) -> None:
        self.numbers = NumberWindow(SIZES.calls, epoch)

    @rule(
        seed=st.integers(0, 1 << 30),
        steps=st.integers(1, 300),
        departs=st.sampled_from((0.1, 1.0)),
        arrives=st.sampled_from((0.0, 0.02, 0.2, 1.0)),
        returns=st.sampled_from((0.0, 0.02, 0.2, 1.0)),
        patience=st.sampled_from((0.0, 0.1, 1.0)),
        keeps=st.sampled_from((0, 1)),
        pace=st.sampled_from((0.02, 0.2)),
    )
    def spell(
        self,
        seed: int,
        steps: int,
        departs: float,
        arrives: float,
        returns: float,
        patience: float,
        keeps: int,
        pace: float,
    ) -> None:
        rng = random.Random(seed)
        for _ in range(steps):
            self.begin()
            if rng.random() < departs:
                self.send(rng)
            if rng.random() < arrives:
                self.receive(rng)
            if rng.random() < returns:
                self.be_answered(rng)
            if rng.random() >= patience and len(self.open) > keeps:
                self.end(rng.choice(sorted(self.open)[: len(self.open) - keeps]))
            if rng.random() < pace:
                self.wait(rng.randint(1, SETTLING_NS))

    @rule()
    def calm(self) -> None:
        self.wait(SETTLING_NS)

    def begin(self) -> None:
        if self.numbers.may_begin(self.now, SETTLING_NS):
            index, number = self.numbers.take()
            assert number not in {other for other, _ in self.open.values()}
            self.open[index] = (number, request())

    def send(self, rng: random.Random) -> None:
        if self.open:
            index = rng.choice(sorted(self.open))
            number, repetition = self.open[index]
            repetition.tries += 1
            repetition.sent_at = self.now
            self.requests.append((index, number, self.now + SETTLING_NS))

    def receive(self, rng: random.Random) -> None:
        if not self.requests:
            return
        index, number, _ = rng.choice(self.requests)
        if self.server.table.get(key(number)) is not None:
            assert self.taken[number] == index, "taken for a call that is long over"
        else:
            assert index not in self.executed, "executed twice"
            self.executed.add(index)
            assert self.server.take(key(number)) is not None
            self.taken[number] = index
            known = {taken.key.number for taken in self.server.table.of(1)}
            self.taken = {each: self.taken[each] for each in self.taken if each in known}
        answered = rng.choice(sorted(self.taken))
        self.answers.append((self.taken[answered], answered, self.now + SETTLING_NS))

    def be_answered(self, rng: random.Random) -> None:
        if not self.answers:
            return
        index, number, _ = rng.choice(self.answers)
        for waiting, (its_number, _) in list(self.open.items()):
            if its_number == number:
                assert waiting == index, "answered with the answer to another call"
                self.numbers.proved(index, self.now + SETTLING_NS)
                if rng.random() < 0.5:
                    self.end(index)

    def wait(self, by: int) -> None:
        self.now += by
        self.requests = [each for each in self.requests if each[2] > self.now]
        self.answers = [each for each in self.answers if each[2] > self.now]

    def end(self, index: int) -> None:
        _, repetition = self.open.pop(index)
        self.numbers.ended(index, [repetition])


TestNumbersInTheMedium = NumbersInTheMedium.TestCase
TestNumbersInTheMedium.settings = settings(stateful_step_count=15, max_examples=100, deadline=None)


# Clients


def test_answer_finds_its_call_by_server_stream_and_number() -> None:
    calls = ClientCalls(1, count(1), SIZES.calls)
    call_id, number = begin(calls)
    assert calls.find(2, 20, number) == call_id
    assert calls.find(3, 20, number) is None
    assert calls.find(2, 21, number) is None
    assert calls.locate(call_id) == (20, 2, number)
    calls.respond(call_id, None)
    assert calls.find(2, 20, number) is None
    assert calls.locate(call_id) is None
