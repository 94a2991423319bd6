"""The erasure code of objects: any K fragments of a block, of whichever kind, restore it.

An object is cut into *source fragments* of one size; up to 255 of them form a *block*. A *repair
fragment* is a random linear combination of the source fragments of one block in GF(256). A receiver
with as many fragments of a block as it has source fragments can solve for the missing ones with
probability 0.996, and with one fragment more practically always: on average the code costs 0.004
fragments (a dense random code: Σ 256^-i). So a receiver need not say *which* fragments it lacks,
only how many, and one repair fragment helps every receiver of a broadcast, whatever each has
missed.

Nothing here may ever change, since both ends must agree for ever. The coefficients of a repair
fragment come from SHAKE-128, which any language has: docs/wire.md defines it in one line, and the
golden vectors hold it.

Why not a library? Measured with fragments of 60 bytes, 10 KiB (171) and 1 MiB (17477), half of them
lost, on one busy core of a desktop with Python 3.11:

===================  ==============  =================  =============  ==========================
                     too many (mean  one repair         decode, half   beside
                     fragments)      fragment           lost
===================  ==============  =================  =============  ==========================
this module, 10 KiB  0.004           0.2 ms             12 ms          no dependency, 250 lines
this module, 1 MiB   0.004 a block   0.2 ms             24 ms a block  one block while the next
                                                                       is on its way, 4 min each
raptorq 2.0, 10 KiB  0.004           0.4 ms for all     0.7 ms         compiled; Apache-2.0
raptorq 2.0, 1 MiB   0.004           71 ms for all      86 ms          one block
zfec 1.6             0               not measured       not measured   compiled; GPL 2; 256
                                                                       fragments in all: blocks
                                                                       of 128 at half lost
reedsolo 1.7         0               not measured       not measured   255 in all, likewise
===================  ==============  =================  =============  ==========================

`raptorq` is as good on the channel and faster where it runs. It is not used because its wire format
is not stable: 1.8.0 and 2.0.0 number the same repair fragment differently (observed; upstream calls
it a breaking change), so two vehicles with two versions would never finish an object. Its Python
binding offers only its own default parameters, and no wheels were available for the 64-bit ARM
boards of most vehicles. Speed does not decide: a fragment takes a second on the channel and less
than a millisecond here.
"""

import hashlib
from typing import Final

import msgspec

from zacoustic.core.transport.objects.code.galois import combine, inverse, products

BLOCK_FRAGMENTS: Final = 255
"""The most source fragments of a block, so that a block's missing count is one byte of a
feedback."""
MOST_FRAGMENTS: Final = 32_000
"""The most source fragments of an object; the other indices leave at least 256 repair fragments for
each block."""
LAST_INDEX: Final = 0xFFFE
"""The last index of a fragment; 0xFFFF withdraws an object."""


class Layout(msgspec.Struct, frozen=True):
    """How an object is cut: into blocks as equal as possible, the larger ones first."""

    fragments: int
    """Number of source fragments, 1…`MOST_FRAGMENTS`."""
    fragment_bytes: int
    """Bytes of each fragment, ≥ 1; the last one is padded with zeros."""

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.fragments // BLOCK_FRAGMENTS)

    def first(self, block: int) -> int:
        """Return the index of a block's first source fragment; for `blocks`, the end."""
        size, larger = divmod(self.fragments, self.blocks)
        return block * size + min(block, larger)

    def size(self, block: int) -> int:
        """Return the number of source fragments of a block."""
        return self.first(block + 1) - self.first(block)

    @property
    def seeds(self) -> int:
        """Number of different repair fragments of each block."""
        return (LAST_INDEX + 1 - self.fragments) // self.blocks

    def block_of(self, index: int) -> int:
        """Return the block that a fragment belongs to."""
        if index >= self.fragments:
            return (index - self.fragments) % self.blocks
        size, larger = divmod(self.fragments, self.blocks)
        beyond = index - larger * (size + 1)
        return index // (size + 1) if beyond < 0 else larger + beyond // size

    def repair(self, block: int, seed: int) -> int:
        """Return the index of a repair fragment; after the last seed they repeat."""
        return self.fragments + seed % self.seeds * self.blocks + block

    def seed(self, index: int) -> int:
        """Return the seed of a repair fragment."""
        return (index - self.fragments) // self.blocks


def coefficients(block: int, seed: int, size: int) -> bytes:
    """Return the coefficients of a repair fragment for the source fragments of its block."""
    return hashlib.shake_128(bytes((block,)) + seed.to_bytes(2, "big")).digest(size)


