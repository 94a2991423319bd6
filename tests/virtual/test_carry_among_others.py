"""Carried samples beside everything else: other mechanisms, other fleets, and forty nodes."""

import random
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import pytest

from tests.conftest import SOAK
from tests.virtual.mule import HEARD, HEARTBEAT_S, LOG, MODEM, MOORING, MULE, SHIP, Voyage, table
from tests.virtual.sealed import SealedFleet
from tests.virtual.test_carry import quickly, report
from tests.virtual.twolinks import medium
from zacoustic.core.base.journal import EPOCH_KEY
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    DeliveryEnded,
    DeliveryOutcome,
    Event,
    GoalFailed,
    GoalReceived,
    GoalStatus,
    RequestReceived,
    ResponseReceived,
    ResultReceived,
    SampleReceived,
)
from zacoustic.core.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

ARM, GOTO, NEWS = 20, 30, 40
DEAF = Modem(senses_carrier=False)
SETTLED_S = 7200.0


class Busy(Voyage):
    """A voyage whose mule has calls, goals and news for the mooring and the ship as well."""

    def __init__(self, seed: int, **more: Any) -> None:
        self.told: Counter[str] = Counter()
        """How often each kind of end was told."""
        self.executed: Counter[object] = Counter()
        """How often each request and goal was executed."""
        super().__init__(seed, **more)

    def _happened(self, address: int, event: Event) -> None:
        if address != MULE:  # it publishes as well
            super()._happened(address, event)
        if isinstance(event, RequestReceived | GoalReceived):
            now_s = self.now_s
            self.executed[event.call if isinstance(event, RequestReceived) else event.goal] += 1
            self.network.at(now_s, partial(self.network.apply, address, partial(_answer, event)))
        elif isinstance(event, ResponseReceived | CallFailed):
            what = "call" if event.stream_id == ARM else "command"
            self.told[f"{what} {type(event).__name__}"] += 1
        elif isinstance(event, ResultReceived):
            self.told[f"goal {event.status.name}"] += 1
        elif isinstance(event, GoalFailed):
            self.told["goal failed"] += 1
        elif isinstance(event, SampleReceived) and event.stream_id == NEWS:
            self.told["news"] += 1


def _answer(event: RequestReceived | GoalReceived, engine: Engine, now: int) -> None:
    if isinstance(event, RequestReceived):
        if event.call.stream_id == ARM:
            engine.reply(event.call, b"yes", now)
    else:
        engine.actions.accept(event.goal, now)
        engine.actions.finish(event.goal, GoalStatus.SUCCEEDED, b"done", now)


def busy_table() -> StreamTable:
    """Return the table of a voyage with a service, an action and a topic of the mooring."""
    known = table(after_s=30.0)
    reliable = Qos(reliability=Reliability.RELIABLE, depth=50)
    specs: list[StreamSpec] = [
        *(each.spec for each in known),
        ServiceSpec(stream_id=ARM, name="arm", server=MOORING, timeout_s=900.0),
        ActionSpec(stream_id=GOTO, name="goto", server=MOORING, timeout_s=900.0),
        TopicSpec(
            stream_id=NEWS, name="news", publishers=(MULE,), subscribers=(MOORING,), qos=reliable
        ),
    ]
    return StreamTable(specs, nodes=known.nodes)


