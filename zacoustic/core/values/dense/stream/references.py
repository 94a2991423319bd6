"""Which frames may be referred to: the memory of what a source sent and a receiver got.

A source may refer to a frame that every listener holds: one that it has acknowledged, or that an
acknowledged one refers to (a frame can only be read with its reference). A listener acknowledges
the newest frame that it has read, by its `mark`, whenever a frame that goes anyway has room;
nothing needs an immediate answer, and the next acknowledgement makes up for a lost one.

Frames may be lost, duplicated and late, and have no numbers. For each name, a receiver holds the
last frame that came with it, unless that `is_outdated_by` the one that it holds. The source makes
sure that this is the intended one, as long as at most `REACH` of its frames come between a frame
and a late copy of it:

1. a name that was referred to is given to no other frame while the last `REACH` frames include one
   with that reference;
2. a frame is referred to only if no other one with its name was sent since, or among the `REACH`
   frames before it, except those that it outdates.

To have names for that, it gives a new frame a free one, if it has a choice. Names are given in
turn, and there are more than `REACH`, so as long as frames and samples advance in step, all are
free.

An acknowledgement may be late too: within `REMEMBERED` frames, no two have the same mark.

If more than `REACH` frames are sent within the time in which a late one may arrive, the further
ones stand `apart`: each independent and without a name. Such a frame cannot be taken for another
one, nor cause that, so it does not count.

A stream that stands still may have the same bytes again, against the same reference. That is the
same frame once more.
"""

from collections import OrderedDict
from collections.abc import Iterable, Sequence
from typing import Final

from zacoustic.core.values.dense.model.snapshot import Snapshot
from zacoustic.core.values.dense.stream.frame import Decoded, DenseCodec, DenseSample, Encoded

REACH: Final = 31
"""How many of its successors a frame may arrive after, without any name becoming ambiguous."""

KEPT: Final = 2 * REACH
"""How many frames the source may tell apart. So it refers back by at most `REACH` of them, and
knows all that may outdate a reference."""

ANSWERS: Final = 4 * REACH
"""For how many frames after an acknowledgement another one is expected, and names matter."""

# How much more a frame with a reference may cost than one without: it keeps learning, which pays as
# long as acknowledgements come.
_INVESTED_BYTES: Final = 1
_FRESH: Final = 16

REMEMBERED: Final = 256
"""For how many frames the source does not reuse their marks."""


