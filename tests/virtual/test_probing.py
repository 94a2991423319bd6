"""Probes in virtual time: what nodes count, and commands that go over others."""

from collections.abc import Callable

import pytest

from tests.virtual.fleet import line as fleet_line
from tests.virtual.lineoffive import NODES, LineOfFive
from tests.virtual.sealed import SealedFleet
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, Event, ResponseReceived, RoutingHandled
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.routing import RoutingAnswer, RoutingKind, RoutingRequest
from zacoustic.errors import LocalError
from zacoustic.testing.virtual import VirtualNetwork

PROBE, HEARD = RoutingKind.PROBE, RoutingKind.HEARD


class Asked:
    """A line of five whose first node asks the others, one question at a time."""

    def __init__(self, loss: float, *, sealed: bool = False, **more: object) -> None:
        self._ends: dict[int, ResponseReceived | CallFailed] = {}
        self.handled: list[tuple[int, RoutingHandled]] = []
        build = SealedFleet() if sealed else Engine
        self.line = LineOfFive(loss, happened=self._take, build=build, **more)  # type: ignore[arg-type]
        self.line.network.run(until_s=5.0)

    def ask(self, node: int, request: RoutingRequest) -> RoutingAnswer | str:
        """Ask, and run until the answer is there; returns it, or why there is none."""
        network = self.line.network
        call_id = network.apply(
            1, lambda engine, now: engine.routing.send(node, request, now, timeout_s=500.0)
        )
        while call_id not in self._ends:
            network.run(until_s=network.now / 1e9 + 1.0)
        end = self._ends.pop(call_id)
        if isinstance(end, CallFailed):
            return end.text
        return RoutingAnswer.decode(request.kind, end.value)

    def probe(self, node: int, count: int, via: tuple[int, ...] = ()) -> None:
        """Let a node transmit a run of probes, and wait until it is over."""
        request = RoutingRequest(kind=PROBE, via=via, run=7, count=count)
        answer = self.ask(node, request)
        assert isinstance(answer, RoutingAnswer), answer
        self.line.network.run(until_s=self.line.network.now / 1e9 + answer.over_s + 2.0)

    def heard(self, node: int, via: tuple[int, ...] = ()) -> dict[int, int]:
        """Return what a node has heard of that run."""
        answer = self.ask(node, RoutingRequest(kind=HEARD, via=via, run=7))
        assert isinstance(answer, RoutingAnswer), answer
        return dict(answer.heard)

    def _take(self, node: int, event: Event) -> None:
        if isinstance(event, RoutingHandled):
            self.handled.append((node, event))
        if isinstance(event, ResponseReceived | CallFailed):
            assert node == 1
            self._ends[event.call_id] = event


@pytest.mark.parametrize("sealed", [False, True])
def test_neighbours_count_what_they_hear(sealed: bool, count: Callable[[int], int]) -> None:
    heard = runs = 0
    for seed in range(count(100)):
        asked = Asked(0.3, seed=seed, sealed=sealed)
        asked.probe(2, 32)
        assert set(asked.heard(3, (2,))) == {2}
        heard += asked.heard(3, (2,))[2]
        runs += 1
        assert asked.line.network.engine(1).routing is not None
    assert 0.6 < heard / (32 * runs) < 0.8


def test_a_command_goes_over_others_to_the_end_of_the_line(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        asked = Asked(0.2, seed=seed)
        asked.probe(NODES, 8, (2, 3, 4))
        assert set(asked.heard(4, (2, 3))) == {NODES}


def test_the_channel_may_repeat_and_delay_probes(count: Callable[[int], int]) -> None:
    """A probe is counted once, however often it comes."""
    for seed in range(count(50)):
        asked = Asked(0.1, seed=seed, disturb=lambda source, node, now: (0.0, 3.0, 40.0))
        asked.probe(2, 16)
        assert asked.heard(3, (2,))[2] <= 16


def test_who_may_not_command_gets_no_probe() -> None:
    rules = TransmitRules(commands_from=frozenset({9}))
    asked = Asked(0.1, rules=rules)
    before = asked.line.network.engine(2).stats.frames_transmitted
    answer = asked.ask(2, RoutingRequest(kind=PROBE, run=7, count=32))
    assert answer == "node 2 takes no commands from 1"
    assert asked.line.network.engine(2).stats.frames_transmitted - before < 8


def test_what_others_command_is_told_and_what_they_ask_is_not() -> None:
    asked = Asked(0.0)
    asked.probe(3, 4, (2,))
    asked.heard(3, (2,))
    ((node, executed),) = asked.handled
    assert (node, executed.commanded_by, executed.refusal) == (3, 2, "")
    assert executed.request is not None
    assert (executed.request.kind, executed.request.run, executed.request.count) == (PROBE, 7, 4)
    forbidden = Asked(0.0, rules=TransmitRules(commands_from=frozenset({9})))
    forbidden.ask(2, RoutingRequest(kind=PROBE, run=7, count=32))
    ((node, refused),) = forbidden.handled
    assert (node, refused.commanded_by, refused.request) == (2, 1, None)
    assert refused.refusal == "node 2 takes no commands from 1"


def test_a_way_that_comes_back_or_ends_nowhere_is_refused() -> None:
    asked = Asked(0.1)
    request = RoutingRequest(kind=HEARD, via=(2,))
    with pytest.raises(LocalError, match="each once"):
        asked.ask(1, request)
    with pytest.raises(LocalError, match="each once"):
        asked.ask(2, request)
    bad = asked.ask(3, RoutingRequest(kind=HEARD, via=(2, 4)))  # 4 is not heard by 2
    assert bad == "node 2 had no answer"


def test_one_run_at_a_time_and_none_without_a_command() -> None:
    asked = Asked(0.0001)
    network = asked.line.network
    network.run(until_s=3600.0)
    assert asked.line.frames == 0
    engine = network.engine(3)
    run = RoutingRequest(kind=PROBE, run=1, count=8)
    over: list[int] = []
    for _ in range(2):  # the same command again begins nothing
        network.apply(3, lambda e, now: e.routing.execute(run, now, lambda a, at: over.append(at)))
    other = RoutingRequest(kind=PROBE, run=2, count=8)
    with pytest.raises(LocalError, match="under way"):
        network.apply(3, lambda e, now: e.routing.execute(other, now, lambda a, at: None))
    network.run(until_s=3700.0)
    assert engine.stats.frames_transmitted == 8
    assert len(over) == 2
    assert sum(each.transmitted_bytes for each in engine.stats.ledger()) == (
        engine.stats.bytes_transmitted
    )
    assert engine.is_idle


def test_a_fleet_without_routes_probes_as_well() -> None:
    table = StreamTable(nodes={1: "shore", 2: "auv1"})
    network = VirtualNetwork(fleet_line(0.0, 500.0, channel="none"), table)
    network.run(until_s=1.0)
    run = RoutingRequest(kind=PROBE, run=1, count=8)
    network.apply(1, lambda e, now: e.routing.execute(run, now, lambda a, at: None))
    network.run(until_s=60.0)
    found: list[RoutingAnswer] = []
    heard = RoutingRequest(kind=HEARD, run=1)
    network.apply(2, lambda e, now: e.routing.execute(heard, now, lambda a, at: found.append(a)))
    assert dict(found[0].heard) == {1: 8}
