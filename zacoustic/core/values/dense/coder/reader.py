"""Reads symbols from one block (`zacoustic.core.values.dense.coder.arithmetic`)."""

from bisect import bisect_right
from collections.abc import Sequence
from typing import Final

from zacoustic.core.values.dense.coder.curve import (
    CURVES,
    HALF_STEP,
    HOLD_SHIFT,
    LISTED,
    ODDS,
    POINT_BITS,
    WHOLE,
    Curve,
    span,
)
from zacoustic.core.values.dense.coder.offcurve import beyond, wide
from zacoustic.core.values.dense.coder.shares import (
    CHUNK_BITS,
    FLAG_SHIFT,
    LEAST_WIDTH,
    MARKER_BITS,
    SPARED_BITS,
    TOTAL,
    TOTAL_BITS,
    WIDTH_BITS,
    shortest_bytes,
)
from zacoustic.core.values.payload import PayloadError

_POINT_MASK: Final = (1 << POINT_BITS) - 1
_ZEROS: Final = SPARED_BITS + WIDTH_BITS  # bits that may be read after the end of a block
_IN_A_GAP: Final = "a string in the gap between the symbols"
_ENDS_INSIDE: Final = "the string ends inside a value"


class Reader:
    """Reads what a `Writer` wrote.

    Args:
        block: The received block, at least one byte; zeros follow its end.
    """

    is_reader = True

    def __init__(self, block: bytes) -> None:
        self._size = size = len(block)
        bits = 8 * size - MARKER_BITS
        # Include all the zeros that may be read, so that no method must check for the block's end.
        self._code = code = (int.from_bytes(block, "big") & (1 << bits) - 1) << _ZEROS
        self._bits = self._left = left = bits + SPARED_BITS
        self._width = 1 << WIDTH_BITS
        self._value = code >> left

    @property
    def bits(self) -> int:
        """Bits spent so far, rounded down."""
        return self._bits - self._left

    @property
    def bits_left(self) -> int:
        """Bits that can still be read."""
        return self._left

    def flag(self, probability: int, value: bool = False) -> bool:
        """Read a flag that is set with `probability`."""
        unit = self._width >> TOTAL_BITS
        width, rest = unit * (probability << FLAG_SHIFT), self._value
        is_set = rest < width
        if not is_set:
            rest -= width
            width = (unit << TOTAL_BITS) - width
            if rest >= width:
                raise PayloadError(_IN_A_GAP)
        if width < LEAST_WIDTH:
            lift = WIDTH_BITS - width.bit_length()
            self._left = left = self._left - lift
            if left < 0:
                raise PayloadError(_ENDS_INSIDE)
            width <<= lift
            rest = rest << lift | self._code >> left & (1 << lift) - 1
        self._width = width
        self._value = rest
        return is_set

    def uniform(self, size: int, value: int = 0) -> int:
        """Read one of `size` equally likely values."""
        if size <= 1:
            return 0
        if size > 1 << CHUNK_BITS:
            low_bits = (size - 1).bit_length() - CHUNK_BITS
            value = self.uniform(((size - 1) >> low_bits) + 1) << low_bits
            value |= self.raw(low_bits)
            if value >= size:
                raise PayloadError(f"{value} of {size} values")
            return value
        place = self._place()
        value = (place * size + size - 1) // TOTAL
        start = value * TOTAL // size
        if start > place:
            value -= 1
            start = value * TOTAL // size
        self._narrow(start, (value + 1) * TOTAL // size - start)
        return value

    def raw(self, width: int, value: int = 0) -> int:
        """Read a number of `width` bits."""
        upper = 0
        while width > CHUNK_BITS:
            width -= CHUNK_BITS
            upper = upper << CHUNK_BITS | self.raw(CHUNK_BITS)
        if not width:
            return 0
        unit = self._width >> TOTAL_BITS << TOTAL_BITS - width
        value, rest = divmod(self._value, unit)
        if value >> width:
            raise PayloadError(_IN_A_GAP)
        lift = WIDTH_BITS - unit.bit_length()
        self._left = left = self._left - lift
        if left < 0:
            raise PayloadError(_ENDS_INSIDE)
        self._width = unit << lift
        self._value = rest << lift | self._code >> left & (1 << lift) - 1
        return upper << width | value

    def choice(self, shares: Sequence[int], index: int = 0) -> int:
        """Read the position in a list of relative shares."""
        whole, place = sum(shares), self._place()
        start = before = 0
        for index, share in enumerate(shares):  # noqa: B007 (the last one is the answer)
            before += share
            end = before * TOTAL // whole
            if place < end:
                break
            start = end
        self._narrow(start, end - start)
        return index

    def pick(self, ends: Sequence[int], index: int = 0) -> int:
        """Read the position in a list of fixed shares."""
        unit, rest = self._width >> TOTAL_BITS, self._value
        index, width = 0, unit * ends[1]
        if rest >= width:  # most often it is the first
            place = rest // unit
            if place >= TOTAL:
                raise PayloadError(_IN_A_GAP)
            index = bisect_right(ends, place) - 1
            start = ends[index]
            width = unit * (ends[index + 1] - start)
            rest -= unit * start
        if width < LEAST_WIDTH:
            lift = WIDTH_BITS - width.bit_length()
            self._left = left = self._left - lift
            if left < 0:
                raise PayloadError(_ENDS_INSIDE)
            width <<= lift
            rest = rest << lift | self._code >> left & (1 << lift) - 1
        self._width = width
        self._value = rest
        return index

    def number(self, curve: Curve, value: int = 0) -> int:
        """Read a number that lies on a curve."""
        return self.near(curve.size, curve.center, curve.grade, curve.held, curve.hold)

    def near(self, size: int, center: int, grade: int, held: int, hold: int, value: int = 0) -> int:
        """Read a number on the `Curve` with these parameters."""
        if grade >= LISTED:
            return wide(self, size, center, grade, held, hold, value)
        reach, last, curves = CURVES[grade]
        center += HALF_STEP
        sums = curves[center & _POINT_MASK]
        first = (center >> POINT_BITS) - reach
        odds = ODDS[hold >> HOLD_SHIFT]
        unit = self._width // (WHOLE + odds)
        share = self._value // unit
        place = bisect_right(sums, share) - 1
        held_place = held - first
        if place >= held_place:
            place = bisect_right(sums, share - odds) - 1
            if place < held_place:
                place = held_place
        value = first + place
        if not 0 <= place <= last or not 0 < value < size - 1:
            # Beyond the list or, where the list reaches that far, the number's first or last value.
            if place < 0 < first:
                value = min(first, size) - 1
            elif place > last and first + last < size - 1:
                value = max(first + last + 1, 0)
            else:
                value = min(max(value, 0), size - 1)
            start, end = span(sums, first, size, held, odds, value)
            self._take(unit, start, end)
            if first <= value <= first + last:
                return value
            return beyond(self, size, first, first + last, value)
        start, end = sums[place], sums[place + 1]  # inlined `span` and `_take`
        if value >= held:
            end += odds
            if value > held:
                start += odds
        width = unit * (end - start)
        lift = WIDTH_BITS - width.bit_length()
        self._left = left = self._left - lift
        if left < 0:
            raise PayloadError("the string ends inside a value")
        self._width = width << lift
        self._value = self._value - unit * start << lift | self._code >> left & (1 << lift) - 1
        return value

    def check(self, ways: int, check: int) -> None:
        """Verify the end of the block.

        Raises:
            PayloadError: It is not the block that `Writer.finish` returns.
        """
        value, width, left = self._value, self._width, self._left
        spent = self._bits - left
        if left > _ZEROS:
            lift = left - _ZEROS
            value = value << lift | self._code >> _ZEROS & (1 << lift) - 1
            width <<= lift
            left = _ZEROS
        unit_bits = _ZEROS - left
        index = value >> unit_bits
        count = index + 1 + ((width - 1 - value) >> unit_bits)
        # Rounded as by the writer: the code itself is a multiple of the unit.
        if count < ways or index != check % count:
            raise PayloadError("the check of the string fails")
        # How many blocks of one byte less would lie in the interval.
        lowest = (value - (self._code >> left)) & (1 << unit_bits + 8) - 1
        if (width - 1 - lowest >> unit_bits + 8) + 1 >= ways and self._size > shortest_bytes(spent):
            raise PayloadError("a string longer than needed")

    def _place(self) -> int:
        place = self._value // (self._width >> TOTAL_BITS)
        if place >= TOTAL:
            raise PayloadError(_IN_A_GAP)
        return place

    def _narrow(self, start: int, share: int) -> None:
        unit = self._width >> TOTAL_BITS
        width = unit * share
        value = self._value - unit * start
        if value >= width:
            raise PayloadError(_IN_A_GAP)
        lift = WIDTH_BITS - width.bit_length()
        self._left = left = self._left - lift
        if left < 0:
            raise PayloadError(_ENDS_INSIDE)
        self._width = width << lift
        self._value = value << lift | self._code >> left & (1 << lift) - 1

    def _take(self, unit: int, start: int, end: int) -> None:
        width = unit * (end - start)
        value = self._value - unit * start
        if not 0 <= value < width:
            raise PayloadError("a string in the gap between the symbols")
        lift = WIDTH_BITS - width.bit_length()
        self._left = left = self._left - lift
        if left < 0:
            raise PayloadError("the string ends inside a value")
        self._width = width << lift
        self._value = value << lift | self._code >> left & (1 << lift) - 1
