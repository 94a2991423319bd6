"""Where and how the dive begins; the same between processes and in virtual time."""

from typing import Final

from examples.auv.dynamics import facing

SHORE: Final = 1
"""Acoustic address of the shore."""
VEHICLE: Final = 2
"""Acoustic address of the vehicle."""
NAV_PERIOD_S: Final = 5.0
STATUS_PERIOD_S: Final = 30.0
START: Final = facing(0.0, north_m=0.0, east_m=0.0, depth_m=2.0)
PLACE_PERIOD_S: Final = 1.0
"""Period of the vehicle's position for the channel; half of a metre or two off in between."""


def modem_at(north_m: float, east_m: float, depth_m: float) -> tuple[float, float, float]:
    """Return the position of the vehicle's modem: x east, y north, z down, m."""
    return (east_m, north_m, max(0.0, depth_m))
