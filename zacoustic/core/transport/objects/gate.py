"""What the table, and the count of the key, say of an object that arrives."""

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
    """A former life may have handed it on."""


class Admission(msgspec.Struct, frozen=True):
    """What the table says of an object that another node sends."""

    reason: Reason | None = None
    """Why it is not wanted; None: it is."""
    is_wanted: bool = True
    """This node has subscribed; otherwise it keeps nothing of it, and says nothing about it."""
    is_open: bool = True
    """It may be delivered now; otherwise the tables are not yet known to agree."""
    place: int = 0
    """Of all receivers of the stream, the how many-th this node is: so many speak before it."""
    others: int = 0
    """How many receivers there are beside it."""
    keeps: bool = True
    """It is handed on once in all lives of this node, so not before that is written down."""
    largest_bytes: int | None = None
    """Largest payload of the stream; None: as the node says."""
    stream_digest: bytes = b""
    """Of the stream; empty: not known."""


class Gate(Protocol):
    """Who knows the table and the counts, and takes what is complete."""

    def admit(self, source: int, stream_id: int) -> Admission:
        """Tell what the table says; stream 0: not yet known."""

    def claim(self, source: int, manifest: Manifest, *, is_turn: bool) -> Claim:
        """Tell whether it is the turn of an object that is complete.

        Args:
            source: Who sends it.
            manifest: What it is.
            is_turn: The source says that nothing before it will come.
        """

    def unwanted(self, source: int, stream_id: int, *, is_alone: bool) -> None:
        """An object is on its way that is not wanted, maybe for this node alone."""

    def expect(self, source: int, manifest: Manifest) -> None:
        """An object is on its way: maybe, told again with each of its fragments."""

    def deliver(self, arrived: ObjectReceived) -> None:
        """Take a complete object whose turn it is; once."""
