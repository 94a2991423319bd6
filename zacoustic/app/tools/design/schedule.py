"""A schedule from distances: who transmits after whom, for how long, and how long then is silent.

The guard of a slot covers the distance to the owner of the next one, so the order of the slots
matters: a cycle is as long as its windows and a tour through all nodes at the speed of sound. The
tour is the travelling salesman's. It begins at the nearest neighbours, and pairs of its legs are
exchanged while that makes it shorter (2-opt, Croes 1958), which comes within some per cent of the
shortest tour for the sizes of fleets.

Nodes that no third node hears together may own one slot (`hearing_m`). They are chosen greedily.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Final

import msgspec

from zacoustic.channel.propagation.position import Position
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.spec import ScheduledSlot, ScheduleSpec

Distance = Callable[[int, int], float]
"""Returns the distance of two nodes, m, ≥ 0."""
CLOCK_ERROR_S: Final = 0.01
"""Of computers that NTP set at the surface, s."""
_TIMER_S = 0.02
"""A computer's timers may be late by this, s."""


class ScheduleOptions(msgspec.Struct, frozen=True, kw_only=True):
    """What no plan knows: clocks, and where nodes may be."""

    clock_error_s: float = CLOCK_ERROR_S
    """Largest error of a clock, s, ≥ 0."""
    clock: int | None = None
    """The node whose clock all others follow; None: UTC from each host."""
    drift_m: float = 0.0
    """How far each node may be from where it is assumed to be, m, ≥ 0."""
    hearing_m: float | None = None
    """Nodes farther apart do not hear each other, m, > 0; None: all hear each other."""


class ScheduleWish(ScheduleOptions, frozen=True, kw_only=True):
    """What a schedule is made for."""

    frames: Mapping[int, int]
    """How many of the largest frames each node sends in a cycle, by address, ≥ 1."""
    open_slots: int = 1
    """Slots for nodes that own none, ≥ 0."""
    newcomer_m: float = 0.0
    """Largest distance of such a node from any other, m; less than that of two owners: that."""


def distance_of(positions: Mapping[int, Position]) -> Distance:
    """Return the distances of fixed positions."""
    return lambda one, other: math.dist(positions[one], positions[other])


def make_schedule(
    wish: ScheduleWish,
    distance: Distance,
    capabilities: LinkCapabilities,
    nearest: Distance | None = None,
) -> ScheduleSpec:
    """Make a schedule.

    Args:
        wish: What it is made for.
        distance: Of each two nodes; of moving ones the largest.
        capabilities: The link's, for its airtimes.
        nearest: Of moving nodes the smallest distance, for who hears whom; None: as `distance`.
    """

    def apart_m(ones: Sequence[int], others: Sequence[int]) -> float:
        farthest_m = max(distance(one, other) for one in ones for other in others)
        return farthest_m + 2 * wish.drift_m if farthest_m > 0 else 0.0

    nodes = sorted(wish.frames)
    groups = _groups(nodes, nearest or distance, wish)
    order = _tour(len(groups), lambda one, other: apart_m(groups[one], groups[other]))
    owners = [groups[index] for index in order]
    slots = [
        ScheduledSlot(
            owners=tuple(group),
            for_s=_window_s(max(wish.frames[node] for node in group), capabilities),
            range_m=math.ceil(apart_m(group, following)),
        )
        for group, following in pairwise((*owners, owners[0]))
    ]
    widest_m = math.ceil(max(apart_m(nodes, nodes), wish.newcomer_m))
    for _ in range(wish.open_slots):
        # Whoever comes may be anywhere: the slots around it keep the longest distance.
        slots[-1] = msgspec.structs.replace(slots[-1], range_m=widest_m)
        slots.append(ScheduledSlot(owners=(), for_s=_window_s(1, capabilities), range_m=widest_m))
    return ScheduleSpec(slots=tuple(slots), clock_error_s=wish.clock_error_s, clock=wish.clock)


def _window_s(frames: int, capabilities: LinkCapabilities) -> float:
    airtime_s = capabilities.airtime_ns(capabilities.mtu_bytes) / NS_PER_S
    window_s = frames * airtime_s + (frames - 1) * capabilities.gap_s + frames * _TIMER_S
    return math.ceil(window_s * 1000) / 1000


def _groups(nodes: list[int], distance: Distance, wish: ScheduleWish) -> list[list[int]]:
    """Return the nodes of each slot: no node hears two of them."""
    groups: list[list[int]] = []
    for node in nodes:
        fitting = (
            group
            for group in groups
            if all(_are_apart(node, other, nodes, distance, wish) for other in group)
        )
        found = next(fitting, None)
        if found is None:
            groups.append([node])
        else:
            found.append(node)
    return groups


def _are_apart(
    one: int, other: int, nodes: list[int], distance: Distance, wish: ScheduleWish
) -> bool:
    if wish.hearing_m is None:
        return False
    heard_m = wish.hearing_m + 2 * wish.drift_m
    if distance(one, other) <= heard_m:
        return False
    others = (node for node in nodes if node not in (one, other))
    return all(max(distance(node, one), distance(node, other)) > heard_m for node in others)


def _tour(count: int, length: Callable[[int, int], float]) -> list[int]:
    """Return a short round tour through 0…count - 1."""
    left, tour = set(range(1, count)), [0]
    while left:
        nearest = min(left, key=lambda each: (length(tour[-1], each), each))
        left.remove(nearest)
        tour.append(nearest)
    improved = count > 3
    while improved:
        improved = False
        for first in range(count - 1):
            for last in range(first + 2, count):
                a, b = tour[first], tour[first + 1]
                c, d = tour[last], tour[(last + 1) % count]
                gained = length(a, b) + length(c, d) - length(a, c) - length(b, d)
                if a != d and gained > 1e-9:
                    tour[first + 1 : last + 1] = reversed(tour[first + 1 : last + 1])
                    improved = True
    return tour
