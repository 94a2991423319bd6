"""A peer that falls silent while something of every kind waits for it, and what that costs.

Node 1, the giver, and node 3, the silent one, know each other; on routes and floods node 2 is
between them. At `SILENT_AT_S` the peer crashes or no longer hears, and the giver gets what waits.
Frames are counted as they begin on the channel; of an engine nothing is asked. What a bond asks on
a link that is declared to cost nothing is counted apart.

==============  ====================================================================================
`Way`           the kind of link
`Waits`         what waits
`Silence`       ABSENT: the peer is off; DEAF: it talks, but hears nothing (a one-way channel)
==============  ====================================================================================
"""

import enum
import math
import random
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, Final

import msgspec

from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.base.qos import Forward, Priority, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    DeliveryEnded,
    Event,
    GoalReceived,
    GoalStatus,
    RequestReceived,
    ResponseReceived,
    ResultReceived,
    SampleReceived,
    SubscribersChanged,
)
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.relay.route import Route
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

GIVER, BETWEEN, PEER = 1, 2, 3
DAY_S: Final = 86_400.0
MOST_A_DAY: Final = 100
"""Frames of one node for one silent peer; stated in docs/operations.md."""
SILENT_AT_S: Final = 200.0
TALKS_EVERY_S: Final = 60.0
"""How often a peer that hears nothing says something."""
_APART_M: Final = 700.0
RADIO: Final = "radio"
_RADIO_MODEM: Final = Modem(
    addressed=False, checked=False, senses_carrier=False, controls_access=True
)
_BOND: Final = Bond(number=1, links=(RADIO, ONE_LINK))
_FAR: Final = Route(route_id=1, name="far", path=(GIVER, BETWEEN, PEER), link=ONE_LINK)
_LONG_S: Final = 3 * DAY_S

_TALK, _SAMPLE, _KEPT, _DATED, _STOP, _OBJECT, _KEPT_OBJECT, _CARRIED = 1, 2, 3, 4, 5, 6, 7, 8
_VIEW: Final = 9
_MANY: Final = range(60, 70)
_OTHER: Final = TopicSpec(stream_id=80, name="other")
_CALL, _ASKED, _GOAL, _PURSUED = 20, 21, 30, 31


class Way(enum.Enum):
    """The kind of link between the two."""

    PLAIN = "plain"
    DELEGATED = "delegated"
    """Its device decides when frames go, as DESERT does."""
    ROUTE = "route"
    FLOOD = "flood"
    BOND = "bond"
    """A radio first, sound second."""


class Silence(enum.Enum):
    """What becomes of the peer."""

    ABSENT = "absent"
    DEAF = "deaf"


class Waits(enum.Enum):
    """What waits for the peer."""

    SAMPLE = "sample"
    MANY = "ten topics with four samples each"
    KEPT = "journalled sample"
    DATED = "sample with a deadline"
    EMERGENCY = "emergency"
    OBJECT = "object"
    KEPT_OBJECT = "journalled object"
    CARRIED = "carried sample"
    SUBSCRIPTION = "subscription"
    CALL = "call"
    ANSWER = "answer of a call"
    GOAL = "goal"
    RESULT = "result of a goal"
    COMMAND = "command"
    RANGE = "range request"
    RANGES = "schedule of ranges"
    TABLE = "agreement on another table"


ONE_OF_EACH: Final = tuple(each for each in Waits if each not in (Waits.MANY, Waits.EMERGENCY))
"""All together, but for an emergency, and for what is many."""
_ENDS: Final = (Waits.COMMAND, Waits.RANGE, Waits.RANGES, Waits.TABLE)
"""What the peer does not get when it is back after a day: a command lives for ten minutes."""


class Outcome(msgspec.Struct, frozen=True):
    """What came of a run."""

    frames: dict[int, list[int]]
    """By node, the frames of each day of silence."""
    late_frames: dict[int, int]
    """Of these, those of the first day after its first ten minutes."""
    arrived_s: dict[Waits, float]
    """From the return of the peer to the arrival, s; `math.inf`: never."""
    ended: dict[Waits, str]
    """What ended before, with its reason."""


def rest_of(waits: Iterable[Waits], way: Way) -> list[Waits]:
    """Return the kinds that a link has: only the modem itself measures ranges."""
    only = {Waits.RANGE, Waits.RANGES}
    return [each for each in waits if way is Way.PLAIN or each not in only]


