"""An arithmetic coder: symbols of any probability as one string, to a fraction of a bit each.

The problem: a field whose next value is almost known is worth a tenth of a bit, and whole bits per
field cost ten times that. The idea: the string is a number between 0 and 1; every symbol narrows
the interval in which it must lie to the symbol's share of it. Whoever knows the shares finds the
symbols again by looking in which share the number lies.

`Writer` and `Reader` have the same methods, and each *returns the value*: the writer the one that
it is given, the reader the one that it found. So a model is one piece of code that both ends run
(``depth = coder.uniform(size, depth)``), and cannot say one thing to the writer and another to the
reader.

All arithmetic is on integers. The writer keeps the lower end as one integer of any length, so a
carry needs no care; the width is kept at 48 bits, 28 of which a symbol's share may divide. Numbers
on a curve divide it by as much as all their shares are together.

The end. A string of n bytes stands for the number that it is followed by zeros. Of the strings of
the shortest sufficient length, several may lie in the interval: which of them is sent is a choice
that costs nothing, and is used as a check (`Writer.finish`, `Reader.check`): a number of at least
`ways` values and as many as there happen to be, mod a hash of both ends' knowledge.

The first byte's two highest bits are the marker of a dense frame, and no part of the number.

Flags, picks and numbers are what every message is made of, and a call costs as much as all that
`narrow` does: so these do it themselves.
"""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate
from typing import Final

