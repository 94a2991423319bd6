"""A fleet beside a node that talks without pause: its emergencies, and its reports.

Node 2 publishes frames of one size faster than the channel takes them. The other nodes have
emergencies for each other and for node 2, at random instants, and each reports to node 1 once a
minute. They stand anywhere in a square of 2 km.
"""

import enum
import random
from functools import partial
from typing import Final

import msgspec

from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

BABBLER: Final = 2
SHORE: Final = 1
NEVER: Final = float("inf")
SIDE_M: Final = 2000.0
REPORT_EVERY_S: Final = 60.0
REPORT_BYTES: Final = 10
EMERGENCY_EVERY_S: Final = 60.0
PATIENCE_S: Final = 300.0
"""An emergency that takes longer counts as lost."""
_TAG_BYTES: Final = 3
_GREET_S: Final = 60.0
_BABBLES_AT_S: Final = 70.0
_FIRST_AT_S: Final = 100.0
_TALK, _BABBLE, _REPORT, _EMERGENCY = 1, 2, 3, 10
_PROFILE: Final = profile_named(DEFAULT_PROFILE)


class Talk(enum.Enum):
    """What the babbler says."""

    ONE = "to one"
    """Best-effort samples for node 1."""
    ALL = "to all"
    """Best-effort samples for all nodes."""
    RELIABLE = "reliable"
    """Reliable samples for node 1."""
    QUEUE = "queue"
    """A thousand best-effort samples that wait from the beginning."""
    PHOTO = "photo"
    """Reliable samples of 20 kB for node 1."""
    SHARE = "share"
    """As `ONE`, but so seldom that it takes an equal share of the channel."""
    NOTHING = "nothing"
    """It keeps silent."""


class Setting(msgspec.Struct, frozen=True, kw_only=True):
    """One kind of fleet."""

    nodes: int = 3
    """How many there are, the babbler included; at least 3."""
    frame_bytes: int = 33
    """Size of its frames."""
    addressed: bool = True
    """Whether modems hand over only what is for their node."""
    senses_carrier: bool = True
    """Whether modems tell what they hear."""
    reliable: bool = True
    """Whether emergencies are reliable samples, or best-effort ones."""
    talk: Talk = Talk.ONE
    """What the babbler says."""
    reports: bool = True
    """Whether the other nodes report."""


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """What became of the emergencies and reports of one run."""

    took_s: list[float]
    """For each emergency: time from publication to arrival, of it or of a newer one of its key,
    which takes its place, s, or `NEVER`."""
    reported: float
    """Share of the reports that arrived; NaN without reports."""
    busy: float
    """Share of the time that the babbler was on the air."""
    frames: int
    """Frames of the other nodes."""


