"""What an engine tells the application: frozen records, polled one by one."""

import enum
from typing import Any

import msgspec

from zacoustic.core.actions.news import ActionEvent
from zacoustic.core.keys import Instance
from zacoustic.core.linktypes import LinkMetrics, LinkState, ModemRead, PeerMeasured
from zacoustic.core.objects.progress import ObjectProgress
from zacoustic.core.qos import Priority
from zacoustic.core.ranging import RangeFailed, RangeMeasured
from zacoustic.core.rmw_desert.entities import RosEntitySeen


class SampleReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A sample of a topic arrived."""

    stream_id: int
    """The topic's stream."""
    source: int
    """Address of the node that published it."""
    instance: Instance
    """Which of the topic's keys; see `zacoustic.core.keys`."""
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


class CallKey(msgspec.Struct, frozen=True):
    """Identifies a call at its server: who called, in which life, on which stream, which number.

    As a text ``client/epoch/stream/number``. Numbers come again after 64 calls at the earliest.
    """

    client: int
    epoch: int
    stream_id: int
    number: int

    def __str__(self) -> str:
        return f"{self.client}/{self.epoch}/{self.stream_id}/{self.number}"


class RequestReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A client calls a service of this node: answer by `Engine.reply` or `Engine.reply_error`."""

    call: CallKey
    """Names the call in the answer."""
    value: Any
    """The request."""
    deadline_at: int
    """Instant after which an answer is worthless, ns."""
    age_s: float | None = None
    """How old the request was when its frame was composed, s; None: the service has no stamp."""


class ResponseReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A call of this node was answered."""

    call_id: int
    """What `Engine.call` returned."""
    stream_id: int
    """The service's stream."""
    value: Any
    """The response."""
    age_s: float | None = None
    """How old it was when its frame was composed, s; None: the service has no stamp."""


class CallFailure(enum.IntEnum):
    """Why a call has no response; the numbers are on the wire."""

    HANDLER = 1
    """The handler of the service failed; the text is its own."""
    NO_SERVER = 2
    """The server's node has nobody who serves."""
    BAD_REQUEST = 3
    """The request could not be decoded by the server's node."""
    TABLE_MISMATCH = 4
    """The two nodes hold different definitions of this stream."""
    BAD_RESPONSE = 5
    """The response could not be decoded here."""
    TIMED_OUT = 6
    """No answer before the deadline. Whether the service ran is unknown."""
    CANCELLED = 7
    """Given up by the caller."""
    UNKNOWN = 8
    """The server ended without an answer: whether it has done its work is unknown."""


class CallFailed(msgspec.Struct, frozen=True, kw_only=True):
    """A call of this node has no response."""

    call_id: int
    """What `Engine.call` returned."""
    stream_id: int
    """The service's stream."""
    failure: CallFailure
    """Why."""
    text: str
    """One line for people."""


class SilenceChanged(msgspec.Struct, frozen=True, kw_only=True):
    """Silence was ordered or has ended, and the journal has it; or a former life has left one."""

    is_silent: bool
    """Nothing is transmitted now."""
    is_ordered: bool
    """By an order; otherwise, if silent, by a quiet window."""
    ends_at: int | None
    """End as far as it is known, ns; None: there is none, or until it is resumed."""
    changed_at: int
    """Instant of this state, ns."""
    doubt: str = ""
    """Why it may last longer than it was ordered, one line; empty: it does not."""


class StreamTuned(msgspec.Struct, frozen=True, kw_only=True):
    """It was ordered how a topic of this node is sent, and the journal has it."""

    stream_id: int
    """The topic's stream."""
    on: bool
    """Its samples go; otherwise they wait, expire and are superseded."""
    min_interval_s: float
    """Least time between two samples of one key on the water, s."""
    priority: Priority
    """Zenoh's priority."""
    ordered_by: int
    """Address of the node that has ordered it; 0: it was ordered here."""
    changed_at: int
    """Instant, ns."""


class SubscribersChanged(msgspec.Struct, frozen=True, kw_only=True):
    """Others subscribe to an on-demand topic of this node than before."""

    stream_id: int
    """The topic's stream."""
    subscribers: tuple[int, ...]
    """Addresses of those who do; none: its samples are not sent."""
    changed_at: int
    """Instant of the change, ns."""


class DeadlineSide(enum.Enum):
    """Who has missed a deadline; the words are those of DDS."""

    OFFERED = "offered"
    """This node, which has promised samples: nothing was published in time."""
    REQUESTED = "requested"
    """This node, to which they are promised: nothing has come in time."""


