"""A node of a sealed fleet keeps another one transmitting: it is capped and named, no stop is lost.

What the other node has transmitted is taken from its link, not from the accounts of the budget.
"""

import random
from functools import cache, partial
from typing import Final

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
from zacoustic.core.peers.sealing import Refusal
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.streams.commands import COMMANDS_STREAM_ID, CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import QueueFullError
from zacoustic.testing.virtual import VirtualNetwork

ECHO, NAV, LOG = 10, 11, 12
TABLE: Final = StreamTable(
    [
        ServiceSpec(stream_id=ECHO, name="auv/echo", server=2),
        TopicSpec(stream_id=NAV, name="{node}/nav"),
        TopicSpec(stream_id=LOG, name="{node}/log", qos=Qos(reliability=Reliability.RELIABLE)),
    ],
    nodes={1: "captured", 2: "auv", 3: "shore"},
)
SHARE: Final = 0.001
DAY_SHARE_S: Final = 86_400 * SHARE
RUN_S: Final = 9000


class Fleet:
    """Node 2 answers calls; node 1 makes as many as its own modem allows, and reliable samples."""

    def __init__(self, *, seed: int, sealed: bool = True) -> None:
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
        self._rng = random.Random(seed)
        self.network.every(8.0, self._flood)
        self.network.every(600.0, partial(self._call, 3), first_s=300.0)
        command = RemoteCommand(kind=CommandKind.ASK)
        for at_s in (0.6 * RUN_S, 0.8 * RUN_S):
            self.network.at(at_s, partial(self._command, command))
        self.network.run(until_s=RUN_S)

    def times_s(self, node: int, kind: type, stream_id: int) -> list[float]:
        """Return when a node had an event of a stream, s."""
        return [
            at_s
            for at_s, at, event in self.events
            if at == node
            and isinstance(event, kind)
            and getattr(event, "stream_id", 0) == stream_id
        ]

    @property
    def alarms(self) -> list[tuple[float, int, SealAlarm]]:
        """All alarms: instant, node, alarm."""
        return [each for each in self.events if isinstance(each[2], SealAlarm)]  # type: ignore[misc]

    def airtime_s(self) -> float:
        """Return for how long node 2 has transmitted, s."""
        return self.network.engine(2).stats.airtime_ns / 1e9

    def _flood(self) -> None:
        self.network.publish(1, NAV, b"n%d" % self._rng.randrange(100))
        try:
            self.network.publish(1, LOG, self._rng.randbytes(20))
            self._call(1)
        except QueueFullError:
            pass

    def _call(self, client: int) -> None:
        value = self._rng.randbytes(20)
        self.network.apply(client, lambda each, now: each.call(ECHO, value, now, timeout_s=50.0))

    def _command(self, command: RemoteCommand) -> None:
        self.network.apply(1, lambda each, now: each.commands.send(2, command, now))

    def _happened(self, address: int, event: Event) -> None:
        if isinstance(event, LinkStateChanged):
            return  # the network is being made
        self.events.append((self.network.now / 1e9, address, event))
        if isinstance(event, RequestReceived):
            self.network.apply(2, lambda each, now: each.reply(event.call, event.value, now))


@cache
def _fleet(*, sealed: bool = True) -> Fleet:
    return Fleet(seed=1, sealed=sealed)


def test_a_node_that_asks_without_end_is_answered_for_a_share_of_the_day() -> None:
    fleet, unlimited = _fleet(), _fleet(sealed=False)
    paid_s = DAY_SHARE_S + RUN_S * SHARE
    # Beside it: answers to node 3, to commands, and the last frame that made the debt.
    assert paid_s < fleet.airtime_s() < paid_s + 25
    assert unlimited.airtime_s() > 2.5 * fleet.airtime_s()
    told = {(at, each.address, each.refusal, each.is_too_many) for _, at, each in fleet.alarms}
    assert told == {(2, 1, Refusal.COSTLY, False)}
    assert not unlimited.alarms


def test_its_best_effort_samples_arrive_and_its_commands_are_answered() -> None:
    fleet = _fleet()
    begins_s = fleet.alarms[0][0]
    assert begins_s < 0.55 * RUN_S
    late = [at_s for at_s in fleet.times_s(2, SampleReceived, NAV) if at_s > begins_s]
    assert len(late) > 0.7 * (RUN_S - begins_s) / 8
    assert len(fleet.times_s(1, ResponseReceived, COMMANDS_STREAM_ID)) == 2


def test_other_nodes_are_answered_as_before() -> None:
    assert len(_fleet().times_s(3, ResponseReceived, ECHO)) >= RUN_S // 600 - 2


def test_when_its_debt_is_paid_it_is_answered_again() -> None:
    fleet = _fleet()
    begins_s = fleet.alarms[0][0]
    assert [at_s for at_s in fleet.times_s(1, ResponseReceived, ECHO) if at_s > begins_s + 600]
