"""The sources of a frame beside the queue, as the composer sees them.

Objects and dense blocks are mechanisms between two ends, above the schedule; this is what the
schedule needs of them.
"""

from collections.abc import Sequence
from typing import Protocol

import msgspec

from zacoustic.core.base.parts import Offer, Part
from zacoustic.core.schedule.queue import Waiting
from zacoustic.core.schedule.savings import Savings
from zacoustic.core.values.dense import Encoded
from zacoustic.core.wire.controls import Extension


class Source(Protocol):
    """A reason for frames; the composer takes the best offer."""

    def due_at(self, now: int) -> int | None:
        """Return the earliest instant of a frame for it, ns; None: it has nothing."""

    def offer(self, now: int) -> Offer | None:
        """Return what it would put into a frame now; None: nothing is due."""


class Said(msgspec.Struct, frozen=True, kw_only=True):
    """A control of an external transport."""

    extension: Extension
    """The control."""
    part: Part = Part()
    """Who is told what becomes of it."""


class ExtensionSource(Source, Protocol):
    """A transport of somebody else."""

    def say(self, destination: int, room_bytes: int, now: int) -> Said | None:
        """Return what it says in a frame to `destination`, with so much room for the body."""


class Taken(msgspec.Struct, frozen=True, kw_only=True):
    """A record for a frame."""

    stream_id: int
    """Stream to which its airtime belongs, 0 when it is not known."""
    record: bytes
    """The bytes."""
    header_bytes: int
    """How many of them are not payload."""
    is_first: bool = False
    """With it an object begins."""
    is_repair: bool = False
    """It is a repair fragment."""
    ends_run: bool = False
    """It says that a listen window follows."""
    part: Part
    """Who is told what becomes of it."""


class ObjectSource(Source, Protocol):
    """Payloads that are larger than a frame, and what is to be said of those that arrive."""

    @property
    def is_exclusive(self) -> bool:
        """The object that is under way needs the channel for itself."""

    def hold_until(self, now: int) -> int:
        """Return until when nothing else should start, ns: an answer is awaited."""

    def has_fragment(self, now: int) -> bool:
        """Whether a fragment is due."""

    def take_feedback(self, destination: int, room_bytes: int, now: int) -> Taken | None:
        """Take an answer that is due and goes to this destination, if it fits."""

    def take_fragment(self, room_bytes: int, now: int, frames_before_pause: int) -> Taken | None:
        """Take the fragment that `offer` told of, if it fits."""

    def hold(self, stream_id: int, until: int) -> None:
        """Send no fragment of a stream before an instant."""


class DenseSource(Protocol):
    """Writes samples of dense streams into one block, and says which blocks have arrived."""

    @property
    def savings(self) -> Savings:
        """What the blocks of this node have saved."""

    def admits(self, item: Waiting, destination: int) -> bool:
        """Tell whether a payload that waits can be part of a dense block to `destination`."""

    def encode(
        self, items: Sequence[Waiting], destination: int, room_bytes: int, now: int
    ) -> Encoded | None:
        """Write a block of all these payloads; None where they do not fit."""

    def sent(self, encoded: Encoded, now: int) -> None:
        """Note that a block is sent; until then it is a draft."""

    def acks(self, destination: int, room_bytes: int) -> bytes:
        """Return the acknowledgements that a frame to `destination` has room for."""
