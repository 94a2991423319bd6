"""Random scenarios in which several nodes begin to speak at once, and have to come to an end.

Two to four nodes, near or far, with or without carrier sense, with losses that last; in some one of
them is out of reach for up to half an hour. Within a few seconds, mostly in the same instant, they
publish reliable samples, large ones among them, make calls, send goals and ask for orders. Nothing
else happens. `Outcome.settled_s` tells how long it took until the last of them had an outcome.
"""

import random
from functools import partial
from typing import Any, Final

import msgspec

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S, ns_to_seconds
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    DeliveryEnded,
    DeliveryOutcome,
    Event,
    GoalKey,
    GoalStatus,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import GoalFailed, GoalReceived, ResultReceived
from zacoustic.testing.virtual import Modem, VirtualNetwork

LIMIT_S: Final = 10_800.0
"""How long a scenario is watched, s; what has no outcome by then never ends."""
BEGIN_S: Final = 100.0
"""When they begin to speak, s."""

_SMALL: Final = (Priority.REAL_TIME, Priority.INTERACTIVE_HIGH, Priority.DATA, Priority.BACKGROUND)
_LARGE: Final = 9
_SERVICE: Final = 20
_ACTION: Final = 40
_PATIENCE_S: Final = 7200.0
_UNREACHABLE: Final = 0.2
"""Share of the scenarios in which a node is out of reach for a while."""
_PLANS: Final = ("sample", "sample", "sample", "call", "call", "goal", "object", "order")


class Outcome(msgspec.Struct, frozen=True):
    """What came of a scenario."""

    settled_s: float
    """To the last outcome, from the instant at which the nodes began, or the last of them was back
    in reach, s."""
    unended: tuple[str, ...]
    """What had none within `LIMIT_S`."""
    failed: tuple[str, ...]
    """What ended otherwise than well."""
    frames: int
    """Frames transmitted."""


