"""Section 7.3: dense blocks in frames. Written from docs/wire.md alone.

The page gives the arithmetic decoder of section 7.2, but leaves curves, learning, habits and texts
to source code. So this reader finds a block, its digest and its acknowledgement, and does not read
its samples.
"""

import hashlib
from dataclasses import dataclass

from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

FIRST = 0xC0


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
