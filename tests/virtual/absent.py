"""A node that has crashed, and another one that has something of every kind for it.

Two nodes 1500 m apart know each other. One crashes; then the other one gives what is asked for: a
reliable sample, a call, a goal, a command, an object of 3 kB, an emergency. Ten minutes later the
crashed node is back.
"""

import enum
import math
import random
from collections.abc import Iterable
from functools import partial
from typing import Final

import msgspec

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, RequestReceived, SampleReceived
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import GoalReceived
from zacoustic.testing.virtual import Modem, VirtualNetwork

NEVER: Final = math.inf
RANGE_M: Final = 1500.0
CRASHES_AT_S: Final = 120.0
ABSENT_S: Final = 600.0
OBJECT_BYTES: Final = 3000
_GIVER, _ABSENT = 1, 2
_TALK, _SAMPLE, _OBJECT, _EMERGENCY, _CALL, _GOAL = 1, 10, 11, 12, 20, 30
_BACK_AT_S: Final = CRASHES_AT_S + 1 + ABSENT_S


class Kind(enum.Enum):
    """What waits for the absent node."""

    SAMPLE = "sample"
    CALL = "call"
    GOAL = "goal"
    COMMAND = "command"
    OBJECT = "object"
    EMERGENCY = "emergency"


EVERYTHING: Final = (Kind.SAMPLE, Kind.CALL, Kind.GOAL, Kind.COMMAND, Kind.OBJECT)


class Outcome(msgspec.Struct, frozen=True):
    """What came of a run."""

    frames: int
    """Frames that were transmitted to the absent node in the ten minutes."""
    airtime_s: float
    """Their airtime, s."""
    arrived_s: dict[Kind, float]
    """From the return of the node to the arrival of each kind, s, or `NEVER`; of a command nothing,
    since it is given up after ten minutes."""


def run(
    seed: int,
    kinds: Iterable[Kind],
    *,
    loss: float = 0.0,
    forged_s: Iterable[float] = (),
    modem: Modem | None = None,
    access: AccessSpec | None = None,
    announces: bool = False,
) -> Outcome:
    """Let one node be absent.

    Args:
        seed: Everything follows from it.
        kinds: What the other one has for it.
        loss: Share of the frames that is lost.
        forged_s: Instants after the crash at which somebody repeats a frame of the absent node, s.
        modem: What the modems do by themselves; None: what S2C modems do.
        access: How they share the channel; None: they sense each other's carriers.
        announces: Whether a node that is back says so.
    """
    kinds = tuple(kinds)
    awaited = [kind for kind in kinds if kind is not Kind.COMMAND]
    arrived: dict[Kind, float] = {}
    sent: list[TraceRecord] = []
    said: list[bytes] = []

    def deliver(address: int, event: Event) -> None:
        kind = kind_of(event) if address == _ABSENT else None
        if kind is not None:
            arrived.setdefault(kind, network.now / NS_PER_S - _BACK_AT_S)

    def trace(record: TraceRecord) -> None:
        if record.what == "transmit" and record.node == _GIVER:
            sent.append(record)
        elif record.what == "transmit":
            said.append(bytes.fromhex(record.frame))

    def forge() -> None:
        frame = ReceivedFrame(
            frame_bytes=said[-1], received_at=network.now, source=_ABSENT, destination=_GIVER
        )
        network.apply(_GIVER, lambda engine, now: engine.handle_frame(frame, now))

    scenario = scenario_from_mapping(
        {
            "nodes": [
                {"address": _GIVER, "position": [0, 0, 10]},
                {"address": _ABSENT, "position": [RANGE_M, 0, 10]},
            ],
            "seed": seed,
            "channel": "none",
            "loss": {"frame": loss},
        },
        source="test",
    )
    network = VirtualNetwork(
        scenario,
        table(),
        modem=modem,
        rules=TransmitRules(access=access, contact=ContactRules(announces=announces)),
        digest=False,
        deliver=deliver,
        trace=trace,
    )
    for turn in range(3):  # they get to know each other
        for node in (_GIVER, _ABSENT):
            at_s = turn * 30 + 10 * node
            network.at(at_s, partial(network.apply, node, talk))
    network.at(CRASHES_AT_S, partial(network.crash, _ABSENT))
    rng = random.Random(seed)
    for kind in kinds:
        network.at(
            CRASHES_AT_S + rng.uniform(0, 1), partial(network.apply, _GIVER, partial(give, kind))
        )
    for forged_at_s in forged_s:
        network.at(CRASHES_AT_S + forged_at_s, forge)
    network.run(until_s=_BACK_AT_S)
    away = [each for each in sent if each.at > CRASHES_AT_S * NS_PER_S]
    capabilities = network.engine(_GIVER).capabilities
    assert capabilities is not None
    airtime_ns = sum(capabilities.airtime_ns(each.size_bytes) for each in away)
    network.start(_ABSENT)
    until_s = _BACK_AT_S
    while len(arrived) < len(awaited) and until_s < _BACK_AT_S + 6 * 3600:
        until_s += 10 if until_s < _BACK_AT_S + 1800 else 600
        network.run(until_s=until_s)
    return Outcome(
        frames=len(away),
        airtime_s=airtime_ns / NS_PER_S,
        arrived_s={kind: arrived.get(kind, NEVER) for kind in awaited},
    )