from zacoustic.core.dense.curve import (
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
from zacoustic.core.dense.offcurve import beyond, wide
from zacoustic.core.payload import PayloadError

TOTAL_BITS: Final = 28
TOTAL: Final = 1 << TOTAL_BITS
"""Shares are multiples of 1/`TOTAL`."""

PROBABILITY_BITS: Final = 16
"""Probabilities of flags are multiples of 2**-16."""

MARKER: Final = 0xC0
"""The two highest bits of the first byte."""

MARKER_BITS: Final = 2

# A string ends where only zeros would follow, but for no more than this: so a short string cannot
# make its reader work for long.
_SPARED_BITS: Final = 64

_WIDTH_BITS: Final = 48
_LEAST_WIDTH: Final = 1 << _WIDTH_BITS - 1
_ZEROS: Final = _SPARED_BITS + _WIDTH_BITS  # that many are looked at behind the end of a string
_FLAG_SHIFT: Final = TOTAL_BITS - PROBABILITY_BITS
_CHUNK_BITS: Final = 16
_POINT_MASK: Final = (1 << POINT_BITS) - 1

_IN_A_GAP: Final = "a string in the gap between the symbols"
_ENDS_INSIDE: Final = "the string ends inside a value"


_START: Final = 0, 1 << _WIDTH_BITS, _WIDTH_BITS


class Writer:
    """Writes symbols.

    Args:
        mark: Where it goes on from, of another writer.
    """

    is_reader = False

    def __init__(self, mark: tuple[int, int, int] = _START) -> None:
        self._low, self._width, self._shift = mark

    @property
    def bits(self) -> int:
        """Bits spent so far, rounded down to a whole one."""
        return self._shift - _WIDTH_BITS

    def mark(self) -> tuple[int, int, int]:
        """Return where the writer stands, for `rewind`."""
        return self._low, self._width, self._shift

    def rewind(self, mark: tuple[int, int, int]) -> None:
        """Forget everything written since `mark`."""
        self._low, self._width, self._shift = mark

    def narrow(self, start: int, share: int) -> None:
        """Write the symbol whose share of `TOTAL` is `share`, > 0, from `start` on."""
        unit = self._width >> TOTAL_BITS
        width = unit * share
        lift = _WIDTH_BITS - width.bit_length()
        self._low = (self._low + unit * start) << lift
        self._width = width << lift
        self._shift += lift

    def flag(self, probability: int, value: bool) -> bool:
        """Write a flag that is set with `probability`, 1…2**16-1."""
        unit = self._width >> TOTAL_BITS
        width = unit * (probability << _FLAG_SHIFT)
        if not value:
            self._low += width
            width = (unit << TOTAL_BITS) - width
        if width < _LEAST_WIDTH:
            lift = _WIDTH_BITS - width.bit_length()
            width <<= lift
            self._low <<= lift
            self._shift += lift
        self._width = width
        return value

    def uniform(self, size: int, value: int) -> int:
        """Write one of `size` equally likely values, 0…size-1."""
        if size <= 1:
            return value
        if size > 1 << _CHUNK_BITS:
            low_bits = (size - 1).bit_length() - _CHUNK_BITS
            # The upper part first: its last value may have fewer lower parts, which costs nothing.
            self.uniform(((size - 1) >> low_bits) + 1, value >> low_bits)
            self.raw(low_bits, value & (1 << low_bits) - 1)
            return value
        start = value * TOTAL // size
        self.narrow(start, (value + 1) * TOTAL // size - start)
        return value

    def raw(self, width: int, value: int) -> int:
        """Write a number of `width` bits."""
        while width > _CHUNK_BITS:
            width -= _CHUNK_BITS
            self.raw(_CHUNK_BITS, value >> width)
        if width:
            unit = self._width >> TOTAL_BITS << TOTAL_BITS - width
            lift = _WIDTH_BITS - unit.bit_length()
            self._low = (self._low + unit * (value & (1 << width) - 1)) << lift
            self._width = unit << lift
            self._shift += lift
        return value

    def choice(self, shares: Sequence[int], index: int) -> int:
        """Write the position in a list of relative shares, each > 0."""
        whole, before = sum(shares), sum(shares[:index])
        start = before * TOTAL // whole
        self.narrow(start, (before + shares[index]) * TOTAL // whole - start)
        return index

    def pick(self, ends: Sequence[int], index: int) -> int:
        """Write the position in a list of fixed shares, given by its `ends_of`."""
        unit, start = self._width >> TOTAL_BITS, ends[index]
        width = unit * (ends[index + 1] - start)
        self._low += unit * start
        if width < _LEAST_WIDTH:
            lift = _WIDTH_BITS - width.bit_length()
            width <<= lift
            self._low <<= lift
            self._shift += lift
        self._width = width
        return index

    def number(self, curve: Curve, value: int) -> int:
        """Write a number that lies on a curve."""
        return self.near(curve.size, curve.center, curve.grade, curve.held, curve.hold, value)

    def near(self, size: int, center: int, grade: int, held: int, hold: int, value: int) -> int:
        """Write a number that lies on the `Curve` of all these, without having made it."""
        if grade >= LISTED:
            return wide(self, size, center, grade, held, hold, value)
        reach, last, curves = CURVES[grade]
        center += HALF_STEP
        sums = curves[center & _POINT_MASK]
        first = (center >> POINT_BITS) - reach
        odds = ODDS[hold >> HOLD_SHIFT]
        unit = self._width // (WHOLE + odds)
        place = value - first
        if not 0 <= place <= last or not 0 < value < size - 1:
            start, end = span(sums, first, size, held, odds, value)
            self._take(unit, start, end)
            if 0 <= place <= last:
                return value
            return beyond(self, size, first, first + last, value)
        start, end = sums[place], sums[place + 1]  # as `span` and `_take` do: calls would cost more
        if value >= held:
            end += odds
            if value > held:
                start += odds
        width = unit * (end - start)
        lift = _WIDTH_BITS - width.bit_length()
        self._low = (self._low + unit * start) << lift
        self._width = width << lift
        self._shift += lift
        return value

    def _take(self, unit: int, start: int, end: int) -> None:
        width = unit * (end - start)
        lift = _WIDTH_BITS - width.bit_length()
        self._low = (self._low + unit * start) << lift
        self._width = width << lift
        self._shift += lift

    def finish(self, ways: int, check: int) -> bytes:
        """Return the shortest string.

        Args:
            ways: Least number of strings to choose from, 1…2**32; each doubling costs a bit.
            check: Chooses among as many as there are.
        """
        bits = self._shift - _WIDTH_BITS
        size = (bits + MARKER_BITS + 7) // 8
        # Codes of that size are multiples of this many bits: those up to the interval's last number
        # less those before its first one lie in it.
        unit_bits = self._shift - 8 * size + MARKER_BITS
        before = self._low - 1
        last = before + self._width
        while (last >> unit_bits + 8) - (before >> unit_bits + 8) >= ways:
            if size <= shortest_bytes(bits):
                break
            size -= 1
            unit_bits += 8
        while (count := (last >> unit_bits) - (before >> unit_bits)) < ways:
            size += 1
            unit_bits -= 8
        code = (before >> unit_bits) + 1 + check % count
        return (code | MARKER << 8 * (size - 1)).to_bytes(size, "big")


def ends_of(*shares: int) -> tuple[int, ...]:
    """Where relative shares that never change begin and end, for `pick`."""
    whole = sum(shares)
    return tuple(before * TOTAL // whole for before in accumulate(shares, initial=0))


def shortest_bytes(bits: int) -> int:
    """Least size of a string that holds that many bits, the marker and zeros spared, bytes."""
    return max(1, (bits + MARKER_BITS - _SPARED_BITS + 7) // 8)


class Reader:
    """Reads what a `Writer` wrote.

    Args:
        string: Off the water, at least one byte; what lies behind its end is zeros.
    """

    is_reader = True

    def __init__(self, string: bytes) -> None:
        self._size = size = len(string)
        bits = 8 * size - MARKER_BITS
        # With all the zeros that may be read, so that nobody needs to look where the string ends.
        self._code = code = (int.from_bytes(string, "big") & (1 << bits) - 1) << _ZEROS
        self._bits = self._left = left = bits + _SPARED_BITS
        self._width = 1 << _WIDTH_BITS
        self._value = code >> left

    @property
    def bits(self) -> int:
        """Bits spent so far, rounded down to a whole one."""
        return self._bits - self._left

    @property
    def bits_left(self) -> int:
        """Bits that can still be read."""
        return self._left

    def flag(self, probability: int, value: bool = False) -> bool:
        """Read a flag that is set with `probability`."""
        unit = self._width >> TOTAL_BITS
        width, rest = unit * (probability << _FLAG_SHIFT), self._value
        is_set = rest < width
        if not is_set:
            rest -= width
            width = (unit << TOTAL_BITS) - width
            if rest >= width:
                raise PayloadError(_IN_A_GAP)
        if width < _LEAST_WIDTH:
            lift = _WIDTH_BITS - width.bit_length()
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
        if size > 1 << _CHUNK_BITS:
            low_bits = (size - 1).bit_length() - _CHUNK_BITS
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
        while width > _CHUNK_BITS:
            width -= _CHUNK_BITS
            upper = upper << _CHUNK_BITS | self.raw(_CHUNK_BITS)
        if not width:
            return 0
        unit = self._width >> TOTAL_BITS << TOTAL_BITS - width
        value, rest = divmod(self._value, unit)
        if value >> width:
            raise PayloadError(_IN_A_GAP)
        lift = _WIDTH_BITS - unit.bit_length()
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
        if width < _LEAST_WIDTH:
            lift = _WIDTH_BITS - width.bit_length()
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
        """Read a number that lies on the `Curve` of all these."""
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
            # What is beyond the list or, where that reaches so far, the number's first or last.
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
        start, end = sums[place], sums[place + 1]  # as `span` and `_take` do
        if value >= held:
            end += odds
            if value > held:
                start += odds
        width = unit * (end - start)
        lift = _WIDTH_BITS - width.bit_length()
        self._left = left = self._left - lift
        if left < 0:
            raise PayloadError("the string ends inside a value")
        self._width = width << lift
        self._value = self._value - unit * start << lift | self._code >> left & (1 << lift) - 1
        return value

    def check(self, ways: int, check: int) -> None:
        """Verify the end.

        Raises:
            PayloadError: The string is not the one that `Writer.finish` returns.
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
        # Rounded as the writer's: the code itself is a multiple of the unit.
        if count < ways or index != check % count:
            raise PayloadError("the check of the string fails")
        # How many strings of one byte less lie in the interval, were they allowed.
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
        lift = _WIDTH_BITS - width.bit_length()
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
        lift = _WIDTH_BITS - width.bit_length()
        self._left = left = self._left - lift
        if left < 0:
            raise PayloadError("the string ends inside a value")
        self._width = width << lift
        self._value = value << lift | self._code >> left & (1 << lift) - 1


Coder = Writer | Reader
"""What models are written for.

Both have `flag`, `uniform`, `raw`, `choice`, `pick`, `number` and `near`.
"""
