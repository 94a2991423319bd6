"""DirectIP: how the provider's gateway and the shore exchange messages over TCP.

A message is a version, a length and *elements*, each with an identifier and a length; integers are
big-endian. A message from a modem comes on a connection that the gateway makes; one for a modem
goes on a connection to the gateway, which answers with a confirmation.

Source:
    Iridium Short Burst Data Service Developers Guide, DirectIP; the Rust package `sbd`.
"""

import struct
from typing import Final

import msgspec

VERSION: Final = 1
HEAD_BYTES: Final = 3
MOST_BYTES: Final = 4096
"""Longest message that is read, bytes."""
_MO_HEADER, _PAYLOAD, _MT_HEADER, _MT_PAYLOAD, _CONFIRMATION = 0x01, 0x02, 0x41, 0x42, 0x44
_MO: Final = struct.Struct(">I15sBHHI")
_MT: Final = struct.Struct(">I15sH")
_CONFIRMED: Final = struct.Struct(">I15sIh")


class FromModem(msgspec.Struct, frozen=True):
    """A message that a modem has sent."""

    imei: str
    """Number of the modem."""
    number: int
    """MOMSN: the same again if the modem has sent it again."""
    status: int
    """Status of the session; 0…2: the message is whole."""
    data: bytes
    """Its content; empty for a look into the mailbox."""


class ForModem(msgspec.Struct, frozen=True):
    """A message for a modem."""

    imei: str
    """Number of the modem."""
    client_id: int
    """Comes back in the confirmation."""
    data: bytes
    """Its content."""


class Confirmed(msgspec.Struct, frozen=True):
    """What the gateway says of a message for a modem."""

    client_id: int
    """That of the message."""
    status: int
    """Its place in the queue, ≥ 1, or an error, < 0; 0: it was no message."""


Message = FromModem | ForModem | Confirmed


def encode(message: Message, *, session_time: int = 0) -> bytes:
    """Return the bytes of a message.

    Args:
        message: The message.
        session_time: Of one from a modem, s since 1970.
    """
    match message:
        case FromModem(imei, number, status, data):
            header = _MO.pack(0, imei.encode(), status, number, 0, session_time)
            elements = _element(_MO_HEADER, header) + (_element(_PAYLOAD, data) if data else b"")
        case ForModem(imei, client_id, data):
            header = _MT.pack(client_id, imei.encode(), 0)
            elements = _element(_MT_HEADER, header) + _element(_MT_PAYLOAD, data)
        case Confirmed(client_id, status):
            confirmed = _CONFIRMED.pack(client_id, b"0" * 15, 0, status)
            elements = _element(_CONFIRMATION, confirmed)
    return bytes((VERSION,)) + len(elements).to_bytes(2, "big") + elements


def whole_bytes(head: bytes) -> int | None:
    """Return how many bytes a message has that begins so; None: it is none."""
    if len(head) < HEAD_BYTES or head[0] != VERSION:
        return None
    size_bytes = HEAD_BYTES + int.from_bytes(head[1:3], "big")
    return size_bytes if size_bytes <= MOST_BYTES else None


def decode(encoded: bytes) -> Message | None:
    """Decode a whole message; None: it is not one of these."""
    found = _elements(encoded)
    if found is None:
        return None
    if (header := found.get(_MO_HEADER)) is not None and len(header) == _MO.size:
        _, imei, status, number, _, _ = _MO.unpack(header)
        return FromModem(_text(imei), number, status, found.get(_PAYLOAD, b""))
    if (header := found.get(_MT_HEADER)) is not None and len(header) == _MT.size:
        client_id, imei, _ = _MT.unpack(header)
        return ForModem(_text(imei), client_id, found.get(_MT_PAYLOAD, b""))
    if (header := found.get(_CONFIRMATION)) is not None and len(header) == _CONFIRMED.size:
        client_id, _, _, status = _CONFIRMED.unpack(header)
        return Confirmed(client_id, status)
    return None


def _element(identifier: int, content: bytes) -> bytes:
    return bytes((identifier,)) + len(content).to_bytes(2, "big") + content


def _elements(encoded: bytes) -> dict[int, bytes] | None:
    if whole_bytes(encoded) != len(encoded):
        return None
    found: dict[int, bytes] = {}
    at = HEAD_BYTES
    while at < len(encoded):
        end = at + HEAD_BYTES + int.from_bytes(encoded[at + 1 : at + 3], "big")
        if at + HEAD_BYTES > len(encoded) or end > len(encoded):
            return None
        found[encoded[at]] = encoded[at + HEAD_BYTES : end]
        at = end
    return found


def _text(imei: bytes) -> str:
    return imei.decode("ascii", "replace")
