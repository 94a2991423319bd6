"""Calls across the water: each caller hears exactly one end of it, and each runs at most once."""

import random
from collections.abc import Callable
from functools import partial

import pytest

from tests.virtual.fleet import line, settling_s
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    Event,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import Tag
from zacoustic.errors import QueueFullError
from zacoustic.testing.virtual import VirtualNetwork


def fleet(nodes: int = 2, server: int = 1) -> StreamTable:
    return StreamTable(
        [
            ServiceSpec(stream_id=20, name="arm", server=server, timeout_s=60),
            TopicSpec(stream_id=1, name="a", qos=Qos(depth=5)),
        ],
        nodes={address: f"n{address}" for address in range(1, nodes + 1)},
    )


class Bench:
    """A network whose node 1 serves, and what became of each call."""

    def __init__(
        self,
        nodes: int = 2,
        *,
        tables: dict[int, StreamTable] | None = None,
        serve: Callable[["Bench", RequestReceived], None] | None = None,
        seed: int = 1,
        disturb: Callable[[int, int, int], list[float]] | None = None,
        **settings: object,
    ) -> None:
        self.ended: dict[tuple[int, int], list[Event]] = {}
        self.executed: list[tuple[int, bytes]] = []
        self._serve = serve or later(0)
        medium = line(
            *(300.0 * number for number in range(nodes)), channel="none", seed=seed, **settings
        )
        self.medium = VirtualNetwork(
            medium, tables or fleet(nodes), deliver=self._deliver, disturb=disturb
        )

    def call(self, address: int, text: bytes, timeout_s: float | None = None) -> int:
        """Call from a node; returns the call id."""
        return self.medium.apply(
            address, lambda engine, now: engine.call(20, text, now, timeout_s=timeout_s)
        )

    def reply(self, event: RequestReceived, text: bytes) -> bool:
        """Answer from node 1."""
        return self.medium.apply(1, lambda engine, now: engine.reply(event.call, text, now))

    def fail(self, event: RequestReceived, failure: CallFailure, text: str) -> bool:
        """Answer from node 1 with an error."""
        return self.medium.apply(
            1, lambda engine, now: engine.reply_error(event.call, failure, text, now)
        )

    def end(self, address: int, call_id: int) -> Event:
        """Return the one event that ended a call."""
        (event,) = self.ended[address, call_id]
        return event

    def failure(self, address: int, call_id: int) -> tuple[CallFailure, str]:
        """Return why a call failed."""
        event = self.end(address, call_id)
        assert isinstance(event, CallFailed)
        return event.failure, event.text

    def _deliver(self, node: int, event: Event) -> None:
        if isinstance(event, RequestReceived):
            self.executed.append((event.call.client, event.value))
            self._serve(self, event)
        elif isinstance(event, CallFailed | ResponseReceived):
            self.ended.setdefault((node, event.call_id), []).append(event)


def later(delay_s: float) -> Callable[[Bench, RequestReceived], None]:
    """Return a server that takes its time."""

    def serve(bench: Bench, event: RequestReceived) -> None:
        at_s = bench.medium.now / 1e9 + delay_s
        bench.medium.at(at_s, lambda: bench.reply(event, b"re " + event.value))

    return serve


def failing(failure: CallFailure, text: str) -> Callable[[Bench, RequestReceived], None]:
    """Return a server that answers with an error."""

    def serve(bench: Bench, event: RequestReceived) -> None:
        bench.fail(event, failure, text)

    return serve


def test_several_clients_get_their_own_answers_at_once() -> None:
    bench = Bench(5, serve=later(30))
    calls: dict[tuple[int, int], int] = {}

    def call(address: int) -> None:
        for number in range(3):
            calls[address, number] = bench.call(address, b"%d.%d" % (address, number))

    for address in range(2, 6):
        bench.medium.at(5.0 * address, partial(call, address))
    bench.medium.run(until_s=200)
    for (address, number), call_id in calls.items():
        event = bench.end(address, call_id)
        assert isinstance(event, ResponseReceived)
        assert event.value == b"re %d.%d" % (address, number)
    assert len(calls) == 12
    assert bench.medium.is_quiet


def test_answer_arrives_after_a_late_frame_of_a_former_life_of_the_server() -> None:
    bench = Bench(serve=later(30))
    for number in range(3):
        bench.medium.at(100 * number, partial(bench.call, 2, b"%d" % number))
    # The client does not know any more that the server knows it; the server does not know that.
    frame = Tag(7).encode() + b"\x01x"
    stray = ReceivedFrame(frame_bytes=frame, received_at=215 * 10**9, source=1)
    bench.medium.at(
        215, lambda: bench.medium.apply(2, lambda engine, now: engine.handle_frame(stray, now))
    )
    bench.medium.run(until_s=400)
    ends = [bench.end(2, call_id) for call_id in (1, 2, 3)]
    answers = [end.value for end in ends if isinstance(end, ResponseReceived)]
    assert answers == [b"re 0", b"re 1", b"re 2"]
    assert [text for _, text in bench.executed] == [b"0", b"1", b"2"]


def test_error_of_the_handler_reaches_the_caller() -> None:
    bench = Bench(serve=failing(CallFailure.HANDLER, "no arm"))
    call_id = bench.call(2, b"x")
    bench.medium.run(until_s=100)
    assert bench.failure(2, call_id) == (CallFailure.HANDLER, "no arm")


