"""Events of the dialogue for its shell: `AtDialogue.poll_event`."""

from typing import TypeAlias

import msgspec

from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    Measurement,
    ReceivedFrame,
    TransmitReport,
)


class FrameHeard(msgspec.Struct, frozen=True):
    """A frame arrived."""

    frame: ReceivedFrame
    """The frame, with the modem's measurements."""


class TransmissionEnded(msgspec.Struct, frozen=True):
    """A transmission has ended; exactly one event for each."""

    report: TransmitReport
    """How it ended."""


class LinkChanged(msgspec.Struct, frozen=True):
    """The link went up or down, or waits for something else."""

    state: LinkState
    """The new state."""
    detail: str
    """The modem, or what the link waits for."""
    capabilities: LinkCapabilities | None = None
    """With UP: the capabilities of the link."""


class CarrierChanged(msgspec.Struct, frozen=True):
    """A sound of another node began or ended."""

    busy: bool
    """Whether it began."""


class Measured(msgspec.Struct, frozen=True):
    """The modem has measured another one, or reports values of itself."""

    measurement: Measurement
    """The values."""


class ConnectionUseless(msgspec.Struct, frozen=True):
    """The connection is useless: reopen it."""

    reason: str
    """The cause."""


class OpeningHopeless(msgspec.Struct, frozen=True):
    """The modem answers but cannot serve this node; only people can change that."""

    reason: str
    """The fault."""
    hint: str
    """Its cure."""


Event: TypeAlias = (
    FrameHeard
    | TransmissionEnded
    | LinkChanged
    | CarrierChanged
    | Measured
    | ConnectionUseless
    | OpeningHopeless
)
"""All events."""
