"""Positions of nodes: fixed places and tracks, and the travel time of sound between them.

Positions are x east, y north, z down, in metres, in one flat frame; at the ranges of acoustic
modems the earth is flat. A track is a list of way-points with times. The node moves on straight
lines between them, and stands still before the first and after the last. The times of a track count
from instant 0 of the scenario. A track may also grow during the run: a caller that steers a node
sets its position now and then (`Motion.move`), and sound travels to the latest one.

Between moving nodes the delay is not distance / c, because the receiver moves while the sound is
under way. The delay solves ``|receiver(t + τ) − sender(t)| = c τ``, here by fixed-point steps, each
of which shrinks the error by v/c (0.1 % at 1.5 m/s).
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import Final, TypeAlias

import msgspec

Position: TypeAlias = tuple[float, float, float]
"""x east, y north, z down, m."""

_NS_PER_S: Final = 1_000_000_000
_TOLD_MOST: Final = 64
"""Positions stored of a steered node: more than sound under way can need."""
_DELAY_STEPS: Final = 3  # (v/c)³ of the delay: below a nanosecond at 2 m/s and 10 km


class Waypoint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Position of a node at one time."""

    t: float
    """Time since the start of the scenario, s."""
    position: Position
    """x east, y north, z down, m."""


class Path(msgspec.Struct, frozen=True, kw_only=True):
    """The way of sound from one node to another at one instant."""

    distance_m: float
    """Slant distance that the sound covers, m."""
    propagation_s: float
    """Propagation delay, one way, s."""
    range_rate_m_s: float
    """Relative velocity along the line, m/s, positive when the distance grows."""


class Motion:
    """The position of one node over time.

    Args:
        waypoints: One for a fixed place, more for a track, times strictly increasing; `scenario`
            checks them.
    """

    def __init__(self, waypoints: Sequence[Waypoint]) -> None:
        self._times_s = [waypoint.t for waypoint in waypoints]
        self._positions = [waypoint.position for waypoint in waypoints]

    @classmethod
    def fixed(cls, position: Position) -> "Motion":
        """Return the motion of a node that stays at this place."""
        return cls([Waypoint(t=0.0, position=position)])

    def move(self, position: Position, at_s: float) -> None:
        """Set the node's position from now on; drop later way-points.

        Args:
            position: x east, y north, z down, m.
            at_s: The time, s since the start of the scenario.
        """
        before = self.position(at_s)
        kept = bisect_left(self._times_s, at_s)
        self._times_s[kept:], self._positions[kept:] = [at_s], [position]
        if kept == 0:
            # It stood still, or its track had not begun: it has not moved since then.
            self._times_s.insert(0, at_s - 1.0)
            self._positions.insert(0, before)
        del self._times_s[:-_TOLD_MOST], self._positions[:-_TOLD_MOST]

    @property
    def places(self) -> Sequence[Position]:
        """Corners of its track; it never leaves the lines between them."""
        return self._positions

    @property
    def is_fixed(self) -> bool:
        """Whether the node never moves."""
        return len(self._positions) == 1

    def position(self, at_s: float) -> Position:
        """Return the position at a time in s since the start of the scenario."""
        index = bisect_right(self._times_s, at_s)
        if index == 0:
            return self._positions[0]
        if index == len(self._times_s):
            return self._positions[-1]
        start_s, end_s = self._times_s[index - 1], self._times_s[index]
        part = (at_s - start_s) / (end_s - start_s)
        (ax, ay, az), (bx, by, bz) = self._positions[index - 1], self._positions[index]
        return (ax + part * (bx - ax), ay + part * (by - ay), az + part * (bz - az))

    def velocity_m_s(self, at_s: float) -> Position:
        """Return the velocity (east, north, down) at a time, m/s; zero outside the track."""
        index = bisect_right(self._times_s, at_s)
        if index in (0, len(self._times_s)):
            return (0.0, 0.0, 0.0)
        span_s = self._times_s[index] - self._times_s[index - 1]
        (ax, ay, az), (bx, by, bz) = self._positions[index - 1], self._positions[index]
        return ((bx - ax) / span_s, (by - ay) / span_s, (bz - az) / span_s)


def distance_m(a: Position, b: Position) -> float:
    """Return the slant distance of two places, m."""
    return math.dist(a, b)


def path_between(sender: Motion, receiver: Motion, now: int, *, sound_speed_m_s: float) -> Path:
    """Return the path of sound that leaves the sender at an instant.

    Args:
        sender: Motion of the sender.
        receiver: Motion of the receiver.
        now: Instant of departure, ns since the start of the scenario.
        sound_speed_m_s: Speed of sound, m/s, > 0, far above the speed of any node.

    Returns:
        Distance, delay and range rate; the range rate is that at departure.
    """
    at_s = now / _NS_PER_S
    origin = sender.position(at_s)
    target = receiver.position(at_s)
    distance = math.dist(origin, target)
    range_rate = _range_rate_m_s(
        origin, target, sender.velocity_m_s(at_s), receiver.velocity_m_s(at_s)
    )
    if not receiver.is_fixed:
        for _ in range(_DELAY_STEPS):
            target = receiver.position(at_s + distance / sound_speed_m_s)
            distance = math.dist(origin, target)
    return Path(
        distance_m=distance,
        propagation_s=distance / sound_speed_m_s,
        range_rate_m_s=range_rate,
    )


def _range_rate_m_s(a: Position, b: Position, a_m_s: Position, b_m_s: Position) -> float:
    distance = math.dist(a, b)
    if distance == 0.0:
        return 0.0
    growth = sum((bx - ax) * (bv - av) for ax, bx, av, bv in zip(a, b, a_m_s, b_m_s, strict=True))
    return growth / distance
