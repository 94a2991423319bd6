"""Numbers that are not in the lists of a curve: see `zacoustic.core.values.dense.coder.curve`.

Lists end where a scale has become wide, and at a number of scales from the center. Both cases are
rare: each costs another symbol or two, and no more than the digits of the distance.
"""

from typing import Protocol

from zacoustic.core.values.dense.coder.curve import GRADES, HALF_STEP, LISTED
from zacoustic.core.values.payload import PayloadError


class Digits(Protocol):
    """The writer or reader of these numbers.

    See `zacoustic.core.values.dense.coder.arithmetic`.
    """

    def flag(self, probability: int, value: bool) -> bool:
        """Write or read a flag that is set with `probability`, 1…2**16-1."""

    def uniform(self, size: int, value: int) -> int:
        """Write or read one of `size` equally likely values, 0…size-1."""

    def raw(self, width: int, value: int) -> int:
        """Write or read a number of `width` bits."""

    def near(self, size: int, center: int, grade: int, held: int, hold: int, value: int) -> int:
        """Write or read a number on the curve with these parameters."""


def wide(
    coder: Digits, size: int, center: int, grade: int, held: int, hold: int, value: int
) -> int:
    """Write or read a number on a curve wider than those in lists.

    First whether it is held; if not, all but its lowest bits on a narrower curve, and then these
    bits.
    """
    if hold and coder.flag(hold, value == held):
        if not 0 <= held < size:
            raise PayloadError(f"{held} of {size} values")
        return held
    shift = (grade - LISTED) // GRADES + 1
    center = (center + HALF_STEP >> shift) - HALF_STEP
    parts = (size - 1 >> shift) + 1
    upper = value >> shift
    if parts > 1:
        upper = coder.near(parts, center, grade - shift * GRADES, 0, 0, upper)
    value = (upper << shift) + coder.raw(shift, value & (1 << shift) - 1)
    if value >= size:
        raise PayloadError(f"{value} of {size} values")
    return value


def beyond(coder: Digits, size: int, first: int, last: int, value: int) -> int:
    """Write or read a number outside of `first`…`last`; on which side is known.

    First the number of digits of the distance, uniformly, and then the digits.
    """
    is_below = value < first
    nearest = min(first, size) - 1 if is_below else max(last + 1, 0)
    count = nearest + 1 if is_below else size - nearest
    distance = nearest - value if is_below else value - nearest
    digits = coder.uniform(count.bit_length(), (distance + 1).bit_length() - 1)
    distance = (1 << digits) - 1 + coder.raw(digits, distance + 1 & (1 << digits) - 1)
    if distance >= count:
        raise PayloadError(f"{distance} of {count} values")
    return nearest - distance if is_below else nearest + distance
