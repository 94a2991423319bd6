"""One forged frame in a fleet at work: what is different ten minutes later?

The fleet does the same twice, once with the frame and once without; what the applications put in
from ten minutes after it on, and what they got of that, is compared. The oracle knows nothing of
how an engine thinks: it knows what was put in, what came out, and what was on the air.
"""

import functools
from collections.abc import Callable, Iterable
from typing import Final

import msgspec

from tests.hostile import fleet
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    DeliveryEnded,
    Event,
    GoalStatus,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.transport.actions.events import GoalFailed, GoalReceived, ResultReceived
from zacoustic.core.wire.goals import GoalKey
from zacoustic.testing.virtual import Modem, VirtualNetwork

NODES: Final = (1, 2, 3)
FORGED_S: Final = 1210.0
"""When the frame comes."""
AFTER_S: Final = 600.0
"""No effect of it outlasts that."""
_ROUND_S: Final = 300.0
_TURN_S: Final = 100.0
_PAUSE_S: Final = 7.0
"""Between two things that a node does: what one of them entails is over then."""
_JUDGED: Final = range(7, 10)
"""Rounds that are compared."""
_QUIET: Final = range(4, 7)
"""Rounds in which a quiet fleet has nothing to say."""
END_S: Final = _ROUND_S * (_JUDGED.stop + 1)

TABLE: Final = fleet.table(range(1, 4))


class Forged(msgspec.Struct, frozen=True):
    """A frame of somebody who says to be another node, or one that nobody knows."""

    hearer: int
    """The node that hears it."""
    source: int
    """The node that it seems to be from."""
    destination: int
    """That node, or `BROADCAST`."""
    frame_bytes: bytes


class Outcome(msgspec.Struct):
    """What came of a run."""

    got: list[tuple[int, object, int, int]] = msgspec.field(default_factory=list)
    """What the applications got of what was put in while it is compared."""
    spent: int = 0
    """Bytes on the air in the last round."""
    answered: int = 0
    """Bytes on the air from the forged frame on, until ten minutes later."""


