"""Events of an engine for the application: frozen records, polled one by one.

Each is defined where it arises; this module has their union, and the events of the engine itself.
"""

import msgspec

from zacoustic.core.base.linktypes import ONE_LINK, LinkState, ModemRead, PeerMeasured
from zacoustic.core.bond.bonding import PeerReachable
from zacoustic.core.peers.alarms import SealAlarm
from zacoustic.core.peers.contact import PeerFound, PeerLost
from zacoustic.core.peers.doubt import JournalDoubted
from zacoustic.core.peers.handshake import PeerSeen, StreamsDiffer
from zacoustic.core.peers.lostcontact import ContactLost, ContactRestored
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.peers.twins import AddressShared
from zacoustic.core.profiles.entities import RosEntitySeen
from zacoustic.core.profiles.native.protocols import ProtocolEvent
from zacoustic.core.schedule.hosttime import ClockStateChanged
from zacoustic.core.schedule.silence import SilenceChanged
from zacoustic.core.schedule.transmitter import AccessStateChanged, NothingHeard
from zacoustic.core.transport.actions.events import (
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
from zacoustic.core.transport.calls.calls import CallFailed, RequestReceived, ResponseReceived
from zacoustic.core.transport.commands.commands import CommandHandled, StreamOverridden
from zacoustic.core.transport.contract import TransportEvent
from zacoustic.core.transport.deliveries import (
    CustodyChanged,
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    SampleReceived,
)
from zacoustic.core.transport.keydelivery import KeyDelivered
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.transport.objects.sending.bulkpaths import BulkChanged
from zacoustic.core.transport.routing import RoutingHandled
from zacoustic.core.transport.subscriptions.subscriptions import SubscribersChanged
from zacoustic.core.transport.topics.deadlines import DeadlineMissed, DeadlineSide
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.core.wire.goals import GoalFailure, GoalKey, GoalStatus

__all__ = [
    "AccessStateChanged",
    "ActionEvent",
    "AddressShared",
    "BulkChanged",
    "CallFailed",
    "CallFailure",
    "CallKey",
    "CancelAnswered",
    "CancelRequested",
    "ClockStateChanged",
    "CommandHandled",
    "ContactLost",
    "ContactRestored",
    "CustodyChanged",
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
    "KeyDelivered",
    "LinkState",
    "LinkStateChanged",
    "ModemRead",
    "NothingHeard",
    "ObjectProgress",
    "ObjectState",
    "PeerFound",
    "PeerLost",
    "PeerMeasured",
    "PeerReachable",
    "PeerSeen",
    "RangeFailed",
    "RangeMeasured",
    "RequestReceived",
    "ResponseReceived",
    "ResultReceived",
    "RosEntitySeen",
    "RoutingHandled",
    "SampleReceived",
    "SealAlarm",
    "SilenceChanged",
    "StreamOverridden",
    "StreamsDiffer",
    "SubscribersChanged",
    "TransportEvent",
]


class LinkStateChanged(msgspec.Struct, frozen=True, kw_only=True):
    """The link went up or down."""

    state: LinkState
    """The new state."""
    changed_at: int
    """Instant of the change, ns."""
    link: str = ONE_LINK
    """Name of the link."""


class JournalStateChanged(msgspec.Struct, frozen=True, kw_only=True):
    """The journal cannot be written, or can be again."""

    failure: str
    """Why it cannot, one line; empty: it can. Until it can, no promise is made that depends on
    it."""
    changed_at: int
    """Instant of the change, ns."""


class EngineRestarted(msgspec.Struct, frozen=True, kw_only=True):
    """An internal error has ended the engine of this node; a new one continues from the journal.

    The runner emits it. Waiting best-effort samples are lost; further events report how everything
    else ended that was under way.
    """

    faults: int
    """Internal errors of this process so far."""
    cause: str
    """The exception, one line."""
    changed_at: int
    """Instant of the restart, ns."""


Event = (
    ProtocolEvent
    | PeerSeen
    | StreamsDiffer
    | ContactLost
    | ContactRestored
    | PeerMeasured
    | ModemRead
    | SilenceChanged
    | StreamOverridden
    | CommandHandled
    | RoutingHandled
    | KeyDelivered
    | AccessStateChanged
    | ClockStateChanged
    | NothingHeard
    | LinkStateChanged
    | PeerReachable
    | JournalStateChanged
    | JournalDoubted
    | AddressShared
    | SealAlarm
    | EngineRestarted
    | TransportEvent
)
"""Any event of an engine."""
