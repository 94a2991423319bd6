"""What both ends know of a source after one of its frames.

A frame that may be referred to has a number, mod 16. Whoever holds it holds its snapshot: of each
stream the last sample that this frame, its reference or theirs had. So one reference serves all
streams of a frame, whether it had samples of them or not.

A snapshot's digest covers the bytes of its frame and the digest of its reference's snapshot, hence
all that was ever said along the chain. A few bits of it go into the check of each frame that refers
to it: who holds another frame of that number does not decode plausible garbage, but refuses.
"""

import hashlib
from typing import Final

from zacoustic.core.dense.adaptation import StreamState
from zacoustic.core.dense.habits import Habit

NUMBERS: Final = 16
"""Frame numbers are mod this; a reference is fewer frames back."""

_DIGEST_BYTES: Final = 8


class Snapshot:
    """A frame, as something to refer to; never changed.

    Attributes:
        streams: Last sample of each stream, by stream id.
        habits: What the source's frames usually hold, by stream id.
        counts: How many samples of each stream the frame had, by stream id; 0 is left out.
        ticks: When the last sample of each stream was taken, in steps of the stream, by stream id.
            The sender's affair: a receiver counts on from where it began.
        digest: Of all frames up to this one.
    """

    __slots__ = ("counts", "digest", "habits", "streams", "ticks")

    def __init__(
        self,
        streams: dict[int, StreamState],
        habits: dict[int, Habit],
        counts: dict[int, int],
        ticks: dict[int, int],
        digest: bytes,
    ) -> None:
        self.streams = streams
        self.habits = habits
        self.counts = counts
        self.ticks = ticks
        self.digest = digest

    @property
    def check(self) -> int:
        """What frames that refer to this one are checked against."""
        return int.from_bytes(self.digest[:4], "big")


def chained_digest(digest: bytes, frame: bytes) -> bytes:
    """The digest of a frame whose reference has `digest`."""
    return hashlib.blake2s(digest + frame, digest_size=_DIGEST_BYTES).digest()
