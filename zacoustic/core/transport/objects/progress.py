"""Events of objects for the application."""

import enum

import msgspec

from zacoustic.core.base.linktypes import ONE_LINK


class ObjectState(enum.Enum):
    """How far an object is."""

    UNDER_WAY = "under_way"
    """Fragments are on their way."""
    DELIVERED = "delivered"
    """Every receiver has it; at a receiver: it is complete and was handed over."""
    REFUSED = "refused"
    """A receiver does not want it; the others have it."""
    CANCELLED = "cancelled"
    """Cancelled here or at the other end."""
    EXPIRED = "expired"
    """Too old before every receiver had it."""
    SUPERSEDED = "superseded"
    """A newer sample of its key pushed it out."""


class ObjectProgress(msgspec.Struct, frozen=True, kw_only=True):
    """How far an object is; the last one of each object has another state than UNDER_WAY."""

    stream_id: int
    """Its topic; 0: not yet known."""
    peer: int
    """The node that it comes from; of an own object where it goes, or `BROADCAST`."""
    transfer: int
    """Number that the source gave it, 0…63."""
    object_id: int | None = None
    """Of an own object: what its publication returned."""
    state: ObjectState
    """How far."""
    done_bytes: int
    """Bytes that have arrived, as far as known here."""
    sent_bytes: int | None = None
    """Of an own object: bytes that were on the air at least once; repair is not counted."""
    total_bytes: int | None
    """Bytes of the payload; None: not yet known."""
    missing: tuple[int, ...] = ()
    """Of an own object that has ended: addresses of the receivers that do not have it."""
    detail: str = ""
    """Why, in a few words."""
    link: str = ONE_LINK
    """Name of the link that it goes by, or comes by."""
