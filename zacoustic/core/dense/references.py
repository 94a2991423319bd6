"""Which frames may be referred to: a source remembers what it sent, a receiver what it got.

A source may refer to a frame that every listener holds: one that it has acknowledged, or that one
that it has acknowledged refers to (nobody reads a frame without holding its reference). A listener
acknowledges the newest frame that it has read, by its `mark`, whenever there is room for a byte in
what goes anyway; nothing has to be answered at once, and a lost acknowledgement is made up for by
the next.

Both ends keep the same number of frames: the last `KEPT` that were sent are more than the last
`KEPT` that were received, so what the source may refer to is always still held.

Nothing is numbered, and frames may be lost, doubled and late. Names are short, and a name must not
mean two frames, or the wrong one would be read into plausible garbage. A receiver takes the newest
that it holds of that name, so the source sees to it that

- among all frames sent since a reference, and `LATEST` before it, which may come after it, no other
  has its name: else it gives the long name, and where these agree too, it takes an older reference;
- no frame has the name by which one of the `LATEST` before it refers to another: that one may come
  after it. Then the same is said in other words, with a long name or without a reference;
- the same bytes never mean two things, so that what comes twice is read as it was the first time.
"""

import itertools
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from zacoustic.core.dense.frame import Decoded, DenseCodec, DenseSample, Encoded
from zacoustic.core.dense.snapshot import Snapshot

KEPT: Final = 32
"""How many frames each end remembers."""

LATEST: Final = 4
"""A frame may arrive behind so many of its successors, and still no name is ambiguous."""


_FORMS: Final = 3
"""In how many ways, with a reference, a frame is tried to be clear."""


class _Sent:
    """A frame that was sent."""

    def __init__(self, encoded: Encoded) -> None:
        self.frame = encoded.frame
        self.snapshot = encoded.snapshot
        self.reference = encoded.reference
        self.has_long_name = encoded.long_name
        self.holders: set[int] = set()

    def may_mean(self, snapshot: Snapshot) -> bool:
        """Tell whether the name of the reference could be taken for that of another frame."""
        if self.reference is None or self.reference.digest == snapshot.digest:
            return False
        if self.has_long_name:
            return self.reference.long_name == snapshot.long_name
        return self.reference.short_name == snapshot.short_name


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

        Returns:
            None also where whatever form the frame has could be misunderstood.
        """
        forms = itertools.islice(self._references(set(listeners)), _FORMS)
        for reference, long_name in (*forms, (None, False)):
            encoded = self._codec.encode(samples, room, reference, long_name=long_name)
            if encoded is None or self._is_clear(encoded):
                return encoded
        return None

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

    def _is_clear(self, encoded: Encoded) -> bool:
        """Tell whether no receiver can take a frame, or take another for it."""
        meant = encoded.snapshot
        lately = list(self._sent)[-LATEST:]
        return not any(each.may_mean(meant) for each in lately) and all(
            each.frame != encoded.frame or each.snapshot.digest == meant.digest
            for each in self._sent
        )

    def _references(self, listeners: set[int]) -> Iterator[tuple[Snapshot, bool]]:
        """Yield frames that all hold and that can be named, and whether by the long name.

        The newest first, by its short name before its long one.
        """
        if not listeners:
            return
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
                yield meant, False
            if all(other.long_name != meant.long_name for other in others):
                yield meant, True


class Listener:
    """The receiving end of one source's dense frames.

    Args:
        codec: The source's.
    """

    def __init__(self, codec: DenseCodec) -> None:
        self._codec = codec
        self._held: deque[Snapshot] = deque(maxlen=KEPT)
        self._read: deque[tuple[bytes, Decoded]] = deque(maxlen=KEPT)

    @property
    def mark(self) -> int | None:
        """What to acknowledge: the mark of the newest frame; None: none was read."""
        return self._held[-1].mark if self._held else None

    def decode(self, frame: bytes) -> Decoded:
        """Read a frame off the water.

        Raises:
            PayloadError: It is damaged, or its reference is not held.
        """
        for known, decoded in self._read:
            if known == frame:
                return decoded
        decoded = self._codec.decode(frame, self._held)
        self._held.append(decoded.snapshot)
        self._read.append((frame, decoded))
        return decoded

    def forget(self) -> None:
        """Take note that the source has restarted."""
        self._held.clear()
        self._read.clear()
