"""Each policy of medium access with the same traffic at the same places, beside its own bound.

Every node has samples for all others that fill a frame each, at random instants. What a policy
carries is the number of frames that each of the others gets, in airtimes per second; a frame that
arrives at some of them counts in part.
"""

import math
import random
import statistics
from functools import partial
from typing import Final

import msgspec

from tests.virtual.throughput import carrier_sense_theory
from zacoustic.app.tools.design.schedule import ScheduleWish, distance_of, make_schedule
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import (
    AlohaSpec,
    CarrierSenseSpec,
    PollingSpec,
    ScheduleSpec,
    TdmaSpec,
)
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

SOUND_M_S: Final = 1500.0
FRAMES: Final = 3
"""Frames of a slot, and of a turn."""
PAYLOAD_BYTES: Final = 50
CLOCK_ERROR_S: Final = 0.005
_PROFILE: Final = profile_named(DEFAULT_PROFILE)
AIRTIME_S: Final = _PROFILE.airtime_s(_PROFILE.mtu_bytes)
UNSCHEDULED: Final = ("aloha", "slotted", "carrier_sense")
POLICIES: Final = (*UNSCHEDULED, "polling", "tdma", "schedule")


class Carried(msgspec.Struct, frozen=True, kw_only=True):
    """What a policy carried."""

    throughput: float
    """Airtimes of the largest frame that arrive, per second."""
    bound: float
    """The same at the best, of this policy at these places."""
    p95_s: float
    """Delay from publication that 95 of 100 arrivals keep, s; NaN: nothing arrived."""
    fairness: float
    """Jain's index of what arrives of each node."""
    longest_s: float
    """Longest time between two arrivals of a node at another one, s."""
    median_s: float
    """Median of these times over instants, not over arrivals, s: the frames of one turn follow each
    other closely, and between them nobody waits."""


def carry(
    policy: str, nodes: int, distance_m: float, load: float, length_s: float, *, seed: int = 1
) -> Carried:
    """Let a policy carry the traffic of a fleet.

    Args:
        policy: One of `POLICIES`.
        nodes: How many.
        distance_m: Diameter of the circle in which they are, m.
        load: What all of them offer together, in airtimes of the largest frame per second.
        length_s: How long, s.
        seed: Of places and instants.
    """
    rng = random.Random(seed)
    addresses = range(1, nodes + 1)
    places = _places(rng, nodes, distance_m)
    scenario = scenario_from_mapping(
        {
            "nodes": [{"address": node, "position": place} for node, place in places.items()],
            "seed": seed,
            "channel": "none",
            "collisions": "protocol",
            "sound_speed_m_s": SOUND_M_S,
        },
        source="load",
    )
    access, bound = _access(policy, places, distance_m)
    table = StreamTable(
        [TopicSpec(stream_id=1, name="{node}/t", qos=Qos(depth=FRAMES))],
        nodes={node: f"n{node}" for node in addresses},
    )
    last: dict[tuple[int, int], int] = {}
    waits: list[int] = []
    delays: list[int] = []
    arrived = dict.fromkeys(addresses, 0)

    def deliver(address: int, event: Event) -> None:
        if not isinstance(event, SampleReceived):
            return
        pair = event.source, address
        waits.append(network.now - last.get(pair, 0))
        last[pair] = network.now
        arrived[event.source] += 1
        assert isinstance(event.value, bytes)
        delays.append(network.now - int.from_bytes(event.value[:8], "big"))

    network = VirtualNetwork(
        scenario, table, deliver=deliver, digest=False, rules=TransmitRules(access=access)
    )
    period_s = nodes * AIRTIME_S / load

    def say(node: int) -> None:
        content = network.now.to_bytes(8, "big") + rng.randbytes(PAYLOAD_BYTES - 8)
        network.publish(node, 1, content)
        network.at(network.now / NS_PER_S + rng.expovariate(1 / period_s), partial(say, node))

    for node in addresses:
        network.at(rng.uniform(0, period_s), partial(say, node))
    network.run(until_s=length_s)
    waits += [network.now - last.get((a, b), 0) for a in addresses for b in addresses if a != b]
    counts = list(arrived.values())
    squares = sum(each * each for each in counts)
    return Carried(
        throughput=sum(counts) * AIRTIME_S / (nodes - 1) / length_s,
        bound=bound,
        p95_s=statistics.quantiles(delays, n=20)[-1] / NS_PER_S if len(delays) > 1 else math.nan,
        fairness=sum(counts) ** 2 / (nodes * squares) if squares else 0.0,
        longest_s=max(waits) / NS_PER_S,
        median_s=_median_over_time(waits) / NS_PER_S,
    )


