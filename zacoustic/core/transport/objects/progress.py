"""The progress events of objects."""

import enum

import msgspec

from zacoustic.core.base.linktypes import ONE_LINK


class ObjectState(enum.Enum):
    """The state of an object."""

    UNDER_WAY = "under_way"
    """Its fragments are being sent."""
    DELIVERED = "delivered"
    """Every receiver has it; at a receiver: it is complete and was delivered."""
    REFUSED = "refused"
    """A receiver refuses it; the others have it."""
    CANCELLED = "cancelled"
    """It was cancelled at either end."""
    EXPIRED = "expired"
    """Its lifespan ended before every receiver had it."""
    SUPERSEDED = "superseded"
    """A newer sample of its key replaced it."""


class ObjectProgress(msgspec.Struct, frozen=True, kw_only=True):
    """The progress of an object; each state but UNDER_WAY is the last one of its object."""

    stream_id: int
    """Its topic; 0: not yet known."""
    peer: int
    """The source; for an outgoing object the destination, or `BROADCAST`."""
    transfer: int
    """The source's number for it, 0…63."""
    object_id: int | None = None
    """For an outgoing object: what its publication returned."""
    state: ObjectState
    """The state."""
    done_bytes: int
    """Bytes that are known to have arrived."""
    sent_bytes: int | None = None
    """For an outgoing object: bytes that were transmitted at least once, without repair."""
    total_bytes: int | None
    """Bytes of the payload; None: not yet known."""
    missing: tuple[int, ...] = ()
    """For an outgoing object that has ended: addresses of the receivers that do not have it."""
    detail: str = ""
    """The reason, in a few words."""
    link: str = ONE_LINK
    """Name of the link that carries it."""
