"""From records to bytes, in both directions: a host's commands, a modem's messages.

Pure functions. They raise `ValueError` for what the grammar or the device does not allow: a payload
of 65 bytes in an instant message, an acknowledged broadcast, a source level of 4. The decoder of
the other side reads their output as the same record.
"""

from typing import TypeAlias

from zacoustic_evologics.at.commands import Command, Escape
from zacoustic_evologics.at.framing import CRLF, TCP_LINE_END, Framing, encode_packet
from zacoustic_evologics.at.messages import Noise, RawData, Reply
from zacoustic_evologics.at.notifications import Notification, RecvIm, RecvPbm
from zacoustic_evologics.at.table import COMMANDS, FIRMWARE_1_6, NOTIFICATIONS, Row

Speakable: TypeAlias = Notification | Reply | Noise | RawData
"""All messages of a modem."""


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
    return prefix + COMMANDS[type(command)].encode(command) + line_end


def command_name(command: Command) -> str:
    """Return the name that the packet of its answer has: the command without parameters."""
    return "" if isinstance(command, Escape) else COMMANDS[type(command)].name_of(command)


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
    body = _row_of(message).encode(message)
    if framing is Framing.LINES:
        return body + CRLF
    return encode_packet("?NOISE" if isinstance(message, Noise) else "", body)


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


def _row_of(record: Notification | Noise) -> Row:
    if isinstance(record, RecvIm | RecvPbm):
        older = record.bit_rate_bps, record.propagation_us
        if None not in older and record.duration_us is None:
            return FIRMWARE_1_6[type(record)]
        if older != (None, None):
            raise ValueError("fields of two firmwares; allowed: duration, or bit rate and delay")
    return NOTIFICATIONS[type(record)]
