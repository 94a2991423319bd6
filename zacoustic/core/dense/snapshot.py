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

import hashlib
import struct
from typing import Final

from zacoustic.core.dense.adaptation import StreamState
from zacoustic.core.dense.habits import Habits

SHORT_NAMES: Final = 31
"""How many short names there are; what is left of five bits announces a long one."""

LONG_NAME_BITS: Final = 7
"""Bits of a long name."""

MARK_BITS: Final = 14
"""Bits of a mark."""

_PARTS: Final = struct.Struct(">IHHH2x")  # of a digest: check, names and mark


class Snapshot:
    """A frame, as something to refer to; never changed.

    Attributes:
        streams: Last sample of each stream, by stream id.
        habits: What the source's frames usually hold.
        ticks: When the last sample of each stream was taken, in steps of the stream, by stream id.
            The sender's affair: a receiver counts on from where it began.
        digest: Of all frames up to this one.
        check: What frames that refer to this one are checked against.
        short_name: Says which frame is meant, 0…30.
        long_name: Says it with more certainty, 0…127.
        mark: Says in an acknowledgement which frame is meant, 0…16383.
    """

    __slots__ = (
        "check",
        "digest",
        "habits",
        "long_name",
        "mark",
        "short_name",
        "streams",
        "ticks",
    )

    def __init__(
        self,
        streams: dict[int, StreamState],
        habits: Habits,
        ticks: dict[int, int],
        digest: bytes,
    ) -> None:
        self.streams = streams
        self.habits = habits
        self.ticks = ticks
        self.digest = digest
        self.check, short, long, mark = _PARTS.unpack(digest)
        self.short_name = short % SHORT_NAMES
        self.long_name = long >> 16 - LONG_NAME_BITS
        self.mark = mark >> 16 - MARK_BITS


def chained_digest(digest: bytes, frame: bytes) -> bytes:
    """The digest of a frame whose reference has `digest`."""
    return hashlib.blake2s(digest + frame, digest_size=_PARTS.size).digest()
