"""Attitudes: every component of a quaternion comes back within half a step."""

import math
import random

import pytest

from zacoustic.core.values.dense import DenseCodec, DenseSample
from zacoustic.core.values.dense.model.attitude import Attitude
from zacoustic.core.values.types import FieldSpec, TypeSpec

STEP = 0.001


def quaternion(rng: random.Random, tilt_deg: float) -> list[float]:
    """A random attitude."""
    tilt = math.radians(tilt_deg)
    roll, pitch = rng.uniform(-tilt, tilt) / 2, rng.uniform(-tilt, tilt) / 2
    yaw = rng.uniform(-math.pi, math.pi)
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]


@pytest.mark.parametrize("tilt_deg", [2, 20, 60])
def test_attitudes_travel_as_three_angles_within_half_a_step(tilt_deg: float) -> None:
    rng, attitude, failures = random.Random(tilt_deg), Attitude(STEP), 0
    for _ in range(500):
        parts = quaternion(rng, tilt_deg)
        angles = attitude.angles(parts)
        if angles is None:
            failures += 1
            continue
        found = attitude.parts(angles)
        assert max(abs(a - b) for a, b in zip(found, parts, strict=True)) <= STEP / 2
    assert failures <= 10


def test_four_numbers_that_are_no_attitude_travel_as_they_are() -> None:
    fields = tuple(
        FieldSpec(name=f"q{part}", type="float64", range=(-1, 1), step=STEP) for part in "xyzw"
    )
    codec = DenseCodec({4: TypeSpec(name="Attitude", fields=fields)})
    rng = random.Random(5)
    samples: list[list[float]] = [[0.0] * 4, [1.0] * 4, [0.9, -0.9, 0.3, 0.0]]
    samples += [quaternion(rng, 20) for _ in range(20)]
    samples += [[round(part, 3) for part in quaternion(rng, 90)] for _ in range(40)]
    values = [dict(zip(("qx", "qy", "qz", "qw"), each, strict=True)) for each in samples]
    encoded = codec.encode([DenseSample(4, value, n) for n, value in enumerate(values)], 4096)
    assert encoded is not None
    for (_, found), value in zip(codec.decode(encoded.frame).samples, values, strict=True):
        assert all(abs(found[name] - value[name]) <= STEP / 2 + 1e-12 for name in value)
