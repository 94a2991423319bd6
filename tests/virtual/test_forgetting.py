"""A node that is forgotten leaves nothing behind, in memory or in the journal."""

import gc
import random
import types
from collections import deque
from collections.abc import Callable
from functools import partial

import msgspec

from tests.hostile import fleet
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, GoalReceived, GoalStatus, RequestReceived
from zacoustic.core.linktypes import LinkMetrics, PeerMeasured
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

SHORE = fleet.SERVER
LAST = 254
PRESENT_S = 400.0
AWAY_S = 1500.0
"""By then what was under way has ended."""


class Meetings:
    """A shore that lives on, and one vehicle after the other that has to do with it."""

    def __init__(self) -> None:
        self.said: set[str] = set()
        """Kinds of events that the shore was told."""
        nodes = [
            {"address": address, "position": [10 * address % 700, address % 7, 10]}
            for address in range(1, LAST + 1)
        ]
        self.network = VirtualNetwork(
            scenario_from_mapping({"nodes": nodes, "channel": "none"}, source="test"),
            _for_the_shore(fleet.table(range(1, LAST + 1))),
            deliver=self._take,
            digest=False,
        )
        for address in range(2, LAST + 1):
            self.network.crash(address)

    @property
    def shore(self) -> Engine:
        return self.network.engine(SHORE)

    @property
    def entries(self) -> set[str]:
        return set(self.network.journal(SHORE).entries)

    def meet(self, address: int) -> None:
        """Let a vehicle say, and be told, something of every kind; then it goes."""
        network, rng = self.network, random.Random(address)
        now_s = network.now / NS_PER_S
        network.start(address)
        for turn in range(3):
            network.at(now_s + 10 + 60 * turn, partial(self._speak, address, turn, rng))
        network.at(now_s + 200, lambda: network.publish(address, fleet.LOG, bytes(900)))
        network.run(until_s=now_s + PRESENT_S)
        network.crash(address)

    def forget(self, address: int) -> None:
        """Forget the vehicle when nothing that has to do with it is under way."""
        network = self.network
        network.run(until_s=network.now / NS_PER_S + AWAY_S)
        network.apply(SHORE, lambda engine, now: engine.forget(address, now))
        network.run(until_s=network.now / NS_PER_S + 10)

    def _speak(self, address: int, turn: int, rng: random.Random) -> None:
        network = self.network
        for stream_id in (*fleet.BEST_EFFORT, *fleet.RELIABLE):
            part = (0,) if stream_id in fleet.WITH_PARTS else ()
            if stream_id not in fleet.ON_DEMAND:
                value = fleet.value_of(stream_id, 1 + turn, 8)
                network.publish(address, stream_id, value, instance=part)
        for stream_id in fleet.ON_DEMAND:
            network.apply(address, partial(_want, stream_id))
            network.publish(SHORE, stream_id, rng.randbytes(8))
        network.publish(SHORE, fleet.NAV, fleet.value_of(fleet.NAV, 1 + turn, 8))
        network.apply(address, lambda engine, now: engine.call(fleet.ARM, b"arm", now))
        network.apply(
            address,
            lambda engine, now: engine.actions.send_goal(fleet.GOTO, b"go", now, timeout_s=100),
        )
        override = RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=fleet.RAW, on=True)
        network.apply(address, lambda engine, now: engine.commands.send(SHORE, override, now))
        ask = RemoteCommand(kind=CommandKind.ASK)
        network.apply(SHORE, lambda engine, now: engine.commands.send(address, ask, now))
        metrics = LinkMetrics(propagation_s=0.5, bearing_rad=1.0, elevation_rad=0.1)
        network.apply(
            SHORE,
            lambda engine, now: engine.handle_measurement(
                PeerMeasured(address=address, measured_at=now, metrics=metrics), now
            ),
        )

    def _take(self, address: int, event: Event) -> None:
        if address != SHORE:
            return
        self.said.add(type(event).__name__)
        if isinstance(event, RequestReceived):
            self._soon(lambda engine, now: engine.reply(event.call, b"done", now))
        elif isinstance(event, GoalReceived):
            self._soon(lambda engine, now: engine.actions.accept(event.goal, now))
            self._soon(
                lambda engine, now: engine.actions.finish(
                    event.goal, GoalStatus.SUCCEEDED, b"there", now
                )
            )

    def _soon(self, command: Callable[[Engine, int], object]) -> None:
        self.network.at(self.network.now / NS_PER_S, lambda: self.network.apply(SHORE, command))


def test_nodes_that_are_forgotten_leave_nothing_behind(count: Callable[[int], int]) -> None:
    meetings = Meetings()
    for address in (2, 3):  # what is there once, whoever comes
        meetings.meet(address)
        meetings.forget(address)
    assert meetings.said >= {"SampleReceived", "RequestReceived", "GoalReceived", "PeerSeen",
                             "ObjectProgress", "StreamOverridden",
                             "SubscribersChanged"}  # fmt: skip
    entries, objects = meetings.entries, reached(meetings.shore)
    known = []
    for address in range(4, 4 + count(LAST - 3)):
        meetings.meet(address)
        known.append(reached(meetings.shore) - objects)
        meetings.forget(address)
    assert meetings.entries == entries
    assert min(known) > 100, "a node that is known leaves nothing that could be forgotten"
    assert reached(meetings.shore) - objects < 60
    assert not any(meetings.shore.peers().values())
    assert meetings.shore.measurements.addresses() == []


def _want(stream_id: int, engine: Engine, now: int) -> None:
    engine.subscriptions.want(stream_id, now)


def reached(root: object) -> int:
    """Count what an object refers to, and the entries of containers.

    Code and modules are excepted. So are numbers, of which small ones are no objects of their own:
    a count that has grown is nothing that was left behind, but one more entry is.
    """
    skipped = (
        type, types.ModuleType, types.FunctionType, types.CodeType, types.MethodType,
        types.BuiltinFunctionType, int, float,
    )  # fmt: skip
    seen: set[int] = set()
    waiting: list[object] = [root]
    entries = 0
    while waiting:
        each = waiting.pop()
        if id(each) not in seen and not isinstance(each, skipped):
            seen.add(id(each))
            waiting += gc.get_referents(each)
            entries += len(each) if isinstance(each, dict | list | set | deque) else 0
    return len(seen) + entries


def _for_the_shore(table: StreamTable) -> StreamTable:
    """Return a table whose topics on demand are from the shore, and reliable ones to the shore."""
    specs = []
    for stream in table:
        spec = stream.spec
        if isinstance(spec, TopicSpec) and stream.is_on_demand:
            spec = msgspec.structs.replace(spec, publishers=(SHORE,))
        elif isinstance(spec, TopicSpec) and stream.stream_id in fleet.RELIABLE:
            spec = msgspec.structs.replace(spec, subscribers=(SHORE,))
        if not stream.is_built_in:
            specs.append(spec)
    return StreamTable(specs, types=table.types, nodes=table.nodes)
