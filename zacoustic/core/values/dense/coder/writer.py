"""Writes symbols as one block (`zacoustic.core.values.dense.coder.arithmetic`)."""

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
    MARKER,
    MARKER_BITS,
    TOTAL,
    TOTAL_BITS,
    WIDTH_BITS,
    shortest_bytes,
)

_POINT_MASK: Final = (1 << POINT_BITS) - 1
_START: Final = 0, 1 << WIDTH_BITS, WIDTH_BITS


class Writer:
    """Writes symbols.

    Args:
        mark: The state of another writer to continue from.
    """

    is_reader = False

    def __init__(self, mark: tuple[int, int, int] = _START) -> None:
        self._low, self._width, self._shift = mark

    @property
    def bits(self) -> int:
        """Bits spent so far, rounded down."""
        return self._shift - WIDTH_BITS

    def mark(self) -> tuple[int, int, int]:
        """Return the writer's state, for `rewind`."""
        return self._low, self._width, self._shift

    def rewind(self, mark: tuple[int, int, int]) -> None:
        """Discard everything written since `mark`."""
        self._low, self._width, self._shift = mark

    def narrow(self, start: int, share: int) -> None:
        """Write the symbol with this share of `TOTAL`, > 0, from `start` on."""
        unit = self._width >> TOTAL_BITS
        width = unit * share
        lift = WIDTH_BITS - width.bit_length()
        self._low = (self._low + unit * start) << lift
        self._width = width << lift
        self._shift += lift

    def flag(self, probability: int, value: bool) -> bool:
        """Write a flag that is set with `probability`, 1…2**16-1."""
        unit = self._width >> TOTAL_BITS
        width = unit * (probability << FLAG_SHIFT)
        if not value:
            self._low += width
            width = (unit << TOTAL_BITS) - width
        if width < LEAST_WIDTH:
            lift = WIDTH_BITS - width.bit_length()
            width <<= lift
            self._low <<= lift
            self._shift += lift
        self._width = width
        return value

    def uniform(self, size: int, value: int) -> int:
        """Write one of `size` equally likely values, 0…size-1."""
        if size <= 1:
            return value
        if size > 1 << CHUNK_BITS:
            low_bits = (size - 1).bit_length() - CHUNK_BITS
            # The upper part first: its last value may have fewer lower parts, which costs nothing.
            self.uniform(((size - 1) >> low_bits) + 1, value >> low_bits)
            self.raw(low_bits, value & (1 << low_bits) - 1)
            return value
        start = value * TOTAL // size
        self.narrow(start, (value + 1) * TOTAL // size - start)
        return value

    def raw(self, width: int, value: int) -> int:
        """Write a number of `width` bits."""
        while width > CHUNK_BITS:
            width -= CHUNK_BITS
            self.raw(CHUNK_BITS, value >> width)
        if width:
            unit = self._width >> TOTAL_BITS << TOTAL_BITS - width
            lift = WIDTH_BITS - unit.bit_length()
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
        """Write the position in a list of fixed shares, given by `ends_of`."""
        unit, start = self._width >> TOTAL_BITS, ends[index]
        width = unit * (ends[index + 1] - start)
        self._low += unit * start
        if width < LEAST_WIDTH:
            lift = WIDTH_BITS - width.bit_length()
            width <<= lift
            self._low <<= lift
            self._shift += lift
        self._width = width
        return index

    def number(self, curve: Curve, value: int) -> int:
        """Write a number that lies on a curve."""
        return self.near(curve.size, curve.center, curve.grade, curve.held, curve.hold, value)

    def near(self, size: int, center: int, grade: int, held: int, hold: int, value: int) -> int:
        """Write a number on the `Curve` with these parameters, without making the `Curve`."""
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
        start, end = sums[place], sums[place + 1]  # inlined `span`, `_take`: calls cost more
        if value >= held:
            end += odds
            if value > held:
                start += odds
        width = unit * (end - start)
        lift = WIDTH_BITS - width.bit_length()
        self._low = (self._low + unit * start) << lift
        self._width = width << lift
        self._shift += lift
        return value

    def _take(self, unit: int, start: int, end: int) -> None:
        width = unit * (end - start)
        lift = WIDTH_BITS - width.bit_length()
        self._low = (self._low + unit * start) << lift
        self._width = width << lift
        self._shift += lift

    def finish(self, ways: int, check: int) -> bytes:
        """Return the shortest block.

        Args:
            ways: Least number of blocks to choose from, 1…2**32; each doubling costs a bit.
            check: Chooses one of the available blocks.
        """
        bits = self._shift - WIDTH_BITS
        size = (bits + MARKER_BITS + 7) // 8
        # Codes of that size are multiples of this many bits: count those up to the interval's last
        # number, less those before its first.
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
