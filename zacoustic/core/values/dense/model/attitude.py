"""Attitudes: four numbers with three degrees of freedom, which turn with the vehicle.

The components of a quaternion change together when a vehicle turns, by sines and cosines that no
linear prediction follows, and one of them is redundant. So a quaternion crosses as roll, pitch and
yaw, each a multiple of an angle so small that every component comes back within half a step of its
field, and a flag for its sign. The sender checks that; if it fails (four numbers that are no
attitude, or a vehicle on its tail), the numbers cross as they are.

A quaternion is four adjacent float fields of one type, with the range [-1, 1], the same step, and
names that end in x, y, z, w.

Only the sender's rounding and the receiver's result are floating-point: what is coded, and learnt
from, is integers.
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import Final

from zacoustic.core.values.types import FieldSpec

_PARTS: Final = "xyzw"

# The angles in steps of the components. A component moves by half of what roll and pitch move, in
# parts that depend on the yaw, at worst at 45°; and by half of what the yaw moves. So at a pitch of
# 15° one sample in thousands is off by more than half a step, and within it a step further on; of
# quaternions that were rounded to their steps before, one in twelve is, and most of these cross as
# they are.
_TILT_PER_STEP: Final = 1.45
_YAW_PER_STEP: Final = 1.75
_NEIGHBOURS: Final = sorted(
    product((-1, 0, 1), repeat=3), key=lambda more: (sum(map(abs, more)), more)
)
_COARSEST: Final = 0.1  # of the fields' step: a coarser one has no small angle


class Attitude:
    """A quaternion as angles.

    Args:
        step: The step of its components.
    """

    def __init__(self, step: float) -> None:
        self._half_step = step / 2
        # Angles are counted from -180° and, for the pitch, from -90°.
        self.tilt_circle = 4 * math.ceil(math.tau / (_TILT_PER_STEP * step) / 4)
        """Steps of roll and pitch in a circle, a multiple of 4."""
        self.yaw_circle = 2 * math.ceil(math.tau / (_YAW_PER_STEP * step) / 2)
        """Steps of the yaw in a circle, even."""

    def angles(self, parts: Sequence[float]) -> tuple[int, int, int, int] | None:
        """Return sign (0, 1), roll, pitch and yaw of x, y, z, w; None: they are no attitude."""
        x, y, z, w = parts
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if not 0.5 < norm < 2:
            return None
        x, y, z, w = x / norm, y / norm, z / norm, w / norm
        tilt, turn = self.tilt_circle / math.tau, self.yaw_circle / math.tau
        roll = round(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) * tilt)
        pitch = round(math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))) * tilt)
        yaw = round(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) * turn)
        roll, pitch = roll + self.tilt_circle // 2, pitch + self.tilt_circle // 4
        yaw += self.yaw_circle // 2
        for more in _NEIGHBOURS:
            near = (roll + more[0], pitch + more[1], (yaw + more[2]) % self.yaw_circle)
            if not (0 <= near[0] <= self.tilt_circle and 0 <= near[1] <= self.tilt_circle // 2):
                continue
            for sign in (0, 1):
                found = self.parts((sign, *near))
                errors = (abs(one - other) for one, other in zip(found, parts, strict=True))
                if max(errors) <= self._half_step:
                    return (sign, *near)
        return None

    def parts(self, angles: Sequence[int]) -> tuple[float, float, float, float]:
        """Return x, y, z, w of sign, roll, pitch and yaw."""
        sign, *counts = angles
        tilt, turn = math.pi / self.tilt_circle, math.pi / self.yaw_circle  # half angles
        roll = (counts[0] - self.tilt_circle // 2) * tilt
        pitch = (counts[1] - self.tilt_circle // 4) * tilt
        yaw = (counts[2] - self.yaw_circle // 2) * turn
        cr, sr = math.cos(roll), math.sin(roll)
        cp, sp = math.cos(pitch), math.sin(pitch)
        cy, sy = math.cos(yaw), math.sin(yaw)
        x, y = sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy
        z, w = cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy
        return (-x, -y, -z, -w) if sign else (x, y, z, w)


def quaternion_at(fields: Sequence[FieldSpec], place: int) -> Attitude | None:
    """Return the attitude of the quaternion that begins at an index of fields; None: none does."""
    group = fields[place : place + 4]
    if len(group) < 4 or [field.name[-1:].lower() for field in group] != list(_PARTS):
        return None
    step = group[0].step
    if step is None or step > _COARSEST or group[0].is_integer:
        return None
    alike = all(
        field.range == (-1.0, 1.0)
        and field.step == step
        and field.type == group[0].type
        and field.outside == "reject"
        and not (field.is_array or field.optional or field.wraps or field.nan)
        for field in group
    )
    return Attitude(float(step)) if alike else None
