"""What the demo prints while it runs: frozen records, each with its instant."""

from typing import Any

import msgspec


class Note(msgspec.Struct, frozen=True, kw_only=True, tag_field="event"):
    """Something that happened."""

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
    """How long the channel is taken for it, s."""


class Arrived(Note, frozen=True, kw_only=True, tag="arrived"):
    """A frame was heard to its end, or was lost."""

    source: int
    """Address of the sender."""
    target: int
    """Address of the receiver."""
    frame_bytes: int
    """Length of the frame."""
    outcome: str
    """Its outcome, in the medium's word; `received` is the good one."""
    propagation_s: float
    """How long the sound was on its way, s."""


class Sent(Note, frozen=True, kw_only=True, tag="sent"):
    """A client put something that should cross."""

    stream: str
    """Lane: the name of the stream, for a service with `request` or `response`."""
    source: int
    """Address of the side it came from."""
    count: int
    """Number of it on its lane, from 0."""
    value: Any
    """What it is."""


class Crossed(Note, frozen=True, kw_only=True, tag="crossed"):
    """It reached a client on the other side."""

    stream: str
    """Lane, as in `Sent`."""
    source: int
    """Address of the side it came from."""
    count: int
    """Number of it on its lane."""
    delay_s: float
    """From client to client, s: the gateways, waiting for the channel, the sound."""
    value: Any
    """What arrived."""


AnyNote = Started | Emitted | Arrived | Sent | Crossed
