"""`Ends`: the ends of the range of a float, also in single precision.

A program that computes in singles says π as 3.1415927, which is above π. So the single nearest to
an end, if it lies beyond, stands for that end. In a float32 so does each number that is rounded to
that single, since nothing else of it crosses. All that checks floats asks here.
"""

import math
import struct
from typing import Final

from zacoustic.core.values.types.fields import FieldSpec

_SINGLE: Final = struct.Struct(">f")


def single(number: float) -> float:
    """Return the nearest number of single precision; infinite beyond its range."""
    try:
        rounded: float = _SINGLE.unpack(_SINGLE.pack(number))[0]
    except OverflowError:
        return math.copysign(math.inf, number)
    return rounded


class Ends:
    """The ends of the range of one field.

    Args:
        field: A float with `limits`.

    Attributes:
        low: Least value.
        high: Greatest value.
        least: The least number that stands for a value: `low`, or of a float32 its single.
        greatest: The greatest such number.
    """

    def __init__(self, field: FieldSpec) -> None:
        self.low, self.high = field.bounds
        self._is_single = field.type == "float32"
        below, above = single(self.low), single(self.high)
        self._below = below if -math.inf < below < self.low else None
        self._above = above if self.high < above < math.inf else None
        self.least = self.low if self._below is None or not self._is_single else self._below
        self.greatest = self.high if self._above is None or not self._is_single else self._above

    def value(self, number: float) -> float | None:
        """Return the value of the range that a number stands for; None: it lies outside."""
        if self.low <= number <= self.high:
            return number
        if self._is_single:
            number = single(number)
            if self.low <= number <= self.high:
                return number
        if number == self._below:
            return self.low
        return self.high if number == self._above else None
