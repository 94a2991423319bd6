"""Which frames may be referred to: a source remembers what it sent, a receiver what it got.

A source may refer to a frame that every listener holds: one that it has acknowledged, or that one
that it has acknowledged refers to (nobody reads a frame without holding its reference). A listener
acknowledges the newest frame that it has read, by its `mark`, whenever there is room for a byte in
what goes anyway; nothing has to be answered at once, and a lost acknowledgement is made up for by
the next.

Both ends keep the same number of frames: the last `KEPT` that were sent are more than the last
`KEPT` that were received, so what the source may refer to is always still held. Nothing is numbered
and no order is relied upon, so frames may be lost, doubled and late. A short name must not mean two
frames: the source compares it with those of all frames sent since, and of a few before, since a
late one may come after its successors; where two agree, it gives the long name, and where these
agree too, it takes an older reference.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Final

from zacoustic.core.dense.frame import Decoded, DenseCodec, DenseSample, Encoded
from zacoustic.core.dense.snapshot import Snapshot

KEPT: Final = 32
"""How many frames each end remembers."""

LATEST: Final = 2
"""A frame may arrive behind so many of its successors, and still no name is ambiguous."""


class _Sent:
    """A frame that was sent."""

    def __init__(self, encoded: Encoded) -> None:
        self.snapshot = encoded.snapshot
        self.reference = encoded.reference
        self.holders: set[int] = set()


class Speaker:
    """The sending end of one source's dense frames.

    Args:
        codec: The source's.
    """

    def __init__(self, codec: DenseCodec) -> None:
        self._codec = codec
        self._sent: deque[_Sent] = deque(maxlen=KEPT)

    def encode(
        self, samples: Sequence[DenseSample], room: int, listeners: Iterable[int] = ()
    ) -> Encoded | None:
        """Write a frame; see `DenseCodec.encode`.

        Args:
            samples: The most important first.
            room: Greatest size of the frame, bytes.
            listeners: Addresses of all who must be able to read it; none: it stands for itself.
        """
        reference, long_name = self._reference(set(listeners))
        return self._codec.encode(samples, room, reference, long_name=long_name)

    def sent(self, encoded: Encoded) -> None:
        """Take note that a frame was handed to the link; until then it was a draft."""
        # The same bytes again (a stream that stands still) are the same frame to the receiver too.
        if all(each.snapshot.digest != encoded.snapshot.digest for each in self._sent):
            self._sent.append(_Sent(encoded))

    def acknowledged(self, listener: int, mark: int) -> bool:
        """Take note that a listener holds a frame.

        Args:
            listener: Its address.
            mark: `Snapshot.mark` of the frame.

        Returns:
            Whether it is known which frame that is.
        """
        newest = max(
            (n for n, each in enumerate(self._sent) if listener in each.holders), default=0
        )
        meant = [
            each for n, each in enumerate(self._sent) if n >= newest and each.snapshot.mark == mark
        ]
        if len(meant) != 1:
            return False
        known = {each.snapshot.digest: each for each in self._sent}
        found: _Sent | None = meant[0]
        while found is not None and listener not in found.holders:
            found.holders.add(listener)
            before = found.reference
            found = None if before is None else known.get(before.digest)
        return True

    def forget(self, listener: int) -> None:
        """Take note that a listener holds nothing any more: it has restarted."""
        for each in self._sent:
            each.holders.discard(listener)

    def _reference(self, listeners: set[int]) -> tuple[Snapshot | None, bool]:
        """The newest frame that all hold and that can be named, and whether by its long name."""
        if not listeners:
            return None, False
        # The oldest may be pushed out at a receiver by the frame that is being written.
        for place in range(len(self._sent) - 1, 0 if len(self._sent) == KEPT else -1, -1):
            if not listeners <= self._sent[place].holders:
                continue
            meant = self._sent[place].snapshot
            others = [
                self._sent[other].snapshot
                for other in range(max(place - LATEST, 0), len(self._sent))
                if other != place
            ]
            if all(other.short_name != meant.short_name for other in others):
                return meant, False
            if all(other.long_name != meant.long_name for other in others):
                return meant, True
        return None, False


class Listener:
    """The receiving end of one source's dense frames.

    Args:
        codec: The source's.
    """

    def __init__(self, codec: DenseCodec) -> None:
        self._codec = codec
        self._held: deque[Snapshot] = deque(maxlen=KEPT)

    @property
    def mark(self) -> int | None:
        """What to acknowledge: the mark of the newest frame; None: none was read."""
        return self._held[-1].mark if self._held else None

    def decode(self, frame: bytes) -> Decoded:
        """Read a frame off the water.

        Raises:
            PayloadError: It is damaged, or its reference is not held.
        """
        decoded = self._codec.decode(frame, self._held)
        if all(each.digest != decoded.snapshot.digest for each in self._held):
            self._held.append(decoded.snapshot)
        return decoded

    def forget(self) -> None:
        """Take note that the source has restarted."""
        self._held.clear()
