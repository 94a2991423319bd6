"""The schedule of a plan: its slots are as long as what each node has to say."""

import math
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.plan.fleet import Fleet
from zacoustic.app.tools.design.schedule import (
    Distance,
    ScheduleOptions,
    ScheduleWish,
    distance_of,
    make_schedule,
)
from zacoustic.app.tools.design.sharenote import capabilities_like
from zacoustic.channel.profiles import profile_named
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.schedule.access.spec import ScheduleSpec

_SPARE: Final = 1.5
"""A slot has room for this times what its node says on average in a cycle."""
_MOST_FRAMES: Final = 32
_MOMENTS: Final = 24
"""Parts of the planned time, at whose ends moving nodes are looked at."""
_ROUNDS: Final = 4
"""A longer slot makes the cycle longer, and that the slots: so often, which is enough where the
fleet says less than half of what fits."""


class SchedulePlan(msgspec.Struct, frozen=True, kw_only=True):
    """A schedule."""

    access: dict[str, Any]
    """The table `access` of the link, for the config of each node."""
    cycle_s: float
    """Length of a cycle, s: nobody waits longer for its slot."""
    guards_s: float
    """How much of it is guard time, s."""
    uniform_s: float
    """Length of a cycle in which each slot has the longest guard, s."""


def schedule_of(
    fleet: Fleet, airtime_s: Mapping[int, float], until_s: float, options: ScheduleOptions
) -> SchedulePlan:
    """Make the schedule of a plan.

    Args:
        fleet: The nodes and their places.
        airtime_s: How long each node transmits in the plan, by address, s.
        until_s: In this time, s.
        options: The settings.
    """
    profile = profile_named(fleet.scenario.profile)
    capabilities = capabilities_like(profile)
    max_frame_s = max(
        (each.max_frame_s for each in fleet.rules.values() if each.max_frame_s is not None),
        default=None,
    )
    if max_frame_s is not None:
        capabilities = capabilities.bounded(max_frame_s)
    largest_s = capabilities.airtime_ns(capabilities.mtu_bytes) / NS_PER_S
    distance, nearest = _distances(fleet, until_s)
    frames = dict.fromkeys(fleet.nodes, 1)
    for _ in range(_ROUNDS):
        wish = ScheduleWish(frames=frames, **msgspec.structs.asdict(options))
        spec = make_schedule(wish, distance, capabilities, nearest)
        cycles = until_s / spec.cycle_s
        wanted = {each: airtime_s.get(each, 0.0) / cycles / largest_s for each in fleet.nodes}
        frames = {
            each: min(max(1, math.ceil(_SPARE * share)), _MOST_FRAMES)
            for each, share in wanted.items()
        }
    guards = [slot.guard_ns / NS_PER_S for slot in spec.timed_slots]
    return SchedulePlan(
        access=_as_table(spec),
        cycle_s=spec.cycle_s,
        guards_s=sum(guards),
        uniform_s=spec.cycle_s - sum(guards) + len(guards) * max(guards),
    )


def _distances(fleet: Fleet, until_s: float) -> tuple[Distance, Distance]:
    """Return the largest and the smallest distance of two nodes while the plan lasts."""
    apart_m = fleet.apart_m
    if apart_m is not None:

        def same(one: int, other: int) -> float:
            return 0.0 if one == other else apart_m

        return same, same
    motions = {each.address: each.motion() for each in fleet.scenario.nodes}
    moments = [
        distance_of(
            {
                address: motion.position(until_s * part / _MOMENTS)
                for address, motion in motions.items()
            }
        )
        for part in range(_MOMENTS + 1)
    ]

    def farthest(one: int, other: int) -> float:
        return max(each(one, other) for each in moments)

    def nearest(one: int, other: int) -> float:
        return min(each(one, other) for each in moments)

    return farthest, nearest


def _as_table(spec: ScheduleSpec) -> dict[str, Any]:
    table: dict[str, Any] = {"method": "schedule", "clock_error_s": spec.clock_error_s}
    if spec.clock is not None:
        table["clock"] = spec.clock
    slots = [
        {"owners": list(slot.owners), "for_s": slot.for_s, "range_m": int(slot.range_m)}
        for slot in spec.slots
    ]
    return {**table, "slots": slots}
