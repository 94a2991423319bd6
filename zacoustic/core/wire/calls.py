"""Records of services: after the stream id one byte, two bits kind and six bits call number.

`zacoustic.core.transport.calls.calls` defines what the kinds mean and when a number is reused.
"""

import enum
from typing import Final

from zacoustic.core.wire.exchanges import (
    LONGEST_ERROR_TEXT_BYTES,
    ExchangeKey,
    decode_text,
    encode_text,
)

NAME_BYTES: Final = 1
"""Additional bytes of a named answer."""


class CallKey(ExchangeKey, frozen=True):
    """Identifies a call at its server; a number is reused after 64 calls at the earliest."""


class CallFailure(enum.IntEnum):
    """Why a call has no response; the numbers are on the wire."""

    HANDLER = 1
    """The handler of the service failed; it gives the text."""
    NO_SERVER = 2
    """The server's node has no server."""
    BAD_REQUEST = 3
    """The server's node could not decode the request."""
    TABLE_MISMATCH = 4
    """The two nodes hold different definitions of this stream."""
    BAD_RESPONSE = 5
    """This node could not decode the response."""
    TIMED_OUT = 6
    """No answer before the deadline. Whether the service ran is unknown."""
    CANCELLED = 7
    """Cancelled by the caller."""
    UNKNOWN = 8
    """The server ended without an answer: whether the service ran is unknown."""


class CallKind(enum.IntEnum):
    """The two upper bits of the call byte."""

    REQUEST = 0
    RESPONSE = 1
    ERROR = 2
    CONFIRM = 3
    """From the server: it has the request. From the client: it has the answer."""


NAMED: Final = CallKind.REQUEST
"""From the server: a response, error or confirm that names the client's boot epoch. One byte
precedes its payload: two bits kind, and the lower six bits of the epoch."""


def encode_call_byte(kind: CallKind, number: int) -> int:
    """Return the byte after the stream id of a service's record."""
    return kind << 6 | number


def decode_call_byte(byte: int) -> tuple[CallKind, int]:
    """Return kind and number of a call byte."""
    return CallKind(byte >> 6), byte & 0x3F


def encode_name(kind: CallKind, epoch: int) -> bytes:
    """Return the byte after the call byte of a named answer."""
    return bytes((kind << 6 | epoch & 0x3F,))


def decode_name(content: bytes, epoch: int) -> CallKind | None:
    """Return the kind of a named answer for this epoch; None: it is for another epoch.

    Args:
        content: The bytes after the call byte.
        epoch: This node's epoch.
    """
    if not content or (content[0] ^ epoch) & 0x3F:
        return None
    return CallKind(content[0] >> 6)


def encode_error(
    failure: CallFailure, text: str, longest_bytes: int = LONGEST_ERROR_TEXT_BYTES
) -> bytes:
    """Return the payload of an error: its number and its text, cut at a character."""
    return bytes((failure,)) + encode_text(text, longest_bytes)


def decode_error(payload: bytes) -> tuple[CallFailure, str] | None:
    """Return number and text of an error's payload; None if its number is not listed."""
    try:
        return CallFailure(payload[0]), decode_text(payload[1:])
    except (IndexError, ValueError):
        return None
