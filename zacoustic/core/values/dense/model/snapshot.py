"""What both ends know of a source after one of its frames.

A node with a frame has its snapshot: for each stream, the last sample in this frame, in its
reference, or in an earlier one of the chain. So one reference serves all streams of a frame,
whether it had samples of them or not.

A snapshot's digest covers the bytes of its frame and the digest of its reference's snapshot, so it
covers the whole chain. A frame that refers to another states that frame's *name*, one of `NAMES`.
Frames have no numbers, and need none: a frame's name follows from its reference or from its digest,
and the source chooses which (`Form`), so that a name never means another frame while a frame that
states it may be under way (`references`).
"""

import struct
from hashlib import blake2s
from typing import Final

from zacoustic.core.values.dense.model.adaptation import StreamState
from zacoustic.core.values.dense.model.habits import Habit, Presence

SHORT_NAMES: Final = 20
"""How many names take five bits: the first ones. The others take six."""

TURNS: Final = 38
"""How many names are given in turn: the first ones."""

NAMES: Final = 44
"""The number of names."""

FORMS: Final = 6
"""The number of forms of a frame. In the first form a frame has the name whose turn it is, in the
last it has none; in the others it has a name after the turns, by its digest, which differs between
forms."""

MARK_BITS: Final = 14
"""Bits of a mark."""

_DIGEST_BYTES: Final = 12
_GENERATIONS: Final = 16
_MARK_SHIFT: Final = 16 - MARK_BITS
_parts_of = struct.Struct(">IH2xH2x").unpack  # of a digest: check, name and mark


Known = tuple[StreamState | None, int | None, Habit]
"""What is known of a stream:

- its last sample; None: there was none;
- when that was taken, in steps of the stream; None: there was none. Only the sender needs it: a
  receiver counts on from where it began;
- what the source's frames usually hold of it.
"""


class Snapshot:
    """A frame as a possible reference; never changed.

    Args:
        streams: See below.
        presence: See below.
        said: The frame; for the root, what both ends agree on.
        reference: The frame's reference, or the root; None: this is the root.
        form: How the frame gets its name, see `FORMS`.
        distance: By how many frames it seems to follow its reference.

    Attributes:
        streams: What is known of each stream, in the order of their ids.
        presence: Which streams the source's frames usually hold.
        digest: Digest of all frames up to this one.
        ancestors: Digests of the reference, its reference …, as many as are remembered.
        check: What frames that refer to this one are checked against.
        turn: Its name, if names are given in turn; None: this is the root.
        name: The frame's name in references, 0…`NAMES` - 1; None: it has none.
        mark: The frame's mark in acknowledgements, 0…16383.
    """

    check: int

    __slots__ = ("ancestors", "check", "digest", "mark", "name", "presence", "streams", "turn")

    def __init__(
        self,
        streams: list[Known],
        presence: Presence,
        said: bytes,
        reference: "Snapshot | None" = None,
        form: int = FORMS - 1,
        distance: int = 1,
    ) -> None:
        self.streams = streams
        self.presence = presence
        self.ancestors: tuple[bytes, ...] = ()
        self.turn: int | None = None
        self.name: int | None = None
        if reference is not None:
            said = reference.digest + said
        self.digest: bytes = blake2s(said, digest_size=_DIGEST_BYTES).digest()
        self.check, place, mark = _parts_of(self.digest)
        self.mark: int = mark >> _MARK_SHIFT
        if reference is None:
            return
        if reference.turn is None:
            self.turn = place % TURNS
        else:
            self.turn = (reference.turn + distance) % TURNS
            self.ancestors = (reference.digest, *reference.ancestors[: _GENERATIONS - 1])
        if form == 0:
            self.name = self.turn
        elif form < FORMS - 1:
            self.name = TURNS + place % (NAMES - TURNS)

    def is_outdated_by(self, other: "Snapshot") -> bool:
        """Return whether this frame refers to one that the other's reference descends from.

        Both ends know that alike, in whatever order the frames come. So if both frames have the
        same name, it belongs to the other.
        """
        return bool(self.ancestors) and self.ancestors[0] in other.ancestors[1:]