class Settling:
    """One scenario.

    Args:
        seed: Everything follows from it.
        senses_carrier: The modems tell when somebody else is heard.
    """

    def __init__(self, seed: int, *, senses_carrier: bool = False) -> None:
        self._rng = rng = random.Random(f"settling/{seed}")
        addresses = range(1, 1 + rng.choice((2, 2, 2, 3, 4)))
        side_m = rng.choice((10.0, 50.0, 150.0, 500.0, 1500.0))
        nodes = [
            {"address": each, "position": [rng.uniform(0, side_m), rng.uniform(0, side_m), 10]}
            for each in addresses
        ]
        medium: dict[str, Any] = {
            "seed": seed,
            "channel": "none",
            "profile": rng.choice(("evologics_s2c_18_34", "evologics_s2c_7_17", "nanomodem")),
            "nodes": nodes,
            "loss": {"frame": rng.choice((0.0, 0.0, 0.1, 0.3))},
        }
        self._waits: dict[tuple[str, int, object], str] = {}
        self._failed: list[str] = []
        self._settled_at = 0
        self._begin_s = BEGIN_S
        if rng.random() < _UNREACHABLE:
            self._begin_s += rng.uniform(60, 1800)
            out = {"node": rng.choice(addresses), "from_s": BEGIN_S, "to_s": self._begin_s}
            medium["faults"] = {"blackouts": [out]}
        self.network = VirtualNetwork(
            scenario_from_mapping(medium, source=f"settling {seed}"),
            _table(addresses),
            modem=rng.choice(_modems(senses_carrier)),
            deliver=self._take,
            digest=False,
        )
        if rng.random() < 0.5:  # they have met before
            for each in addresses:
                self.network.at(10.0 * each, partial(self._publish, each, 1 + len(_SMALL), 4))
        spread_s = rng.choice((0.0, 0.0, 1.0, 10.0))
        for _ in range(rng.randint(2, 6)):
            source = rng.choice(addresses)
            target = rng.choice([each for each in addresses if each != source])
            at_s = BEGIN_S + rng.uniform(0, spread_s)
            self.network.at(at_s, self._plan(source, target))

    def run(self) -> Outcome:
        """Let it happen, until nothing waits for an outcome, or far too long."""
        until_s = BEGIN_S + 20.0
        self.network.run(until_s=until_s)
        while self._waits and until_s < self._begin_s + LIMIT_S:
            until_s += 60.0
            self.network.run(until_s=until_s)
        return Outcome(
            settled_s=max(0.0, ns_to_seconds(self._settled_at) - self._begin_s),
            unended=tuple(self._waits.values()),
            failed=tuple(self._failed),
            frames=sum(each.frames_transmitted for each in self.network.stats()),
        )

    # Below the methods above

    def _plan(self, source: int, target: int) -> partial[None]:
        rng = self._rng
        kind = rng.choice(_PLANS)
        if kind == "order" and self._begin_s > BEGIN_S:
            kind = "call"  # an order is given up after ten minutes
        if kind == "sample":
            number = rng.randrange(len(_SMALL))
            return partial(self._publish, source, 1 + number, rng.choice((2, 8, 16, 24)))
        if kind == "object":
            return partial(self._publish, source, _LARGE, rng.choice((200, 800, 3000)))
        if kind == "call":
            return partial(self._call, source, target, rng.choice((2, 16)))
        if kind == "goal":
            return partial(self._send_goal, source, target, rng.choice((2, 16)))
        return partial(self._ask, source, target)

    def _publish(self, source: int, stream_id: int, size_bytes: int) -> None:
        delivery_id = self.network.publish(source, stream_id, self._rng.randbytes(size_bytes))
        key = ("sample", source, delivery_id)
        self._waits[key] = f"{source}: {size_bytes} bytes of stream {stream_id}"

    def _call(self, source: int, server: int, size_bytes: int) -> None:
        request = self._rng.randbytes(size_bytes)
        call_id = self.network.apply(
            source, lambda engine, now: engine.call(_SERVICE + server, request, now)
        )
        self._waits["call", source, call_id] = f"{source}: call of {server}"

    def _send_goal(self, source: int, server: int, size_bytes: int) -> None:
        goal = self.network.apply(
            source,
            lambda engine, now: engine.actions.send_goal(
                _ACTION + server, self._rng.randbytes(size_bytes), now
            ),
        )
        self._waits["goal", source, goal] = f"{source}: goal for {server}"

    def _ask(self, source: int, node: int) -> None:
        call_id = self.network.apply(
            source,
            lambda engine, now: engine.commands.send(
                node, RemoteCommand(kind=CommandKind.ASK), now
            ),
        )
        self._waits["call", source, call_id] = f"{source}: what holds at {node}"

    def _take(self, node: int, event: Event) -> None:
        match event:
            case RequestReceived():
                self._soon(node, lambda engine, now: engine.reply(event.call, b"done", now))
            case GoalReceived():
                self._soon(node, partial(_carry_out, event.goal))
            case DeliveryEnded():
                is_well = event.outcome is DeliveryOutcome.DELIVERED
                self._end(("sample", node, event.delivery_id), event, is_well=is_well)
            case ResponseReceived() | CallFailed():
                is_well = isinstance(event, ResponseReceived)
                self._end(("call", node, event.call_id), event, is_well=is_well)
            case ResultReceived() | GoalFailed():
                is_well = isinstance(event, ResultReceived)
                self._end(("goal", node, event.goal), event, is_well=is_well)
            case _:
                pass

    def _soon(self, node: int, command: Any) -> None:
        """Let the application act as soon as the engine has told everything."""
        now_s = ns_to_seconds(self.network.now)
        self.network.at(now_s, lambda: self.network.apply(node, command))

    def _end(self, key: tuple[str, int, object], event: Event, *, is_well: bool) -> None:
        what = self._waits.pop(key, None)
        if self.network.now >= BEGIN_S * NS_PER_S:
            self._settled_at = self.network.now
        if not is_well:
            self._failed.append(f"{what}: {event}")


def _carry_out(goal: GoalKey, engine: Engine, now: int) -> None:
    engine.actions.accept(goal, now)
    engine.actions.finish(goal, GoalStatus.SUCCEEDED, b"done", now)


def _modems(senses_carrier: bool) -> tuple[Modem, ...]:
    return tuple(
        Modem(
            senses_carrier=senses_carrier,
            addressed=addressed,
            checked=addressed,
            framed=framed,
            mtu_bytes=mtu_bytes,
        )
        for addressed, framed in ((True, True), (False, True), (False, False))
        for mtu_bytes in (64, 48)
    )


def _table(addresses: range) -> StreamTable:
    specs: list[StreamSpec] = [
        _topic(1 + number, f"{{node}}/p{number}", priority)
        for number, priority in enumerate(_SMALL)
    ]
    specs.append(_topic(1 + len(_SMALL), "{node}/hello", Priority.DATA))
    specs.append(_topic(_LARGE, "{node}/photo", Priority.BACKGROUND))
    for each in addresses:
        specs.append(
            ServiceSpec(
                stream_id=_SERVICE + each, name=f"s{each}", server=each, timeout_s=_PATIENCE_S
            )
        )
        specs.append(
            ActionSpec(
                stream_id=_ACTION + each,
                name=f"a{each}",
                server=each,
                timeout_s=_PATIENCE_S,
                result_timeout_s=_PATIENCE_S,
            )
        )
    return StreamTable(specs, nodes={each: f"n{each}" for each in addresses})


def _topic(stream_id: int, name: str, priority: Priority) -> TopicSpec:
    qos = Qos(reliability=Reliability.RELIABLE, depth=100, priority=priority)
    return TopicSpec(stream_id=stream_id, name=name, qos=qos)
