"""From a modem's reports on others and on itself to measurements of the link contract.

- A fix whose uncertainty is about as large as the distance does not count: the modem has heard the
  answer without a direction. Its delay is still valid.
- Fixes come half a second after their sound, and carry that delay as two readings of the system
  clock. Only the difference counts, since the clock may be set at any time.
- No source says where bearings begin. The driver takes them as angles in the plane of east and
  north, counted from the east, since `x` is called the first axis and the emulator does the same;
  the contract counts from the north. A test with a head and a compass can settle it.
"""

import math
from typing import Final

from zacoustic.core.linktypes import LinkMetrics, ModemRead, PeerMeasured
from zacoustic_evologics.at.notifications import RecvEnd
from zacoustic_evologics.at.settings import SOURCE_LEVELS_DB
from zacoustic_evologics.at.usbl import UsblAngles, UsblLong
from zacoustic_evologics.driver.session.session import (
    CLOCK_TRUST_NS,
    ModemSession,
)

NO_FIX_SHARE: Final = 0.9
"""Ratio of uncertainty to distance above which a fix is invalid; a capture without one has 1.0."""


def measured_delay(
    session: ModemSession, address: int, delay_us: int, at: int, answer: RecvEnd | None
) -> PeerMeasured | None:
    """Return the measurement of an exchange; None if the modem has no delay.

    Args:
        session: State of the modem.
        address: The other modem.
        delay_us: The modem's value, µs; 0 or less: none.
        at: When the exchange had ended, ns.
        answer: The sound of the acknowledgement, if the modem has reported it.
    """
    if delay_us <= 0:
        return None
    propagation_s = delay_us / 1e6
    metrics = LinkMetrics(
        propagation_s=propagation_s,
        range_m=session.range_m(propagation_s),
        received_level_db=float(answer.rssi_db) if answer is not None else None,
        integrity=float(answer.integrity) if answer is not None else None,
    )
    return PeerMeasured(address=address, measured_at=at, metrics=metrics)


def measured_position(session: ModemSession, fix: UsblLong, now: int) -> PeerMeasured:
    """Return the values of a fix; without the position if it is invalid."""
    propagation_s = fix.propagation_us / 1e6 if fix.propagation_us > 0 else None
    distance_m = math.hypot(fix.east_m, fix.north_m, fix.up_m)
    has_place = 0 <= fix.accuracy_m < NO_FIX_SHARE * distance_m
    metrics = LinkMetrics(
        propagation_s=propagation_s,
        range_m=session.range_m(propagation_s),
        received_level_db=float(fix.rssi_db),
        integrity=float(fix.integrity),
        east_m=fix.east_m if has_place else None,
        north_m=fix.north_m if has_place else None,
        up_m=fix.up_m if has_place else None,
        accuracy_m=fix.accuracy_m if has_place else None,
    )
    at = _heard_at(fix.clock_us, fix.measured_us, now)
    return PeerMeasured(address=fix.address, measured_at=at, metrics=metrics)


def measured_direction(angles: UsblAngles, now: int) -> PeerMeasured | None:
    """Return the direction of a message; None if the head does not know it."""
    if angles.accuracy_rad < 0:
        return None
    metrics = LinkMetrics(
        received_level_db=float(angles.rssi_db),
        integrity=float(angles.integrity),
        bearing_rad=(math.pi / 2 - angles.bearing_rad) % math.tau,
        elevation_rad=angles.elevation_rad,
        accuracy_rad=angles.accuracy_rad,
    )
    at = _heard_at(angles.clock_us, angles.measured_us, now)
    return PeerMeasured(address=angles.address, measured_at=at, metrics=metrics)


def modem_read(session: ModemSession, now: int) -> ModemRead:
    """Return the modem's own values."""
    level = session.source_level
    return ModemRead(
        read_at=now,
        firmware=session.firmware,
        battery_v=session.battery_v,
        relative_source_level_db=None if level is None else SOURCE_LEVELS_DB[level],
    )


def _heard_at(clock_us: int, measured_us: int, now: int) -> int:
    """Return when the sound of this report was received, ns."""
    ago_ns = (clock_us - measured_us) * 1000
    return now - (ago_ns if 0 < ago_ns < CLOCK_TRUST_NS else 0)
