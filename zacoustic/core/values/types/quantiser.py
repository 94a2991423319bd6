"""`Quantiser`: a number with a step as a whole number of steps, and back.

The count is the integer nearest to value / step: nearest, not the floor, so the error is at most
half a step and has no bias. Decimal steps are not binary fractions (``454 * 0.1`` is
45.400000000000006), so both directions use the step as the exact ratio of two integers that its
decimal text means: 0.1 is 1/10, and 454 steps are 454/10, which is the float that prints as 45.4.
The text is the shortest that reads back as the same float, so it is the same at both ends. A step
that is no short decimal, such as the 1/60000 of a degree of positions in NMEA 0183, is taken as the
simplest ratio that rounds to the same float.

Ends of the range. The count of an end may lie up to half a step outside the range; its value is
then the end itself. Where the range wraps, the top is the bottom: the count of the top, unless it
is below the top, is the count of the bottom. Both rules keep two laws: the error is at most half a
step (measured around the circle where it wraps), and encoding a decoded value gives the same count.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Final

# 2**50: within it neither direction loses a count to the 53 bits of a float.
MAX_COUNT: Final = 1 << 50
"""Greatest magnitude of a count in a float field."""

_EXACT: Final = 1 << 53
_SIMPLE: Final = 10_000_000  # greatest denominator of a step that is no short decimal


class Quantiser:
    """Numbers of one field as counts of its step.

    Args:
        step: Distance between neighbouring values, > 0; an `int` makes all values integers.
        limits: Least and greatest value.
        wraps: Whether the two limits are the same value.
    """

    def __init__(
        self, step: int | float, limits: tuple[int | float, int | float], *, wraps: bool = False
    ) -> None:
        self.step = step
        self._low, self._high = limits
        self._integers = isinstance(step, int)
        self._wraps = wraps
        ratio = Fraction(repr(step))
        if ratio.denominator > _EXACT:
            simple = Fraction(step).limit_denominator(_SIMPLE)
            ratio = simple if float(simple) == step else ratio
        exact = ratio.numerator <= _EXACT and ratio.denominator <= _EXACT
        self._ratio = (ratio.numerator, ratio.denominator) if exact else None
        self.low_count = self._nearest(self._low)
        """The least count that `count` returns."""
        self.high_count = self._nearest(self._high)
        """The greatest count that `count` returns."""
        self._folds_at: int | None = None
        if wraps and self._multiple(self.high_count) >= self._high:
            self._folds_at = self.high_count
            self.high_count -= 1

    @property
    def closes(self) -> bool:
        """Whether the circle of a wrapping field closes with an error of at most half a step."""
        return self._folds_at is None or self._multiple(self.low_count) <= self._low

    def count(self, value: int | float) -> int:
        """Return the count nearest to `value`, which must lie within the limits."""
        count = self._nearest(value)
        return self.low_count if count == self._folds_at else count

    def value(self, count: int) -> int | float:
        """Return the value of a count between `low_count` and `high_count`."""
        value = self._multiple(count)
        if value < self._low:
            return self._low
        return self._high if value > self._high else value

    def indexer(self) -> Callable[[int | float], int]:
        """Make the function that returns how far `count` lies above `low_count`.

        Every number of every sample passes through it: it is one call where `count` takes three.
        """
        count, low = self.count, self.low_count
        if self._integers or self._ratio is None:
            return lambda value: count(value) - low
        # As floats, which both are exactly: a float times an integer would convert it each time.
        numerator, denominator = map(float, self._ratio)
        if self._folds_at is None:
            return lambda value: round(value * denominator / numerator) - low
        size = self.high_count - low + 1
        return lambda value: (round(value * denominator / numerator) - low) % size

    def taker(self) -> Callable[[object], int | None]:
        """Make an indexer for unchecked values; it returns None for those that are not allowed.

        It checks and counts in one call, which is what most numbers of most samples need.
        """
        kind, least, greatest = (int if self._integers else float), self._low, self._high
        index = self.indexer()
        if self._wraps or self._integers or self._ratio is None:
            beyond = greatest if self._wraps else math.inf

            def take(value: object) -> int | None:
                if type(value) is kind and least <= value <= greatest and value != beyond:
                    return index(value)
                return None

            return take
        numerator, denominator = map(float, self._ratio)
        low = self.low_count

        def take_float(value: object) -> int | None:
            if type(value) is float and least <= value <= greatest:
                return round(value * denominator / numerator) - low
            return None

        return take_float

    def locator(self) -> Callable[[int], int | float]:
        """Make the function that returns the `value` of a number of counts above `low_count`."""
        value, low = self.value, self.low_count
        if self._integers or self._ratio is None:
            return lambda index: value(index + low)
        least, greatest = self._low, self._high
        numerator, denominator = self._ratio
        if least <= self._multiple(low) and self._multiple(self.high_count) <= greatest:
            return lambda index: (index + low) * numerator / denominator

        def locate(index: int) -> int | float:
            found = (index + low) * numerator / denominator
            if found < least:
                return least
            return greatest if found > greatest else found

        return locate

    def _nearest(self, value: int | float) -> int:
        if self._integers:
            return int((2 * value + self.step) // (2 * self.step))
        if self._ratio is None:
            return round(value / self.step)
        numerator, denominator = self._ratio
        return round(value * denominator / numerator)

    def _multiple(self, count: int) -> int | float:
        if self._integers or self._ratio is None:
            return count * self.step
        numerator, denominator = self._ratio
        return count * numerator / denominator