class _Sent:
    """A frame that was sent, once or several times.

    Attributes:
        first: When it was first sent, counted in frames.
        last: When it was last sent.
        holders: Addresses of the listeners that are known to hold it.
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
        self._sent: OrderedDict[bytes, _Sent] = OrderedDict()  # by digest; newest last
        self._named: dict[int, list[_Sent]] = {}  # the frames with each name
        self._forgotten = -REACH  # when a frame that is forgotten was sent last
        self._referred: dict[int, tuple[int, bytes]] = {}  # by name: when last, and to what
        self._answered = -ANSWERS  # the last acknowledgement
        self._said = -REACH  # when a name was last referred to
        self._marks: dict[int, bytes] = {}  # digests by mark, of more frames than are kept

    def encode(
        self,
        samples: Sequence[DenseSample],
        room: int,
        listeners: Iterable[int] = (),
        *,
        apart: bool = False,
    ) -> Encoded | None:
        """Write a frame; see `DenseCodec.encode`.

        Args:
            samples: The most important first.
            room: Greatest size of the frame, bytes.
            listeners: Addresses of all nodes that must be able to read it; none: it is independent.
            apart: It is independent and has no name.
        """
        if apart:
            return self._codec.encode(samples, room, refuses=lambda _: True)
        reference = self._reference(set(listeners))
        # Without acknowledgements no name is ever referred to: all are equally good.
        matters_until = max(self._answered + ANSWERS, self._said + REACH)
        is_choosy = reference is not None or matters_until > self._count
        refuses = self._refuses if is_choosy else None
        spared = _INVESTED_BYTES if self._answered + _FRESH > self._count else 0
        return self._codec.encode(samples, room, reference, refuses=refuses, invested=spared)

    def sent(self, encoded: Encoded) -> None:
        """Record that a frame was handed to the link; until then it was a draft."""
        if encoded.is_apart:
            return
        self._count += 1
        snapshot, reference = encoded.snapshot, encoded.reference
        digest = snapshot.digest
        if reference is not None and reference.name is not None:
            self._referred[reference.name] = self._count, reference.digest
            self._said = self._count
        sent = self._sent.get(digest)
        if sent is not None:
            sent.last = self._count
            self._sent.move_to_end(digest)
            return
        sent = self._sent[digest] = _Sent(encoded, self._count)
        if snapshot.name is not None:
            self._named.setdefault(snapshot.name, []).append(sent)
        if len(self._sent) > KEPT:
            _, oldest = self._sent.popitem(last=False)
            self._forgotten = oldest.last
            if oldest.snapshot.name is not None:
                self._named[oldest.snapshot.name].remove(oldest)
        is_clear = self._marks.setdefault(snapshot.mark, digest) == digest
        if not is_clear:  # the mark is ambiguous
            self._marks[snapshot.mark] = b""
        if len(self._marks) > REMEMBERED:
            del self._marks[next(iter(self._marks))]

    def acknowledged(self, listener: int, mark: int) -> bool:
        """Record that a listener holds a frame.

        Args:
            listener: Its address.
            mark: `Snapshot.mark` of the frame.

        Returns:
            Whether the mark identifies a frame.
        """
        sent = self._sent.get(self._marks.get(mark, b""))
        if sent is None or sent.snapshot.name is None:
            return False
        self._answered = self._count
        while sent is not None and listener not in sent.holders:
            sent.holders.add(listener)
            sent = self._sent.get(sent.reference.digest) if sent.reference is not None else None
        return True

    def forget(self, listener: int) -> None:
        """Record that a listener has restarted and holds nothing any more."""
        for each in self._sent.values():
            each.holders.discard(listener)

    def _refuses(self, new: Encoded) -> bool:
        """Return whether a frame would be taken for another one, or cause another one to be."""
        snapshot = new.snapshot
        name, digest = snapshot.name, snapshot.digest
        assert name is not None
        if self._marks.get(snapshot.mark, digest) != digest:
            return True
        if new.reference is not None and new.reference.name == name:
            return True
        last, meant = self._referred.get(name, (0, digest))
        if meant != digest and last + REACH > self._count:
            return True
        same = self._sent.get(digest)
        for other in self._named.get(name, ()):
            if same is not None and other is not same and other.last > same.first:
                return True  # a listener that missed it would hold it, the others the other
            if same is None and (
                snapshot.is_outdated_by(other.snapshot)
                or (
                    other.last + REACH > self._count and not other.snapshot.is_outdated_by(snapshot)
                )
            ):
                return True
        return False

    def _reference(self, listeners: set[int]) -> Snapshot | None:
        """Return the newest frame that all hold and that can be named; None: there is none."""
        if listeners:
            for each in reversed(self._sent.values()):
                if each.last + REACH < self._count:
                    break
                if (
                    listeners <= each.holders
                    and each.first - REACH > self._forgotten
                    and self._is_clear(each)
                ):
                    return each.snapshot
        return None

    def _is_clear(self, meant: _Sent) -> bool:
        """Return whether every receiver of a frame holds it as the one with its name."""
        snapshot = meant.snapshot
        assert snapshot.name is not None
        for other in self._named[snapshot.name]:
            if other is meant:
                continue
            if other.last >= meant.first - REACH:
                if not other.snapshot.is_outdated_by(snapshot):
                    return False
            elif snapshot.is_outdated_by(other.snapshot):
                return False
        return True


class Listener:
    """The receiving end of one source's dense frames.

    Args:
        codec: The source's.
    """

    def __init__(self, codec: DenseCodec) -> None:
        self._codec = codec
        self._held: dict[int, Snapshot] = {}  # by name
        self.mark: int | None = None
        """The mark to acknowledge, that of the newest frame; None: none was read."""

    def decode(self, frame: bytes, *, alone: bool = False) -> Decoded:
        """Read a received frame.

        Args:
            frame: The whole frame, from the marker on.
            alone: Whether frames with a reference are for other listeners.

        Raises:
            PayloadError: It is damaged, or its reference is not held.
        """
        decoded = self._codec.decode(frame, {} if alone else self._held)
        snapshot = decoded.snapshot
        if snapshot.name is not None:
            held = self._held.get(snapshot.name)
            if held is None or not snapshot.is_outdated_by(held):
                self._held[snapshot.name] = snapshot
                self.mark = snapshot.mark
        return decoded

    def forget(self) -> None:
        """Forget all frames: the source has restarted."""
        self._held.clear()
        self.mark = None
