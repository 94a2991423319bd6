"""What an engine tells of samples: one arrived, one is in the journal, one ended."""

import enum
from typing import Any

import msgspec

from zacoustic.core.base.linktypes import LinkMetrics
from zacoustic.core.streams.keys import Instance


class SampleReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A sample of a topic arrived."""

    stream_id: int
    """The topic's stream."""
    source: int
    """Address of the node that published it."""
    instance: Instance
    """Which of the topic's keys; see `zacoustic.core.streams.keys`."""
    value: Any
    """The sample as its type says, bytes for an opaque stream, None for a delete."""
    deleted: bool = False
    """The key was deleted; there is no value."""
    encoding: str
    """Zenoh encoding that the publisher used."""
    age_s: float | None = None
    """How old the sample was when its frame was composed, s; infinity: over an hour; None: the
    stream has no stamp."""
    received_at: int
    """Instant at which the frame had arrived, ns; of one that a former life has left, the first
    instant of this life."""
    metrics: LinkMetrics
    """What the modem measured on the frame."""
    again: bool = False
    """It may have been handed on before: a life of this node ended, or its journal was put back,
    at that very moment."""


class DeliveryOutcome(enum.Enum):
    """How a reliable sample ended."""

    DELIVERED = "delivered"
    """Every subscriber's engine has it."""
    SUPERSEDED = "superseded"
    """A newer sample of its key pushed it out."""
    EXPIRED = "expired"
    """It became too old."""
    REFUSED = "refused"
    """A subscriber does not take it: it is larger than allowed there, or not wanted any more."""
    CANCELLED = "cancelled"
    """Given up by its publisher."""
    UNKNOWN = "unknown"
    """Published by a former life, and the journal is in doubt: whether those that are missing have
    handed it on, nobody can tell any more."""


class DeliveryStored(msgspec.Struct, frozen=True, kw_only=True):
    """A sample that this node published is in its journal: it survives a restart."""

    delivery_id: int
    """What `Engine.publish` returned."""
    stream_id: int
    """The topic's stream."""


class DeliveryEnded(msgspec.Struct, frozen=True, kw_only=True):
    """A sample that this node published reliably is not repeated any more."""

    delivery_id: int
    """What `Engine.publish` returned, maybe in a former life."""
    stream_id: int
    """The topic's stream."""
    outcome: DeliveryOutcome
    """How it ended."""
    missing: tuple[int, ...]
    """Addresses of the subscribers that have not acknowledged it."""
    ended_at: int
    """Instant, ns."""
    detail: str = ""
    """Why, where the outcome does not say it."""


DeliveryEvent = DeliveryStored | DeliveryEnded
"""What a publisher is told of a reliable sample."""
