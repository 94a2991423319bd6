"""Positions of other modems: unsolicited messages of a modem with an ultra-short baseline head.

`AT@ZU1` switches them on for each port. The head's frame is x, y, z; its attitude (roll, pitch,
yaw) converts that to east, north, up. The system clock counts from the start of the modem, or is
Unix time if somebody has set it; it is not the modem's clock of 32 bits.
"""

from typing import Annotated, TypeAlias

import msgspec

from zacoustic.link.fields import Several
from zacoustic_evologics.at import fields


class _Fix(msgspec.Struct, frozen=True, kw_only=True):
    clock_us: fields.SystemClock
    """System clock at this notification, µs."""
    measured_us: fields.SystemClock
    """System clock at the measurement, µs."""
    address: fields.Address
    """The other modem."""


class UsblLong(_Fix, frozen=True, kw_only=True):
    """Position of the other modem, measured by the answer to a message."""

    x_m: fields.Metres
    """In the frame of the head, m; four decimals, as all that follow."""
    y_m: fields.Metres
    """In the frame of the head, m."""
    z_m: fields.Metres
    """In the frame of the head, m."""
    east_m: fields.Metres
    """Turned by the head's attitude, m."""
    north_m: fields.Metres
    """Turned by the head's attitude, m."""
    up_m: fields.Metres
    """Turned by the head's attitude, m."""
    roll_rad: fields.Angle
    """Attitude of the head, rad."""
    pitch_rad: fields.Angle
    """Attitude of the head, rad."""
    yaw_rad: fields.Angle
    """Attitude of the head, rad."""
    propagation_us: fields.Duration
    """Propagation delay, one way, µs."""
    rssi_db: fields.Rssi
    """Received level, dB re 1 V."""
    integrity: fields.Integrity
    """Signal integrity."""
    accuracy_m: fields.Accuracy
    """Uncertainty, m; about the range itself when there is no fix."""


class UsblAngles(_Fix, frozen=True, kw_only=True):
    """Direction of a received message, without a range."""

    local_bearing_rad: fields.Angle
    """In the frame of the head, rad; four decimals, as all that follow."""
    local_elevation_rad: fields.Angle
    """In the frame of the head, rad."""
    bearing_rad: fields.Angle
    """Turned by the head's attitude, rad."""
    elevation_rad: fields.Angle
    """Turned by the head's attitude, rad."""
    roll_rad: fields.Angle
    """Attitude of the head, rad."""
    pitch_rad: fields.Angle
    """Attitude of the head, rad."""
    yaw_rad: fields.Angle
    """Attitude of the head, rad."""
    rssi_db: fields.Rssi
    """Received level, dB re 1 V."""
    integrity: fields.Integrity
    """Signal integrity."""
    accuracy_rad: fields.Accuracy
    """Uncertainty, rad; negative when the angles are invalid."""


class UsblPhyD(_Fix, frozen=True, kw_only=True):
    """Delays between hydrophones."""

    fix: fields.Signed
    """As the modem says it."""
    delays: Annotated[tuple[int, ...], Several(fields.SIGNED, 8)]
    """Eight: hydrophones 1-5, 2-5, 3-5, 4-5, 1-2, 4-1, 3-2, 3-4; 16777215 is invalid. No source
    states the unit."""


class UsblPhyP(_Fix, frozen=True, kw_only=True):
    """Positions from groups of three hydrophones."""

    fix: fields.Signed
    """As the modem says it."""
    positions_m: Annotated[tuple[float, ...], Several(fields.RAW_METRES, 18)]
    """Eighteen: x, y, z, m, from hydrophones 123, 432, 341, 412, 153, 254."""


UsblNotification: TypeAlias = UsblLong | UsblAngles | UsblPhyD | UsblPhyP
"""All messages of a head."""
