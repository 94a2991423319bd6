"""The vehicle's estimated position: its Doppler log, corrected by acoustic fixes.

A Kalman filter of one number for both coordinates: the log makes the variance grow, a fix makes it
small. The depth of the gauge is smoothed over half a second.
"""

from typing import Final

from examples.auv.sensors import FIX_SIGMA_M, Readings

LOG_VARIANCE_M2_S: Final = 0.01
"""By how much the variance of the position grows, m² each second: log and compass."""
SMOOTHING_S: Final = 0.5


class Navigator:
    """The vehicle's own idea of its place.

    Args:
        north_m: Where it begins.
        east_m: The same.
        depth_m: The same.
    """

    def __init__(self, north_m: float, east_m: float, depth_m: float) -> None:
        self.north_m = north_m
        self.east_m = east_m
        self.depth_m = depth_m
        self._variance_m2 = FIX_SIGMA_M**2

    @property
    def sigma_m(self) -> float:
        """Standard deviation of either coordinate."""
        return float(self._variance_m2**0.5)

    def take(self, readings: Readings, step_s: float) -> None:
        """Take the measurements of a step later."""
        north_m_s, east_m_s = readings.ground_m_s
        self.north_m += north_m_s * step_s
        self.east_m += east_m_s * step_s
        self._variance_m2 += LOG_VARIANCE_M2_S * step_s
        self.depth_m += (readings.depth_m - self.depth_m) * min(1.0, step_s / SMOOTHING_S)
        if readings.fix_m is not None:
            gain = self._variance_m2 / (self._variance_m2 + FIX_SIGMA_M**2)
            self.north_m += gain * (readings.fix_m[0] - self.north_m)
            self.east_m += gain * (readings.fix_m[1] - self.east_m)
            self._variance_m2 *= 1.0 - gain