def talk(engine: Engine, now: int) -> object:
    """Let a node say something, so that it is known."""
    return engine.publish(_TALK, b"", now)


def give(kind: Kind, engine: Engine, now: int) -> object:
    """Give an engine something for the absent node."""
    match kind:
        case Kind.CALL:
            return engine.call(_CALL, b"call", now)
        case Kind.GOAL:
            return engine.actions.send_goal(_GOAL, b"goal", now, timeout_s=3600.0)
        case Kind.COMMAND:
            order = RemoteCommand(kind=CommandKind.ASK)
            return engine.commands.send(_ABSENT, order, now)
        case Kind.OBJECT:
            return engine.publish(_OBJECT, random.Random(1).randbytes(OBJECT_BYTES), now)
        case _:
            topics = {Kind.SAMPLE: _SAMPLE, Kind.EMERGENCY: _EMERGENCY}
            return engine.publish(topics[kind], b"sample", now)


def kind_of(event: Event) -> Kind | None:
    """Return what an event shows to have arrived; None: nothing of it."""
    match event:
        case SampleReceived():
            topics = {_SAMPLE: Kind.SAMPLE, _OBJECT: Kind.OBJECT, _EMERGENCY: Kind.EMERGENCY}
            return topics.get(event.stream_id)
        case RequestReceived():
            return Kind.CALL
        case GoalReceived():
            return Kind.GOAL
    return None


def table() -> StreamTable:
    """Return the table of both nodes."""
    reliable = Qos(reliability=Reliability.RELIABLE, depth=4)

    def topic(stream_id: int, name: str, qos: Qos) -> TopicSpec:
        return TopicSpec(
            stream_id=stream_id, name=name, qos=qos, publishers=(_GIVER,), subscribers=(_ABSENT,)
        )

    return StreamTable(
        [
            TopicSpec(stream_id=_TALK, name="{node}/talk"),
            topic(_SAMPLE, "sample", reliable),
            topic(
                _OBJECT,
                "object",
                msgspec.structs.replace(reliable, priority=Priority.BACKGROUND),
            ),
            topic(
                _EMERGENCY,
                "emergency",
                msgspec.structs.replace(reliable, priority=Priority.REAL_TIME),
            ),
            ServiceSpec(stream_id=_CALL, name="call", server=_ABSENT, timeout_s=3600.0),
            ActionSpec(
                stream_id=_GOAL,
                name="goal",
                server=_ABSENT,
                timeout_s=3600.0,
                result_timeout_s=3600.0,
            ),
        ],
        nodes={_GIVER: "giver", _ABSENT: "absent"},
    )
