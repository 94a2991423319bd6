"""Messages from the decoder of a modem's bytes to the dialogue.

The decoder knows no pending command, so it does not interpret a reply: `Reply` holds the text, and
`answers.decode_reply` reads that text by the command. All unsolicited messages are records of
`notifications`. Nothing is lost silently: other bytes become `Unrecognised`, or in data mode
`RawData`.
"""

from typing import TypeAlias

import msgspec

from zacoustic_evologics.at import fields
from zacoustic_evologics.at.notifications import Notification


class Reply(msgspec.Struct, frozen=True):
    """An answer to a command, or one line of it."""

    text: str
    """Without line end. From a packet: all lines at once, each with its line feed. Otherwise one
    line; an empty one ends an answer of several."""
    command: str | None = None
    """Name of the answered command, e.g. `?AL` or `*SENDIM`; None in LINES."""


class Noise(msgspec.Struct, frozen=True, kw_only=True):
    """The answer to `AT?NOISE`: a recording. No source is certain about the three numbers."""

    first: fields.Signed
    """Perhaps the sample rate."""
    second: fields.Signed
    """Perhaps the gain."""
    third: fields.Signed
    """Perhaps the received level."""
    payload: fields.AnyPayload
    """The recording."""


class RawData(msgspec.Struct, frozen=True):
    """Data mode: bytes outside of packets, received or to transmit. Cut anywhere."""

    content: bytes
    """One byte or more."""


class Unrecognised(msgspec.Struct, frozen=True):
    """Bytes outside of the grammar, or damaged."""

    raw: bytes
    """The bytes, without the line end."""


Message: TypeAlias = Notification | Reply | Noise | RawData | Unrecognised
"""All messages of a modem."""
