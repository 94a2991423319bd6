"""The possible meanings of a command's answer; their text forms are in `answers`.

Four answers fit every command: `OK`, `[*]OK`, and all that begins with `ERROR` or `BUSY`. No source
explains `[*]` for certain: accepted, but not stored, or not in force yet. The driver records it and
decides nothing by it. The reason of a refusal is for people: drivers have met three spellings of
one.
"""

import enum
from typing import TypeAlias

import msgspec

from zacoustic_evologics.at.framing import Interpreter


class Accepted(msgspec.Struct, frozen=True):
    """`OK`."""

    starred: bool = False
    """It came as `[*]OK`."""


class RefusalKind(enum.Enum):
    """How a modem refuses."""

    ERROR = "ERROR"
    """It cannot do that."""
    BUSY = "BUSY"
    """It cannot do that now."""


class Refused(msgspec.Struct, frozen=True):
    """`ERROR …` or `BUSY …`."""

    kind: RefusalKind
    """Which of them."""
    reason: str = ""
    """What follows the word."""


class Number(msgspec.Struct, frozen=True):
    """A setting, or a measurement that is a whole number."""

    value: int
    """In the unit of the queried setting."""
    starred: bool = False
    """It came with `[*]`."""


class Measurement(msgspec.Struct, frozen=True):
    """A measurement with decimals: `AT?E` dB, `AT?V` m/s, `AT?BV` V."""

    value: float
    """Four decimals."""


class ModeReply(msgspec.Struct, frozen=True):
    """The answer to `AT?MODE`."""

    interpreter: Interpreter
    """Who reads the commands."""


class DeliveryState(enum.Enum):
    """`AT?DI`'s states of the last instant message; the value is the word."""

    EMPTY = "EMPTY"
    """There is none, or it needs no more."""
    DELIVERING = "DELIVERING"
    """It is under way."""
    DELIVERED = "DELIVERED"
    """It was acknowledged. One driver expects this word; no capture has it."""
    FAILED = "FAILED"
    """It was not acknowledged."""
    EXPIRED = "EXPIRED"
    """Its time had passed."""


class DeliveryReply(msgspec.Struct, frozen=True):
    """The answer to `AT?DI`."""

    state: DeliveryState
    """What has become of it."""


class LinkStatus(msgspec.Struct, frozen=True):
    """The answer to `AT?S` of the AT interpreter, and to the commands that change the state."""

    state: str
    """Words: `INITIATION LISTEN`, `INITIATION NOISE`, `ONLINE …`, `PHY …`."""
    free_bytes: tuple[int, ...] = ()
    """Room in the transmit buffer, for each channel."""


class NetStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to `AT?S` of the NET interpreter."""

    local_address: int
    """Of this modem."""
    remote_address: int
    """For raw bursts."""
    state: str
    """As in `LinkStatus`."""
    pool: str
    """The vendor's words on the transmit buffer; no source has them exactly."""
    promiscuous: bool
    """Whether it reports messages for others."""


class ShownSetting(msgspec.Struct, frozen=True):
    """One line of `AT&V`."""

    label: str
    """The vendor's name for it; firmware 1.7 misspells one."""
    value: int
    """What it is set to."""
    starred: bool = False
    """It came with `[*]`."""


class SettingsReply(msgspec.Struct, frozen=True):
    """The answer to `AT&V`."""

    settings: tuple[ShownSetting, ...]
    """In the order of the modem."""


class Path(msgspec.Struct, frozen=True):
    """One way that sound took."""

    delay_us: int
    """After the first, µs."""
    strength: int
    """In the modem's own scale."""


class MultipathReply(msgspec.Struct, frozen=True):
    """The answer to `AT?P`."""

    paths: tuple[Path, ...]
    """Eight, those without sound are 0."""


class PositionReply(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to `AT?UP` (frame of the head) and `AT?UPX` (east, north, up)."""

    measured_s: int
    """System clock, s."""
    address: int
    """The other modem."""
    x_m: float
    """Or east, m."""
    y_m: float
    """Or north, m."""
    z_m: float
    """Or up, m."""


class TextReply(msgspec.Struct, frozen=True):
    """Any other answer."""

    text: str
    """As it came."""


CommandReply: TypeAlias = (
    Accepted
    | Refused
    | Number
    | Measurement
    | ModeReply
    | DeliveryReply
    | LinkStatus
    | NetStatus
    | SettingsReply
    | MultipathReply
    | PositionReply
    | TextReply
)
"""What an answer can mean."""
