"""Admission of an arriving object by the table and by the count of its key."""

from typing import Protocol

import msgspec

from zacoustic.core.base.linktypes import ReceivedFrame
from zacoustic.core.base.moments import Made
from zacoustic.core.transport.objects.manifest import Manifest
from zacoustic.core.transport.reliable.receiving.receiving import Claim
from zacoustic.core.values.age import NO_AGE, Age
from zacoustic.core.wire.objects import Reason


class ObjectReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A complete object for its topic."""

    source: int
    manifest: Manifest
    payload: bytes
    received: ReceivedFrame
    age: Age = NO_AGE
    """Its age as its first fragment had arrived."""
    aged_at: Made = None
    """When that was."""
    again: bool = False
    """Whether an earlier boot epoch may have delivered it."""


class Admission(msgspec.Struct, frozen=True):
    """What the table says about an object from another node."""

    reason: Reason | None = None
    """The reason why it is refused; None: it is admitted."""
    is_wanted: bool = True
    """Whether this node has subscribed; otherwise it keeps nothing of the object and sends no
    feedback."""
    is_open: bool = True
    """Whether it may be delivered now; otherwise the tables are not yet known to agree."""
    rank: int = 0
    """Rank of this node among the stream's receivers: how many answer before it."""
    others: int = 0
    """Number of the other receivers."""
    keeps: bool = True
    """Whether it is delivered once across restarts, and so only after the journal has the
    delivery."""
    largest_bytes: int | None = None
    """Largest payload of the stream; None: the node's limit."""
    stream_digest: bytes = b""
    """Digest of the stream; empty: unknown."""


class AdmissionControl(Protocol):
    """Knows the table and the counts, and takes complete objects."""

    def admit(self, source: int, stream_id: int) -> Admission:
        """Return what the table says about an object; stream 0: not yet known."""

    def claim(self, source: int, manifest: Manifest, *, is_turn: bool) -> Claim:
        """Return whether a complete object may be delivered now.

        Args:
            source: Its source.
            manifest: Its manifest.
            is_turn: The source has sent the turn: nothing before the object will come.
        """

    def unwanted(self, source: int, stream_id: int, *, is_alone: bool) -> None:
        """Note that an unwanted object is under way, perhaps for this node alone."""

    def is_over(self, source: int, manifest: Manifest) -> bool:
        """Return whether an object is known to be delivered or given up, before it is complete."""

    def expect(self, source: int, manifest: Manifest) -> None:
        """Note that an object may be under way; called for each of its fragments."""

    def deliver(self, arrived: ObjectReceived) -> None:
        """Take a complete object whose turn it is; called once for each."""