class Trial:
    """One run; see the module.

    Args:
        seed: Everything follows from it.
        way: The kind of link.
        waits: What waits.
        silence: What becomes of the peer.
        loss: Share of the frames that is lost before the silence and after it.
        is_alone: The node between the two is off, too.
    """

    def __init__(
        self,
        seed: int,
        way: Way,
        waits: Iterable[Waits],
        *,
        silence: Silence = Silence.ABSENT,
        loss: float = 0.0,
        is_alone: bool = False,
    ) -> None:
        self.waits = tuple(waits)
        self._is_alone = is_alone
        self._requests: list[Any] = []
        self._goals: list[Any] = []
        self._way, self._silence, self._loss = way, silence, loss
        self._rng = random.Random(f"silent peer {seed}")
        self._is_silent = False
        self._frames: list[tuple[int, int]] = []
        self.arrived: dict[Waits, int] = {}
        self.ended: dict[Waits, str] = {}
        self._ids: dict[int, Waits] = {}
        has_ranges = any(each in (Waits.RANGE, Waits.RANGES) for each in self.waits)
        modem = msgspec.structs.replace(modem_of(way), acknowledges=has_ranges)
        self.network = VirtualNetwork(
            scenario(seed),
            _table(),
            modem=modem,
            rules=rules(way),
            digest=False,
            deliver=self._deliver,
            disturb=self._disturb,
            trace=self._trace,
            link=ONE_LINK if way is Way.BOND else None,
        )
        if way is Way.BOND:
            self.network.add_link(
                RADIO,
                scenario(seed, profile="ideal"),
                modem=modem_of(way, RADIO),
                disturb=self._disturb,
            )
        for turn in range(4):
            for node in (GIVER, BETWEEN, PEER):
                self.network.at(20 * turn + 6 * node, partial(self._publish, node, _TALK, b"hi"))
        self.network.at(90, partial(self._ask, _ASKED))
        self.network.at(110, partial(self._ask, _PURSUED))
        if Waits.TABLE in self.waits:
            self.network.at(SILENT_AT_S - 12, self._change_table)
        self.network.at(SILENT_AT_S, self._fall_silent)
        for kind in self.waits:
            at_s = SILENT_AT_S + self._rng.uniform(0.1, 1)
            self.network.at(at_s, partial(self.network.apply, GIVER, partial(self._give, kind)))

    def run(self, *, days: int = 1, returns: bool = True) -> Outcome:
        """Run the days of silence, and the return of the peer."""
        until_s = SILENT_AT_S + days * DAY_S
        self.network.run(until_s=until_s)
        nodes = (GIVER,) if self._is_alone else (GIVER, BETWEEN)
        frames = {node: self._by_day(node, days) for node in nodes}
        late_at = (SILENT_AT_S + 600) * NS_PER_S
        late = {
            node: sum(each == node and late_at < at < late_at + DAY_S * NS_PER_S
                      for at, each in self._frames)
            for node in nodes
        }  # fmt: skip
        back_at = round(until_s * NS_PER_S)
        if returns:
            self._is_silent = False
            if self._silence is Silence.ABSENT:
                self.network.start(PEER)
            awaited = [each for each in self._arriving if each not in self.ended]
            while until_s < SILENT_AT_S + days * DAY_S + 4 * 3600 and not all(
                each in self.arrived for each in awaited
            ):
                until_s += 5
                self.network.run(until_s=until_s)
        arrived_s = {
            each: (self.arrived[each] - back_at) / NS_PER_S if each in self.arrived else math.inf
            for each in self._arriving
        }
        return Outcome(frames=frames, late_frames=late, arrived_s=arrived_s, ended=self.ended)

    # Below the methods above

    @property
    def _arriving(self) -> list[Waits]:
        # A call ends with the process that made it.
        lost = {*_ENDS} | ({Waits.ANSWER} if self._silence is Silence.ABSENT else set())
        return [each for each in self.waits if each not in lost]

    def _by_day(self, node: int, days: int) -> list[int]:
        counted = Counter(
            int((at / NS_PER_S - SILENT_AT_S) // DAY_S)
            for at, each in self._frames
            if each == node and at > SILENT_AT_S * NS_PER_S
        )
        return [counted[day] for day in range(days)]

    def _publish(self, node: int, stream_id: int, value: bytes) -> None:
        if self.network.is_running(node):
            self.network.publish(node, stream_id, value)

    def _ask(self, stream_id: int) -> None:
        """Let the peer ask the giver, who answers when the peer is silent."""

        def ask(engine: Engine, now: int) -> object:
            if stream_id == _ASKED:
                return engine.call(_ASKED, b"?", now)
            return engine.actions.send_goal(_PURSUED, b"?", now, timeout_s=_LONG_S)

        self.network.apply(PEER, ask)

    def _change_table(self) -> None:
        """Let the peer come back with another table, say something, and be gone."""
        self.network.restart(PEER, _table(_OTHER))
        self.network.publish(PEER, _TALK, b"hi")
        self.network.at(SILENT_AT_S - 2, lambda: self.network.set_table(PEER, _table()))

    def _fall_silent(self) -> None:
        self._is_silent = True
        if self._is_alone:
            self.network.crash(BETWEEN)
        if self._silence is Silence.ABSENT:
            self.network.crash(PEER)
        else:
            self.network.every(
                TALKS_EVERY_S, partial(self._publish, PEER, _TALK, b"me"), first_s=SILENT_AT_S + 30
            )

    def _disturb(self, source: int, node: int, now: int) -> Sequence[float]:
        if self._way in (Way.ROUTE, Way.FLOOD) and {source, node} == {GIVER, PEER}:
            return ()
        if self._is_silent and node == PEER:
            return ()
        if self._rng.random() < self._loss and not self._is_silent:
            return ()
        return (self._rng.uniform(0.2, 1.5),) if self._way is Way.DELEGATED else (0.0,)

    def _trace(self, record: TraceRecord) -> None:
        if record.what == "transmit" and record.link == ONE_LINK:
            self._frames.append((record.at, record.node))

    def _give(self, kind: Waits, engine: Engine, now: int) -> None:
        """Give the giver something for the peer."""
        rng = self._rng
        topics = {
            Waits.SAMPLE: _SAMPLE, Waits.KEPT: _KEPT, Waits.DATED: _DATED, Waits.EMERGENCY: _STOP,
        }  # fmt: skip
        match kind:
            case Waits.MANY:
                for stream_id in _MANY:
                    for number in range(4):
                        engine.publish(stream_id, bytes([number]) * 9, now)
            case Waits.OBJECT | Waits.KEPT_OBJECT:
                topic = _OBJECT if kind is Waits.OBJECT else _KEPT_OBJECT
                self._ids[engine.publish(topic, rng.randbytes(1500), now)] = kind
            case Waits.CARRIED:
                self._ids[engine.publish(_CARRIED, b"carried", now)] = kind
            case Waits.SUBSCRIPTION:
                engine.subscriptions.want(_VIEW, now)
            case Waits.CALL:
                engine.call(_CALL, b"call", now)
            case Waits.ANSWER:
                for request in self._requests:
                    engine.reply(request, b"!", now)
            case Waits.GOAL:
                engine.actions.send_goal(_GOAL, b"goal", now, timeout_s=_LONG_S)
            case Waits.RESULT:
                for goal in self._goals:
                    engine.actions.finish(goal, GoalStatus.SUCCEEDED, b"!", now)
            case Waits.COMMAND:
                engine.commands.send(PEER, RemoteCommand(kind=CommandKind.ASK), now)
            case Waits.RANGE:
                engine.ranging.request(PEER, now, timeout_s=DAY_S)
            case Waits.RANGES:
                engine.ranging.repeat(PEER, 30.0, now)
            case Waits.TABLE:
                pass  # the peer has begun it
            case _:
                self._ids[engine.publish(topics[kind], b"sample", now)] = kind

    def _deliver(self, address: int, event: Event) -> None:
        kind: Waits | None = None
        match event:
            case RequestReceived() if address == GIVER:
                self._requests.append(event.call)
                return
            case GoalReceived() if address == GIVER:
                self._goals.append(event.goal)
                self.network.at(
                    self.network.now / NS_PER_S,
                    lambda: self.network.apply(
                        GIVER, lambda engine, now: engine.actions.accept(event.goal, now)
                    ),
                )
                return
            case DeliveryEnded() if address == GIVER and event.delivery_id in self._ids:
                if event.outcome.value != "delivered":
                    self.ended[self._ids[event.delivery_id]] = event.detail or event.outcome.value
                return
            case SubscribersChanged() if address == PEER and event.subscribers:
                kind = Waits.SUBSCRIPTION
            case SampleReceived() if address == PEER:
                topics = {
                    _SAMPLE: Waits.SAMPLE, _KEPT: Waits.KEPT, _DATED: Waits.DATED,
                    _STOP: Waits.EMERGENCY, _OBJECT: Waits.OBJECT, _KEPT_OBJECT: Waits.KEPT_OBJECT,
                    _CARRIED: Waits.CARRIED, _MANY[-1]: Waits.MANY,
                }  # fmt: skip
                kind = topics.get(event.stream_id)
            case RequestReceived() if address == PEER:
                kind = Waits.CALL
            case GoalReceived() if address == PEER:
                kind = Waits.GOAL
            case ResponseReceived() if address == PEER:
                kind = Waits.ANSWER
            case ResultReceived() if address == PEER:
                kind = Waits.RESULT
        if kind is not None:
            self.arrived.setdefault(kind, self.network.now)


def modem_of(way: Way, link: str = ONE_LINK) -> Modem:
    """Return the modem of a link."""
    return _RADIO_MODEM if link == RADIO else Modem(controls_access=way is Way.DELEGATED)


def scenario(seed: int, *, profile: str = "") -> Scenario:
    """Return three nodes in a row."""
    apart_m = _APART_M
    mapping: dict[str, Any] = {
        "channel": "none",
        "seed": seed,
        "nodes": [
            {"address": each, "position": [apart_m * each, 0, 10]}
            for each in (GIVER, BETWEEN, PEER)
        ],
    }
    if profile:
        mapping["profile"] = profile
    return scenario_from_mapping(mapping, source="a test")


def rules(way: Way) -> dict[int, TransmitRules]:
    """Return the rules of each node for a kind of link."""
    streams = (*range(2, 10), *_MANY, _CALL, _ASKED, _GOAL, _PURSUED)
    contact = ContactRules(announces=True)
    nodes = (GIVER, BETWEEN, PEER)
    match way:
        case Way.ROUTE:
            by_far = TransmitRules(
                routes=(_FAR,), links_of_streams=dict.fromkeys(streams, "far"), contact=contact,
                default_link="far",
            )  # fmt: skip
            between = TransmitRules(routes=(_FAR,), contact=contact)
            return {GIVER: by_far, BETWEEN: between, PEER: by_far}
        case Way.FLOOD:
            flood = Flood(link=ONE_LINK, hops=3)
            rules = TransmitRules(
                flood=flood, links_of_streams=dict.fromkeys(streams, FLOOD_NAME), contact=contact,
                default_link=FLOOD_NAME,
            )  # fmt: skip
            return dict.fromkeys(nodes, rules)
        case Way.BOND:
            links = (
                LinkRules(name=RADIO, bonded=BondLink(cost=LinkCost.FREE, probe_s=600.0)),
                LinkRules(name=ONE_LINK),
            )
            rules = TransmitRules(
                links=links, bonds=(_BOND,), contact=contact, default_link=_BOND.name,
                links_of_streams=dict.fromkeys(streams, _BOND.name),
            )  # fmt: skip
            return dict.fromkeys(nodes, rules)
    return dict.fromkeys(nodes, TransmitRules(contact=contact))


def _table(*more: TopicSpec) -> StreamTable:
    reliable = Qos(reliability=Reliability.RELIABLE, depth=4)

    def topic(stream_id: int, name: str, *, journal: bool = False, **more: Any) -> TopicSpec:
        qos = msgspec.structs.replace(reliable, **more)
        return TopicSpec(
            stream_id=stream_id, name=name, qos=qos, publishers=(GIVER,), subscribers=(PEER,),
            journal=journal,
        )  # fmt: skip

    return StreamTable(
        [
            TopicSpec(stream_id=_TALK, name="{node}/talk"),
            topic(_SAMPLE, "sample"),
            topic(_KEPT, "kept", journal=True),
            topic(_DATED, "dated", deadline_s=10.0),
            topic(_STOP, "stop", priority=Priority.REAL_TIME),
            topic(_OBJECT, "object", priority=Priority.BACKGROUND),
            topic(_KEPT_OBJECT, "keptobject", journal=True, priority=Priority.BACKGROUND),
            TopicSpec(
                stream_id=_CARRIED,
                name="carried",
                qos=msgspec.structs.replace(reliable, depth=100),
                publishers=(GIVER,),
                subscribers=(PEER,),
                journal=True,
                carry=Carry(by=(BETWEEN,), after_s=120.0, expires_s=_LONG_S),
            ),
            TopicSpec(
                stream_id=_VIEW,
                name="view",
                publishers=(PEER,),
                qos=Qos(forward=Forward.ON_DEMAND),
            ),
            *(topic(each, f"topic{each}") for each in _MANY),
            ServiceSpec(stream_id=_CALL, name="call", server=PEER, timeout_s=_LONG_S),
            ServiceSpec(stream_id=_ASKED, name="asked", server=GIVER, timeout_s=_LONG_S),
            ActionSpec(
                stream_id=_GOAL, name="goal", server=PEER, timeout_s=_LONG_S,
                result_timeout_s=_LONG_S,
            ),
            ActionSpec(
                stream_id=_PURSUED, name="pursued", server=GIVER, timeout_s=_LONG_S,
                result_timeout_s=_LONG_S, journal=True,
            ),
            *more,
        ],
        nodes={GIVER: "giver", BETWEEN: "between", PEER: "peer"},
    )  # fmt: skip
