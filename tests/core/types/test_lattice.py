"""Lattices: a value that is taken at once is the integer that it is after all checks."""

import math
from typing import Any

import pytest

from tests.core.types.made import Level, Mode, one
from zacoustic.core.values.types import Lattice, OutsideValues
from zacoustic.errors import PayloadInvalidError

FIELDS: tuple[tuple[dict[str, Any], tuple[Any, ...]], ...] = (
    ({"type": "float64", "range": (-90.0, 90.0), "step": 1e-6}, (-90.0, 0.1, 90.0)),
    ({"type": "float64", "range": (0, 10), "step": 0.3}, (0.0, 4.4, 10.0)),
    ({"type": "float64", "range": (0, 10), "step": 0.5, "outside": "clamp"}, (0.0, 9.9)),
    ({"type": "float32", "step": 0.01}, (-1e9, 0.004, 3.0)),
    ({"type": "float64", "range": (0, 360), "step": 0.1, "wraps": True}, (0.0, 359.99)),
    ({"type": "float64", "range": (0, 1), "step": 2.0**-60 / 3 * 2**20}, (0.25,)),
    ({"type": "uint8"}, (0, 255)),
    ({"type": "int32", "range": (-5, 5)}, (-5, 5)),
    ({"type": "int32", "range": (-50, 50), "step": 5}, (-50, 3, 50)),
    ({"type": "int32", "range": (0, 360), "wraps": True}, (0, 359)),
    ({"type": "int32", "range": (0, 360), "step": 10, "wraps": True}, (0, 354)),
    ({"type": "enum", "values": ("idle", "survey")}, ("idle", "survey")),
    ({"type": "bool"}, (False, True)),
)
ODD: tuple[Any, ...] = (
    True, 0, 1, -1, 255, 256, 360, 361, 1 << 70, 0.0, -0.0, 5.0, 10.1, 359.97, 360.0, 1e300,
    math.nan, math.inf, -math.inf, "idle", "none", "0", None, [0], {}, b"", Mode.IDLE, Level.LOW,
)  # fmt: skip


@pytest.mark.parametrize(("keys", "normal"), FIELDS)
def test_what_is_taken_at_once_is_what_it_is_after_all_checks(
    keys: dict[str, Any], normal: tuple[Any, ...]
) -> None:
    spec = one(**keys)
    lattice, outside = Lattice(spec.fields[0]), OutsideValues(spec)
    for value in (*normal, *ODD):
        taken = lattice.take(value)
        try:
            checked = outside.bound(spec.validate({"f": value}))["f"]
        except PayloadInvalidError:
            assert taken is None
            continue
        assert taken in (None, lattice.index(checked))
        assert taken is None or not outside.clamped  # which would have been counted
        outside.clamped.clear()
    assert None not in [lattice.take(value) for value in normal]
