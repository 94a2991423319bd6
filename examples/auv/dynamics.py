"""Six degrees of freedom: one step of the vehicle, a function of what was and of the set-points.

The velocity in the state is the one *through the water*, along the axes of the body. In a current
that is the same everywhere the equations of motion are then those of still water (Fossen), and
the current only carries the vehicle along. The attitude is a quaternion: a loop does no harm.

Angles of joints and the thrust have the signs of Gazebo, whose model faces the other way: thrust
that drives forward is negative, a positive angle of the vertical fins turns to starboard, one of
the horizontal fins lowers the bow.
"""

import math
from collections.abc import Sequence
from typing import Final, TypeAlias

import msgspec

from examples.auv import hull
from examples.auv.hydrodynamics import (
    ADDED_MASS,
    DAMPING,
    FIN_LIMIT_RAD,
    FIN_X_M,
    THRUST_LIMIT_N,
    fin_force,
)
from examples.auv.world import STILL, World

STEP_S: Final = 0.1
"""Length of a step, s: a tenth of the fastest time constant."""

_BED_N_M: Final = 2000.0
_BED_N_S_M: Final = 1500.0

Vector: TypeAlias = tuple[float, float, float]
Flat: TypeAlias = tuple[float, ...]


class Controls(msgspec.Struct, frozen=True, kw_only=True):
    """Set-points of the joints, with Gazebo's signs."""

    thrust_n: float = 0.0
    """Of the propeller; forward is negative."""
    rudder_rad: float = 0.0
    """Of the vertical fins; positive: to starboard."""
    elevator_rad: float = 0.0
    """Of the horizontal fins; positive: bow down."""

    def limited(self) -> "Controls":
        """Return what the joints can do of it."""
        return Controls(
            thrust_n=_limit(self.thrust_n, THRUST_LIMIT_N),
            rudder_rad=_limit(self.rudder_rad, FIN_LIMIT_RAD),
            elevator_rad=_limit(self.elevator_rad, FIN_LIMIT_RAD),
        )


