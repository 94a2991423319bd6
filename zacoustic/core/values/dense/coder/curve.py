"""The probability of each value of a number, around its expected value.

Prediction errors of real sensors are peaked like a Laplace distribution, rounded like a Gauss
distribution, and now and then wild: a wave, a fix, a restart. The curve is a fixed sum of all
three, the last a Cauchy distribution with a twelfth of the mass; only its position and its scale
change. Measured on logs of gliders, an AUV and a yacht it costs 0.1 bits a field more than the best
of the three chosen after the fact, and up to 2 bits less than the wrong one.

The problem: computing the curve at the begin and the end of a value takes a division, a table
lookup and an interpolation, twice for each field of each sample at each end, and the reader must
find the value first. The idea: a scale that is a tenth off makes no visible difference. So there
are four curves for each doubling of the scale and sixteen positions within a step, fewer where the
scale is wide. Each curve is a list: the sums of the shares of all values within 32 scales. A
value's share is the difference of two neighbouring entries, and the value of a share is found by
bisection.

A scale is kept as its logarithm, in 1/1024 octaves above the least scale; its *grade* is the same
in 1/16 octaves, and everything that depends on a scale is in a list by grade. Grades begin two
octaves lower still, since a width can make a scale narrower than the least; these all have the
curve of the least.

One value may have a share of its own, for a sensor that stands still: it is *held*, and its *odds*,
which both ends know, stand between the shares of its neighbours. All values beyond the list have
one share on either side, and are told apart by their distance. So nothing is impossible. The share
beyond the range of the number belongs to its first and last value.

Everything is integers, from fixed constants on, since both ends must agree to the last bit: the
densities below are sums of integer recurrences, the logarithms repeated square roots.
"""

from bisect import bisect_right
from itertools import pairwise
from math import isqrt
from typing import Final, NamedTuple

SHARE_BITS: Final = 24
WHOLE: Final = 1 << SHARE_BITS
"""The shares of all values, without the held value's own share."""

POINT_BITS: Final = 4
"""Positions on the curve are multiples of 1/16 of a step."""

HALF_STEP: Final = 1 << POINT_BITS - 1
"""A value begins this far below itself."""

SCALE_BITS: Final = 12
"""Scales that are not logarithms are multiples of 1/4096 of a step."""

LARGEST_SIZE: Final = 1 << 22
"""The most values that a number on a curve may have."""

MOST_HOLD: Final = (1 << 16) - 330
"""The greatest share of a held value, 2**-16."""

OCTAVE: Final = 1 << 10
"""Logarithms of scales are multiples of 1/1024 octave."""

MOST_LOG_SCALE: Final = 32 * OCTAVE
"""The logarithm of the greatest scale."""

NARROWER: Final = 2 * OCTAVE
"""How far below the least scale a grade may be."""

WIDTH_BITS: Final = 13
"""Bits of a width, which says how much wider than its scale a curve is: from two octaves less,
`NARROWER`, up to six more."""

GRADE_SHIFT: Final = 6
"""A grade is a logarithm plus `NARROWER`, without this many low bits."""

GRADES: Final = OCTAVE >> GRADE_SHIFT
"""Grades per octave."""

HOLD_SHIFT: Final = 6
"""How many low bits a hold has more than its index in `ODDS`."""

_LEAST_OCTAVE: Final = -4  # the least scale is 1/16 of a step
_LISTED_OCTAVES: Final = 9  # curves of 32 steps and wider are made of narrower ones
_QUARTER: Final = GRADES // 4
_CELL_BITS: Final = 5  # the curve is computed at multiples of 1/32 of its scale
_FINE_BITS: Final = 9
_TAIL_BITS: Final = 28
_REACH: Final = 32  # lists end about there, scales
_CELLS: Final = _REACH << _CELL_BITS


def _densities() -> list[int]:
    """Return the mass of each cell of one side, in no particular unit."""
    one = 1 << 60
    # exp(-1.1/32), exp(-(0.8/32)**2/2) and the square of the latter, times 2**60.
    laplace_step = 1113963258879365125
    gauss_step, gauss_square = 1152561272925789074, 1152201153799543898
    laplace, gauss, ratio = one, one, gauss_step
    cells = []
    for cell in range(_CELLS):
        # Heights at 0 are those of the densities: 0.5·1.1/2, 0.42·0.8/√(2π), 0.08/2π.
        cauchy = one * 4096 // (4096 + cell * cell)
        cells.append((27500 * laplace + 13405 * gauss + 1273 * cauchy) >> 30)
        laplace = laplace * laplace_step >> 60
        gauss = gauss * ratio >> 60
        ratio = ratio * gauss_square >> 60
    return cells


