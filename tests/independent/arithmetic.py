"""Annex A: symbols in arithmetic-coded blocks. Written from docs/wire.md alone.

Reader and writer have the same methods; each returns the value, the reader the one that it finds.
"""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate

from tests.independent.errors import ReadError

FIRST = 0xC0
_WIDTH = 1 << 48
_LEAST = 1 << 47
_WHOLE = 1 << 28
_SPARED = 64


def shares(*relative: int) -> list[int]:
    """Return where the parts of relative shares begin and end, of 2^28."""
    whole = sum(relative)
    return [before * _WHOLE // whole for before in accumulate(relative, initial=0)]


class Coder(ABC):
    """Reads or writes symbols. `doublings`: the D of the page."""

    def __init__(self) -> None:
        self.width = _WIDTH
        self.doublings = 0

    @abstractmethod
    def part(self, unit: int, ends: Sequence[int], index: int) -> int:
        """Take one of the parts between these ends, in units; return its index."""

    @property
    def unit(self) -> int:
        return self.width >> 28

    def flag(self, probability: int, value: bool = False) -> bool:
        ends = (0, probability << 12, _WHOLE)
        return self.part(self.unit, ends, not value) == 0

    def shares(self, relative: Sequence[int], value: int = 0) -> int:
        return self.part(self.unit, shares(*relative), value)

    def one_of(self, count: int, value: int = 0) -> int:
        if count == 1:
            return 0
        if count > 1 << 16:
            low = (count - 1).bit_length() - 16
            found = self.one_of(((count - 1) >> low) + 1, value >> low) << low
            found |= self.bits(low, value & (1 << low) - 1)
            if found >= count:
                raise ReadError(f"{found} of {count}")
            return found
        # The same as `shares`, without a list of them all.
        ends = _Equal(count)
        return self.part(self.unit, ends, value)

    def bits(self, count: int, value: int = 0) -> int:
        found = 0
        for place in range(count - 1, -1, -1):
            found = found << 1 | self.one_of(2, value >> place & 1)
        return found


class _Equal(Sequence[int]):
    """The ends of equal shares."""

    def __init__(self, count: int) -> None:
        self._count = count

    def __len__(self) -> int:
        return self._count + 1

    def __getitem__(self, place: int) -> int:  # type: ignore[override]
        return place * _WHOLE // self._count


class Source(Coder):
    """Reads the symbols of a block."""

    def __init__(self, data: bytes) -> None:
        super().__init__()
        if not data or data[0] < FIRST:
            raise ReadError("no arithmetic-coded block")
        self._size = len(data)
        self._count = 8 * len(data) - 2
        self._number = int.from_bytes(data, "big") & (1 << self._count) - 1
        self._rest = 0
        self._low = 0
        self._taken = 0
        for _ in range(48):
            self._rest = self._rest << 1 | self._bit()

    def _bit(self) -> int:
        self._taken += 1
        place = self._count - self._taken
        return self._number >> place & 1 if place >= 0 else 0

    def part(self, unit: int, ends: Sequence[int], index: int) -> int:
        index = bisect_right(ends, self._rest // unit) - 1
        if index >= len(ends) - 1:
            raise ReadError("no symbol")
        self._rest -= unit * ends[index]
        self._low += unit * ends[index]
        self.width = unit * (ends[index + 1] - ends[index])
        while self.width < _LEAST:
            self.width <<= 1
            self._low <<= 1
            self._rest = self._rest << 1 | self._bit()
            self.doublings += 1
        if self.doublings > self._count + _SPARED:
            raise ReadError("the block ends within a symbol")
        return index

    def end(self, check: int) -> None:
        """Refuse any block but the one that a writer would have chosen."""
        size, number = choose(self._low, self.width, self.doublings, check)
        if (size, number) != (self._size, self._number):
            raise ReadError("another block should stand for these symbols")


class Sink(Coder):
    """Writes symbols."""

    def __init__(self) -> None:
        super().__init__()
        self._low = 0

    def part(self, unit: int, ends: Sequence[int], index: int) -> int:
        self._low += unit * ends[index]
        self.width = unit * (ends[index + 1] - ends[index])
        while self.width < _LEAST:
            self.width <<= 1
            self._low <<= 1
            self.doublings += 1
        return index

    def end(self, check: int) -> bytes:
        """Return the block."""
        size, number = choose(self._low, self.width, self.doublings, check)
        return (number | FIRST << 8 * (size - 1)).to_bytes(size, "big")


def choose(low: int, width: int, doublings: int, check: int) -> tuple[int, int]:
    """Return size and number of the block for an interval."""
    size = max(1, (doublings - 55) // 8)
    while True:
        finer = doublings + 48 - (8 * size - 2)
        first = -(-low >> finer)
        last = (low + width - 1) >> finer
        if first <= last:
            return size, first + check % (last - first + 1)
        size += 1
