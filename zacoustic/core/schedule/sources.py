"""The sources of frames beside the queue, as the composer sees them.

Objects and dense blocks are mechanisms between two ends, above the schedule; these protocols are
what the schedule needs of them.
"""

from collections.abc import Sequence
from typing import Protocol

import msgspec

from zacoustic.core.base.parts import Offer, Part
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.schedule.savings import Savings
from zacoustic.core.values.dense import Encoded
from zacoustic.core.wire.controls import Extension


class Source(Protocol):
    """A reason for frames; the composer takes the best offer."""

    def due_at(self, now: int) -> int | None:
        """Return the earliest instant at which it needs a frame, ns; None: it has nothing."""

    def offer(self, now: int) -> Offer | None:
        """Return what it would put into a frame now; None: nothing is due."""


class Said(msgspec.Struct, frozen=True, kw_only=True):
    """A control of a third-party transport."""

    extension: Extension
    """The control."""
    part: Part = Part()
    """Follows its transmission."""


class ExtensionSource(Source, Protocol):
    """A third-party transport."""

    def say(self, destination: int, room_bytes: int, now: int) -> Said | None:
        """Return what to add to a frame to `destination`, with a body of at most `room_bytes`."""


class Forwarded(msgspec.Struct, frozen=True, kw_only=True):
    """The content of a frame for relays, without envelope."""

    content: bytes
    """It goes as it is, and needs the frame for itself."""
    part: Part = Part()
    """Follows its transmission."""
    is_urgent: bool = False
    """Whether this node has made it, and it goes before all others."""
    is_pressing: bool = False
    """Whether its hop needs a long head: it is urgent, whoever has made it, or was sent before."""


class ForwardingSource(Source, Protocol):
    """The routes over relays of which this node is a part, or the bonds of its links."""

    @property
    def goes_on(self) -> bool:
        """Whether the last frame has announced that another one follows at once."""

    @property
    def is_urgent(self) -> bool:
        """Whether a frame waits that medium access is to treat as urgent."""

    @property
    def has_granted(self) -> bool:
        """Whether a frame waits that may go although the node is silent."""

    def take_granted(self, room_bytes: int, now: int) -> tuple[int, Forwarded] | None:
        """Take the frame that may go in silence, and its destination; None: it does not fit."""

    def take(self, room_bytes: int, now: int) -> Forwarded | None:
        """Take the frame of `offer`, if it fits."""


class Taken(msgspec.Struct, frozen=True, kw_only=True):
    """A record for a frame."""

    stream_id: int
    """The stream to which its airtime belongs; 0: unknown."""
    record: bytes
    """The encoded record."""
    header_bytes: int
    """How many of its bytes are not payload."""
    is_first: bool = False
    """Whether it is the first of its object."""
    is_repair: bool = False
    """Whether it is a repair fragment."""
    ends_run: bool = False
    """Whether it announces a listen window."""
    part: Part
    """Follows its transmission."""


class ObjectSource(Source, Protocol):
    """Payloads that are larger than a frame, and feedback about incoming ones."""

    @property
    def is_exclusive(self) -> bool:
        """Whether the object under way needs the channel to itself."""

    def hold_until(self, now: int) -> int:
        """Return the instant until which nothing else should start, ns: an answer is awaited."""

    def has_fragment(self, now: int) -> bool:
        """Return whether a fragment is due."""

    def take_feedback(self, destination: int, room_bytes: int, now: int) -> Taken | None:
        """Take a due answer for this destination, if it fits."""

    def take_fragment(self, room_bytes: int, now: int, frames_before_pause: int) -> Taken | None:
        """Take the fragment of `offer`, if it fits."""

    def owes_answer(self, now: int) -> bool:
        """Return whether feedback is due or still in transmission."""

    def bulk_due_at(self, now: int) -> int | None:
        """Return the instant at which a fragment is due on the bulk service, ns, or None."""

    def bulk_destination(self, now: int) -> int | None:
        """Return the receiver of the fragment that is due on the bulk service, or None."""

    def take_bulk(self, room_bytes: int, now: int) -> Taken | None:
        """Take the fragment of `bulk_destination`, if it fits."""

    def hold(self, stream_id: int, until: int) -> None:
        """Hold the fragments of a stream until an instant, ns."""


class DenseSource(Source, Protocol):
    """Writes samples of dense streams into one block, and acknowledges received blocks."""

    @property
    def savings(self) -> Savings:
        """What this node's blocks have saved."""

    @property
    def fills_link(self) -> bool:
        """Whether its blocks fill the link, so that their listener should know the pauses."""

    def admits(self, item: QueuedRecord, destination: int) -> bool:
        """Return whether a waiting payload can be part of a dense block to `destination`."""

    def encode(
        self, items: Sequence[QueuedRecord], destination: int, room_bytes: int, now: int
    ) -> Encoded | None:
        """Encode a block of all these payloads; return None if they do not fit."""

    def sent(self, encoded: Encoded, now: int) -> None:
        """Record that a block is sent; until then it is a draft."""

    def acks(self, destination: int, room_bytes: int) -> bytes:
        """Take the acknowledgements that fit into a frame to `destination`."""
