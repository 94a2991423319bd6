"""A node of a sealed fleet keeps another one transmitting: it is capped and named, no stop is lost.

What the other node has transmitted is taken from its link, not from the accounts of the budget.
"""

import enum
import random
from functools import cache, partial
from typing import Final

import pytest

from tests.virtual.fleet import line
from tests.virtual.sealed import SealedFleet
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    Event,
    LinkStateChanged,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
    SealAlarm,
)
from zacoustic.core.peers.sealing import SealRefusal
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.schedule.silence import SilenceChanged
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import CancelRequested, GoalReceived
from zacoustic.core.wire.goals import GoalKey, GoalStatus
from zacoustic.errors import QueueFullError
from zacoustic.testing.virtual import VirtualNetwork

ECHO, NAV, LOG, DIVE = 10, 11, 12, 13
TABLE: Final = StreamTable(
    [
        ServiceSpec(stream_id=ECHO, name="auv/echo", server=2),
        TopicSpec(stream_id=NAV, name="{node}/nav"),
        TopicSpec(stream_id=LOG, name="{node}/log", qos=Qos(reliability=Reliability.RELIABLE)),
        ActionSpec(stream_id=DIVE, name="auv/dive", server=2),
    ],
    nodes={1: "captured", 2: "auv", 3: "shore"},
)
SHARE: Final = 0.001
DAY_SHARE_S: Final = 86_400 * SHARE
RUN_S: Final = 9000
CANCELLED_S: Final = 6303.3
SILENCED_S: Final = 6703.3
FLOOD_ENDS_S: Final = 7000
ASKED_S: Final = 8503.3
"""In all scenarios the debt is paid by then."""
SILENCE: Final = RemoteCommand(kind=CommandKind.SILENCE, for_s=600.0)


class Flood(enum.Enum):
    """What node 1 asks for, every eight seconds."""

    CALLS = enum.auto()
    """A call and a reliable sample."""
    COMMANDS = enum.auto()
    """The state."""
    GOALS = enum.auto()
    """A goal, and the end of the one before."""


class Fleet:
    """Node 2 answers everything; node 1 asks for as much as its own modem allows.

    In the debt it cancels its first goal and commands a silence. Long after the flood it calls.
    """

    def __init__(self, flood: Flood, *, seed: int, sealed: bool = True) -> None:
        self.events: list[tuple[float, int, Event]] = []
        rules = {
            1: TransmitRules(),
            2: TransmitRules(sealing=SealRules(reply_share=SHARE)),
            3: TransmitRules(),
        }
        self.network = VirtualNetwork(
            line(0, 500, 900),
            TABLE,
            rules=rules,
            seed=seed,
            build=SealedFleet() if sealed else Engine,
            deliver=self._happened,
        )
        self._flood = flood
        self._rng = random.Random(seed)
        self._goals: list[GoalKey] = []
        self.network.at(1.0, self._goal)
        self.network.every(8.0, self._ask, first_s=60.0)
        self.network.every(600.0, partial(self._call, 3), first_s=300.0)
        self.network.at(CANCELLED_S, partial(self._cancel, 0))
        self.network.at(SILENCED_S, partial(self._command, SILENCE, 600.0))
        self.network.at(ASKED_S, partial(self._call, 1))
        self.network.run(until_s=RUN_S)

    def times_s(self, node: int, kind: type, stream_id: int | None = None) -> list[float]:
        """Return when a node had an event, of one stream or of all, s."""
        return [
            at_s
            for at_s, at, event in self.events
            if at == node
            and isinstance(event, kind)
            and (stream_id is None or getattr(event, "stream_id", 0) == stream_id)
        ]

    @property
    def alarms(self) -> list[tuple[float, int, SealAlarm]]:
        """All alarms: instant, node, alarm."""
        return [each for each in self.events if isinstance(each[2], SealAlarm)]  # type: ignore[misc]

    @property
    def cancelled(self) -> list[GoalKey]:
        """The goals whose end node 2 was asked for."""
        return [event.goal for _, _, event in self.events if isinstance(event, CancelRequested)]

    @property
    def first_goal(self) -> GoalKey:
        """The goal from before the flood."""
        return self._goals[0]

    def airtime_s(self) -> float:
        """Return for how long node 2 has transmitted, s."""
        return self.network.engine(2).stats.airtime_ns / 1e9

    def _ask(self) -> None:
        self.network.publish(1, NAV, b"n%d" % self._rng.randrange(100))
        if self.network.now / 1e9 > FLOOD_ENDS_S:
            return
        try:
            if self._flood is Flood.COMMANDS:
                self._command(RemoteCommand(kind=CommandKind.ASK))
            elif self._flood is Flood.GOALS:
                self._goal()
                if len(self._goals) > 2:
                    self._cancel(-2)
            else:
                self.network.publish(1, LOG, self._rng.randbytes(20))
                self._call(1)
        except QueueFullError:
            pass

    def _call(self, client: int) -> None:
        value = self._rng.randbytes(20)
        self.network.apply(client, lambda each, now: each.call(ECHO, value, now, timeout_s=50.0))

    def _goal(self) -> None:
        value = self._rng.randbytes(20)
        send = lambda each, now: self._goals.append(each.actions.send_goal(DIVE, value, now))  # noqa: E731
        self.network.apply(1, send)

    def _cancel(self, place: int) -> None:
        goal = self._goals[place]
        self.network.apply(1, lambda each, now: each.actions.cancel_goal(goal, now))

    def _command(self, command: RemoteCommand, timeout_s: float = 60.0) -> None:
        self.network.apply(
            1, lambda each, now: each.commands.send(2, command, now, timeout_s=timeout_s)
        )

    def _happened(self, address: int, event: Event) -> None:
        if isinstance(event, LinkStateChanged):
            return  # the network is being made
        self.events.append((self.network.now / 1e9, address, event))
        if isinstance(event, RequestReceived):
            self.network.apply(2, lambda each, now: each.reply(event.call, event.value, now))
        elif isinstance(event, GoalReceived):
            self.network.apply(2, lambda each, now: each.actions.accept(event.goal, now))
        elif isinstance(event, CancelRequested):
            self.network.apply(2, partial(_stop, event.goal))


