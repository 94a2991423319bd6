"""Section 7.3: dense blocks in frames. Written from docs/wire.md alone.

The page gives the arithmetic decoder of section 7.2, but leaves curves, learning, habits and texts
to source code. So this reader finds a block, the name of its reference, its digest and its
acknowledgement, and does not read its samples.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

FIRST = 0xC0
REFERRING, INDEPENDENT, SINGLE = range(3)
_WHOLE = 1 << 28
_WIDTH = 48
_SHORT_NAMES = 20


@dataclass(frozen=True)
class Block:
    """A dense block, unread."""

    data: bytes


@dataclass(frozen=True)
class BlockAck:
    """The acknowledgement of the newest block that a receiver holds. `node`: None in unicast."""

    node: int | None
    mark: int

    def write(self) -> bytes:
        node = b"" if self.node is None else bytes((self.node,))
        return b"\xb9" + node + bytes((FIRST | self.mark >> 8, self.mark & 0xFF))


def read_mark(cursor: Cursor) -> int:
    """Take the mark of a block."""
    first, second = cursor.take(2)
    if first < FIRST:
        raise ReadError("no mark")
    return (first & 0x3F) << 8 | second


def block_digest(reference: bytes, data: bytes) -> bytes:
    """Return the digest of a block over that of its reference, or the root.

    The page speaks of the first 12 bytes of BLAKE2s. The vectors are of BLAKE2s with a digest of 12
    bytes, which is another hash.
    """
    return hashlib.blake2s(reference + data, digest_size=12).digest()


def root(table_digest: bytes, model_digest: bytes = b"") -> bytes:
    """Return what stands in place of a reference. Without a model its digest is empty."""
    return block_digest(table_digest, model_digest)


def mark_of(digest: bytes) -> int:
    """Return the mark of a block: the highest 14 bits of bytes 8 and 9 of its digest."""
    return int.from_bytes(digest[8:10], "big") >> 2


class Decoder:
    """Takes symbols from a block. Its first width is a guess: the least of 48 bits."""

    def __init__(self, data: bytes) -> None:
        if not data or data[0] < FIRST:
            raise ReadError("no dense block")
        self._bits = int.from_bytes(data, "big") & ((1 << (8 * len(data) - 2)) - 1)
        self._left = 8 * len(data) - 2
        self._width = 1 << (_WIDTH - 1)
        self._value = 0
        for _ in range(_WIDTH - 1):
            self._shift()

    def _shift(self) -> None:
        self._left -= 1
        bit = self._bits >> self._left & 1 if self._left >= 0 else 0
        self._value = self._value << 1 | bit

    def symbol(self, shares: Sequence[int]) -> int:
        """Take a symbol, by the shares of all in 2^28."""
        unit = self._width >> 28
        start = 0
        for place, share in enumerate(shares):
            if self._value < (start + share) * unit:
                self._value -= start * unit
                self._width = share * unit
                while self._width < 1 << (_WIDTH - 1):
                    self._width <<= 1
                    self._shift()
                return place
            start += share
        raise ReadError("no symbol")


@dataclass(frozen=True)
class Head:
    """The kind of a block, and the name of its reference."""

    kind: int
    name: int | None = None


def read_head(data: bytes) -> Head:
    """Read how the contents of a block begin."""
    decoder = Decoder(data)
    kind = decoder.symbol([share * _WHOLE // 32 for share in (28, 3, 1)])
    if kind != REFERRING:
        return Head(kind)
    name = decoder.symbol([_WHOLE // 32] * 32)
    if name >= _SHORT_NAMES:
        low = decoder.symbol([_WHOLE // 2] * 2)
        name = _SHORT_NAMES + ((name - _SHORT_NAMES) << 1 | low)
    return Head(kind, name)
