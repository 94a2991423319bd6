"""Directions of a field that wraps, from a table of integers.

The table is computed with integers alone, since libraries of different machines may differ in the
last digit: a rotation by 1/4096 of a circle, repeated, with twenty digits to spare.
"""

from typing import Final

SINE_BITS: Final = 14
"""Sines are multiples of 2**-14."""

_STEPS: Final = 4096
# cos and sin of 2π/4096, times 2**80.
_COS: Final = 1208924397255013589970078
_SIN: Final = 1854468253976911810989


def _table() -> list[int]:
    cosine, sine = 1 << 80, 0
    sines = []
    for _ in range(_STEPS):
        sines.append((sine + (1 << 79 - SINE_BITS)) >> 80 - SINE_BITS)
        cosine, sine = (
            (cosine * _COS - sine * _SIN) >> 80,
            (sine * _COS + cosine * _SIN) >> 80,
        )
    return sines


_SINES: Final = _table()
_QUARTER: Final = _STEPS // 4
_DIRECTIONS: Final = list(zip(_SINES[_QUARTER:] + _SINES[:_QUARTER], _SINES, strict=True))


def direction(value: int, size: int) -> tuple[int, int]:
    """Return cosine and sine of `value`, 0…size-1, of `size` parts of a circle, times 2**14."""
    return _DIRECTIONS[value * _STEPS // size]
