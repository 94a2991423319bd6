"""What the vehicle measures: the truth, and noise from a seeded generator."""

import math
import random
from typing import Final

import msgspec

from examples.auv.dynamics import Motion
from examples.auv.world import World

DEPTH_SIGMA_M: Final = 0.05
ATTITUDE_SIGMA_RAD: Final = math.radians(0.3)
RATE_SIGMA_RAD_S: Final = math.radians(0.1)
SPEED_SIGMA_M_S: Final = 0.02
FIX_SIGMA_M: Final = 1.0
"""Of each coordinate of an acoustic fix."""
FIX_PERIOD_S: Final = 5.0
ALTITUDE_SIGMA_M: Final = 0.2
CAPACITY_J: Final = 1.5 * 3.6e6
HOTEL_W: Final = 20.0
EFFICIENCY: Final = 0.4
"""Of motor and propeller."""


class Readings(msgspec.Struct, frozen=True, kw_only=True):
    """The sensors' readings at one instant."""

    depth_m: float
    roll_rad: float
    pitch_rad: float
    heading_rad: float
    pitch_rate_rad_s: float
    yaw_rate_rad_s: float
    ground_m_s: tuple[float, float]
    """Velocity over ground of a Doppler log: to the north, to the east."""
    speed_m_s: float
    """Through the water."""
    fix_m: tuple[float, float] | None
    """Position north and east of an acoustic system, when there is one."""
    altitude_m: float
    battery: float
    """Charge, percent."""


class Sensors:
    """The instruments and the battery.

    Args:
        world: What they are in.
        rng: Source of the noise.
    """

    def __init__(self, world: World, rng: random.Random) -> None:
        self._world = world
        self._rng = rng
        self._fix_at_s = 0.0
        self._drawn_j = 0.0

    def draw(self, thrust_n: float, speed_m_s: float, step_s: float) -> None:
        """Take energy from the battery."""
        power_w = HOTEL_W + abs(thrust_n) * max(0.3, speed_m_s) / EFFICIENCY
        self._drawn_j += power_w * step_s

    def read(self, before: Motion, motion: Motion, step_s: float, now_s: float) -> Readings:
        """Measure; `before` is the motion a step ago."""
        noise = self._rng.gauss
        fix = None
        if now_s >= self._fix_at_s:
            self._fix_at_s = now_s + FIX_PERIOD_S
            fix = (
                motion.north_m + noise(0, FIX_SIGMA_M),
                motion.east_m + noise(0, FIX_SIGMA_M),
            )
        bed_m = self._world.bed_depth_m(motion.north_m, motion.east_m)
        return Readings(
            depth_m=motion.depth_m + noise(0, DEPTH_SIGMA_M),
            roll_rad=motion.roll_rad + noise(0, ATTITUDE_SIGMA_RAD),
            pitch_rad=motion.pitch_rad + noise(0, ATTITUDE_SIGMA_RAD),
            heading_rad=(motion.heading_rad + noise(0, ATTITUDE_SIGMA_RAD)) % math.tau,
            pitch_rate_rad_s=motion.velocity[4] + noise(0, RATE_SIGMA_RAD_S),
            yaw_rate_rad_s=motion.velocity[5] + noise(0, RATE_SIGMA_RAD_S),
            ground_m_s=(
                (motion.north_m - before.north_m) / step_s + noise(0, SPEED_SIGMA_M_S),
                (motion.east_m - before.east_m) / step_s + noise(0, SPEED_SIGMA_M_S),
            ),
            speed_m_s=max(0.0, motion.speed_m_s + noise(0, SPEED_SIGMA_M_S)),
            fix_m=fix,
            altitude_m=max(0.0, bed_m - motion.depth_m + noise(0, ALTITUDE_SIGMA_M)),
            battery=max(0.0, 100.0 * (1.0 - self._drawn_j / CAPACITY_J)),
        )
