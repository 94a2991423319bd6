"""Admission of an arriving object, by the table and the count of its key."""

from typing import Protocol

import msgspec

from zacoustic.core.base.linktypes import ReceivedFrame
from zacoustic.core.transport.objects.manifest import Manifest
from zacoustic.core.transport.reliable.receiving.receiving import Claim
from zacoustic.core.wire.objects import Reason


class ObjectReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A complete object, for its topic."""

    source: int
    manifest: Manifest
    payload: bytes
    received: ReceivedFrame
    again: bool = False
    """A former boot epoch may have delivered it."""


class Admission(msgspec.Struct, frozen=True):
    """The table's facts about an object of another node."""

    reason: Reason | None = None
    """Why it is not wanted; None: it is."""
    is_wanted: bool = True
    """This node has subscribed; otherwise it keeps nothing of it, and sends no feedback."""
    is_open: bool = True
    """It may be delivered now; otherwise the tables are not yet known to agree."""
    rank: int = 0
    """Rank of this node among the receivers of the stream: so many answer before it."""
    others: int = 0
    """Number of the other receivers."""
    keeps: bool = True
    """It is delivered once in all boot epochs of this node, so not before that is written down."""
    largest_bytes: int | None = None
    """Largest payload of the stream; None: the node's limit."""
    stream_digest: bytes = b""
    """Of the stream; empty: not known."""


class AdmissionControl(Protocol):
    """Knows the table and the counts, and takes complete objects."""

    def admit(self, source: int, stream_id: int) -> Admission:
        """Return the table's facts; stream 0: not yet known."""

    def claim(self, source: int, manifest: Manifest, *, is_turn: bool) -> Claim:
        """Tell whether it is the turn of an object that is complete.

        Args:
            source: Who sends it.
            manifest: What it is.
            is_turn: The source has sent the turn: nothing before it will come.
        """

    def unwanted(self, source: int, stream_id: int, *, is_alone: bool) -> None:
        """An object is on its way that is not wanted, maybe for this node alone."""

    def expect(self, source: int, manifest: Manifest) -> None:
        """An object may be under way; called with each of its fragments."""

    def deliver(self, arrived: ObjectReceived) -> None:
        """Take a complete object whose turn it is; once."""
