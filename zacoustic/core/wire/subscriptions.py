"""The record of subscriptions: eight streams at a time, and the answer.

::

    BC  page 1  version 1  streams 1

page
    the low five bits: which eight stream ids (page *p* is 8 *p* … 8 *p* + 7); ``80`` set: an
    answer, which repeats what it answers; the other bits are 0, and ignored
version
    counts the sender's messages about the page, modulo 256
streams
    bit *i* set: the sender subscribes to stream 8 *p* + *i* at the destination
"""

from collections.abc import Iterable, Iterator
from typing import Final

import msgspec

from zacoustic.core.wire.controls import Form, fixed

SUBSCRIBE_CODE: Final = 0xBC
SUBSCRIBE_BYTES: Final = 4
"""Size with the code."""
PAGE_STREAMS: Final = 8
"""Streams of a page."""
_PAGE: Final = 0x1F
_ANSWER: Final = 0x80


class Subscribe(msgspec.Struct, frozen=True):
    """What a node wants of the one that the frame is for; or, in return, what that has noted."""

    page: int
    """Which eight streams."""
    version: int
    """Counts the messages about the page, modulo 256."""
    streams: int
    """Bit *i*: the *i*-th stream of the page."""
    is_answer: bool = False
    """It repeats a message, to acknowledge it."""

    @property
    def body(self) -> bytes:
        """The three bytes behind the code."""
        return bytes((self.page | (_ANSWER if self.is_answer else 0), self.version, self.streams))

    def encode(self) -> bytes:
        """Return the four bytes of the control."""
        return bytes((SUBSCRIBE_CODE,)) + self.body

    @staticmethod
    def decode(body: bytes) -> "Subscribe":
        """Read the three bytes behind the code."""
        return Subscribe(body[0] & _PAGE, body[1], body[2], bool(body[0] & _ANSWER))


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


FORMS: Final[tuple[Form, ...]] = (
    fixed(SUBSCRIBE_CODE, "SUBSCRIBE", SUBSCRIBE_BYTES, Subscribe.decode),
)
