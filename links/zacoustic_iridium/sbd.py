"""What an SBD modem and its host exchange beside AT lines: checked data, and sessions.

Source:
    Iridium 9602 SBD transceiver AT command reference: +SBDWB, +SBDRB, +SBDIX; the tables of status
    words are also in DUNE and in the Rust package `sbd`.
"""

import re
from typing import Final

import msgspec

CHECK_BYTES: Final = 2
LENGTH_BYTES: Final = 2
SENT: Final = range(5)
"""Status words of a session whose message the gateway has."""
MAYBE_SENT: Final = frozenset({10, 13, 17, 18})
"""Those of one that broke off: the gateway may have it."""
_SESSION: Final = re.compile(r"\+SBDIX: ?(\d+), ?(\d+), ?(\d+), ?(\d+), ?(\d+), ?(\d+)")

_BUFFERS: Final = re.compile(r"\+SBDS: ?(\d+), ?(\d+), ?(\d+), ?(-?\d+)")

STATUS_WORDS: Final = {
    10: "the gateway took too long",
    11: "the gateway's queue is full",
    12: "too many segments",
    13: "the session broke off",
    14: "invalid segment size",
    15: "access is denied",
    16: "the modem is locked",
    17: "the gateway does not answer",
    18: "the connection was lost",
    19: "the link failed",
    32: "no network",
    33: "antenna fault",
    34: "the radio is off",
    35: "the modem is busy",
    36: "try again in three minutes",
    37: "the service is blocked for a time",
    38: "try again later: traffic is managed",
}


class Session(msgspec.Struct, frozen=True):
    """The result of a session."""

    sent: int
    """Status word of the message from the modem."""
    sent_number: int
    """Its number, MOMSN; the same again if the buffer is sent again."""
    received: int
    """0: no message for the modem, 1: one has come, 2: an error."""
    received_number: int
    """Its number, MTMSN."""
    received_bytes: int
    """Its size, bytes."""
    waiting: int
    """How many more wait at the gateway."""


class Buffers(msgspec.Struct, frozen=True):
    """What the modem holds."""

    has_message: bool
    """Whether there is a message to send."""
    next_number: int
    """The MOMSN of the next session: it grows with each that succeeds, a look included."""


def checked(data: bytes) -> bytes:
    """Return data with the sum of its bytes behind it."""
    return data + (sum(data) & 0xFFFF).to_bytes(CHECK_BYTES, "big")


def take_message(buffer: bytes) -> tuple[bytes | None, int] | None:
    """Take the answer to +SBDRB from the begin of a buffer.

    Returns:
        The message, or None if its sum is wrong, and how many bytes it takes; None: more bytes are
        needed.
    """
    if len(buffer) < LENGTH_BYTES:
        return None
    end = LENGTH_BYTES + int.from_bytes(buffer[:LENGTH_BYTES], "big")
    if len(buffer) < end + CHECK_BYTES:
        return None
    data = buffer[LENGTH_BYTES:end]
    is_whole = checked(data) == buffer[LENGTH_BYTES : end + CHECK_BYTES]
    return (data if is_whole else None), end + CHECK_BYTES


def session_in(line: str) -> Session | None:
    """Return the session that a line reports, or None."""
    found = _SESSION.fullmatch(line)
    return None if found is None else Session(*map(int, found.groups()))


def buffers_in(line: str) -> Buffers | None:
    """Return what a line says of the modem's buffers, or None."""
    found = _BUFFERS.fullmatch(line)
    return None if found is None else Buffers(found[1] == "1", int(found[2]))


def status_words(status: int) -> str:
    """Return a status word in words."""
    return f"status {status}: {STATUS_WORDS.get(status, 'unknown')}"
