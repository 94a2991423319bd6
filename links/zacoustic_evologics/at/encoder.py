"""From records to bytes, in both directions: a host's commands, a modem's messages.

Pure functions. They raise `ValueError` for what the grammar or the device does not allow: a payload
of 65 bytes in an instant message, an acknowledged broadcast, a source level of 4. The decoder of
the other side reads their output as the same record.
"""

import re
from typing import Final, TypeAlias, assert_never

from zacoustic_evologics.at.commands import (
    Act,
    Command,
    Escape,
    ExtensionCommand,
    Help,
    PayloadCommand,
    Query,
    SendBurst,
    SendIm,
    SendIms,
    SendPbm,
    SendProbe,
    Set,
    SetOption,
)
from zacoustic_evologics.at.fields import CLOCK_US, MODEM, PROTOCOL_ID, SIGNED, TARGET, Maybe
from zacoustic_evologics.at.framing import CRLF, TCP_LINE_END, Framing, encode_packet
from zacoustic_evologics.at.layouts import (
    FIRMWARE_1_6_LAYOUT_OF,
    IM_LIMIT_BYTES,
    LAYOUTS_OF,
    Layout,
    encode_columns,
)
from zacoustic_evologics.at.messages import Noise, RawData, Reply
from zacoustic_evologics.at.notifications import (
    AsyncError,
    Extension,
    ImFlag,
    Notification,
    RecvIm,
    RecvPbm,
)
from zacoustic_evologics.at.settings import SETTINGS

BURST_LIMIT_BYTES: Final = 1024
"""Longest burst written: a convention of several drivers; no source knows the modem's limit."""
BROADCAST: Final = 255
"""Address of all nodes."""

Speakable: TypeAlias = Notification | Reply | Noise | RawData
"""All messages of a modem."""

_NAME: Final = re.compile("[A-Z]{1,12}")
_TEXT: Final = re.compile(r"[ -~]*")
_KEY: Final = re.compile(r"[?!@&%*]?[A-Z]{1,12}")
_EXTENSION_KEY: Final = re.compile(r"[!-+\--~]{1,40}")


def encode_command(
    command: Command, framing: Framing = Framing.LINES, line_end: bytes = TCP_LINE_END
) -> bytes:
    """Write a command.

    Args:
        command: The command.
        framing: Framing of the connection; in PACKETS the command gets its `+++`.
        line_end: `TCP_LINE_END` or `SERIAL_LINE_END`, by the port.

    Raises:
        ValueError: The modem would refuse the command.
    """
    if isinstance(command, Escape):
        if framing is Framing.LINES:
            raise ValueError("there is no way out of data mode when lines are read")
        return b"+++"
    prefix = b"+++AT" if framing is Framing.PACKETS else b"AT"
    if isinstance(command, PayloadCommand):
        return prefix + _encode_payload_command(command) + line_end
    return prefix + _encode_line_command(command).encode("ascii") + line_end


def command_name(command: Command) -> str:
    """Return the name that the packet of its answer has: the command without parameters."""
    match command:
        case SendIm() | SendIms() | SendPbm() | SendBurst():
            return _PAYLOAD_NAMES[type(command)]
        case SendProbe():
            return "*SENDPROBE"
        case Query():
            return "?" + command.name
        case Set():
            return "!" + command.name
        case SetOption():
            return "@" + command.name
        case Act():
            return command.action.value
        case Help():
            return command.key + "$"
        case ExtensionCommand():
            return "%" + command.key
        case Escape():
            return ""
        case _:
            assert_never(command)


def encode_message(message: Speakable, framing: Framing = Framing.LINES) -> bytes:
    """Write a modem's message.

    Args:
        message: The record. A `Reply` in PACKETS needs its `command`, in LINES it must have none.
            A reply of several lines ends with a line feed; in LINES the empty line after it is
            written too.
        framing: Framing of the connection.

    Raises:
        ValueError: A value that its field does not allow, or raw data in LINES.
    """
    if isinstance(message, RawData):
        if framing is Framing.LINES:
            raise ValueError("raw data is exchanged in data mode only")
        return message.content
    if isinstance(message, Reply):
        return _encode_reply(message, framing)
    body = _encode_record(message)
    if framing is Framing.LINES:
        return body + CRLF
    return encode_packet("?NOISE" if isinstance(message, Noise) else "", body)


def _encode_payload_command(command: PayloadCommand) -> bytes:
    fields = [] if command.pid is None else ["p" + PROTOCOL_ID.encode(command.pid)]
    fields.append(str(len(command.payload)))
    limit = BURST_LIMIT_BYTES if isinstance(command, SendBurst) else IM_LIMIT_BYTES
    if not 1 <= len(command.payload) <= limit:
        raise ValueError(f"a payload of {len(command.payload)} bytes; allowed: 1..{limit}")
    match command:
        case SendIm():
            if command.destination == BROADCAST and command.flag is ImFlag.ACK:
                raise ValueError(f"nobody acknowledges for {BROADCAST}; allowed: noack, force")
            fields += [TARGET.encode(command.destination), command.flag.value]
        case SendIms():
            start = Maybe(CLOCK_US).encode(command.start_us)
            fields += [TARGET.encode(command.destination), start]
        case SendPbm() | SendBurst():
            fields.append(MODEM.encode(command.destination))
        case _:
            assert_never(command)
    header = ",".join([_PAYLOAD_NAMES[type(command)], *fields, ""])
    return header.encode("ascii") + command.payload