@pytest.mark.parametrize("modem", [Modem(), DEAF], ids=["senses carrier", "deaf"])
def test_samples_are_carried_beside_calls_goals_and_news_of_the_same_nodes(
    modem: Modem, count: Callable[[int], int]
) -> None:
    answered = asked = 0
    for seed in range(count(200)):
        rng = random.Random(seed)
        loss = rng.choice((0.0, 0.2, 0.4))
        voyage = Busy(seed, loss=loss, hears=quickly, table=busy_table(), modem=modem)
        network = voyage.network
        for index in range(20):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        given = 6
        for _ in range(given):
            at_s = rng.uniform(0, 500)
            network.at(at_s, partial(network.apply, MULE, _call))
            network.at(at_s + rng.uniform(0, 5), partial(network.apply, MULE, _goal))
            network.at(at_s + rng.uniform(0, 5), partial(network.publish, MULE, NEWS, b"news"))
            network.at(at_s + rng.uniform(0, 5), partial(network.apply, MULE, _command))
        network.run(until_s=SETTLED_S)
        report(voyage)
        told = voyage.told
        # At a loss of 40 % and with a pass in five minutes some time out, which is an end as well.
        for what in ("call", "command"):
            ends = told[f"{what} ResponseReceived"] + told[f"{what} CallFailed"]
            assert ends == given, f"seed {seed}"
        assert sum(times for each, times in told.items() if each.startswith("goal")) == given
        assert told["news"] == given, f"seed {seed}"
        assert max(voyage.executed.values()) == 1, f"seed {seed}: executed twice"
        answered += told["call ResponseReceived"] + told["goal SUCCEEDED"]
        asked += 2 * given
    assert answered > 0.9 * asked


def _call(engine: Engine, now: int) -> None:
    engine.call(ARM, b"arm", now)


def _goal(engine: Engine, now: int) -> None:
    engine.actions.send_goal(GOTO, b"goto", now)


def _command(engine: Engine, now: int) -> None:
    engine.commands.send(MOORING, RemoteCommand(kind=CommandKind.ASK), now)


# Another fleet


def foreign_frames(seed: int) -> Sequence[TraceRecord]:
    """Return what three nodes of another fleet say, whose carried topics are others."""
    heard: list[TraceRecord] = []

    def note(record: TraceRecord) -> None:
        if record.what == "transmit":
            heard.append(record)

    theirs = table(after_s=30.0, depth=500, expires_s=7200.0)
    specs: list[StreamSpec] = [*(each.spec for each in theirs), *_others()]
    names = {each: f"other{each}" for each in theirs.nodes}
    voyage = Voyage(
        seed, loss=0.1, hears=quickly, table=StreamTable(specs, nodes=names), trace=note
    )
    rng = random.Random(seed)
    for address in (MOORING, MULE, SHIP):  # boot epochs are drawn, only those of a test are counted
        epoch = rng.randrange(1 << 16).to_bytes(2, "big")
        voyage.network.journal(address).put_back({EPOCH_KEY: epoch})
        voyage.network.restart(address)
    for index in range(20):
        voyage.publish_at(10.0 + 25 * index, b"foreign %d" % index)
    voyage.network.run(until_s=1500)
    return heard


def _others() -> list[StreamSpec]:
    return [TopicSpec(stream_id=each, name=f"other{each}") for each in (10, 11, 12)]


@pytest.mark.parametrize("sealed", [False, True])
def test_carried_samples_of_another_fleet_in_reach(
    sealed: bool, count: Callable[[int], int]
) -> None:
    """A sealed fleet notices nothing. Another one may take an ACK of the others for its own, and
    then a sample is not carried: its publisher is never told that it was delivered."""
    for seed in range(count(200)):
        rng = random.Random(seed)
        strange = foreign_frames(1000 + seed % 8)
        voyage = Voyage(
            seed, loss=0.1, hears=quickly, table=table(after_s=30.0, expires_s=7200.0),
            build=SealedFleet() if sealed else Engine,
        )  # fmt: skip
        for index in range(20):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        at_s = 0.0
        for each in strange:
            at_s += rng.expovariate(1 / 5)
            octets = bytearray.fromhex(each.frame)
            if rng.random() < 0.2:
                octets[rng.randrange(len(octets))] ^= 1 << rng.randrange(8)
            to = each.peer if each.peer != BROADCAST else rng.choice((MOORING, MULE, SHIP))
            heard = ReceivedFrame(
                frame_bytes=bytes(octets), source=each.node, destination=each.peer,
                received_at=round(at_s * NS_PER_S),
            )  # fmt: skip
            hear = partial(voyage.network.apply, to, partial(_hear, heard))
            voyage.network.at(at_s, hear)
        voyage.network.run(until_s=at_s + 2 * SETTLED_S)
        if sealed:
            report(voyage)
            continue
        got = [value for value, _ in voyage.got if value in voyage.given]
        assert len(got) == len(set(got)), f"seed {seed}: doubled"
        ends = {DeliveryOutcome.DELIVERED, DeliveryOutcome.EXPIRED, DeliveryOutcome.REFUSED}
        assert set(voyage.outcomes.values()) <= ends
        told = {
            value
            for value, outcome in voyage.outcomes.items()
            if outcome is DeliveryOutcome.DELIVERED
        }
        assert told <= set(got), f"seed {seed}: told delivered, and is not"
        assert set(voyage.outcomes) == set(voyage.given), f"seed {seed}: without an end"


