"""The record of subscriptions: eight streams at a time, and the answer.

::

    BC  page 1  version 1  streams 1  [ heard 2 ]

page
    the low five bits: which eight stream ids (page *p* is 8 *p* … 8 *p* + 7); ``80`` set: an
    answer, which repeats the message; ``40`` set: heard follows; ``20`` set, in an answer: the
    message holds until the next one
version
    counts the sender's messages about the page, modulo 256
streams
    bit *i* set: the sender subscribes to stream 8 *p* + *i* at the destination
heard
    the destination's boot epoch that the sender has heard
"""

from collections.abc import Iterable, Iterator
from typing import Final

import msgspec

from zacoustic.core.wire.controls import Form

SUBSCRIBE_CODE: Final = 0xBC
PAGE_STREAMS: Final = 8
"""Number of streams in a page."""
_PAGE: Final = 0x1F
_ANSWER: Final = 0x80
_HEARD: Final = 0x40
_KEPT: Final = 0x20
_BODY_BYTES: Final = 3
_HEARD_BYTES: Final = 2


class Subscribe(msgspec.Struct, frozen=True):
    """A node's subscriptions at the frame's destination, or the answer to them."""

    page: int
    """The page: which eight streams."""
    version: int
    """Counts the messages about the page, modulo 256."""
    streams: int
    """Bit *i*: the *i*-th stream of the page."""
    is_answer: bool = False
    """Whether it repeats a message to acknowledge it."""
    heard: int | None = None
    """Boot epoch of the frame's destination; None: the sender knows none."""
    is_kept: bool = False
    """In an answer: whether the message holds until the next one."""

    @property
    def body(self) -> bytes:
        """The bytes after the code."""
        flags = _ANSWER * self.is_answer | _KEPT * self.is_kept
        if self.heard is None:
            return bytes((self.page | flags, self.version, self.streams))
        head = bytes((self.page | flags | _HEARD, self.version, self.streams))
        return head + self.heard.to_bytes(_HEARD_BYTES, "big")

    def encode(self) -> bytes:
        """Return the control."""
        return bytes((SUBSCRIBE_CODE,)) + self.body

    @staticmethod
    def decode(body: bytes) -> "Subscribe":
        """Decode the bytes after the code."""
        return Subscribe(
            body[0] & _PAGE,
            body[1],
            body[2],
            is_answer=bool(body[0] & _ANSWER),
            heard=int.from_bytes(body[_BODY_BYTES:], "big") if body[0] & _HEARD else None,
            is_kept=bool(body[0] & _KEPT),
        )


def page_of(stream_id: int) -> int:
    """Return the page of a stream."""
    return stream_id // PAGE_STREAMS


def streams_of(page: int, bits: int) -> Iterator[int]:
    """Yield the streams of a page whose bits are set."""
    for place in range(PAGE_STREAMS):
        if bits >> place & 1:
            yield page * PAGE_STREAMS + place


def bits_of(stream_ids: Iterable[int]) -> int:
    """Return the bits of streams of one page."""
    return sum(1 << stream_id % PAGE_STREAMS for stream_id in set(stream_ids))


def _read(buffer: bytes, offset: int) -> tuple[Subscribe, int] | None:
    begin = offset + 1
    has_heard = begin < len(buffer) and buffer[begin] & _HEARD
    end = begin + _BODY_BYTES + (_HEARD_BYTES if has_heard else 0)
    return None if end > len(buffer) else (Subscribe.decode(buffer[begin:end]), end)


FORMS: Final[tuple[Form, ...]] = (Form(SUBSCRIBE_CODE, "SUBSCRIBE", _read),)
