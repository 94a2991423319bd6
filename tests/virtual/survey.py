"""Five nodes on a TDMA schedule that publish nav and status: a survey, without its vehicles.

Each publishes nav every 20 s and status every 40 s; node 1 is the sink. Slots hold two of the
largest frames.
"""

import math
import random
from functools import partial
from typing import Any, Final

import msgspec

from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import TdmaSpec
from zacoustic.core.schedule.access.spec import SLOWEST_SOUND_M_S
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.testing.virtual import VirtualNetwork

NODES: Final = range(1, 6)
SINK: Final = 1
RANGE_M: Final = 1500.0
CLOCK_ERROR_S: Final = 0.005
NAV: Final = 10
STATUS: Final = 11
PERIODS_S: Final = {NAV: 20.0, STATUS: 40.0}

_PROFILE = profile_named(DEFAULT_PROFILE)
_FRAME_S = _PROFILE.airtime_s(_PROFILE.mtu_bytes)
SLOT_S: Final = 2 * _FRAME_S + _PROFILE.gap_s + RANGE_M / SLOWEST_SOUND_M_S + 0.03
SCHEDULE: Final = TdmaSpec(
    slots=tuple(NODES), slot_s=SLOT_S, clock_error_s=CLOCK_ERROR_S, max_range_m=RANGE_M
)


def _number(name: str, low: float, high: float, step: float, **more: Any) -> FieldSpec:
    return FieldSpec(name=name, type="float64", range=(low, high), step=step, **more)


_TYPES = TypeTable(
    [
        TypeSpec(
            name="Nav",
            fields=(
                _number("lat", 54.1, 54.3, 1e-6),
                _number("lon", 10.1, 10.3, 1e-6),
                _number("depth", 0, 1000, 0.1),
                _number("heading", 0, 360, 0.1, wraps=True),
                _number("pitch", -45, 45, 0.1),
                _number("roll", -45, 45, 0.1),
                _number("speed", -1, 4, 0.01),
                _number("altitude", 0, 200, 0.1),
                _number("yaw_rate", -20, 20, 0.1),
            ),
        ),
        TypeSpec(
            name="Status",
            fields=(
                FieldSpec(name="mode", type="uint8", range=(0, 7)),
                FieldSpec(name="battery", type="uint8", range=(0, 100)),
                _number("voltage", 18, 30, 0.1),
                *(FieldSpec(name=f"leak{index}", type="bool") for index in range(4)),
                FieldSpec(name="leg", type="uint8"),
                FieldSpec(name="fault", type="uint16"),
            ),
        ),
    ]
)
_TABLE = StreamTable(
    [
        TopicSpec(
            stream_id=stream_id,
            name=f"{{node}}/{type_name.lower()}",
            type_name=type_name,
            subscribers=(SINK,),
            qos=Qos(depth=4, lifespan_s=120.0),
        )
        for stream_id, type_name in ((NAV, "Nav"), (STATUS, "Status"))
    ],
    types=_TYPES,
    nodes={node: f"n{node}" for node in NODES},
)


class Result(msgspec.Struct, frozen=True):
    """What one run gave."""

    published: int
    """By all nodes but the sink."""
    delivered: int
    """To the sink."""
    frames: int
    losses: dict[str, int]
    longest_s: float
    """Longest time from publication to delivery."""


def _values(stream_id: int, rng: random.Random) -> dict[str, object]:
    if stream_id == NAV:
        return {
            "lat": 54.1 + rng.random() * 0.2, "lon": 10.1 + rng.random() * 0.2,
            "depth": rng.random() * 200, "heading": rng.random() * 360,
            "pitch": rng.gauss(0, 4), "roll": rng.gauss(0, 4), "speed": rng.random() * 2,
            "altitude": rng.random() * 100, "yaw_rate": rng.gauss(0, 4),
        }  # fmt: skip
    return {
        "mode": 2, "battery": rng.randrange(101), "voltage": 18 + rng.random() * 12,
        "leak0": False, "leak1": False, "leak2": False, "leak3": False, "leg": rng.randrange(256),
        "fault": rng.randrange(1 << 16),
    }  # fmt: skip


def survey(hours: float, *, seed: int = 7) -> Result:
    """Let it go on for so long in virtual time."""
    rng = random.Random(seed)
    places = [(math.tau * index / len(NODES)) for index in range(len(NODES))]
    radius_m = RANGE_M / 2
    nodes = [
        {
            "address": node,
            "position": [radius_m * math.cos(angle), radius_m * math.sin(angle), 20 + node],
        }
        for node, angle in zip(NODES, places, strict=True)
    ]
    clocks = [
        {"node": node, "error_s": CLOCK_ERROR_S, "offset_s": rng.uniform(-1, 1) * CLOCK_ERROR_S}
        for node in NODES
    ]
    medium = scenario_from_mapping(
        {"nodes": nodes, "seed": seed, "channel": "none", "faults": {"clocks": clocks}},
        source="survey",
    )
    waits: dict[tuple[int, int], list[int]] = {}
    delivered = published = longest = 0

    def deliver(address: int, event: Event) -> None:
        nonlocal delivered, longest
        if address == SINK and isinstance(event, SampleReceived):
            delivered += 1
            waiting = waits[event.source, event.stream_id]
            longest = max(longest, network.now - waiting.pop(0))

    network = VirtualNetwork(
        medium,
        _TABLE,
        deliver=deliver,
        digest=False,
        rules=TransmitRules(access=SCHEDULE),
    )

    def publish(node: int, stream_id: int) -> None:
        nonlocal published
        if node != SINK:
            published += 1
            waits.setdefault((node, stream_id), []).append(network.now)
        network.publish(node, stream_id, _values(stream_id, rng))

    end_s = hours * 3600.0
    for node in NODES:
        for stream_id, period_s in PERIODS_S.items():
            first_s = rng.uniform(0, period_s)
            network.every(period_s, partial(publish, node, stream_id), first_s=first_s)
    network.run(until_s=end_s)
    frames = sum(each.frames_transmitted for each in network.stats())
    return Result(published, delivered, frames, dict(network.losses), longest / 1e9)
