"""What both ends know of a source after one of its frames.

Whoever holds a frame holds its snapshot: of each stream the last sample that this frame, its
reference or theirs had. So one reference serves all streams of a frame, whether it had samples of
them or not.

A snapshot's digest covers the bytes of its frame and the digest of its reference's snapshot, hence
all that was ever said along the chain. Frames have no numbers: a frame that refers to another says
a part of that one's digest, its *name*. That tells the receiver which one is meant, and at the same
time checks that it holds the very same state: a number would cost as much and tell only the first.
Names are short, so two frames may have the same one; `Speaker` sees to it that it is not ambiguous,
by the long name where it must.
"""

import struct
from hashlib import blake2s
from typing import Final

from zacoustic.core.dense.adaptation import StreamState
from zacoustic.core.dense.habits import Habit, Presence

NAME_BITS: Final = 5
"""Bits of a short name."""

SHORT_NAMES: Final = (1 << NAME_BITS) - 1
"""How many short names there are; what is left announces a long one."""

LONG_NAME_BITS: Final = 7
"""Bits of a long name."""

MARK_BITS: Final = 14
"""Bits of a mark."""

_DIGEST_BYTES: Final = 12
_LONG_NAME_SHIFT: Final = 16 - LONG_NAME_BITS
_MARK_SHIFT: Final = 16 - MARK_BITS
_parts_of = struct.Struct(">IHHH2x").unpack  # of a digest: check, names and mark

Known = tuple[StreamState | None, int | None, Habit]
"""What is known of a stream:

- its last sample; None: there was none;
- when that was taken, in steps of the stream; None: there was none. The sender's affair: a receiver
  counts on from where it began;
- what the source's frames usually hold of it.
"""


class Snapshot:
    """A frame, as something to refer to; never changed.

    Args:
        streams: See below.
        presence: See below.
        said: The digest of the reference's snapshot, and the frame.

    Attributes:
        streams: What is known of each stream, in the order of their ids.
        presence: Of which streams the source's frames usually are.
        digest: Of all frames up to this one.
        check: What frames that refer to this one are checked against.
        short_name: Says which frame is meant, 0…30.
        long_name: Says it with more certainty, 0…127.
        mark: Says in an acknowledgement which frame is meant, 0…16383.
    """

    check: int
    short_name: int
    long_name: int
    mark: int

    __slots__ = (
        "check",
        "digest",
        "long_name",
        "mark",
        "presence",
        "short_name",
        "streams",
    )

    def __init__(self, streams: list[Known], presence: Presence, said: bytes) -> None:
        self.streams = streams
        self.presence = presence
        self.digest = digest = blake2s(said, digest_size=_DIGEST_BYTES).digest()
        self.check, short, long, mark = _parts_of(digest)
        self.short_name = short % SHORT_NAMES
        self.long_name = long >> _LONG_NAME_SHIFT
        self.mark = mark >> _MARK_SHIFT