def _hear(frame: ReceivedFrame, engine: Engine, now: int) -> None:
    engine.handle_frame(frame, now)


# Forty nodes

NODES = 40 if SOAK else 12
GLIDERS = (1, 2, 3)
SHORE = NODES
MOORINGS = range(4, NODES)
PASS_S = 1200.0


def passes(source: int, node: int, now: int) -> bool:
    """Tell who hears whom: each glider visits its moorings one after the other, then the shore."""
    ends = sorted((source, node))
    at_s = now / NS_PER_S % PASS_S
    if ends[0] not in GLIDERS or ends[1] in GLIDERS:
        return ends[0] not in GLIDERS and SHORE not in ends and ends[1] - ends[0] == 1
    if ends[1] == SHORE:
        return at_s >= 0.7 * PASS_S
    return ends[1] % len(GLIDERS) + 1 == ends[0] and at_s < 0.6 * PASS_S


def test_three_gliders_bring_home_what_a_field_of_moorings_says(
    count: Callable[[int], int],
) -> None:
    ends: dict[str, Any] = {
        "publishers": tuple(MOORINGS), "subscribers": (SHORE,), "journal": True,
        "qos": Qos(reliability=Reliability.RELIABLE, depth=50),
        "carry": Carry(by=GLIDERS, after_s=60.0, expires_s=86_400.0),
    }  # fmt: skip
    nodes = {each: f"n{each}" for each in range(1, NODES + 1)}
    streams = StreamTable([TopicSpec(stream_id=LOG, name="{node}/log", **ends)], nodes=nodes)
    for seed in range(count(8) if not SOAK else 3):
        rng = random.Random(seed)
        given: dict[int, list[bytes]] = defaultdict(list)
        got: dict[int, list[bytes]] = defaultdict(list)
        ended: Counter[DeliveryOutcome] = Counter()

        def happened(address: int, event: Event) -> None:
            if isinstance(event, SampleReceived) and address == SHORE:
                got[event.source].append(event.value)  # noqa: B023
            elif isinstance(event, DeliveryEnded):
                ended[event.outcome] += 1  # noqa: B023

        def disturb(source: int, node: int, now: int) -> Sequence[float]:
            return (0.0,) if passes(source, node, now) and rng.random() > 0.1 else ()  # noqa: B023

        network = VirtualNetwork(
            medium(NODES, apart_m=20.0, profile=MODEM, loss=0.0, seed=seed),
            table=streams, deliver=happened, disturb=disturb, digest=False,
            rules=dict.fromkeys((*GLIDERS, SHORE), HEARD),
        )  # fmt: skip
        for mooring in MOORINGS:
            for index in range(5):
                value = b"%d %d" % (mooring, index)
                given[mooring].append(value)
                at_s = 60.0 * index + rng.uniform(0, 60)
                network.at(at_s, partial(network.publish, mooring, LOG, value))
        network.run(until_s=8 * PASS_S)
        assert got == given, seed
        samples = sum(map(len, given.values()))
        assert ended == {DeliveryOutcome.DELIVERED: samples}
        frames = sum(network.engine(each).stats.frames_transmitted for each in nodes)
        frames -= round((len(GLIDERS) + 1) * 8 * PASS_S / HEARTBEAT_S)
        assert frames / samples < 40, frames / samples
