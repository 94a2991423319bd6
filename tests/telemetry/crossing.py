"""Telemetry between whole engines on the simulated channel: airtime for each sample that arrives.

Everything on the channel is counted, of both ends: samples, acknowledgements, introductions. What a
codec gains in the samples and pays in acknowledgements is in the same sum.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, Final

import msgspec

from tests.telemetry.streams import STREAM_IDS
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import TypeSpec, TypeTable
from zacoustic.testing.virtual import VirtualNetwork

VEHICLE: Final = 1
SHORE: Final = 2
_WORD: Final = 60
"""Stream of what the shore says: opaque bytes."""
_PROFILE: Final = "evologics_s2c_18_34"
_SETTLING_S: Final = 60.0


class Way(msgspec.Struct, frozen=True, kw_only=True):
    """How samples are published, and what comes back."""

    name: str
    """In words."""
    period_s: float
    """Between two samples."""
    linger_s: float = 0.0
    """How long a sample waits for company."""
    back_s: float | None = None
    """Between two words of the shore, of eight bytes each; None: it says nothing."""
    to_all: bool = False
    """Samples are broadcast, as to a shore that is not listed."""


WAYS: Final = (
    Way(name="every 5 s, nothing comes back", period_s=5),
    Way(name="every 5 s, a word back every 3 s", period_s=5, back_s=3),
    Way(name="every 5 s, a word back every 10 s", period_s=5, back_s=10),
    Way(name="every 5 s, a word back every minute", period_s=5, back_s=60),
    Way(name="every 5 s, a word back every 5 min", period_s=5, back_s=300),
    Way(name="linger 20 s, nothing comes back", period_s=5, linger_s=20),
    Way(name="linger 20 s, a word back every 30 s", period_s=5, linger_s=20, back_s=30),
    Way(name="every 30 s, a word back every 30 s", period_s=30, back_s=30),
    Way(name="every 5 s to all, nothing comes back", period_s=5, to_all=True),
    Way(name="every 5 s to all, a word back every 10 s", period_s=5, back_s=10, to_all=True),
)
"""Those that are measured."""


class Crossing(msgspec.Struct, frozen=True):
    """What came of it."""

    delivered: int
    """Samples."""
    airtime_s: float
    """Of both ends, less that of the words of the shore by themselves."""

    @property
    def airtime_of_each_s(self) -> float:
        """Airtime of a sample that arrived."""
        return self.airtime_s / self.delivered


def cross(
    type_spec: TypeSpec, values: Sequence[dict[str, Any]], codec: str, way: Way, *, loss: float,
    seed: int,
) -> Crossing:  # fmt: skip
    """Publish samples on one end, and count what it takes until they are on the other.

    Args:
        type_spec: Type of the samples.
        values: The samples.
        codec: Of their stream.
        way: How.
        loss: Share of the frames that are lost.
        seed: Decides which.
    """
    stream_id = STREAM_IDS["nav"]
    qos = Qos(depth=10, linger_s=way.linger_s)
    table = StreamTable(
        [
            TopicSpec(
                stream_id=stream_id, name="auv/nav", type_name=type_spec.name, codec=codec, qos=qos,
                publishers=(VEHICLE,), subscribers=None if way.to_all else (SHORE,),
            ),
            TopicSpec(stream_id=_WORD, name="shore/word", subscribers=(VEHICLE,)),
        ],
        types=TypeTable([type_spec]),
        nodes={VEHICLE: "auv", SHORE: "shore"},
    )  # fmt: skip
    scenario = scenario_from_mapping(
        {
            "seed": seed,
            "profile": _PROFILE,
            "channel": "none",
            "loss": {"frame": loss},
            "nodes": [
                {"address": VEHICLE, "position": [0, 0, 10]},
                {"address": SHORE, "position": [1000, 0, 10]},
            ],
        },
        source="crossing",
    )
    delivered = 0

    def take(address: int, event: Event) -> None:
        nonlocal delivered
        delivered += isinstance(event, SampleReceived) and event.stream_id == stream_id

    channel = VirtualNetwork(scenario, table, deliver=take, digest=False)
    for number, value in enumerate(values):
        channel.at(number * way.period_s, partial(channel.publish, VEHICLE, stream_id, value))
    until_s = len(values) * way.period_s + _SETTLING_S
    words = int(until_s / way.back_s) if way.back_s is not None else 0
    for number in range(words):
        # Out of step with the samples, so that the two seldom meet.
        at_s = number * (way.back_s or 0.0) + 0.6 * way.period_s
        channel.at(at_s, partial(channel.publish, SHORE, _WORD, bytes(8)))
    channel.run(until_s=until_s + _SETTLING_S)
    airtime_ns = sum(channel.engine(address).stats.airtime_ns for address in (VEHICLE, SHORE))
    word_ns = words * channel.capabilities(SHORE).airtime_ns(9)
    return Crossing(delivered, (airtime_ns - word_ns) / NS_PER_S)
