"""What an engine tells the application: frozen records, polled one by one.

Each is defined where it arises; here is the union of them, for whoever drives an engine, and what
arises in the engine itself.
"""

import msgspec

from zacoustic.core.actions.news import (
    ActionEvent,
    CancelAnswered,
    CancelRequested,
    FeedbackReceived,
    GoalAnswered,
    GoalFailed,
    GoalReceived,
    GoalRecovered,
    ResultReceived,
)
from zacoustic.core.actions.wire import GoalFailure, GoalKey, GoalStatus
from zacoustic.core.callrecords import CallFailure, CallKey
from zacoustic.core.calls import CallFailed, RequestReceived, ResponseReceived
from zacoustic.core.contact import PeerFound, PeerLost
from zacoustic.core.deadlines import DeadlineMissed, DeadlineSide
from zacoustic.core.deliveries import DeliveryEnded, DeliveryOutcome, DeliveryStored, SampleReceived
from zacoustic.core.demand.demand import SubscribersChanged
from zacoustic.core.doubt import JournalDoubted
from zacoustic.core.handshake import PeerSeen, StreamsDiffer
from zacoustic.core.hosttime import ClockStateChanged
from zacoustic.core.linktypes import LinkState, ModemRead, PeerMeasured
from zacoustic.core.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.orders.orders import StreamTuned
from zacoustic.core.protocols import ProtocolEvent
from zacoustic.core.ranging import RangeFailed, RangeMeasured
from zacoustic.core.rmw_desert.entities import RosEntitySeen
from zacoustic.core.silence import SilenceChanged
from zacoustic.core.transmitter import NothingHeard

__all__ = [
    "ActionEvent",
    "CallFailed",
    "CallFailure",
    "CallKey",
    "CancelAnswered",
    "CancelRequested",
    "ClockStateChanged",
    "DeadlineMissed",
    "DeadlineSide",
    "DeliveryEnded",
    "DeliveryOutcome",
    "DeliveryStored",
    "EngineRestarted",
    "Event",
    "FeedbackReceived",
    "GoalAnswered",
    "GoalFailed",
    "GoalFailure",
    "GoalKey",
    "GoalReceived",
    "GoalRecovered",
    "GoalStatus",
    "JournalDoubted",
    "JournalStateChanged",
    "LinkState",
    "LinkStateChanged",
    "ModemRead",
    "NothingHeard",
    "ObjectProgress",
    "ObjectState",
    "PeerFound",
    "PeerLost",
    "PeerMeasured",
    "PeerSeen",
    "RangeFailed",
    "RangeMeasured",
    "RequestReceived",
    "ResponseReceived",
    "ResultReceived",
    "RosEntitySeen",
    "SampleReceived",
    "SilenceChanged",
    "StreamTuned",
    "StreamsDiffer",
    "SubscribersChanged",
]


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


Event = (
    ProtocolEvent
    | PeerSeen
    | StreamsDiffer
    | PeerMeasured
    | ModemRead
    | SilenceChanged
    | StreamTuned
    | ClockStateChanged
    | NothingHeard
    | LinkStateChanged
    | JournalStateChanged
    | JournalDoubted
    | EngineRestarted
)
"""Anything that an engine tells."""