class Motion(msgspec.Struct, frozen=True, kw_only=True):
    """Where the vehicle is, and how it moves."""

    north_m: float = 0.0
    east_m: float = 0.0
    depth_m: float = 0.0
    """Of the middle of the hull."""
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Attitude: from the axes of the body to north, east, down."""
    velocity: tuple[float, float, float, float, float, float] = (0.0,) * 6
    """u, v, w through the water, m/s; p, q, r, rad/s."""

    @property
    def roll_rad(self) -> float:
        """Positive: starboard side down."""
        w, x, y, z = self.quaternion
        return math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))

    @property
    def pitch_rad(self) -> float:
        """Positive: bow up."""
        w, x, y, z = self.quaternion
        return math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))

    @property
    def heading_rad(self) -> float:
        """0 is north, π/2 east; 0…2π."""
        w, x, y, z = self.quaternion
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) % math.tau

    @property
    def speed_m_s(self) -> float:
        """Through the water."""
        return math.hypot(*self.velocity[:3])


def facing(heading_rad: float, *, north_m: float, east_m: float, depth_m: float) -> Motion:
    """Return a vehicle at rest."""
    half = heading_rad / 2
    quaternion = (math.cos(half), 0.0, 0.0, math.sin(half))
    return Motion(north_m=north_m, east_m=east_m, depth_m=depth_m, quaternion=quaternion)


class Body:
    """The vehicle's mechanics; holds constants only.

    Args:
        world: The water around it.
        ballast_m: How far its centre of mass lies below that of buoyancy, m.
    """

    def __init__(self, world: World = STILL, *, ballast_m: float = hull.BALLAST_M) -> None:
        self._world = world
        self._centre = (hull.CENTRE_X_M, ballast_m)
        self._inverse = _inverse(_mass_matrix(*self._centre))

    def step(self, motion: Motion, controls: Controls, step_s: float = STEP_S) -> Motion:
        """Return how the vehicle moves a step later (Runge and Kutta's fourth order)."""
        limited = controls.limited()
        flat: Flat = (
            motion.north_m, motion.east_m, motion.depth_m, *motion.quaternion, *motion.velocity,
        )  # fmt: skip
        half = step_s / 2
        k1 = self._rate(flat, limited)
        k2 = self._rate([a + half * b for a, b in zip(flat, k1, strict=True)], limited)
        k3 = self._rate([a + half * b for a, b in zip(flat, k2, strict=True)], limited)
        k4 = self._rate([a + step_s * b for a, b in zip(flat, k3, strict=True)], limited)
        sixth = step_s / 6
        new = [
            a + sixth * (b + 2 * (c + d) + e)
            for a, b, c, d, e in zip(flat, k1, k2, k3, k4, strict=True)
        ]
        norm = math.sqrt(sum(part * part for part in new[3:7]))
        w, x, y, z = (part / norm for part in new[3:7])
        forward, aside, down, p, q, r = new[7:]
        return Motion(
            north_m=new[0],
            east_m=new[1],
            depth_m=new[2],
            quaternion=(w, x, y, z),
            velocity=(forward, aside, down, p, q, r),
        )

    def _rate(self, flat: Sequence[float], controls: Controls) -> Flat:
        """Rates of place, attitude and velocity."""
        north, east, depth, qw, qx, qy, qz, u, v, w, p, q, r = flat
        current_north, current_east = self._world.current_m_s
        # Rows: where the axes of the body point in north, east, down.
        xx, yy, zz = qx * qx, qy * qy, qz * qz
        north_u, north_v, north_w = (
            1 - 2 * (yy + zz), 2 * (qx * qy - qw * qz), 2 * (qx * qz + qw * qy),
        )  # fmt: skip
        east_u, east_v, east_w = (
            2 * (qx * qy + qw * qz), 1 - 2 * (xx + zz), 2 * (qy * qz - qw * qx),
        )  # fmt: skip
        down_u, down_v, down_w = (
            2 * (qx * qz - qw * qy), 2 * (qy * qz + qw * qx), 1 - 2 * (xx + yy),
        )  # fmt: skip
        sinking = down_u * u + down_v * v + down_w * w
        wrench = self._wrench((u, v, w, p, q, r), controls)
        down_n = hull.net_weight_n(depth) + self._bed_n(north, east, depth, sinking)
        centre_x, centre_z = self._centre
        weight_n = hull.MASS_KG * hull.GRAVITY_M_S2
        # Weight acts at the centre of mass, buoyancy right above it.
        lever = weight_n * (centre_z * hull.submerged_share(depth))
        forces = (
            wrench[0] + down_n * down_u,
            wrench[1] + down_n * down_v,
            wrench[2] + down_n * down_w,
            wrench[3] - lever * down_v,
            wrench[4] + lever * down_u - down_n * centre_x * down_w,
            wrench[5] + down_n * centre_x * down_v,
        )
        acceleration = [sum(map(float.__mul__, row, forces)) for row in self._inverse]
        return (
            north_u * u + north_v * v + north_w * w + current_north,
            east_u * u + east_v * v + east_w * w + current_east,
            sinking,
            -0.5 * (qx * p + qy * q + qz * r),
            0.5 * (qw * p + qy * r - qz * q),
            0.5 * (qw * q + qz * p - qx * r),
            0.5 * (qw * r + qx * q - qy * p),
            *acceleration,
        )

    def _wrench(self, velocity: Flat, controls: Controls) -> Flat:
        """Forces, N, and moments, N·m, of propeller, fins, damping and rotation."""
        u, v, w, p, q, r = velocity
        across, sinking = v + FIN_X_M * r, w - FIN_X_M * q
        rudder_x, rudder_y = fin_force(u, across, sinking, -controls.rudder_rad)
        lifted_x, lifted_z = fin_force(u, sinking, across, -controls.elevator_rad)
        mass = hull.MASS_KG
        cx, cz = self._centre
        # Centripetal terms of a rigid body whose centre of mass is not the origin.
        spin = p * cx + r * cz
        turn_x = q * w - r * v + p * spin - cx * (p * p + q * q + r * r)
        turn_y = r * u - p * w + q * spin
        turn_z = p * v - q * u + r * spin - cz * (p * p + q * q + r * r)
        turn_q = (hull.INERTIA_X_KG_M2 - hull.INERTIA_YZ_KG_M2) * p * r
        turn_r = (hull.INERTIA_YZ_KG_M2 - hull.INERTIA_X_KG_M2) * p * q
        flow_x, flow_y, flow_z = q * w - r * v, r * u - p * w, p * v - q * u
        return (
            -controls.thrust_n + rudder_x + lifted_x - DAMPING[0] * u * abs(u) - mass * turn_x,
            rudder_y - DAMPING[1] * v * abs(v) - mass * turn_y,
            lifted_z - DAMPING[2] * w * abs(w) - mass * turn_z,
            -DAMPING[3] * p * abs(p) + mass * cz * flow_y,
            -FIN_X_M * lifted_z - DAMPING[4] * q * abs(q) - turn_q
            - mass * (cz * flow_x - cx * flow_z),
            FIN_X_M * rudder_y - DAMPING[5] * r * abs(r) - turn_r - mass * cx * flow_y,
        )  # fmt: skip

    def _bed_n(self, north_m: float, east_m: float, depth_m: float, sinking_m_s: float) -> float:
        """Force down, N, of a sea bed that the vehicle stands on: a soft spring."""
        inside_m = depth_m + hull.HEIGHT_M / 2 - self._world.bed_depth_m(north_m, east_m)
        if inside_m <= 0.0:
            return 0.0
        return -_BED_N_M * inside_m - _BED_N_S_M * max(0.0, sinking_m_s)


def _limit(value: float, most: float) -> float:
    return min(most, max(-most, value))


def _mass_matrix(cx: float, cz: float) -> list[list[float]]:
    """Mass of the body about the origin, and of the water that it moves."""
    mass = hull.MASS_KG
    inertia_x = hull.INERTIA_X_KG_M2 + mass * cz * cz
    inertia_y = hull.INERTIA_YZ_KG_M2 + mass * cz * cz
    inertia_z = hull.INERTIA_YZ_KG_M2
    matrix = [
        [mass, 0.0, 0.0, 0.0, mass * cz, 0.0],
        [0.0, mass, 0.0, -mass * cz, 0.0, mass * cx],
        [0.0, 0.0, mass, 0.0, -mass * cx, 0.0],
        [0.0, -mass * cz, 0.0, inertia_x, 0.0, -mass * cx * cz],
        [mass * cz, 0.0, -mass * cx, 0.0, inertia_y, 0.0],
        [0.0, mass * cx, 0.0, -mass * cx * cz, 0.0, inertia_z],
    ]
    for index, added in enumerate(ADDED_MASS):
        matrix[index][index] += added
    return matrix


def _inverse(matrix: list[list[float]]) -> list[list[float]]:
    """Invert by Gauss and Jordan; the matrix is positive definite, so no pivot is sought."""
    size = len(matrix)
    rows = [[*row, *(float(i == j) for j in range(size))] for i, row in enumerate(matrix)]
    for index in range(size):
        pivot = rows[index][index]
        rows[index] = [value / pivot for value in rows[index]]
        for other in range(size):
            factor = rows[other][index]
            if other != index and factor:
                rows[other] = [
                    a - factor * b for a, b in zip(rows[other], rows[index], strict=True)
                ]
    return [row[size:] for row in rows]