def _median_over_time(waits: list[int]) -> int:
    """Return the wait such that half of all instants lie in one that is no longer."""
    left = sum(waits) / 2
    for wait in sorted(waits):
        left -= wait
        if left <= 0:
            return wait
    raise ValueError("there is no wait")


def _places(
    rng: random.Random, nodes: int, distance_m: float
) -> dict[int, tuple[float, float, float]]:
    """Return places in a circle; the first two are at its ends."""
    places = {1: (0.0, 0.0, 10.0), 2: (distance_m, 0.0, 10.0)}
    for node in range(3, nodes + 1):
        radius_m, angle = distance_m / 2 * math.sqrt(rng.random()), rng.uniform(0, math.tau)
        x_m = distance_m / 2 + radius_m * math.cos(angle)
        places[node] = (x_m, radius_m * math.sin(angle), 10.0)
    return places


def _access(
    policy: str, places: dict[int, tuple[float, float, float]], distance_m: float
) -> tuple[AccessSpec, float]:
    """Return the settings of a policy, and the most that it can carry."""
    capabilities = Modem().capabilities(_PROFILE, distance_m / SOUND_M_S)
    nodes = sorted(places)
    way_s = distance_m / SOUND_M_S
    delay = way_s / AIRTIME_S
    run_s = FRAMES * AIRTIME_S + (FRAMES - 1) * capabilities.gap_s
    match policy:
        case "aloha":
            return AlohaSpec(), 1 / (2 * math.e)
        case "slotted":
            return AlohaSpec(slot_s=AIRTIME_S + way_s + 0.03), 1 / (math.e * (1 + delay))
        case "carrier_sense":
            loads = (0.05 * 1.2**step for step in range(40))
            return CarrierSenseSpec(), max(carrier_sense_theory(delay, load) for load in loads)
        case "polling":
            # A turn is asked for from the poller and begins a way later; what ends it comes back.
            mean_s = statistics.fmean(math.dist(places[1], places[node]) for node in nodes[1:])
            asked_s = _PROFILE.airtime_s(8) + 2 * mean_s / SOUND_M_S
            turns_s = (len(nodes) - 1) * (run_s + asked_s) + run_s
            turn_s = min(5.1, run_s + 0.1)
            return (
                PollingSpec(poller=1, nodes=tuple(nodes[1:]), turn_s=turn_s, idle_s=0.0),
                len(nodes) * FRAMES * AIRTIME_S / turns_s,
            )
        case "tdma":
            tdma = TdmaSpec(
                slots=tuple(nodes),
                slot_s=run_s + FRAMES * 0.02 + distance_m / 1400 + 2 * CLOCK_ERROR_S + 0.01,
                max_range_m=distance_m,
                clock_error_s=CLOCK_ERROR_S,
            )
            return tdma, FRAMES * AIRTIME_S / tdma.slot_s
    wish = ScheduleWish(
        frames=dict.fromkeys(nodes, FRAMES), clock_error_s=CLOCK_ERROR_S, open_slots=0
    )
    schedule: ScheduleSpec = make_schedule(wish, distance_of(places), capabilities)
    return schedule, len(nodes) * FRAMES * AIRTIME_S / schedule.cycle_s
