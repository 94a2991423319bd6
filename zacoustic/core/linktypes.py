"""What goes between engine and link: `zacoustic.core.base.linktypes`."""

from zacoustic.core.base.linktypes import (
    BROADCAST,
    UNKNOWN_SOURCE,
    LinkCapabilities,
    LinkMetrics,
    LinkState,
    Measurement,
    ModemRead,
    PeerMeasured,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)

__all__ = [
    "BROADCAST",
    "UNKNOWN_SOURCE",
    "LinkCapabilities",
    "LinkMetrics",
    "LinkState",
    "Measurement",
    "ModemRead",
    "PeerMeasured",
    "ReceivedFrame",
    "Transmission",
    "TransmitOutcome",
    "TransmitReport",
]
