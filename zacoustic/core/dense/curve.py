"""How likely each value of a number is, around where it is expected.

Prediction errors of real sensors are peaked like a Laplace distribution, rounded like a Gauss
distribution, and now and then wild: a wave, a fix, a restart. The curve is a fixed sum of all
three, the last a Cauchy distribution of a twelfth of the mass; only its place and its scale change.
Measured on logs of gliders, an AUV and a yacht it costs 0.1 bits a field more than the best of the
three chosen after the fact, and up to 2 bits less than the wrong one.

Everything is integers, from fixed constants on, since both ends must agree to the last bit: the
densities below are sums of integer recurrences, the tail between table entries is linear and beyond
the table falls with the distance, as that of a Cauchy distribution does. Every value has a share of
its own whatever the curve says, so that nothing is impossible; the value of the reference may have
one more, for a sensor that stands still.
"""

from itertools import pairwise
from typing import Final, NamedTuple

SHARE_BITS: Final = 28
_TOTAL: Final = 1 << SHARE_BITS
_HALF: Final = _TOTAL >> 1

POINT_BITS: Final = 4
"""Places on the curve are multiples of 1/16 of a step."""

SCALE_BITS: Final = 12
"""Scales are multiples of 1/4096 of a step."""

LARGEST_SIZE: Final = 1 << 22
"""Most values that a number on a curve may have."""

MOST_HOLD: Final = (1 << 16) - 330
"""Greatest share of a held value, 2**-16: the curve and the floor of all values need some."""

_CELL_BITS: Final = 5  # table entries are 1/32 of the scale apart
_FINE_BITS: Final = 9
_FINE_MASK: Final = (1 << _FINE_BITS) - 1
_REACH: Final = 32 << _CELL_BITS  # the table ends at 32 scales
_Z_SHIFT: Final = _CELL_BITS + _FINE_BITS + SCALE_BITS - POINT_BITS
_FLOOR: Final = 1 << 17  # mass that all values share alike: 1/2048
_HOLD_SHIFT: Final = SHARE_BITS - 16
_STEP: Final = 1 << POINT_BITS
_HALF_STEP: Final = _STEP >> 1  # a value begins so far below it
_OUTSIDE: Final = LARGEST_SIZE << POINT_BITS + 2  # further away than any value


def _densities() -> list[int]:
    """Mass of each cell of one side, in no particular unit."""
    one = 1 << 60
    # exp(-1.1/32), exp(-(0.8/32)**2/2) and the square of the latter, times 2**60.
    laplace_step = 1113963258879365125
    gauss_step, gauss_square = 1152561272925789074, 1152201153799543898
    laplace, gauss, ratio = one, one, gauss_step
    cells = []
    for cell in range(_REACH):
        # Heights at 0 are those of the densities: 0.5·1.1/2, 0.42·0.8/√(2π), 0.08/2π.
        cauchy = one * 4096 // (4096 + cell * cell)
        cells.append((27500 * laplace + 13405 * gauss + 1273 * cauchy) >> 30)
        laplace = laplace * laplace_step >> 60
        gauss = gauss * ratio >> 60
        ratio = ratio * gauss_square >> 60
    return cells


