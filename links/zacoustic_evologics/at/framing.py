"""The division of a connection's bytes: into lines, or into raw data with packets in it.

A modem has two interpreters, and one of them two modes:

- NET: lines, always.
- AT, in command mode: lines.
- AT, in data mode (after power-up and reset): every byte is acoustic data, out or in, except
  commands that begin with `+++AT`, and their answers, which come as packets
  ``+++AT<name>:<length>:<body>CRLF``. Vendor word: TIES, time-independent escape sequence.

So a connection is either in LINES or in PACKETS. In a packet only the length counts: a body may
contain CR LF and whole packets.
"""

import enum
import re
from typing import Final

import msgspec

PACKET_START: Final = b"+++AT"
"""Begins a command in data mode, and every packet."""
CRLF: Final = b"\r\n"
"""Ends all messages of a modem, on every kind of port."""
TCP_LINE_END: Final = b"\n"
"""Ends a command on a TCP port."""
SERIAL_LINE_END: Final = b"\r"
"""Ends a command on a serial port. After CR LF a modem may see an empty line."""
PAYLOAD_LIMIT_BYTES: Final = 16_384
"""Longest payload to wait for: a whole default transmit pool. The longest known is a burst of 1024
bytes."""
HEADER_LIMIT_BYTES: Final = 160
"""Longest text before a payload; ten fields of ten digits are 110."""
BODY_LIMIT_BYTES: Final = PAYLOAD_LIMIT_BYTES + HEADER_LIMIT_BYTES
"""Longest body of a packet to wait for."""

_PACKET_HEADER: Final = re.compile(rb"\+{3}AT([!-*,-9;-~]{0,32}):([0-9]{1,5}):")
_PACKET_HEADER_PART: Final = re.compile(rb"\+{3}AT[!-*,-9;-~]{0,32}(:[0-9]{0,5})?")
_PACKET_HEADER_LIMIT: Final = len("+++AT") + 32 + 1 + 5 + 1


_LENGTH: Final = re.compile(rb"[^,]*,(?:p[0-9]{1,3},)?([0-9]{1,6}),")


class Interpreter(enum.Enum):
    """Interpreter of the commands on a port; the answer to `AT?MODE`."""

    NET = "NET"
    """Networking interpreter."""
    AT = "AT"
    """AT interpreter, with its two modes."""


class Framing(enum.Enum):
    """How the bytes of a connection are divided."""

    LINES = "lines"
    """NET interpreter, or AT interpreter in command mode."""
    PACKETS = "packets"
    """AT interpreter in data mode."""


class Gap(enum.Enum):
    """Why something could not be read at this place."""

    INCOMPLETE = "incomplete"
    """More bytes will decide."""
    MALFORMED = "malformed"
    """No following byte can make it valid."""


class Packet(msgspec.Struct, frozen=True):
    """A whole packet."""

    name: str
    """The command it answers, without parameters; empty in a notification."""
    body: bytes
    """Its content."""
    end: int
    """Number of bytes it took."""


class Header(msgspec.Struct, frozen=True):
    """The text before a payload."""

    text: str
    """From the name to the last comma."""
    payload_start: int
    """Where the payload begins."""
    payload_end: int
    """Where it ends."""


def read_packet(buffer: bytes | bytearray, start: int = 0) -> Packet | Gap:
    """Read the packet whose `+++AT` is at `start`.

    Returns:
        The packet; MALFORMED if this is no packet, or no CR LF follows its body.
    """
    head = bytes(buffer[start : start + _PACKET_HEADER_LIMIT])
    match = _PACKET_HEADER.match(head)
    if not match:
        return Gap.INCOMPLETE if _PACKET_HEADER_PART.fullmatch(head) else Gap.MALFORMED
    length = int(match[2])
    body_start = start + match.end()
    body_end = body_start + length
    if length > BODY_LIMIT_BYTES:
        return Gap.MALFORMED
    found = bytes(buffer[body_end : body_end + len(CRLF)])
    if not CRLF.startswith(found):
        return Gap.MALFORMED
    if found != CRLF:
        return Gap.INCOMPLETE
    return Packet(match[1].decode("ascii"), bytes(buffer[body_start:body_end]), body_end + 2)


def encode_packet(name: str, body: bytes) -> bytes:
    """Wrap a body.

    Raises:
        ValueError: The body is too long, or the name is not valid.
    """
    packet = b"%s%s:%d:%s\r\n" % (PACKET_START, name.encode("ascii"), len(body), body)
    if len(body) > BODY_LIMIT_BYTES or not _PACKET_HEADER.match(packet):
        raise ValueError(f"no packet {name!r} of {len(body)} bytes; allowed: {BODY_LIMIT_BYTES}")
    return packet


def read_header(
    buffer: bytes | bytearray, start: int, commas: int, payload_limit: int
) -> Header | Gap:
    """Read ``NAME,[p<pid>,]<length>,<field>,…,``; the fields are not judged.

    Args:
        buffer: Has the name and a comma at `start`.
        start: Where the header begins.
        commas: Number of commas in a header without protocol id.
        payload_limit: Longest payload that a header may announce, bytes.
    """
    head = bytes(buffer[start : start + HEADER_LIMIT_BYTES])
    commas += head.startswith(b"p", head.find(b",") + 1)
    pieces = head.split(b",", commas)
    text = b"".join(piece + b"," for piece in pieces[:commas])
    is_short = len(pieces) <= commas
    if b"\r" in text or b"\n" in text or (is_short and len(head) == HEADER_LIMIT_BYTES):
        return Gap.MALFORMED
    if is_short:
        return Gap.INCOMPLETE
    match = _LENGTH.match(text)
    if match is None or int(match[1]) > payload_limit:
        return Gap.MALFORMED
    payload_start = start + len(text)
    return Header(text.decode("latin-1"), payload_start, payload_start + int(match[1]))
