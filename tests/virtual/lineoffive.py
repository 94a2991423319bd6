"""Five nodes in a line, each 1.5 km from the next one, and a route from the first to the last.

A handler at the last node answers calls and pursues goals at once, and counts how often it did.
"""

import itertools
import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec

from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.scenario import LinkSpec, NodeSpec, Scenario
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.engine.events import (
    CallFailed,
    Event,
    GoalFailed,
    GoalReceived,
    GoalStatus,
    RequestReceived,
    ResponseReceived,
    ResultReceived,
    SampleReceived,
)
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.relay.route import Route
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

NODES: Final = 5
APART_M: Final = 1500.0
FIX, PLAN, KEPT, ARM, MOVE, BACK, STOP = 1, 2, 3, 4, 5, 6, 7
"""Best effort; reliable; reliable and journalled; a service and an action of the last node; best
effort from there to the first; an emergency for the last one."""
STREAMS: Final = (FIX, PLAN, KEPT, ARM, MOVE, BACK, STOP)
SEA_LOSS: Final = 0.096
"""Frames that the channel loses over one hop; over two it loses 40 %, over three 85 %."""
UNHEARD_DB: Final = -100.0
_NO_RULES: Final = TransmitRules()


def route(
    *line: int,
    path: tuple[int, ...] | None = None,
    route_id: int = 1,
    name: str = "far",
    **more: Any,
) -> Route:
    """Return a route over the only link."""
    return Route(route_id=route_id, name=name, path=path or line, link="link", **more)


def table() -> StreamTable:
    """Return the table of all nodes."""
    reliable = Qos(reliability=Reliability.RELIABLE, depth=50)
    there: dict[str, Any] = {"publishers": (1,), "subscribers": (NODES,)}
    return StreamTable(
        [
            TopicSpec(stream_id=FIX, name="fix", **there),
            TopicSpec(stream_id=PLAN, name="plan", qos=reliable, **there),
            TopicSpec(stream_id=KEPT, name="kept", qos=reliable, journal=True, **there),
            ServiceSpec(stream_id=ARM, name="arm", server=NODES, timeout_s=900.0),
            ActionSpec(stream_id=MOVE, name="move", server=NODES, timeout_s=900.0),
            TopicSpec(stream_id=BACK, name="back", publishers=(NODES,), subscribers=(1,)),
            TopicSpec(stream_id=STOP, name="stop", qos=Qos(priority=Priority.REAL_TIME), **there),
        ],
        nodes={each: f"n{each}" for each in range(1, NODES + 1)},
    )


class LineOfFive:
    """The network.

    Args:
        loss: Share of frames that are lost over one hop, and only neighbours hear each other;
            None: the channel decides.
        seed: Of medium and engines.
        routes: The routes; the streams go by the first one.
        streams: Table of all nodes; None: that of `table`.
        rules: Other rules of all nodes.
        happened: Takes each event as well.
        more: Arguments of `VirtualNetwork`.
    """

    def __init__(
        self,
        loss: float | None = None,
        *,
        seed: int = 1,
        routes: tuple[Route, ...] | None = None,
        streams: StreamTable | None = None,
        rules: TransmitRules = _NO_RULES,
        happened: Callable[[int, Event], None] | None = None,
        **more: Any,
    ) -> None:
        routes = routes or (route(*range(1, NODES + 1)),)
        self.served: Counter[tuple[int, bytes]] = Counter()
        """How often each request and goal was begun, by stream and content."""
        self.ended: Counter[tuple[int, object]] = Counter()
        """How often each call and goal has ended at its client."""
        self.received: list[tuple[int, int, bytes]] = []
        """``(instant, stream, value)`` of each sample, in order."""
        addresses = range(1, NODES + 1)
        scenario = Scenario(
            seed=seed,
            channel="sea",
            nodes=tuple(
                NodeSpec(address=each, position=(APART_M * each, 0.0, 10.0)) for each in addresses
            ),
            links=() if loss is None else _neighbours(loss),
        )
        self._also = happened
        of_ends = dict.fromkeys(STREAMS, routes[0].name)
        rules = msgspec.structs.replace(rules, routes=routes)
        at_end = msgspec.structs.replace(rules, links_of_streams=of_ends)
        of_all = {each: at_end if routes[0].other_end(each) else rules for each in addresses}
        self.network = VirtualNetwork(
            scenario, streams or table(), rules=of_all, deliver=self._happened, digest=False, **more
        )

    def every(
        self, mean_s: float, until_s: float, rng: random.Random, act: Callable[[int], object]
    ) -> int:
        """Do something at random instants, half to one and a half of the mean apart.

        Returns:
            How often; `act` is given the number of each time.
        """
        times, at_s = 0, 60.0
        while at_s < until_s:
            self.network.at(at_s, partial(act, times))
            times, at_s = times + 1, at_s + mean_s * rng.uniform(0.5, 1.5)
        return times

    def publish(self, stream_id: int, value: bytes) -> None:
        """Publish at the first node, or the last one, if that runs."""
        node = NODES if stream_id == BACK else 1
        if self.network.is_running(node):
            self.network.publish(node, stream_id, value)

    def call(self, request: bytes) -> int:
        """Call the service of the last node from the first."""
        return self.network.apply(1, lambda engine, now: engine.call(ARM, request, now))

    def send_goal(self, goal: bytes) -> object:
        """Send a goal from the first node to the last."""
        return self.network.apply(1, lambda engine, now: engine.actions.send_goal(MOVE, goal, now))

    def values(self, stream_id: int) -> list[bytes]:
        """Return the received values of a stream, in order."""
        return [value for _, stream, value in self.received if stream == stream_id]

    @property
    def frames(self) -> int:
        """How many frames all nodes have transmitted."""
        return sum(each.frames_transmitted for each in self.network.stats())

    def dropped(self, reason: str) -> int:
        """How often something was dropped for a reason."""
        return sum(each.dropped.get(reason, 0) for each in self.network.stats())

    # Below the methods above

    def _happened(self, node: int, event: Event) -> None:
        if self._also is not None:
            self._also(node, event)
        match event:
            case SampleReceived():
                self.received.append((self.network.now, event.stream_id, event.value))
            case RequestReceived():
                self.served[ARM, event.value] += 1
                self._later(node, lambda engine, now: engine.reply(event.call, event.value, now))
            case GoalReceived():
                self.served[MOVE, event.value] += 1
                self._later(node, lambda engine, now: _pursue(engine, event.goal, now))
            case ResponseReceived() | CallFailed():
                self.ended[ARM, event.call_id] += 1
            case ResultReceived() | GoalFailed():
                self.ended[MOVE, event.goal] += 1

    def _later(self, node: int, command: Any) -> None:
        def act() -> None:
            if self.network.is_running(node):
                self.network.apply(node, command)

        self.network.at(self.network.now / 1e9, act)


def _neighbours(loss: float) -> tuple[LinkSpec, ...]:
    """Return the directions of a line in which only neighbours hear each other."""
    more = LossSpec(frame=max(0.0, 1 - (1 - loss) / (1 - SEA_LOSS)))
    pairs = itertools.permutations(range(1, NODES + 1), 2)
    return tuple(
        LinkSpec(source=source, target=target, loss=more)
        if abs(source - target) == 1
        else LinkSpec(source=source, target=target, gain_db=UNHEARD_DB)
        for source, target in pairs
    )


def _pursue(engine: Any, goal: Any, now: int) -> None:
    if engine.actions.accept(goal, now):
        engine.actions.finish(goal, GoalStatus.SUCCEEDED, b"done", now)
