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
    """The frame, with what the modem measured on it."""


class TransmissionEnded(msgspec.Struct, frozen=True):
    """A transmission has ended; exactly one for each."""

    report: TransmitReport
    """How it ended."""


class LinkChanged(msgspec.Struct, frozen=True):
    """The link went up or down, or waits for something else."""

    state: LinkState
    """What it is."""
    detail: str
    """The modem, or what the link waits for."""
    capabilities: LinkCapabilities | None = None
    """With UP: what the link can do."""


class CarrierChanged(msgspec.Struct, frozen=True):
    """A sound that is not ours began or ended."""

    busy: bool
    """It began."""


class Measured(msgspec.Struct, frozen=True):
    """The modem has measured another one, or reports values of itself."""

    measurement: Measurement
    """What."""


class ConnectionUseless(msgspec.Struct, frozen=True):
    """Give up the connection and reopen it."""

    reason: str
    """Why."""


class OpeningHopeless(msgspec.Struct, frozen=True):
    """The modem is there and cannot serve this node; waiting changes nothing, people do."""

    reason: str
    """What is wrong."""
    hint: str
    """What to do about it."""


Event: TypeAlias = (
    FrameHeard
    | TransmissionEnded
    | LinkChanged
    | CarrierChanged
    | Measured
    | ConnectionUseless
    | OpeningHopeless
)
"""All of them."""