def _stop(goal: GoalKey, engine: Engine, now: int) -> None:
    engine.actions.answer_cancel(goal, now, accepted=True)
    engine.actions.finish(goal, GoalStatus.CANCELED, b"", now)


@cache
def _fleet(flood: Flood, *, sealed: bool = True) -> Fleet:
    return Fleet(flood, seed=5, sealed=sealed)


@pytest.mark.parametrize("flood", Flood)
def test_a_node_that_asks_without_end_is_answered_for_a_share_of_the_day(flood: Flood) -> None:
    fleet = _fleet(flood)
    paid_s = DAY_SHARE_S + RUN_S * SHARE
    # Beside it: answers to node 3, and the last frame that made the debt.
    assert paid_s < fleet.airtime_s() < paid_s + 30
    told = {(at, each.address, each.refusal, each.is_too_many) for _, at, each in fleet.alarms}
    assert told == {(2, 1, SealRefusal.COSTLY, False)}


@pytest.mark.parametrize(
    "flood",
    [
        Flood.CALLS,
        pytest.param(Flood.COMMANDS, marks=pytest.mark.soak),
        pytest.param(Flood.GOALS, marks=pytest.mark.soak),
    ],
)
def test_without_a_seal_it_would_be_answered_for_far_longer(flood: Flood) -> None:
    unlimited = _fleet(flood, sealed=False)
    assert unlimited.airtime_s() > 2 * _fleet(flood).airtime_s()
    assert not unlimited.alarms


@pytest.mark.parametrize("flood", Flood)
def test_what_it_sends_has_its_effect_in_the_debt(flood: Flood) -> None:
    fleet = _fleet(flood)
    begins_s = fleet.alarms[0][0]
    assert begins_s < CANCELLED_S - 60
    late = [at_s for at_s in fleet.times_s(2, SampleReceived, NAV) if at_s > begins_s]
    assert len(late) > 0.6 * (RUN_S - begins_s) / 8
    assert fleet.first_goal in fleet.cancelled
    # It gets no answers, so it repeats as rarely as to an absent node.
    assert fleet.times_s(2, SilenceChanged)


@pytest.mark.parametrize("flood", Flood)
def test_other_nodes_are_answered_as_before(flood: Flood) -> None:
    assert len(_fleet(flood).times_s(3, ResponseReceived, ECHO)) >= RUN_S // 600 - 2


@pytest.mark.parametrize("flood", Flood)
def test_when_its_debt_is_paid_it_is_answered_again(flood: Flood) -> None:
    answered = _fleet(flood).times_s(1, ResponseReceived, ECHO)
    assert [at_s for at_s in answered if ASKED_S < at_s < ASKED_S + 60]
