"""The events of samples: arrived, journalled, ended."""

import enum
from typing import Any, Self

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import LinkMetrics
from zacoustic.core.streams.keys import Instance


class SampleReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A sample of a topic arrived."""

    stream_id: int
    """The topic's stream."""
    source: int
    """Address of the node that published it."""
    instance: Instance
    """The key within the topic; see `zacoustic.core.streams.keys`."""
    value: Any
    """The sample in its type, bytes for an opaque stream, None for a delete."""
    deleted: bool = False
    """Whether the key was deleted; then there is no value."""
    encoding: str
    """The Zenoh encoding that the publisher used."""
    age_s: float | None = None
    """Age of the sample at `received_at`, s; 30 days: at least so old; None: unknown, or the stream
    has no stamp."""
    age_error_s: float | None = None
    """How wrong that may be, s; None: nothing bounds it."""
    received_at: int
    """Instant at which the frame had arrived, ns; for a sample from before a restart, the instant
    at which the link came up."""
    metrics: LinkMetrics
    """The modem's measurements on the frame."""
    again: bool = False
    """Whether it may have been delivered before: this node stopped, or its journal was restored
    from an old copy, just then."""

    def aged(self, now: int) -> Self:
        """Return the same with its age at `now`, ns, as if it had arrived then."""
        age_s = self.age_s
        if age_s is not None:
            age_s = round(age_s + ns_to_seconds(max(0, now - self.received_at)), 3)
        return msgspec.structs.replace(self, age_s=age_s, received_at=now)


class DeliveryOutcome(enum.Enum):
    """How a reliable sample ended."""

    DELIVERED = "delivered"
    """Every subscriber's engine has it."""
    SUPERSEDED = "superseded"
    """A newer sample of its key replaced it."""
    EXPIRED = "expired"
    """Its lifespan ended."""
    REFUSED = "refused"
    """A subscriber refused it: it is too large there, or no longer wanted."""
    CANCELLED = "cancelled"
    """Its publisher cancelled it."""
    UNKNOWN = "unknown"
    """Published before a restart while the journal is in doubt: it is no longer known whether the
    missing subscribers have delivered it."""


class DeliveryStored(msgspec.Struct, frozen=True, kw_only=True):
    """A sample that this node published is journalled: it survives a restart."""

    delivery_id: int
    """The return value of `Engine.publish`."""
    stream_id: int
    """The topic's stream."""


class DeliveryEnded(msgspec.Struct, frozen=True, kw_only=True):
    """A reliable sample of this node has ended: it is no longer repeated."""

    delivery_id: int
    """What `Engine.publish` returned, perhaps before a restart."""
    stream_id: int
    """The topic's stream."""
    outcome: DeliveryOutcome
    """How it ended."""
    missing: tuple[int, ...]
    """Addresses of the subscribers that have not acknowledged it."""
    ended_at: int
    """Instant of the end, ns."""
    detail: str = ""
    """The reason, where the outcome alone does not tell it."""


class CustodyChanged(msgspec.Struct, frozen=True, kw_only=True):
    """A custodian has taken a sample of a carried topic along, or has no room for it.

    The sample has not ended: its subscriber may get it by the custodian, or straight from this node
    if it is heard before. `DeliveryEnded` comes with the subscriber's receipt.
    """

    delivery_id: int
    """What `Engine.publish` returned, perhaps before a restart."""
    stream_id: int
    """The topic's stream."""
    subscriber: int
    """Address of the subscriber that it is for."""
    custodian: int | None
    """Address of the node that has it; None: none has it any more."""
    changed_at: int
    """Instant of the change, ns."""
    detail: str = ""
    """The reason why none has it."""


DeliveryEvent = DeliveryStored | CustodyChanged | DeliveryEnded
"""The events that report a reliable sample to its publisher."""
