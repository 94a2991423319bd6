"""Many nodes at once, in a soak forty: little is repeated to an absent one, and all arrives."""

import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from tests.conftest import SOAK
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    DeliveryEnded,
    DeliveryOutcome,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

NODES: Final = 40 if SOAK else 24
"""A run costs by their square."""
SHORE: Final = 1
OTHERS: Final = range(2, NODES + 1)
PLAN, NEWS, ARM = 10, 11, 20
DAY_S: Final = 86_400.0
MOST_FRAMES: Final = 20
"""Of one node to an absent one, in ten minutes, with a sample and a call for it."""
LATEST_S: Final = 1800.0
"""From the return of the absent to the last arrival, s."""


class Forty:
    """So many S2C modems in 3 km of sea; node 1 answers the calls of the others."""

    def __init__(self, seed: int) -> None:
        self.events: list[tuple[int, Event]] = []
        self.sent: list[int] = []
        """Senders of all frames."""
        self.network = VirtualNetwork(
            sea(seed), table(), deliver=self._take, trace=self._note, digest=False
        )

    def call(self, node: int) -> None:
        """Call the service of node 1."""
        self.network.apply(node, lambda engine, now: engine.call(ARM, b"arm%d" % node, now))

    def command(self, node: int) -> None:
        """Ask a node, from node 1, how it is."""
        ask = RemoteCommand(kind=CommandKind.ASK)
        self.network.apply(SHORE, lambda engine, now: engine.commands.send(node, ask, now))

    def told(self, node: int, kind: type) -> list[Any]:
        """Return the events of a class that a node has told."""
        return [event for at, event in self.events if at == node and isinstance(event, kind)]

    def _note(self, record: TraceRecord) -> None:
        if record.what == "transmit":
            self.sent.append(record.node)

    def _take(self, node: int, event: Event) -> None:
        self.events.append((node, event))
        if isinstance(event, RequestReceived):
            answer = partial(self.network.apply, node, partial(_answer, event))
            self.network.at(self.network.now / NS_PER_S, answer)


def _answer(event: RequestReceived, engine: Engine, now: int) -> None:
    engine.reply(event.call, event.value, now)


def sea(seed: int) -> Scenario:
    rng = random.Random(seed)
    nodes = [
        {"address": each, "position": [rng.uniform(0, 3000), rng.uniform(0, 3000), 10]}
        for each in range(1, NODES + 1)
    ]
    return scenario_from_mapping(
        {"nodes": nodes, "seed": seed, "channel": "none", "loss": {"frame": 0.05}}, source="test"
    )


def table() -> StreamTable:
    reliable = Qos(reliability=Reliability.RELIABLE, depth=4)
    return StreamTable(
        [
            TopicSpec(stream_id=PLAN, name="{node}/plan", subscribers=(SHORE,), qos=reliable),
            TopicSpec(stream_id=NEWS, name="news", publishers=(SHORE,), qos=reliable),
            ServiceSpec(stream_id=ARM, name="arm", server=SHORE, timeout_s=6 * 3600.0),
        ],
        nodes={each: f"n{each}" for each in range(1, NODES + 1)},
    )


def test_little_is_repeated_to_an_absent_node_and_all_arrives_when_it_is_back(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(100)):
        fleet, rng = Forty(seed), random.Random(seed)
        network = fleet.network
        network.crash(SHORE)
        for node in OTHERS:
            network.at(rng.uniform(10, 15), partial(network.publish, node, PLAN, b"plan%d" % node))
            network.at(rng.uniform(10, 15), partial(fleet.call, node))
        network.run(until_s=610.0)
        frames = Counter(fleet.sent)
        assert set(frames) == set(OTHERS), seed
        assert max(frames.values()) <= MOST_FRAMES, (seed, frames)
        network.start(SHORE)
        network.run(until_s=610.0 + LATEST_S)
        plans = Counter(event.value for event in fleet.told(SHORE, SampleReceived))
        assert plans == {b"plan%d" % node: 1 for node in OTHERS}, seed
        calls = Counter(event.value for event in fleet.told(SHORE, RequestReceived))
        assert calls == {b"arm%d" % node: 1 for node in OTHERS}, seed
        for node in OTHERS:
            assert [each.value for each in fleet.told(node, ResponseReceived)] == [b"arm%d" % node]
        network.run(until_s=DAY_S)
        ended = len(fleet.sent)
        network.run(until_s=2 * DAY_S)
        assert len(fleet.sent) == ended, seed


def test_one_node_reaches_all_others_though_a_tenth_is_absent(
    count: Callable[[int], int],
) -> None:
    wanted = answered = 0
    for seed in range(count(100)):
        fleet, rng = Forty(seed), random.Random(seed)
        network = fleet.network
        absent = rng.sample(OTHERS, 4)
        for node in absent:
            network.crash(node)
        for node in OTHERS:
            network.at(10.0, partial(fleet.command, node))
        network.at(10.0, partial(network.publish, SHORE, NEWS, b"news"))
        network.run(until_s=700.0)
        answers = fleet.told(SHORE, ResponseReceived)
        failures = [each.failure for each in fleet.told(SHORE, CallFailed)]
        assert set(failures) <= {CallFailure.TIMED_OUT}, (seed, failures)
        assert len(answers) + len(failures) == len(OTHERS), seed
        # All forty have just started and speak at once: a command may meet another frame at its
        # receiver nine times in its ten minutes. Then its sender is told.
        assert len(answers) >= len(OTHERS) - len(absent) - 1, seed
        wanted += len(OTHERS) - len(absent)
        answered += len(answers)
        for node in absent:
            network.start(node)
        network.run(until_s=700.0 + LATEST_S)
        for node in OTHERS:
            assert [each.value for each in fleet.told(node, SampleReceived)] == [b"news"], seed
        ended = fleet.told(SHORE, DeliveryEnded)
        assert [each.outcome for each in ended] == [DeliveryOutcome.DELIVERED], seed
    assert answered >= 0.999 * wanted or wanted - answered <= 1
