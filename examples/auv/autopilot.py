"""The autopilot: depth, heading and speed by the three joints; and the way to a way-point.

Fins stay below their stall. A rudder of 0.17 rad makes a circle of 24.5 m, so a way-point beside
the vehicle cannot be reached by turning towards it: it would be circled for ever. When it lies in
one of the two turning circles the vehicle goes straight on, until it is well clear of them.
"""

import math
from typing import Final

import msgspec

from examples.auv.dynamics import Controls
from examples.auv.hydrodynamics import DAMPING, STALL_RAD
from examples.auv.sensors import Readings

FIN_MOST_RAD: Final = 0.95 * STALL_RAD
PITCH_MOST_RAD: Final = math.radians(25.0)
THRUST_MOST_N: Final = 31.0
CIRCLE_M: Final = 26.0
"""Radius of a turning circle: a little more than that of the full rudder."""
CLEAR_M: Final = 36.0
"""So far from the middle of the circle a way-point lies before the vehicle turns to it again."""

_HEADING_GAIN: Final = 0.6
_YAW_DAMPING_S: Final = 0.6
_DEPTH_GAIN_RAD_M: Final = 0.12
_DEPTH_INTEGRAL_RAD_M_S: Final = 0.003
_INTEGRAL_MOST_RAD: Final = 0.1
_INTEGRAL_WITHIN_M: Final = 1.0
"""Further away the depth error is not summed up: the way there is no steady error."""
_PITCH_GAIN: Final = 1.2
_PITCH_DAMPING_S: Final = 1.0
_THRUST_GAIN_N_S_M: Final = 20.0


class Course(msgspec.Struct, frozen=True, kw_only=True):
    """What the autopilot is to hold."""

    depth_m: float
    heading_rad: float
    speed_m_s: float


class Autopilot:
    """Holds a course; its only memory is the sum of depth errors."""

    def __init__(self) -> None:
        self._integral_rad = 0.0

    def steer(self, course: Course, readings: Readings, depth_m: float, step_s: float) -> Controls:
        """Return the set-points of the joints.

        Args:
            course: To be held.
            readings: What was measured now.
            depth_m: The smoothed depth.
            step_s: Time since the last call, s.
        """
        turn = angle_between(readings.heading_rad, course.heading_rad)
        rudder = _HEADING_GAIN * turn - _YAW_DAMPING_S * readings.yaw_rate_rad_s
        deeper_m = course.depth_m - depth_m
        if abs(deeper_m) < _INTEGRAL_WITHIN_M:
            summed = self._integral_rad + _DEPTH_INTEGRAL_RAD_M_S * deeper_m * step_s
            self._integral_rad = _limit(summed, _INTEGRAL_MOST_RAD)
        bow_down = _DEPTH_GAIN_RAD_M * deeper_m + self._integral_rad
        pitch_rad = -_limit(bow_down, PITCH_MOST_RAD)
        elevator = (
            _PITCH_GAIN * (readings.pitch_rad - pitch_rad)
            + _PITCH_DAMPING_S * readings.pitch_rate_rad_s
        )
        lacking_m_s = course.speed_m_s - readings.speed_m_s
        thrust_n = DAMPING[0] * course.speed_m_s**2 + _THRUST_GAIN_N_S_M * lacking_m_s
        return Controls(
            thrust_n=-min(THRUST_MOST_N, max(0.0, thrust_n)),
            rudder_rad=_limit(rudder, FIN_MOST_RAD),
            elevator_rad=_limit(elevator, FIN_MOST_RAD),
        )


class Guidance:
    """The way to one way-point; it remembers whether it goes straight on."""

    def __init__(self) -> None:
        self._straight = False

    def heading(
        self, north_m: float, east_m: float, heading_rad: float, waypoint: tuple[float, float]
    ) -> float:
        """Return the heading to steer from a place, rad; the way-point is north and east."""
        to_north, to_east = waypoint[0] - north_m, waypoint[1] - east_m
        aside = CIRCLE_M * -math.sin(heading_rad), CIRCLE_M * math.cos(heading_rad)
        nearest_m = min(
            math.hypot(to_north - side * aside[0], to_east - side * aside[1])
            for side in (1.0, -1.0)
        )
        self._straight = nearest_m < (CLEAR_M if self._straight else CIRCLE_M)
        return heading_rad if self._straight else math.atan2(to_east, to_north) % math.tau


def angle_between(from_rad: float, to_rad: float) -> float:
    """Return the turn from one heading to another, -π…π, positive to starboard."""
    return (to_rad - from_rad + math.pi) % math.tau - math.pi


def _limit(value: float, most: float) -> float:
    return min(most, max(-most, value))