def test_nobody_who_serves_is_told() -> None:
    bench = Bench(serve=failing(CallFailure.NO_SERVER, ""))
    call_id = bench.call(2, b"x")
    bench.medium.run(until_s=100)
    assert bench.failure(2, call_id) == (CallFailure.NO_SERVER, "")


def test_server_that_is_not_there_is_a_time_out_at_the_deadline() -> None:
    bench = Bench(tables={2: fleet()})
    call_id = bench.call(2, b"x", timeout_s=25)
    bench.medium.run(until_s=24.9)
    assert bench.ended == {}
    bench.medium.run(until_s=25)
    assert bench.failure(2, call_id)[0] is CallFailure.TIMED_OUT
    bench.medium.run(until_s=60)
    assert bench.medium.is_quiet


def test_answer_after_the_deadline_is_not_sent() -> None:
    bench = Bench(serve=later(61))
    call_id = bench.call(2, b"x")
    bench.medium.run(until_s=300)
    assert bench.failure(2, call_id)[0] is CallFailure.TIMED_OUT
    assert bench.executed == [(2, b"x")]
    assert bench.medium.engine(1).stats.transmitted.get(20) is None


def test_service_that_differs_fails_long_before_the_deadline() -> None:
    tables = {1: fleet(), 2: StreamTable(fleet_with_response(), nodes={1: "n1", 2: "n2"})}
    bench = Bench(tables=tables)
    call_id = bench.call(2, b"x")
    bench.medium.run(until_s=15)
    failure, text = bench.failure(2, call_id)
    assert failure is CallFailure.TABLE_MISMATCH
    assert text == "node 1 defines stream 20 in another way"
    assert bench.executed == []
    again = bench.call(2, b"x")
    assert bench.failure(2, again)[0] is CallFailure.TABLE_MISMATCH


def fleet_with_response() -> list[ServiceSpec]:
    return [ServiceSpec(stream_id=20, name="disarm", server=1)]


@pytest.mark.parametrize("seed", range(20))
def test_request_that_arrives_twice_runs_once_and_its_answer_is_taken_once(seed: int) -> None:
    rng = random.Random(seed)
    delay_s = rng.uniform(0, 4.2)
    bench = Bench(
        seed=seed,
        serve=later(rng.choice((0.0, 2.0))),
        faults={"duplicate": 1.0, "duplicate_after_s": delay_s},
    )
    assert delay_s < settling_s(bench.medium.engine(1).capabilities)
    calls = [bench.call(2, b"%d" % number) for number in range(5)]
    bench.medium.run(until_s=200)
    executed = [value for _, value in bench.executed]
    assert len(executed) == len(set(executed)), f"seed {seed}, duplicates after {delay_s} s"
    for number, call_id in enumerate(calls):
        event = bench.end(2, call_id)
        if isinstance(event, ResponseReceived):
            assert event.value == b"re %d" % number


def test_cancelled_call_says_nothing_and_its_answer_is_dropped() -> None:
    bench = Bench(serve=later(5))
    call_id = bench.call(2, b"x")
    bench.medium.at(
        4, lambda: bench.medium.apply(2, lambda engine, now: engine.cancel(call_id, now))
    )
    bench.medium.run(until_s=300)
    assert bench.executed == [(2, b"x")]
    assert bench.ended == {}
    assert bench.medium.engine(2).stats.dropped == {"unexpected_answer": 1}


@pytest.mark.parametrize("seed", range(40))
def test_old_answer_is_not_taken_for_a_call_of_the_next_life(seed: int) -> None:
    rng = random.Random(seed)
    loss = rng.choice((0.0, 0.5))
    bench = Bench(
        seed=seed,
        serve=later(rng.uniform(0, 20)),
        disturb=lambda source, node, now: [] if rng.random() < loss else [0.0],
    )
    lives: dict[int, bytes] = {}

    def begin(life: int) -> None:
        lives.clear()
        for number in range(rng.randint(1, 3)):
            text = b"%d.%d" % (life, number)
            lives[bench.call(2, text)] = text
        bench.ended.clear()

    def restart(life: int) -> None:
        bench.medium.restart(2)
        begin(life)

    begin(0)
    at_s = 0.0
    for life in range(1, 5):
        at_s += rng.uniform(0.5, 15)
        bench.medium.at(at_s, partial(restart, life))
        # The server introduces itself, so that the new life knows it before its call is heard.
        bench.medium.at(at_s + rng.uniform(0, 3), lambda: bench.medium.publish(1, 1, b"hello"))
    bench.medium.run(until_s=300)
    for call_id, text in lives.items():
        event = bench.end(2, call_id)
        if isinstance(event, ResponseReceived):
            assert event.value == b"re " + text, f"seed {seed}"


def test_unanswered_calls_do_not_pile_up() -> None:
    bench = Bench(serve=lambda bench, event: None)
    refused = 0
    for second in range(600):

        def call() -> None:
            nonlocal refused
            try:
                bench.call(2, b"x", timeout_s=10)
            except QueueFullError:
                refused += 1

        bench.medium.at(second / 4, call)
    bench.medium.run(until_s=1000)
    assert refused > 0
    assert len(bench.executed) + refused <= 600
    assert sum(map(len, bench.ended.values())) == 600 - refused
    assert bench.medium.engine(2).pending(20) == 0
    assert bench.medium.is_quiet
