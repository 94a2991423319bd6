"""Zenoh over sound: joins networks of Zenoh, ROS 2 or plain Python through acoustic modems.

This module has the names that a program needs. It imports a name on first use, so ``import
zacoustic`` loads neither Zenoh nor a serial port. `zacoustic.blocking` has the same names without
asyncio.
"""

from zacoustic.errors import (
    CallTimeoutError,
    ConfigError,
    DeliveryError,
    JournalUnavailableError,
    LinkClosedError,
    LinkError,
    LinkOpenError,
    LinkUnavailableError,
    LocalError,
    OutcomeUnknownError,
    PayloadInvalidError,
    PayloadTooLargeError,
    QueueFullError,
    RangeUnavailableError,
    ServiceError,
    SessionError,
    UnknownStreamError,
    ZacousticError,
)

TYPE_CHECKING = False  # not from typing: its import takes 20 ms, in which Ctrl-C prints a traceback
if TYPE_CHECKING:
    from typing import Any

    from zacoustic import blocking
    from zacoustic.config import Config, read_config
    from zacoustic.core.base.linktypes import LinkMetrics, LinkState, ModemRead, PeerMeasured
    from zacoustic.core.base.qos import Durability, Forward, Priority, Qos, Reliability, Stamp
    from zacoustic.core.engine.events import (
        AccessStateChanged,
        AddressShared,
        BulkChanged,
        ClockStateChanged,
        ContactLost,
        ContactRestored,
        CustodyChanged,
        DeadlineMissed,
        DeadlineSide,
        DeliveryEnded,
        DeliveryOutcome,
        EngineRestarted,
        GoalStatus,
        JournalDoubted,
        JournalStateChanged,
        LinkStateChanged,
        NothingHeard,
        PeerFound,
        PeerLost,
        PeerReachable,
        PeerSeen,
        SealAlarm,
        SilenceChanged,
        StreamOverridden,
        StreamsDiffer,
        SubscribersChanged,
    )
    from zacoustic.core.peers.measurements import Range
    from zacoustic.core.profiles.entities import RosEntitySeen
    from zacoustic.core.streams.commands import CommandKind, CommandState, RemoteCommand
    from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
    from zacoustic.core.values.types import Bounds
    from zacoustic.zenoh.node import (
        ActionClient,
        ActionServer,
        CallContext,
        Client,
        Delivery,
        GoalHandle,
        GoalResult,
        Node,
        NodeEvent,
        Publisher,
        Sample,
        ServerGoalHandle,
        Service,
        Subscription,
    )

__all__ = [
    "AccessStateChanged",
    "ActionClient",
    "ActionServer",
    "AddressShared",
    "Bounds",
    "BulkChanged",
    "CallContext",
    "CallTimeoutError",
    "Client",
    "ClockStateChanged",
    "CommandKind",
    "CommandState",
    "Config",
    "ConfigError",
    "ContactLost",
    "ContactRestored",
    "CustodyChanged",
    "DeadlineMissed",
    "DeadlineSide",
    "Delivery",
    "DeliveryEnded",
    "DeliveryError",
    "DeliveryOutcome",
    "Durability",
    "EngineRestarted",
    "Forward",
    "GoalHandle",
    "GoalResult",
    "GoalStatus",
    "JournalDoubted",
    "JournalStateChanged",
    "JournalUnavailableError",
    "LinkClosedError",
    "LinkError",
    "LinkMetrics",
    "LinkOpenError",
    "LinkState",
    "LinkStateChanged",
    "LinkUnavailableError",
    "LocalError",
    "ModemRead",
    "Node",
    "NodeEvent",
    "NothingHeard",
    "ObjectProgress",
    "ObjectState",
    "OutcomeUnknownError",
    "PayloadInvalidError",
    "PayloadTooLargeError",
    "PeerFound",
    "PeerLost",
    "PeerMeasured",
    "PeerReachable",
    "PeerSeen",
    "Priority",
    "Publisher",
    "Qos",
    "QueueFullError",
    "Range",
    "RangeUnavailableError",
    "Reliability",
    "RemoteCommand",
    "RosEntitySeen",
    "Sample",
    "SealAlarm",
    "ServerGoalHandle",
    "Service",
    "ServiceError",
    "SessionError",
    "SilenceChanged",
    "Stamp",
    "StreamOverridden",
    "StreamsDiffer",
    "SubscribersChanged",
    "Subscription",
    "UnknownStreamError",
    "ZacousticError",
    "blocking",
    "read_config",
]

_HOMES = {
    "zacoustic.config": ("Config", "read_config"),
    "zacoustic.core.engine.events": (
        "AccessStateChanged",
        "AddressShared",
        "BulkChanged",
        "ClockStateChanged",
        "ContactLost",
        "ContactRestored",
        "DeadlineMissed",
        "DeadlineSide",
        "CustodyChanged",
        "DeliveryEnded",
        "DeliveryOutcome",
        "EngineRestarted",
        "GoalStatus",
        "JournalDoubted",
        "JournalStateChanged",
        "LinkStateChanged",
        "NothingHeard",
        "PeerFound",
        "PeerLost",
        "PeerReachable",
        "PeerSeen",
        "SealAlarm",
        "SilenceChanged",
        "StreamOverridden",
        "StreamsDiffer",
        "SubscribersChanged",
    ),
    "zacoustic.core.base.linktypes": ("LinkMetrics", "LinkState", "ModemRead", "PeerMeasured"),
    "zacoustic.core.peers.measurements": ("Range",),
    "zacoustic.core.transport.objects.progress": ("ObjectProgress", "ObjectState"),
    "zacoustic.core.streams.commands": ("RemoteCommand", "CommandKind", "CommandState"),
    "zacoustic.core.base.qos": ("Durability", "Forward", "Priority", "Qos", "Reliability", "Stamp"),
    "zacoustic.core.profiles.entities": ("RosEntitySeen",),
    "zacoustic.core.values.types": ("Bounds",),
    "zacoustic.zenoh.node": (
        "ActionClient", "ActionServer", "CallContext", "Client", "Delivery", "GoalHandle",
        "GoalResult", "Node", "NodeEvent", "Publisher", "Sample", "ServerGoalHandle", "Service",
        "Subscription",
    ),
}  # fmt: skip


def __getattr__(name: str) -> "Any":  # noqa: ANN401 (of a module: anything)
    """Import a public name when it is first used."""
    import importlib

    if name == "__version__":
        from importlib import metadata

        return metadata.version("zacoustic")
    if name == "blocking":
        return importlib.import_module("zacoustic.blocking")
    for home, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__, "__version__"])
