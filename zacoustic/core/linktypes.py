"""What goes between engine and link: `zacoustic.core.base.linktypes`."""

from zacoustic.core.base.linktypes import (
    BROADCAST,
    UNKNOWN_SOURCE,
    BulkService,
    LinkCapabilities,
    LinkMetrics,
    LinkState,
    Measurement,
    ModemRead,
    PeerMeasured,
    ReceivedFrame,
    Service,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)

__all__ = [
    "BROADCAST",
    "UNKNOWN_SOURCE",
    "BulkService",
    "LinkCapabilities",
    "LinkMetrics",
    "LinkState",
    "Measurement",
    "ModemRead",
    "PeerMeasured",
    "ReceivedFrame",
    "Service",
    "Transmission",
    "TransmitOutcome",
    "TransmitReport",
]
