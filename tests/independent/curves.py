"""Annex A: numbers on a curve. Written from docs/wire.md alone."""

from functools import cache
from math import isqrt

from tests.independent.arithmetic import Coder
from tests.independent.errors import ReadError

LISTED = 176
WIDTH = 2048
_WHOLE = 1 << 24
_MOST_LOG_SCALE = 32768


@cache
def roots() -> list[int]:
    """Return the powers of two within an octave."""
    x = 1 << 61
    for _ in range(10):
        x = isqrt(x << 60)
    y, found = 1 << 60, []
    for _ in range(1024):
        found.append(y >> 30)
        y = y * x >> 60
    return found


def log(number: int, unit_bits: int) -> int:
    octave = number.bit_length() - 1
    mantissa = (number << 30) >> octave
    place = max(i for i, root in enumerate(roots()) if root <= mantissa)
    return 1024 * (octave - unit_bits) + place


def log_scale(scale: int) -> int:
    return min(max(log(scale, 12) + 4096, 0), _MOST_LOG_SCALE)


def _scaled(place: int, octave: int) -> int:
    return (roots()[place] << (octave + 28)) >> 46


def _of_grade(grade: int) -> tuple[int, int]:
    height = max(grade - 32, 0)
    return height // 16 - 4, height % 16


@cache
def scale_of(grade: int) -> int:
    """Return the scale of a grade."""
    octave, i = _of_grade(grade)
    return _scaled(64 * i + 32, octave)


@cache
def reciprocal(grade: int) -> int:
    return (1 << 32) // scale_of(grade)


@cache
def _tails() -> list[int]:
    left = right = 1 << 60
    ratio = 1152561272925789074
    masses = []
    for c in range(1024):
        masses.append((27500 * left + 13405 * right + 1273 * ((1 << 72) // (4096 + c * c))) >> 30)
        left = left * 1113963258879365125 >> 60
        right = right * ratio >> 60
        ratio = ratio * 1152201153799543898 >> 60
    beyond = [1024 * masses[-1]]
    for mass in reversed(masses):
        beyond.append(beyond[-1] + mass)
    beyond.reverse()
    return [(each << 27) // beyond[0] for each in beyond]


@cache
def sums(grade: int, position: int) -> tuple[int, list[int]]:
    """Return the reach of a grade's list, and its sums at a position of the center."""
    octave, i = _of_grade(grade)
    scale = _scaled(256 * (i // 4) + 128, octave)
    together = 1 << min(max(octave + 1, 0), 4)
    p = 2 * (position - position % together) + together - 1
    reach = ((32 * scale) >> 12) + 2
    tails, found = _tails(), []
    for j in range(-reach, reach + 2):
        d = 32 * j - p
        z = (abs(d) << 21) // scale
        c, f = z >> 9, z % 512
        if c < 1024:
            q = tails[c] - ((tails[c] - tails[c + 1]) * f >> 9)
        else:
            q = (tails[1024] << 19) // z
        found.append(q >> 4 if d < 0 else _WHOLE - (q >> 4))
    return reach, found


def number(
    coder: Coder, count: int, center: int, grade: int, held: int, hold: int, value: int = 0
) -> int:
    """Take a number of 0…count - 1."""
    if grade >= LISTED:
        return _wide(coder, count, center, grade, held, hold, value)
    place = center + 8
    reach, listed = sums(grade, place % 16)
    first = (place >> 4) - reach
    last = first + 2 * reach
    k = hold >> 6
    odds = (k << 24) // (1024 - k)
    unit = coder.width // (_WHOLE + odds)

    inside = range(max(first, 0), min(last, count - 1) + 1)
    ends = [0]
    if first > 0:
        ends.append(listed[0] + (odds if held < first else 0))
    for v in inside:
        high = listed[v - first + 1] + (odds if v >= held else 0)
        ends.append(_WHOLE + odds if v == count - 1 else high)
    if last < count - 1:
        if not inside:
            ends.append(listed[-1] + (odds if held <= last else 0))
        ends.append(_WHOLE + odds)
    below = int(first > 0)
    if not inside:
        return _outside_the_list(coder, unit, ends, count, first, last, value)
    index = (
        inside.index(value) + below if value in inside else (0 if value < first else len(ends) - 2)
    )
    index = coder.part(unit, ends, index)
    if below and index == 0:
        return _beyond(coder, count, min(first, count) - 1, below=True, value=value)
    if index - below < len(inside):
        return inside[index - below]
    return _beyond(coder, count, max(last + 1, 0), below=False, value=value)


def _outside_the_list(
    coder: Coder, unit: int, ends: list[int], count: int, first: int, last: int, value: int
) -> int:
    """Take a number of which none is in the list: all are below it, or all above."""
    if last < 0:
        if coder.part(unit, ends, 1) != 1:
            raise ReadError("no symbol")
        return _beyond(coder, count, max(last + 1, 0), below=False, value=value)
    coder.part(unit, ends, 0)
    return _beyond(coder, count, min(first, count) - 1, below=True, value=value)


def _beyond(coder: Coder, count: int, nearest: int, *, below: bool, value: int) -> int:
    there = nearest + 1 if below else count - nearest
    distance = nearest - value if below else value - nearest
    k = coder.one_of(there.bit_length(), (distance + 1).bit_length() - 1)
    distance = coder.bits(k, (distance + 1) & (1 << k) - 1) + (1 << k) - 1
    if distance >= there:
        raise ReadError("beyond the last number")
    return nearest - distance if below else nearest + distance


def _wide(
    coder: Coder, count: int, center: int, grade: int, held: int, hold: int, value: int
) -> int:
    if hold and coder.flag(hold, value == held):
        if not 0 <= held < count:
            raise ReadError("held is no value")
        return held
    k = (grade - LISTED) // 16 + 1
    upper = ((count - 1) >> k) + 1
    found = 0
    if upper > 1:
        found = number(coder, upper, ((center + 8) >> k) - 8, grade - 16 * k, 0, 0, value >> k)
    found = found << k | coder.bits(k, value & (1 << k) - 1)
    if found >= count:
        raise ReadError("beyond the last number")
    return found
