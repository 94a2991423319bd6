"""Which frames may be referred to: a source remembers what it sent, a receiver what it got.

A source may refer to a frame that every listener holds: one that it has acknowledged, or that one
that it has acknowledged refers to (nobody reads a frame without holding its reference). A listener
acknowledges the newest frame that it has read, by its `mark`, whenever there is room for a byte in
what goes anyway; nothing has to be answered at once, and a lost acknowledgement is made up for by
the next.

Both ends keep the same number of frames: the last `KEPT` that were sent are more than the last
`KEPT` that were received, so what the source may refer to is always still held. Nothing is numbered
and no order is relied upon, so frames may be lost, doubled and late. A receiver takes the newest
frame of a name; so a name must not mean a newer frame too. Before it refers to a frame the source
compares its name with those of all that were sent since, and of a few before it, which may be late;
where two agree it gives the long name, and where these agree too it takes an older reference. And
a new frame must not have the name by which a frame that may still be on its way, or it itself
when it comes again, means another one: then it is written in another form.

A stream that stands still may have the same bytes again, against the same reference. That is the
same frame once more; the receiver has it at the place where it came last, which may be any of those
at which it was sent.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from operator import attrgetter
from typing import Final

from zacoustic.core.dense.frame import Decoded, DenseCodec, DenseSample, Encoded
from zacoustic.core.dense.snapshot import SHORT_NAMES, Snapshot

KEPT: Final = 32
"""How many frames each end remembers."""

LATEST: Final = 2
"""A frame may arrive behind so many of its successors, and still no name is ambiguous."""

_OVERLAP: Final = 3  # frames before the newest acknowledged one that can still be acknowledged
_MARKED: Final = 8  # as many of the last frames have marks of their own
_LONG_NAMES: Final = SHORT_NAMES  # long names are counted from here on
_last = attrgetter("last")


class _Sent:
    """A frame that was sent, once or several times.

    Attributes:
        first: When it was sent first, counted in frames.
        last: When it was sent last.
        holders: Who is known to hold it.
    """

    __slots__ = ("first", "holders", "last", "reference", "snapshot")

    def __init__(self, encoded: Encoded, count: int) -> None:
        self.snapshot = encoded.snapshot
        self.reference = encoded.reference
        self.first = self.last = count
        self.holders: set[int] = set()


class Speaker:
    """The sending end of one source's dense frames.

    Args:
        codec: The source's.
    """

    def __init__(self, codec: DenseCodec) -> None:
        self._codec = codec
        self._count = 0
        self._sent: list[_Sent] = []  # by when they were sent last
        self._by_digest: dict[bytes, _Sent] = {}
        self._forgotten = -LATEST  # when a frame was sent last that is no longer among them
        self._marks: list[int] = []  # of `_sent`
        self._late: deque[int] = deque(maxlen=LATEST)  # what the last frames call their references

    def encode(
        self, samples: Sequence[DenseSample], room: int, listeners: Iterable[int] = ()
    ) -> Encoded | None:
        """Write a frame; see `DenseCodec.encode`.

        Args:
            samples: The most important first.
            room: Greatest size of the frame, bytes.
            listeners: Addresses of all who must be able to read it; none: it stands for itself.
        """
        wanted = set(listeners)
        if not wanted:
            return self._codec.encode(samples, room)
        first: Encoded | None = None
        for reference, long_name in self._references(wanted):
            encoded = self._codec.encode(
                samples, room, reference, long_name=long_name, is_mistaken=self._is_mistaken
            )
            if encoded is None or not encoded.is_mistaken:
                return encoded
            first = first or encoded
        return first

    def sent(self, encoded: Encoded) -> None:
        """Take note that a frame was handed to the link; until then it was a draft."""
        self._count += 1
        self._late.append(_said(encoded))
        snapshot = encoded.snapshot
        sent = self._by_digest.get(snapshot.digest)
        if sent is None:
            sent = self._by_digest[snapshot.digest] = _Sent(encoded, self._count)
        else:
            sent.last = self._count
            place = self._sent.index(sent)
            del self._sent[place], self._marks[place]
        self._sent.append(sent)
        self._marks.append(snapshot.mark)
        if len(self._sent) > KEPT:
            oldest = self._sent.pop(0)
            del self._marks[0], self._by_digest[oldest.snapshot.digest]
            self._forgotten = oldest.last

    def acknowledged(self, listener: int, mark: int) -> bool:
        """Take note that a listener holds a frame.

        Args:
            listener: Its address.
            mark: `Snapshot.mark` of the frame.

        Returns:
            Whether it is known which frame that is.
        """
        # What is much older than the newest that is known to be held is of no use; a little older
        # is what a late frame leads to.
        recent = _OVERLAP
        for each in reversed(self._sent):
            recent += 1
            if listener in each.holders:
                break
        marks = self._marks[-recent:]
        if marks.count(mark) != 1:
            return False
        place = marks.index(mark) - len(marks)
        held: Snapshot | None = self._sent[place].snapshot
        for each in self._sent[place::-1]:
            if each.snapshot is held:
                if listener in each.holders:
                    break
                each.holders.add(listener)
                held = each.reference
        return True

    def forget(self, listener: int) -> None:
        """Take note that a listener holds nothing any more: it has restarted."""
        for each in self._sent:
            each.holders.discard(listener)

    def _is_mistaken(self, new: Encoded) -> bool:
        """Whether a frame, or its acknowledgement, would be taken for another one.

        For what a late frame refers to, or what it refers to itself, when it comes again.
        """
        snapshot = new.snapshot
        if snapshot.mark in self._marks[-_MARKED:]:
            for each in self._sent[-_MARKED:]:
                is_same = each.snapshot.digest == snapshot.digest
                if each.snapshot.mark == snapshot.mark and not is_same:
                    return True
        said = (*self._late, _said(new))
        return snapshot.short_name in said or _LONG_NAMES + snapshot.long_name in said

    def _references(self, listeners: set[int]) -> Iterator[tuple[Snapshot | None, bool]]:
        """The newest frame that all hold and that can be named, and whether by its long name.

        More than one way only for who must not take the first; the last is to refer to none.
        """
        for each in reversed(self._sent):
            # Only what came after a frame can push it out at a receiver, or be taken for it.
            earliest = each.first - LATEST
            if earliest <= self._forgotten or not listeners <= each.holders:
                continue
            meant = each.snapshot
            since = self._sent[bisect_left(self._sent, earliest, key=_last) :]
            is_short = [one.snapshot.short_name for one in since].count(meant.short_name) == 1
            if is_short:
                yield meant, False
            is_long = [one.snapshot.long_name for one in since].count(meant.long_name) == 1
            if is_long:
                yield meant, True
            if is_short or is_long:
                break
        yield None, False


class Listener:
    """The receiving end of one source's dense frames.

    Args:
        codec: The source's.
    """

    def __init__(self, codec: DenseCodec) -> None:
        self._codec = codec
        self._held: dict[bytes, Snapshot] = {}  # by digest; the newest last
        self.mark: int | None = None
        """What to acknowledge: the mark of the newest frame; None: none was read."""

    def decode(self, frame: bytes) -> Decoded:
        """Read a frame off the water.

        Raises:
            PayloadError: It is damaged, or its reference is not held.
        """
        held = self._held
        decoded = self._codec.decode(frame, held.values())
        snapshot = decoded.snapshot
        held.pop(snapshot.digest, None)
        held[snapshot.digest] = snapshot
        if len(held) > KEPT:
            del held[next(iter(held))]
        self.mark = snapshot.mark
        return decoded

    def forget(self) -> None:
        """Take note that the source has restarted."""
        self._held.clear()
        self.mark = None


def _said(encoded: Encoded) -> int:
    """What a frame calls its reference: a short name, or a long one behind all short ones."""
    reference = encoded.reference
    if reference is None:
        return -1
    return _LONG_NAMES + reference.long_name if encoded.long_name else reference.short_name