class DeadlineMissed(msgspec.Struct, frozen=True, kw_only=True):
    """Of a topic with `deadline_s` no sample came in time; once for each period without one."""

    stream_id: int
    """The topic's stream."""
    source: int
    """Address of the node that publishes it; that of this node, where `side` is OFFERED."""
    instance: Instance
    """Which of the topic's keys."""
    key: str
    """The key."""
    side: DeadlineSide
    """Who has missed it."""
    missed: int
    """How many periods were missed in all, of this key and node, in this life."""
    is_first: bool
    """There was a sample in the period before."""
    last_at: int
    """Instant of the last sample, ns."""
    missed_at: int
    """End of the period, ns."""


class PeerLost(msgspec.Struct, frozen=True, kw_only=True):
    """Nothing was heard of a node for as long as the config says."""

    address: int
    """The node."""
    heard_at: int | None
    """Instant at which it was heard last, ns; None: not in this life."""
    lost_at: int
    """Instant at which it counts as lost, ns."""


class PeerFound(msgspec.Struct, frozen=True, kw_only=True):
    """A node that was lost is heard again."""

    address: int
    """The node."""
    found_at: int
    """Instant, ns."""


class LinkStateChanged(msgspec.Struct, frozen=True, kw_only=True):
    """The link went up or down."""

    state: LinkState
    """The new state."""
    changed_at: int
    """Instant of the change, ns."""


class JournalStateChanged(msgspec.Struct, frozen=True, kw_only=True):
    """The journal cannot be written, or can be again."""

    failure: str
    """Why it cannot, one line; empty: it can. Until then nothing is promised that needs it."""
    changed_at: int
    """Instant of the change, ns."""


class JournalDoubted(msgspec.Struct, frozen=True, kw_only=True):
    """The journal may be less than what was written last: it is damaged, or was put back.

    The node has begun anew with what is right in it. What came before, and whose outcome it does
    not know, it does not do again: see `zacoustic.core.doubt`.
    """

    reason: str
    """What was found, and by whom, one line."""


class ClockStateChanged(msgspec.Struct, frozen=True, kw_only=True):
    """For want of a time that is sure nothing is transmitted; or no longer."""

    doubt: str
    """What is missing, one line; empty: nothing. Slots and quiet hours need the time."""
    changed_at: int
    """Instant of the change, ns."""


class EngineRestarted(msgspec.Struct, frozen=True, kw_only=True):
    """An internal error has ended the engine of this node; a new one goes on from the journal.

    Told by whoever runs engines. Best-effort samples that waited are lost; how all else ends that
    was under way is told behind this.
    """

    faults: int
    """Internal errors of this process so far."""
    cause: str
    """What was raised, one line."""
    changed_at: int
    """Instant, ns."""


class NothingHeard(msgspec.Struct, frozen=True, kw_only=True):
    """Frames were sent since the link is up, and nothing at all was heard; told once."""

    frames: int
    """How many were sent."""
    up_at: int
    """Instant from which on the link is up, ns."""
    changed_at: int
    """Instant, ns."""


class PeerSeen(msgspec.Struct, frozen=True, kw_only=True):
    """A node told its epoch for the first time, or it restarted."""

    address: int
    """The node."""
    epoch: int
    """Its boot epoch."""
    same_table: bool
    """Its table has the digest of ours."""
    wire_version: int
    """The version it speaks; another than ours is not understood."""


class StreamsDiffer(msgspec.Struct, frozen=True, kw_only=True):
    """A node defines a stream in another way: it is stopped between the two, the others go on."""

    address: int
    """The node."""
    stream_id: int
    """The stream that differs, or that one of the two does not have."""


Event = (
    SampleReceived
    | RequestReceived
    | ResponseReceived
    | CallFailed
    | LinkStateChanged
    | SilenceChanged
    | StreamTuned
    | JournalStateChanged
    | JournalDoubted
    | ClockStateChanged
    | NothingHeard
    | EngineRestarted
    | PeerSeen
    | PeerLost
    | PeerFound
    | SubscribersChanged
    | DeadlineMissed
    | StreamsDiffer
    | DeliveryStored
    | DeliveryEnded
    | PeerMeasured
    | ModemRead
    | RangeMeasured
    | RangeFailed
    | ObjectProgress
    | RosEntitySeen
    | ActionEvent
)