def _encode_line_command(
    command: SendProbe | Query | Set | SetOption | Act | Help | ExtensionCommand,
) -> str:
    match command:
        case SendProbe():
            start = Maybe(CLOCK_US).encode(command.start_us)
            numbers = [SIGNED.encode(command.bit), SIGNED.encode(command.follow)]
            return ",".join(["*SENDPROBE", *numbers, start])
        case Query():
            return "?" + _checked_name(command.name)
        case Set():
            _check_setting(command.name, command.value)
            return f"!{_checked_name(command.name)}{command.value}"
        case SetOption():
            if command.value is None:
                return "@" + _checked_name(command.name)
            _check_setting(command.name, command.value)
            return f"@{_checked_name(command.name)}{command.value}"
        case Act():
            return command.action.value + _encode_act_value(command)
        case Help():
            if not _KEY.fullmatch(command.key):
                raise ValueError(f"help on {command.key!r}; allowed: a command")
            return command.key + "$"
        case ExtensionCommand():
            key = _checked_name(command.key)
            return (
                f"%{key}," + _checked_text(command.parameters) if command.parameters else "%" + key
            )
        case _:
            assert_never(command)


def _encode_act_value(command: Act) -> str:
    if command.value is None:
        return ""
    if command.action.value not in NUMBERED_ACTIONS or not 0 <= command.value <= 255:
        raise ValueError(f"{command.action.name} with {command.value}")
    return str(command.value)


def _check_setting(name: str, value: int) -> None:
    setting = SETTINGS.get(name)
    low, high = (setting.low, setting.high) if setting else (0, 2**32 - 1)
    if not low <= value <= high or (setting and not setting.allows(value)):
        choices = setting.choices if setting else ()
        allowed = ", ".join(map(str, choices)) or f"{low}..{high}"
        raise ValueError(f"setting {name} is {value}; allowed: {allowed}")


def _encode_reply(reply: Reply, framing: Framing) -> bytes:
    text = reply.text.encode("ascii")
    if framing is Framing.PACKETS:
        if reply.command is None:
            raise ValueError("the packet of a reply names its command")
        return encode_packet(reply.command, text)
    if reply.command is not None:
        raise ValueError("a line does not name the command it answers")
    if b"\n" in text and not text.endswith(b"\n"):
        raise ValueError("a reply of several lines ends with a line feed")
    return text + CRLF


def _encode_record(record: Notification | Noise) -> bytes:
    match record:
        case AsyncError():
            return f"ERROR {record.fault.value}".encode("ascii")
        case Extension():
            if not _EXTENSION_KEY.fullmatch(record.key):
                raise ValueError(f"{record.key!r} is no key; allowed: printable, without comma")
            comma = "," if record.parameters else ""
            return f"%{record.key}{comma}{_checked_text(record.parameters)}".encode("ascii")
        case _:
            layout = _layout_of(record)
    fields = encode_columns(layout.columns, record)
    if layout.payload_limit is None:
        return ",".join([layout.token, *fields]).encode("ascii")
    payload: bytes = getattr(record, "payload")  # noqa: B009
    pid: int | None = getattr(record, "pid", None)
    if len(payload) > layout.payload_limit:
        raise ValueError(f"{len(payload)} bytes; allowed: {layout.payload_limit}")
    start = [layout.token] if pid is None else [layout.token, "p" + PROTOCOL_ID.encode(pid)]
    return ",".join([*start, str(len(payload)), *fields, ""]).encode("ascii") + payload


def _layout_of(record: Notification | Noise) -> Layout:
    if isinstance(record, RecvIm | RecvPbm):
        older = record.bit_rate_bps, record.propagation_us
        if None not in older and record.duration_us is None:
            return FIRMWARE_1_6_LAYOUT_OF[type(record)]
        if older != (None, None):
            raise ValueError("fields of two firmwares; allowed: duration, or bit rate and delay")
    return LAYOUTS_OF[type(record)]


def _checked_name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no name of a setting; allowed: 1..12 capital letters")
    return name


def _checked_text(text: str) -> str:
    if not _TEXT.fullmatch(text):
        raise ValueError(f"{text!r} is not printable ASCII in one line")
    return text


NUMBERED_ACTIONS: Final = frozenset("DHIZ")
"""Letters of commands that may carry a number."""
_PAYLOAD_NAMES: Final[dict[type, str]] = {
    SendIm: "*SENDIM",
    SendIms: "*SENDIMS",
    SendPbm: "*SENDPBM",
    SendBurst: "*SEND",
}
