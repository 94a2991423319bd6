"""Lines that the demo prints while it runs: frozen records, each with its instant."""

from typing import Any

import msgspec


class Note(msgspec.Struct, frozen=True, kw_only=True, tag_field="event"):
    """An event."""

    at_s: float
    """Instant, s since the clients' start; negative before."""


class Started(Note, frozen=True, kw_only=True, tag="started"):
    """A process is ready."""

    child: str
    """Its name."""


class Emitted(Note, frozen=True, kw_only=True, tag="emitted"):
    """A modem began to send a frame."""

    source: int
    """Address of the sender."""
    frame_bytes: int
    """Length of the frame."""
    airtime_s: float
    """How long it occupies the channel, s."""


class Arrived(Note, frozen=True, kw_only=True, tag="arrived"):
    """A frame was received to its end, or was lost."""

    source: int
    """Address of the sender."""
    target: int
    """Address of the receiver."""
    frame_bytes: int
    """Length of the frame."""
    outcome: str
    """Its outcome in the medium's word; `received` means success."""
    propagation_s: float
    """Propagation delay, s."""


class Sent(Note, frozen=True, kw_only=True, tag="sent"):
    """A client put an item that should cross."""

    stream: str
    """Lane: the name of the stream, for a service with `request` or `response`."""
    source: int
    """Address of the sending side."""
    count: int
    """Number of the item on its lane, from 0."""
    value: Any
    """Its value."""


class Crossed(Note, frozen=True, kw_only=True, tag="crossed"):
    """An item reached a client on the other side."""

    stream: str
    """Lane, as in `Sent`."""
    source: int
    """Address of the sending side."""
    count: int
    """Number of the item on its lane."""
    delay_s: float
    """From client to client, s: gateways, waiting for the channel, and sound."""
    value: Any
    """Its value on arrival."""


AnyNote = Started | Emitted | Arrived | Sent | Crossed
