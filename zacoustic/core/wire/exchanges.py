"""What records of calls and goals have in common: the key of an exchange, the text of a failure."""

from typing import Final

import msgspec

LONGEST_ERROR_TEXT_BYTES: Final = 48
"""The text of a failure is cut to this many bytes of UTF-8: it is for people, and airtime is
costly."""


class ExchangeKey(msgspec.Struct, frozen=True):
    """Identifies an exchange at both ends and across restarts.

    As a text ``client/epoch/stream/number``.
    """

    client: int
    """Address of the client."""
    epoch: int
    """The client's boot epoch when it began the exchange."""
    stream_id: int
    """The stream of its service or action."""
    number: int
    """Its number; a later exchange may have it again."""

    def __str__(self) -> str:
        return f"{self.client}/{self.epoch}/{self.stream_id}/{self.number}"


def encode_text(text: str, longest_bytes: int) -> bytes:
    """Return the text of a failure, cut at a character; what is no Unicode becomes ``?``."""
    longest_bytes = max(0, min(longest_bytes, LONGEST_ERROR_TEXT_BYTES))
    return text.encode(errors="replace")[:longest_bytes].decode(errors="ignore").encode()


def decode_text(text: bytes) -> str:
    """Return the text of a failure; empty if it is too long, or no UTF-8."""
    if len(text) > LONGEST_ERROR_TEXT_BYTES:
        return ""
    try:
        return text.decode()
    except UnicodeDecodeError:
        return ""
