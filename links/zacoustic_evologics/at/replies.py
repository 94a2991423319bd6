"""The possible meanings of a command's answer; their text forms are in `table`.

Four answers fit every command: `OK`, `[*]OK`, and all that begins with `ERROR` or `BUSY`. No source
explains `[*]` for certain: accepted, but not stored, or not in force yet. The driver records it and
decides nothing by it. The reason of a refusal is for people: drivers have met three spellings of
one.
"""

import enum
from typing import Annotated, TypeAlias

import msgspec

from zacoustic.link.fields import Padded, Switch
from zacoustic.link.forms import Form, Lines
from zacoustic_evologics.at import fields
from zacoustic_evologics.at.framing import Interpreter


class Accepted(msgspec.Struct, frozen=True):
    """`OK`."""

    starred: fields.Starred = False
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
    reason: fields.Reason = ""
    """What follows the word."""


class Number(msgspec.Struct, frozen=True):
    """A setting, or a measurement that is a whole number."""

    value: fields.Signed
    """In the unit of the queried setting."""
    starred: fields.Starred = False
    """It came with `[*]`."""


class Measurement(msgspec.Struct, frozen=True):
    """A measurement with decimals: `AT?E` dB, `AT?V` m/s, `AT?BV` V."""

    value: fields.Reading
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

    state: fields.State
    """Words: `INITIATION LISTEN`, `INITIATION NOISE`, `ONLINE …`, `PHY …`."""
    free_bytes: fields.FreeBytes = ()
    """Room in the transmit buffer, for each channel."""


class NetStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to `AT?S` of the NET interpreter."""

    local_address: fields.Address
    """Of this modem."""
    remote_address: fields.Address
    """For raw bursts."""
    state: fields.Line
    """As in `LinkStatus`."""
    pool: fields.Line
    """The vendor's words on the transmit buffer; no source has them exactly."""
    promiscuous: Annotated[bool, Switch("ON", "OFF", "1")]
    """Whether it reports messages for others."""


class ShownSetting(msgspec.Struct, frozen=True):
    """One line of `AT&V`."""

    label: fields.Label
    """The vendor's name for it; firmware 1.7 misspells one."""
    value: fields.Shown
    """What it is set to."""
    starred: fields.Starred = False
    """It came with `[*]`."""


class SettingsReply(msgspec.Struct, frozen=True):
    """The answer to `AT&V`."""

    settings: Annotated[
        tuple[ShownSetting, ...], Lines(Form(ShownSetting, "{starred}{label}:{value}"), "\r\n")
    ]
    """In the order of the modem. The line ends are those of a capture; the other answers of several
    lines have bare line feeds."""


class Path(msgspec.Struct, frozen=True):
    """One way that sound took."""

    delay_us: Annotated[int, Padded(fields.DIGITS, width=5)]
    """After the first, µs."""
    strength: Annotated[int, Padded(fields.DIGITS, width=5)]
    """In the modem's own scale."""


class MultipathReply(msgspec.Struct, frozen=True):
    """The answer to `AT?P`."""

    paths: Annotated[tuple[Path, ...], Lines(Form(Path, "{delay_us} {strength}"))]
    """Eight, those without sound are 0."""


class PositionReply(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to `AT?UP` (frame of the head) and `AT?UPX` (east, north, up)."""

    measured_s: fields.Count
    """System clock, s."""
    address: fields.Address
    """The other modem."""
    x_m: fields.Metres
    """Or east, m."""
    y_m: fields.Metres
    """Or north, m."""
    z_m: fields.Metres
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


def state_words(reply: CommandReply | None) -> str:
    """Return the words of an answer to `AT?S`; empty if it is another one."""
    match reply:
        case LinkStatus() | NetStatus():
            return reply.state
        case TextReply():
            return reply.text
        case _:
            return ""