def _tails() -> list[int]:
    """Return the mass beyond each multiple of 1/32 of the scale, of one side, 2**-28 of both."""
    cells = _densities()
    tail = cells[-1] * len(cells)  # ∫ dz/z² from there on, all that is left there
    masses = [tail]
    for mass in reversed(cells):
        tail += mass
        masses.append(tail)
    masses.reverse()
    return [(mass << _TAIL_BITS - 1) // masses[0] for mass in masses]


def _roots() -> list[int]:
    """Return 2**(n/1024), times 2**30, for n of one octave."""
    one = 1 << 60
    root = 2 * one
    for _ in range(OCTAVE.bit_length() - 1):
        root = isqrt(root * one)
    power, powers = one, []
    for _ in range(OCTAVE):
        powers.append(power >> 30)
        power = power * root >> 60
    return powers


_ROOTS: Final = _roots()


def logarithm(number: int, bits: int) -> int:
    """Return the logarithm of a number > 0 in 2**-bits, 1/1024 octaves, rounded down."""
    octave = number.bit_length() - 1
    mantissa = number << 30 >> octave
    return (octave - bits) * OCTAVE + bisect_right(_ROOTS, mantissa) - 1


def log_scale(scale: int) -> int:
    """Return the logarithm of a scale in 2**-12 steps, limited to the allowed range."""
    above = logarithm(scale, SCALE_BITS) - _LEAST_OCTAVE * OCTAVE
    return min(max(above, 0), MOST_LOG_SCALE)


def _scale(octave: int, part: int) -> int:
    """Return 2**(octave + part/1024) steps, 2**-12."""
    return _ROOTS[part] << octave + SCALE_BITS + 16 >> 46


def _sums(tails: list[int], scale: int, place: int) -> list[int]:
    """Return the mass below each value from `_REACH` scales below the center on.

    Args:
        tails: See `_tails`.
        scale: Scale of the curve, 2**-12 steps.
        place: Position of the center in the middle value, 1/32 steps.
    """
    reach = (_REACH * scale >> SCALE_BITS) + 2
    sums = []
    for value in range(-reach, reach + 2):
        way = (value << POINT_BITS + 1) - place
        z = (abs(way) << _CELL_BITS + _FINE_BITS + SCALE_BITS - POINT_BITS - 1) // scale
        cell, fine = z >> _FINE_BITS, z & (1 << _FINE_BITS) - 1
        if cell < _CELLS:
            tail = tails[cell] - ((tails[cell] - tails[cell + 1]) * fine >> _FINE_BITS)
        else:
            tail = (tails[_CELLS] * _CELLS << _FINE_BITS) // z
        tail >>= _TAIL_BITS - SHARE_BITS
        sums.append(tail if way < 0 else WHOLE - tail)
    assert all(before < after for before, after in pairwise(sums))
    return sums


Listed = tuple[int, int, list[list[int]]]
"""Curves of a grade: how many values lie below the middle one, the index of the last of them, and
the sums, by the position of the center in the middle value, 1/16 of a step."""


def _curves() -> list[Listed]:
    """Return the curves by grade."""
    tails, found = _tails(), []
    for octave in range(_LEAST_OCTAVE, _LEAST_OCTAVE + _LISTED_OCTAVES):
        # Positions within an eighth of the scale count as one.
        together = 1 << min(max(octave + 1, 0), POINT_BITS)
        for part in range(_QUARTER >> 1, GRADES, _QUARTER):
            scale = _scale(octave, part << GRADE_SHIFT)
            by_place = [
                _sums(tails, scale, 2 * place + together - 1)
                for place in range(0, 1 << POINT_BITS, together)
            ]
            reach = len(by_place[0]) // 2 - 1
            sums = [by_place[place // together] for place in range(1 << POINT_BITS)]
            found += [(reach, 2 * reach, sums)] * _QUARTER
    return [found[0]] * (NARROWER >> GRADE_SHIFT) + found


CURVES: Final = _curves()
"""The curves by grade, up to `LISTED`."""

LISTED: Final = len(CURVES)
"""Grades from here on have no curve of their own."""

_SCALES: Final = [
    _scale(_LEAST_OCTAVE + octave, (part << GRADE_SHIFT) + (1 << GRADE_SHIFT - 1))
    for octave in range((MOST_LOG_SCALE + (1 << WIDTH_BITS)) // OCTAVE)
    for part in range(GRADES)
]
SCALES: Final = [_SCALES[0]] * (NARROWER >> GRADE_SHIFT) + _SCALES
"""Scales by grade, 2**-12 steps."""

ODDS: Final = [
    (hold << SHARE_BITS) // ((1 << 16 - HOLD_SHIFT) - hold)
    for hold in range((MOST_HOLD >> HOLD_SHIFT) + 1)
]
"""The share of a held value beside `WHOLE`, by hold without its `HOLD_SHIFT` low bits."""


class Curve(NamedTuple):
    """The shares of the values 0…size-1 of a number."""

    size: int
    """Number of values, 2…`LARGEST_SIZE`."""
    center: int
    """The expected value, 1/16 of a step; may lie outside."""
    scale: int
    """Mean distance from the center, 1/4096 of a step, > 0."""
    held: int = 0
    """A value with a share of its own."""
    hold: int = 0
    """That share, 0…`MOST_HOLD`, 2**-16."""

    @property
    def grade(self) -> int:
        """The grade of the scale."""
        return log_scale(self.scale) + NARROWER >> GRADE_SHIFT


def span(
    sums: list[int], first: int, size: int, held: int, odds: int, value: int
) -> tuple[int, int]:
    """Return the mass below a value, and the mass up to its end.

    Args:
        sums: Sums of the curve.
        first: The first value in them, may be < 0.
        size: Number of values.
        held: The held value.
        odds: Its share.
        value: 0…size-1. A value before `first`, or after the last, stands for all on that side.
    """
    place = value - first
    if place < 0:
        return 0, sums[0] + (odds if held < first else 0)
    if place >= len(sums) - 1:
        return sums[-1] + (odds if held < first + len(sums) - 1 else 0), WHOLE + odds
    start, end = sums[place], sums[place + 1]
    if value >= held:
        end += odds
        if value > held:
            start += odds
    return start if value > 0 else 0, end if value < size - 1 else WHOLE + odds