def _tails() -> list[int]:
    """Mass beyond each entry of the table, of one side, in shares."""
    cells = _densities()
    beyond = cells[-1] * _REACH  # ∫ dz/z² from the end of the table on, all that is left there
    tail, masses = beyond, [beyond]
    for mass in reversed(cells):
        tail += mass
        masses.append(tail)
    masses.reverse()
    return [mass * _HALF // masses[0] for mass in masses]


_TAILS: Final = _tails()
_FALLS: Final = [tail - after for tail, after in pairwise(_TAILS)]
_FAR: Final = _TAILS[_REACH] * (_REACH << _FINE_BITS)

_GUESS_BITS: Final = 9  # the inverse table has an entry for each 512th of the mass of one side
_GUESS_SHIFT: Final = SHARE_BITS - 1 - _GUESS_BITS


def _guesses() -> list[int]:
    """How far out, in 1/512 cells, the tail has each multiple of that mass."""
    guesses, cell = [_REACH << _FINE_BITS], _REACH - 1
    for entry in range(1, (1 << _GUESS_BITS) + 1):
        mass = entry << _GUESS_SHIFT
        while cell > 0 and _TAILS[cell] < mass:
            cell -= 1
        guesses.append((cell << _FINE_BITS) + (_TAILS[cell] - mass << _FINE_BITS) // _FALLS[cell])
    return guesses


_GUESSES: Final = [*_guesses(), 0]
_GUESS_FALLS: Final = [far - after for far, after in pairwise(_GUESSES)]
_GUESS_MASK: Final = (1 << _GUESS_SHIFT) - 1


class Curve(NamedTuple):
    """The shares of the values 0…size-1 of a number.

    Who needs one of it for a single value, as most do, takes `span` and `find` as they are.
    """

    size: int
    """How many values, 2…`LARGEST_SIZE`."""
    center: int
    """Where it is expected, 1/16 of a step; may lie outside."""
    scale: int
    """Mean distance from there, 1/4096 of a step, > 0."""
    held: int = 0
    """A value with a share of its own."""
    hold: int = 0
    """That share, 0…`MOST_HOLD`, 2**-16."""

    def below(self, value: int) -> int:
        """The sum of the shares of all values below `value`, 0…size."""
        if value <= 0:
            return 0
        return span(*self, value)[0] if value < self.size else _TOTAL

    def find(self, share: int) -> tuple[int, int, int]:
        """Find the value that a share belongs to; see `find`."""
        return find(*self, share)


def span(size: int, center: int, scale: int, held: int, hold: int, value: int) -> tuple[int, int]:
    """The sums of the shares of a `Curve` below a value, 0…size-1, and up to it."""
    floor = _FLOOR // size or 1
    hold <<= _HOLD_SHIFT
    if size > _FLOOR and hold > _TOTAL - 2 * size:
        hold = _TOTAL - 2 * size
    mass = _TOTAL - floor * size - hold
    start = floor * value
    end = start + floor
    place = (value << POINT_BITS) - center - _HALF_STEP
    z = ((place if place >= 0 else -place) << _Z_SHIFT) // scale
    cell = z >> _FINE_BITS
    if cell < _REACH:
        tail = _TAILS[cell] - (_FALLS[cell] * (z & _FINE_MASK) >> _FINE_BITS)
    else:
        tail = _FAR // z
    start += mass * (_TOTAL - tail if place >= 0 else tail) >> SHARE_BITS
    # The same again where the next value begins: a call for both would cost more than they do.
    place += _STEP
    z = ((place if place >= 0 else -place) << _Z_SHIFT) // scale
    cell = z >> _FINE_BITS
    if cell < _REACH:
        tail = _TAILS[cell] - (_FALLS[cell] * (z & _FINE_MASK) >> _FINE_BITS)
    else:
        tail = _FAR // z
    end += mass * (_TOTAL - tail if place >= 0 else tail) >> SHARE_BITS
    if value >= held:
        end += hold
        if value > held:
            start += hold
    if not value:
        start = 0
    if value + 1 == size:
        end = _TOTAL
    return start, end


def find(
    size: int, center: int, scale: int, held: int, hold: int, share: int
) -> tuple[int, int, int]:
    """Find the value of a `Curve` that a share, 0…2**28-1, belongs to.

    Returns:
        The value, the sum below it, and the sum up to it.
    """
    lump = hold << _HOLD_SHIFT
    mass = _TOTAL - _FLOOR - lump  # about; it is a guess that has to be right most of the time
    begin = center + _HALF_STEP
    value = begin + _guess(share, mass, scale) >> POINT_BITS
    if value > held and hold:
        value = max(begin + _guess(share - lump, mass, scale) >> POINT_BITS, held)
    if not 0 <= value < size:
        value = 0 if value < 0 else size - 1
    start, end = span(size, center, scale, held, hold, value)
    if start <= share < end:
        return value, start, end
    curve = Curve(size, center, scale, held, hold)
    if share < start:
        return _search(curve, share, (0, 0), (value, start), value - 1)
    return _search(curve, share, (value + 1, end), (size, _TOTAL), value + 2)


def _guess(share: int, mass: int, scale: int) -> int:
    """About how far from the center a share lies, 1/16 of a step."""
    share = (share << SHARE_BITS) // mass
    tail = share if share < _HALF else _TOTAL - share
    if tail <= 0:
        return _OUTSIDE if share > 0 else -_OUTSIDE
    entry = tail >> _GUESS_SHIFT
    far = _GUESSES[entry] - (_GUESS_FALLS[entry] * (tail & _GUESS_MASK) >> _GUESS_SHIFT)
    far = far * scale >> _Z_SHIFT
    return -far if share < _HALF else far


def _search(
    curve: Curve, share: int, low: tuple[int, int], high: tuple[int, int], value: int
) -> tuple[int, int, int]:
    """As `find`, between two values of which the sums below are known."""
    stride = 1
    while high[0] - low[0] > 1:  # `low` never lies above the value, `high` always does
        if not low[0] < value < high[0]:
            value = (low[0] + high[0]) >> 1
        here = value, curve.below(value)
        stride *= 2
        if here[1] <= share:
            low, value = here, value + stride
        else:
            high, value = here, value - stride
    return low[0], low[1], high[1]
