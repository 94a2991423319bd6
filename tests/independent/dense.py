"""Section 7.3: dense blocks in frames, their digests and marks. Written from docs/wire.md alone.

`blocks.py` reads their samples.
"""

import hashlib
from dataclasses import dataclass

from tests.independent.arithmetic import FIRST, Source
from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

REFERRING, INDEPENDENT, SINGLE = range(3)


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
    """Return the digest of a block over that of its reference, or the root."""
    return hashlib.blake2s(reference + data, digest_size=12).digest()


def root(table_digest: bytes, model_digest: bytes = b"") -> bytes:
    """Return what stands in place of a reference. Without a model its digest is empty."""
    return block_digest(table_digest, model_digest)


def mark_of(digest: bytes) -> int:
    """Return the mark of a block: the highest 14 bits of bytes 8 and 9 of its digest."""
    return int.from_bytes(digest[8:10], "big") >> 2


@dataclass(frozen=True)
class Head:
    """The kind of a block, and the name of its reference."""

    kind: int
    name: int | None = None


def read_head(data: bytes) -> Head:
    """Read how the contents of a block begin."""
    return take_head(Source(data))


def take_head(source: Source) -> Head:
    kind = source.shares((28, 3, 1))
    if kind != REFERRING:
        return Head(kind)
    name = source.bits(5)
    return Head(kind, name if name < 20 else 20 + 2 * (name - 20) + source.bits(1))