class Work:
    """A fleet that does something of everything.

    Args:
        busy: It goes on while the forged frame comes; otherwise it is quiet from before that until
            it is compared.
        rules: As those of `VirtualNetwork`.
    """

    def __init__(self, *, busy: bool, rules: TransmitRules | None = None) -> None:
        self.outcome = Outcome()
        self._tickets: dict[tuple[int, object], tuple[str, int, int]] = {}
        self.tell: Callable[[int, Event], object] = lambda node, event: None
        """Takes each event, too."""
        nodes = [{"address": each, "position": [200 * each, 0, 10]} for each in NODES]
        self.network = VirtualNetwork(
            scenario_from_mapping({"nodes": nodes, "channel": "none", "seed": 7}, source="forged"),
            TABLE,
            modem=Modem(),
            deliver=self._take,
            trace=self._note,
            digest=False,
            rules=rules or TransmitRules(),
        )
        for node in NODES:
            for stream in fleet.ON_DEMAND:
                self._later(1.0 + node, node, functools.partial(_subscribe, stream))
        for number in range(_JUDGED.stop):
            if busy or number not in _QUIET:
                for node in NODES:
                    self._plan(number, node)

    def run(self, forged: Iterable[tuple[float, Forged]] = ()) -> Outcome:
        """Run it, with the frames of somebody else at their instants."""
        for at_s, each in forged:
            self.network.at(at_s, functools.partial(self.hear, each))
        self.network.run(until_s=END_S)
        return self.outcome

    def hear(self, forged: Forged) -> None:
        """Let a node hear a frame that no node has sent."""

        def take(engine: Engine, now: int) -> None:
            frame = ReceivedFrame(
                frame_bytes=forged.frame_bytes, received_at=now, source=forged.source,
                destination=forged.destination,
            )  # fmt: skip
            engine.handle_frame(frame, now)

        self.network.apply(forged.hearer, take)

    # What the applications put in

    def _later(self, at_s: float, node: int, command: Callable[[Engine, int], object]) -> None:
        self.network.at(at_s, functools.partial(self.network.apply, node, command))

    def _plan(self, number: int, node: int) -> None:
        at_s = number * _ROUND_S + 10.0 + (node - 1) * _TURN_S
        ticket = 1 + number * 100 + node * 20
        topics = [
            *fleet.BEST_EFFORT, fleet.LOG, fleet.LIGHT, fleet.DIARY,
        ]  # fmt: skip
        if node != fleet.SERVER:
            topics += [fleet.STOP]
            for stream_id in (fleet.ARM, fleet.GOTO, 175):
                self._later(at_s, node, functools.partial(self._ask, stream_id, ticket))
                at_s += _PAUSE_S
        for stream_id in topics:
            ticket += 1
            self._later(at_s, node, functools.partial(self._publish, stream_id, ticket))
            at_s += _PAUSE_S

    def _publish(self, stream_id: int, ticket: int, engine: Engine, now: int) -> None:
        instance = (0,) if stream_id in fleet.WITH_PARTS else ()
        value = fleet.value_of(stream_id, ticket, 8)
        number = engine.publish(stream_id, value, now, instance=instance)
        if stream_id in fleet.RELIABLE:
            self._tickets[engine.address, number] = ("delivered", stream_id, ticket)

    def _ask(self, stream_id: int, ticket: int, engine: Engine, now: int) -> None:
        value = fleet.value_of(stream_id, ticket, 4)
        given: object
        if stream_id == fleet.ARM:
            given = engine.call(stream_id, value, now, timeout_s=100.0)
        elif stream_id == fleet.GOTO:
            given = engine.actions.send_goal(stream_id, value, now, timeout_s=100.0)
        else:
            ask = RemoteCommand(kind=CommandKind.ASK)
            given = engine.commands.send(fleet.SERVER, ask, now, timeout_s=100.0)
        self._tickets[engine.address, given] = ("done", stream_id, ticket)

    # What comes of it

    def _take(self, node: int, event: Event) -> None:
        self.tell(node, event)
        match event:
            case SampleReceived() if event.source in NODES:  # strangers may say something, too
                self._got(node, event.source, event.stream_id, _ticket(event.value))
            case RequestReceived():
                self._got(node, event.call.client, event.call.stream_id, _ticket(event.value))
                self.network.at(
                    self.network.now / NS_PER_S + 1.0,
                    lambda: self.network.apply(
                        node, lambda engine, now: engine.reply(event.call, b"yes", now)
                    ),
                )
            case GoalReceived():
                goal = event.goal
                self._got(node, goal.client, fleet.GOTO, _ticket(event.value))
                self.network.at(
                    self.network.now / NS_PER_S,
                    lambda: self.network.apply(
                        node, lambda engine, now: _pursue(engine, goal, now)
                    ),
                )
            case DeliveryEnded():
                self._ended(node, event.delivery_id, event.outcome.value)
            case ResponseReceived():
                self._ended(node, event.call_id, "answered")
            case CallFailed():
                self._ended(node, event.call_id, event.failure.name)
            case GoalFailed():
                self._ended(node, event.goal, "failed")
            case ResultReceived():
                self._ended(node, event.goal, event.status)
            case _:
                pass

    def _ended(self, node: int, given: object, outcome: object) -> None:
        what, stream_id, ticket = self._tickets.get((node, given), ("", 0, 0))
        self._got(node, f"{what} {outcome}", stream_id, ticket)

    def _got(self, node: int, how: object, stream_id: int, ticket: int) -> None:
        if ticket >= _JUDGED.start * 100:
            self.outcome.got.append((node, how, stream_id, ticket))

    @property
    def _is_judged(self) -> bool:
        return self.network.now >= seconds_to_ns(_JUDGED.start * _ROUND_S)

    def _note(self, record: TraceRecord) -> None:
        if record.what != "transmit":
            return
        size = record.size_bytes
        if self.network.now >= seconds_to_ns((_JUDGED.stop - 1) * _ROUND_S):
            self.outcome.spent += size
        elif 0 <= self.network.now - seconds_to_ns(FORGED_S) < seconds_to_ns(AFTER_S):
            self.outcome.answered += size


def _ticket(value: object) -> int:
    return fleet.ticket_of(value) or 0


def _subscribe(stream_id: int, engine: Engine, now: int) -> None:
    engine.subscriptions.want(stream_id, now)


def _pursue(engine: Engine, goal: GoalKey, now: int) -> None:
    engine.actions.accept(goal, now)
    engine.actions.finish(goal, GoalStatus.SUCCEEDED, b"done", now)


@functools.cache
def untouched(*, busy: bool) -> Outcome:
    """Return what comes of the same work without a forged frame."""
    return Work(busy=busy).run()
