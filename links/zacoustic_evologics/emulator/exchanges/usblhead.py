"""An ultra-short baseline head on every modem: positions of others, from the scenario's geometry.

The head hangs upright and faces north: its frame is x east, y north, z up, as a capture shows them
for a small yaw. An acknowledgement gives a position (USBLLONG and the raw records), any other
message only angles (USBLANGLES). Fixes have the delay of that capture. Their errors are drawn for
each fix; a range is the propagation delay times the set sound speed.
"""

import math
from typing import Final

from zacoustic_evologics.at.replies import PositionReply
from zacoustic_evologics.at.usbl import (
    UsblAngles,
    UsblLong,
    UsblNotification,
    UsblPhyD,
    UsblPhyP,
)
from zacoustic_evologics.emulator.hardware.chassis import Chassis
from zacoustic_evologics.emulator.hardware.signals import Hearing

FIX_DELAY_NS: Final = 318_000_000
"""From the end of a signal to its fix, ns: 0.457 s after it began, in a capture."""

_ERROR_RAD: Final = 0.004
_LEAST_ACCURACY_M: Final = 0.1
_BASELINE_M: Final = 0.1
_HYDROPHONES_M: Final = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))


class UsblHead:
    """The head of one modem.

    Args:
        chassis: Chassis of the modem.
    """

    def __init__(self, chassis: Chassis) -> None:
        self._chassis = chassis

    def measure_position(self, hearing: Hearing) -> None:
        """Report the position of the answering modem, a little later."""
        at = hearing.ends_at + FIX_DELAY_NS
        propagation_us = self._chassis.measured.propagation_us
        self._chassis.agenda.push(at, self._say_position, hearing, propagation_us, at)

    def measure_angles(self, hearing: Hearing) -> None:
        """Report the direction of a message, a little later."""
        at = hearing.ends_at + FIX_DELAY_NS
        self._chassis.agenda.push(at, self._say_angles, hearing, at)

    def _say_position(self, hearing: Hearing, propagation_us: int, now: int) -> None:
        chassis = self._chassis
        distance_m = propagation_us * 1e-6 * chassis.store["CA"]
        east, north, up = (distance_m * each for each in self._direction(hearing))
        self._say(
            UsblLong, hearing, now,
            x_m=east, y_m=north, z_m=up, east_m=east, north_m=north, up_m=up,
            roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0, propagation_us=propagation_us,
            accuracy_m=max(_LEAST_ACCURACY_M, 2 * _ERROR_RAD * distance_m),
        )  # fmt: skip
        self._say_raw(hearing, now, (east, north, up))
        position = PositionReply(
            measured_s=chassis.system_us(hearing.starts_at) // 1_000_000,
            address=hearing.signal.source,
            x_m=east,
            y_m=north,
            z_m=up,
        )
        chassis.measured.body_position = chassis.measured.earth_position = position

    def _say_raw(self, hearing: Hearing, now: int, position_m: tuple[float, ...]) -> None:
        """Report the raw data of a fix: delays against the middle hydrophone and each other, ns."""
        distance_m = max(math.hypot(*position_m), 1e-3)
        east, north = position_m[0] / distance_m, position_m[1] / distance_m
        single = [
            round(-(x * east + y * north) * _BASELINE_M / hearing.sound_speed_m_s * 1e9)
            for x, y in _HYDROPHONES_M
        ]
        pairs = [(0, 1), (3, 0), (2, 1), (2, 3)]
        delays = (*single, *(single[a] - single[b] for a, b in pairs))
        self._say(UsblPhyD, hearing, now, fix=1, delays=delays)
        self._say(UsblPhyP, hearing, now, fix=1, positions_m=tuple(position_m) * 6)

    def _say_angles(self, hearing: Hearing, now: int) -> None:
        east, north, up = self._direction(hearing)
        bearing = math.atan2(north, east)
        elevation = math.asin(max(-1.0, min(1.0, up)))
        self._say(
            UsblAngles, hearing, now,
            local_bearing_rad=bearing, local_elevation_rad=elevation,
            bearing_rad=bearing, elevation_rad=elevation,
            roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0, accuracy_rad=2 * _ERROR_RAD,
        )  # fmt: skip

    def _say(
        self, kind: type[UsblNotification], hearing: Hearing, now: int, **others: object
    ) -> None:
        """Report a fix of the sender."""
        record = hearing.told(
            kind,
            clock_us=self._chassis.system_us(now),
            measured_us=self._chassis.system_us(hearing.starts_at),
            address=hearing.signal.source,
            **others,
        )
        self._chassis.say(record)

    def _direction(self, hearing: Hearing) -> tuple[float, float, float]:
        """Return the unit vector to the sender, with an error."""
        rng = self._chassis.rng
        distance_m = math.hypot(*hearing.offset_m)
        if distance_m == 0.0:
            return (0.0, 0.0, 0.0)
        east, north, up = (
            each / distance_m + _ERROR_RAD * (2.0 * rng.random() - 1.0) for each in hearing.offset_m
        )
        length = math.hypot(east, north, up)
        return (east / length, north / length, up / length)