class Fragments:
    """The fragments of a complete object.

    Args:
        coded_bytes: Manifest and payload.
        fragment_bytes: Bytes of each fragment.
    """

    def __init__(self, coded_bytes: bytes, fragment_bytes: int) -> None:
        self.layout = Layout(-(-len(coded_bytes) // fragment_bytes), fragment_bytes)
        self._coded_bytes = coded_bytes

    def cut(self, fragment_bytes: int) -> "Fragments":
        """Return the same object in fragments of another size."""
        return Fragments(self._coded_bytes, fragment_bytes)

    def fragment(self, index: int) -> bytes:
        """Return the fragment with an index, source or repair."""
        layout = self.layout
        if index < layout.fragments:
            return self._source(index)
        block = layout.block_of(index)
        begin = layout.first(block)
        sources = [self._source(begin + position) for position in range(layout.size(block))]
        factors = coefficients(block, layout.seed(index), len(sources))
        return combine(factors, sources).to_bytes(layout.fragment_bytes, "big")

    def _source(self, index: int) -> bytes:
        size_bytes = self.layout.fragment_bytes
        piece = self._coded_bytes[index * size_bytes : (index + 1) * size_bytes]
        return piece.ljust(size_bytes, b"\0")


class Block:
    """The fragments of one block that have arrived so far.

    Args:
        number: The block's number in the object.
        size: Number of its source fragments.
        fragment_bytes: Bytes of each fragment.
    """

    def __init__(self, number: int, size: int, fragment_bytes: int) -> None:
        self._number = number
        self._size = size
        self._fragment_bytes = fragment_bytes
        self._sources: dict[int, bytes] = {}
        self._repairs: dict[int, bytes] = {}
        self._dependent: set[int] = set()

    @property
    def lacking(self) -> int:
        """How many more fragments are needed; 0: `content` is available."""
        return self._size - len(self._sources) - len(self._repairs)

    @property
    def is_empty(self) -> bool:
        """Whether no fragment has arrived."""
        return not self._sources and not self._repairs

    def add_source(self, position: int, fragment: bytes) -> bool:
        """Add a source fragment; return False if it is known or not needed."""
        if position in self._sources or not self.lacking:
            return False
        self._sources[position] = fragment
        self._solve_if_complete()
        return True

    def add_repair(self, seed: int, fragment: bytes) -> bool:
        """Add a repair fragment; return False if it is known or not needed."""
        if seed in self._repairs or seed in self._dependent or not self.lacking:
            return False
        self._repairs[seed] = fragment
        self._solve_if_complete()
        return True

    def content(self) -> bytes:
        """Return the source fragments in a row; allowed only when none is lacking."""
        return b"".join(self._sources[position] for position in range(self._size))

    def _solve_if_complete(self) -> None:
        """Replace the repair fragments with the missing source fragments.

        Each repair fragment is an equation. Known fragments are subtracted from it; the rest, the
        coefficients of the missing fragments beside the sum, is reduced to the unit matrix.
        """
        if self.lacking or not self._repairs:
            return
        known = sorted(self._sources)
        rows = [self._sources[position] for position in known]
        missing = [position for position in range(self._size) if position not in self._sources]
        width = len(missing) + self._fragment_bytes
        solved: list[tuple[int, int]] = []  # (column of the leading 1, row as an integer)
        for seed, fragment in self._repairs.items():
            factors = coefficients(self._number, seed, self._size)
            left = bytes(factors[position] for position in missing)
            total = combine(bytes(factors[position] for position in known), rows)
            right = total ^ int.from_bytes(fragment, "big")
            row = left + right.to_bytes(self._fragment_bytes, "big")
            row = _reduce(row, solved, width)
            column = next((at for at in range(len(missing)) if row[at]), None)
            if column is None:
                self._dependent.add(seed)
                continue
            row = row.translate(products(inverse(row[column])))
            solved = [(at, _subtract(each, _byte(each, column, width), row)) for at, each in solved]
            solved.append((column, int.from_bytes(row, "big")))
        for seed in self._dependent & self._repairs.keys():
            del self._repairs[seed]
        if self.lacking:
            return
        for column, number in solved:
            row = number.to_bytes(width, "big")
            self._sources[missing[column]] = row[len(missing) :]
        self._repairs.clear()


def _byte(row: int, column: int, width: int) -> int:
    """Return one byte of a row that is an integer of `width` bytes."""
    return row >> 8 * (width - 1 - column) & 0xFF


def _subtract(row: int, factor: int, other: bytes) -> int:
    """Subtract a multiple of another row."""
    if not factor:
        return row
    return row ^ int.from_bytes(other.translate(products(factor)), "big")


def _reduce(row: bytes, solved: list[tuple[int, int]], width: int) -> bytes:
    """Subtract the solved rows, so that their columns are 0."""
    number = int.from_bytes(row, "big")
    for column, other in solved:
        factor = row[column]
        if factor:
            product = other.to_bytes(width, "big").translate(products(factor))
            number ^= int.from_bytes(product, "big")
    return number.to_bytes(width, "big")
