"""The commands of a host to a modem, one record for each form.

Queries and settings are open: `Query("XY")` exists whether a modem knows it or not, since each
firmware adds some; `settings` lists the known ones with their limits. A record accepts values out
of range, because an emulator must be able to read and refuse them; `encoder` refuses to write them.
"""

import enum
from typing import TypeAlias

import msgspec

from zacoustic_evologics.at import fields, refusals
from zacoustic_evologics.at.notifications import ImFlag


class SendIm(msgspec.Struct, frozen=True, kw_only=True):
    """`AT*SENDIM`: an instant message, at once."""

    payload: fields.MessageSent
    """1…64 bytes."""
    destination: fields.Target
    """1…254, or 255 for broadcast, which is only possible without acknowledgement."""
    flag: ImFlag = ImFlag.NOACK
    """Whether the other modem acknowledges."""
    pid: fields.AskedProtocolId = None
    """Protocol id 0…7, with extended networking only."""


class SendIms(msgspec.Struct, frozen=True, kw_only=True):
    """`AT*SENDIMS`: an instant message at an instant; never acknowledged."""

    payload: fields.MessageSent
    """1…64 bytes."""
    destination: fields.Target
    """1…255."""
    start_us: fields.Start = None
    """Modem's clock at its start; None: at once."""
    pid: fields.AskedProtocolId = None
    """Protocol id 0…7, with extended networking only."""


class SendPbm(msgspec.Struct, frozen=True, kw_only=True):
    """`AT*SENDPBM`: waits until the modem sends something to that address, and goes with it."""

    payload: fields.MessageSent
    """1…64 bytes."""
    destination: fields.Modem
    """1…254."""
    pid: fields.AskedProtocolId = None
    """Protocol id 0…7, with extended networking only."""


class SendBurst(msgspec.Struct, frozen=True, kw_only=True):
    """`AT*SEND`: burst data, over a connection that the modem sets up."""

    payload: fields.BurstSent
    """1…1024 bytes."""
    destination: fields.Modem
    """1…254."""
    pid: fields.AskedProtocolId = None
    """Protocol id 0…7, with extended networking only."""


class SendProbe(msgspec.Struct, frozen=True, kw_only=True):
    """`AT*SENDPROBE`: a probe signal."""

    bit: fields.Signed
    """The bit that it carries."""
    follow: fields.Signed
    """Passed to the modem; no source explains it."""
    start_us: fields.Start = None
    """Modem's clock at its start; None: at once."""


class Query(msgspec.Struct, frozen=True):
    """`AT?NAME`: read a setting or a measurement."""

    name: fields.Name
    """Capital letters."""


class Set(msgspec.Struct, frozen=True):
    """`AT!NAME<n>`: change a setting of the modem until it is switched off."""

    name: fields.Name
    """Capital letters."""
    value: fields.Value
    """The new value."""


class SetOption(msgspec.Struct, frozen=True):
    """`AT@NAME[<n>]`: change an option of this port, or an action without another form."""

    name: fields.Name
    """Capital letters."""
    value: fields.OptionalValue = None
    """None for options without a value, such as `AT@CTRL`."""


class Action(enum.Enum):
    """The commands of one letter; the value is the letter."""

    ATTENTION = ""
    """No action; answered `OK`."""
    LISTEN = "A"
    """Leave any other state, and listen."""
    COMMAND_MODE = "C"
    """Leave data mode."""
    CONNECT = "D"
    """Connect to the remote address, or to the one given."""
    HANG_UP = "H"
    """Close the connection: 0 gracefully, 1 at once."""
    INFORMATION = "I"
    """0 or none firmware, 1 its parts, 2 serial number, 7 manufacturer."""
    MEASURE_NOISE = "N"
    """Go to the state that measures noise, without connections."""
    DATA_MODE = "O"
    """Go to data mode; not answered."""
    PHYSICAL = "P"
    """Give the physical layer over to another protocol."""
    DEAF = "S"
    """Stop listening."""
    RESET = "Z"
    """0 restart, not answered; 1 drop burst data; 3 drop instant messages; 4 empty the buffer."""
    SHOW_SETTINGS = "&V"
    """All settings in many lines."""
    STORE_SETTINGS = "&W"
    """Store the settings permanently."""
    FACTORY_SETTINGS = "&F"
    """Restore the factory settings."""


class Act(msgspec.Struct, frozen=True):
    """`AT<letter>[<n>]`: an action of the modem."""

    action: Action
    """The action."""
    value: fields.ActionValue = None
    """The number after the letter, if any."""


class Help(msgspec.Struct, frozen=True):
    """`AT<key>$`: explain a command."""

    key: fields.Key
    """The text between `AT` and `$`."""


class ExtensionCommand(msgspec.Struct, frozen=True):
    """`AT%KEY[,parameters]`: for the vendor's middleware, not for a modem."""

    key: fields.Name
    """Capital letters."""
    parameters: fields.Parameters = ""
    """The text after the first comma."""


class Escape(msgspec.Struct, frozen=True):
    """`+++` alone, with a second of silence around it: leave data mode."""


PayloadCommand: TypeAlias = SendIm | SendIms | SendPbm | SendBurst
"""Commands that carry a payload."""
LineCommand: TypeAlias = (
    SendProbe | Query | Set | SetOption | Act | Help | ExtensionCommand | Escape
)
"""Commands without a payload."""
Command: TypeAlias = PayloadCommand | LineCommand
"""All commands."""


class Mistake(enum.Enum):
    """Faults of an unreadable command; the value is the modem's answer."""

    WRONG_FORMAT = refusals.WRONG_FORMAT
    """A number is missing, a payload has a wrong length, or `+++` is not allowed."""
    UNKNOWN_COMMAND = refusals.UNKNOWN_COMMAND
    """No command has that letter."""


class InvalidCommand(msgspec.Struct, frozen=True):
    """Bytes of a host that are not a command."""

    raw: bytes
    """The bytes, without line end; shortened if long."""
    mistake: Mistake
    """The fault."""
    name: str = ""
    """Name of the presumed command, for the header of the answer in data mode."""