def babble(
    seed: int,
    setting: Setting,
    *,
    emergencies: int = 15,
    rules: TransmitRules | None = None,
) -> Outcome:
    """Run one fleet.

    Args:
        seed: Everything follows from it.
        setting: The kind of fleet.
        emergencies: How many, one a minute.
        rules: The rules of all nodes; None: the defaults.
    """
    rng = random.Random(f"{seed}/babble")
    addresses = range(1, setting.nodes + 1)
    scenario = scenario_from_mapping(
        {
            "nodes": [
                {
                    "address": each,
                    "position": [rng.uniform(0, SIDE_M), rng.uniform(0, SIDE_M), 20.0],
                }
                for each in addresses
            ],
            "seed": seed,
            "channel": "none",
        },
        source="babble",
    )
    gave_s: dict[bytes, float] = {}
    key_of: dict[bytes, tuple[int, int]] = {}
    came_s: dict[bytes, float] = {}
    published, arrived = 0, 0

    def deliver(address: int, event: Event) -> None:
        nonlocal arrived
        if not isinstance(event, SampleReceived):
            return
        if event.stream_id >= _EMERGENCY:
            assert isinstance(event.value, bytes)
            assert event.value not in came_s, f"delivered twice, seed {seed}"
            came_s[event.value] = network.now / NS_PER_S
        arrived += event.stream_id == _REPORT

    network = VirtualNetwork(
        scenario,
        _table(setting),
        modem=Modem(addressed=setting.addressed, senses_carrier=setting.senses_carrier),
        rules=rules or TransmitRules(),
        digest=False,
        deliver=deliver,
    )
    for turn in range(3):
        for node in addresses:
            at_s = (turn + (node - 1) / setting.nodes) * _GREET_S / 3
            network.at(at_s, partial(network.publish, node, _TALK, b"h"))

    def report(node: int) -> None:
        nonlocal published
        published += 1
        network.publish(node, _REPORT, rng.randbytes(REPORT_BYTES))

    def press(source: int, to: int, value: bytes) -> None:
        gave_s[value], key_of[value] = network.now / NS_PER_S, (source, to)
        network.publish(source, _EMERGENCY + to, value)

    until_s = _FIRST_AT_S + emergencies * EMERGENCY_EVERY_S
    if setting.reports:
        for node in addresses:
            if node in (SHORE, BABBLER):
                continue
            for turn in range(int((until_s - _FIRST_AT_S) / REPORT_EVERY_S)):
                at_s = _FIRST_AT_S + (turn + rng.random()) * REPORT_EVERY_S
                network.at(at_s, partial(report, node))
    for number in range(emergencies):
        source = rng.choice([each for each in addresses if each != BABBLER])
        to = rng.choice([each for each in addresses if each != source])
        at_s = _FIRST_AT_S + (number + rng.random()) * EMERGENCY_EVERY_S
        network.at(at_s, partial(press, source, to, b"%04d" % number))
    _talk(network, setting, rng)
    network.run(until_s=until_s + EMERGENCY_EVERY_S)
    stats = list(network.stats_of(BABBLER))
    for _ in range(int(PATIENCE_S // EMERGENCY_EVERY_S)):
        if len(came_s) == len(gave_s):
            break
        until_s += EMERGENCY_EVERY_S
        network.run(until_s=until_s + EMERGENCY_EVERY_S)
    busy_ns = sum(each.airtime_ns for each in stats)

    def arrived_s(value: bytes) -> float:
        same = (each for each in gave_s if key_of[each] == key_of[value] and each >= value)
        return min((came_s[each] for each in same if each in came_s), default=NEVER)

    took_s = [arrived_s(value) - at_s for value, at_s in gave_s.items()]
    others = (node for node in addresses if node != BABBLER)
    return Outcome(
        took_s=[NEVER if each > PATIENCE_S else each for each in took_s],
        reported=arrived / published if published else float("nan"),
        busy=busy_ns / (network.now - _BABBLES_AT_S * NS_PER_S),
        frames=sum(each.frames_transmitted for node in others for each in network.stats_of(node)),
    )


def _talk(network: VirtualNetwork, setting: Setting, rng: random.Random) -> None:
    """Let the babbler begin."""
    head_bytes = 1 if setting.addressed else 3
    size_bytes = max(1, min(setting.frame_bytes, _PROFILE.mtu_bytes - _TAG_BYTES) - head_bytes)
    frame_s = _PROFILE.airtime_s(setting.frame_bytes)
    period_s = 0.9 * (frame_s + _PROFILE.gap_s)
    match setting.talk:
        case Talk.NOTHING:
            return
        case Talk.PHOTO:
            picture = rng.randbytes(20_000)
            network.every(300.0, partial(network.publish, BABBLER, _BABBLE, picture), first_s=70)
            return
        case Talk.QUEUE:
            for number in range(1000):
                content = number.to_bytes(2, "big") + bytes(max(0, size_bytes - 2))
                network.at(_BABBLES_AT_S, partial(network.publish, BABBLER, _BABBLE, content))
            period_s = frame_s + _PROFILE.gap_s
        case Talk.SHARE:
            period_s = setting.nodes * frame_s
        case _:
            pass
    content = bytes(size_bytes)
    network.every(
        period_s, partial(network.publish, BABBLER, _BABBLE, content), first_s=_BABBLES_AT_S
    )


def _table(setting: Setting) -> StreamTable:
    addresses = range(1, setting.nodes + 1)
    urgent = Qos(priority=Priority.REAL_TIME, depth=4)
    if setting.reliable:
        urgent = msgspec.structs.replace(urgent, reliability=Reliability.RELIABLE)
    babble = Qos(depth=1000 if setting.talk is Talk.QUEUE else 2)
    if setting.talk in (Talk.RELIABLE, Talk.PHOTO):
        babble = msgspec.structs.replace(babble, reliability=Reliability.RELIABLE)
    subscribers = None if setting.talk is Talk.ALL else (SHORE,)
    return StreamTable(
        [
            TopicSpec(stream_id=_TALK, name="{node}/talk"),
            TopicSpec(
                stream_id=_BABBLE,
                name="babble",
                qos=babble,
                publishers=(BABBLER,),
                subscribers=subscribers,
            ),
            TopicSpec(stream_id=_REPORT, name="{node}/report", subscribers=(SHORE,)),
            *(
                TopicSpec(
                    stream_id=_EMERGENCY + each,
                    name=f"stop/{each}/{{node}}",
                    qos=urgent,
                    publishers=tuple(other for other in addresses if other != each),
                    subscribers=(each,),
                )
                for each in addresses
            ),
        ],
        nodes={each: f"n{each}" for each in addresses},
    )
