"""The two records of objects: a fragment, and a receiver's feedback.

::

    0xBA  transfer (1)  index (2)  data (…)          fragment: four bytes of header
    0xBB  transfer (1)  …                            feedback, at most eight bytes

The low six bits of the transfer byte are the *transfer number*, which the source counts. Of a
fragment, the high two bits are the *listen hint*: when the sender will listen (`ListenHint`). Of a
feedback, they give the kind of its body:

====  =========  ===================================================================================
0     lacks      block (1), how many blocks (1), for each how many fragments it lacks (1 each); all
                 blocks before are complete, of those after nothing is there
1     complete   the first four bytes of the object's digest
2     refused    reason (1)
3     headless   how many fragments are there (2); the manifest is not
====  =========  ===================================================================================

A feedback is sent in a unicast frame to the source of the object. A fragment extends to the end of
the frame, a feedback delimits itself. Index 0xFFFF is no fragment: without data it withdraws the
object; with the first four bytes of its digest, in a unicast frame, it is the *turn*: no sample
before the object will come. A receiver that has all of an object and waits for its turn reports
that it lacks 0 fragments of the block after the last.
"""

import enum
from typing import Final

import msgspec

from zacoustic.core.base.sizes import SIZES
from zacoustic.core.wire.controls import Form

FRAGMENT_CODE: Final = 0xBA
FEEDBACK_CODE: Final = 0xBB
FRAGMENT_HEADER_BYTES: Final = 4
FEEDBACK_BYTES: Final = 8
"""Longest feedback, bytes."""
MOST_BLOCKS: Final = 4
"""The most blocks in one feedback."""
MOST_TRANSFERS: Final = SIZES.transfers
"""How many transfer numbers a source has."""
NO_FRAGMENT: Final = 0xFFFF
"""Index of a record about an object that is no fragment."""
WITHDRAWN: Final = b""
"""The data after that index when the object is withdrawn."""
CHECK_BYTES: Final = 4
"""Bytes of the digest in a feedback, and after `NO_FRAGMENT` in a turn."""
_NUMBER: Final = 0x3F


class ListenHint(enum.IntEnum):
    """When the sender of a fragment will listen."""

    ANSWER = 0
    """After this frame, until it is answered."""
    ANSWER_NEXT = 1
    """After one more frame of this length, until it is answered."""
    WINDOW = 2
    """After this frame, for the length of a listen window."""
    NONE = 3
    """Not after this frame or the next."""


class Reason(enum.IntEnum):
    """Why a receiver refuses an object."""

    CANCELLED = 1
    """Cancelled by the receiver or the sender."""
    TOO_LARGE = 2
    """Larger than the receiver accepts."""
    NOT_SUBSCRIBED = 3
    """The receiver does not subscribe to the stream, or does not know it."""
    FORMER = 4
    """Its lineage is over, as the receiver knows it."""


class Fragment(msgspec.Struct, frozen=True):
    """A fragment of an object; with index `NO_FRAGMENT` its withdrawal or its turn."""

    transfer: int
    call: ListenHint
    index: int
    data: bytes

    def encode(self) -> bytes:
        """Return the record."""
        second = self.call << 6 | self.transfer
        return bytes((FRAGMENT_CODE, second)) + self.index.to_bytes(2, "big") + self.data


class Lacks(msgspec.Struct, frozen=True):
    """What a receiver lacks."""

    transfer: int
    block: int
    """The first incomplete block."""
    lacking: tuple[int, ...]
    """Lacking fragments of that block and those after it, 0…255 each, for 1…`MOST_BLOCKS`
    blocks."""

    @property
    def is_nothing(self) -> bool:
        """Whether nothing is lacking and the receiver waits for the object's turn."""
        return self.lacking == (0,)

    def encode(self) -> bytes:
        """Return the record, 5…8 bytes."""
        body = bytes((self.block, len(self.lacking), *self.lacking))
        return bytes((FEEDBACK_CODE, self.transfer)) + body


class Complete(msgspec.Struct, frozen=True):
    """A receiver has the object."""

    transfer: int
    check: bytes
    """The first bytes of its digest."""

    def encode(self) -> bytes:
        """Return the record, 6 bytes."""
        return bytes((FEEDBACK_CODE, 1 << 6 | self.transfer)) + self.check


class Refused(msgspec.Struct, frozen=True):
    """A receiver refuses the object."""

    transfer: int
    reason: int
    """A `Reason`, or one of a later version."""

    def encode(self) -> bytes:
        """Return the record, 3 bytes."""
        return bytes((FEEDBACK_CODE, 2 << 6 | self.transfer, self.reason))


class Headless(msgspec.Struct, frozen=True):
    """A receiver has fragments and no manifest."""

    transfer: int
    held: int
    """Number of fragments."""

    def encode(self) -> bytes:
        """Return the record, 4 bytes."""
        held = min(self.held, 0xFFFF).to_bytes(2, "big")
        return bytes((FEEDBACK_CODE, 3 << 6 | self.transfer)) + held


Feedback = Lacks | Complete | Refused | Headless


def decode_fragment(record: bytes) -> Fragment | None:
    """Decode a fragment that extends to the end of `record`; None if it is invalid."""
    if len(record) < FRAGMENT_HEADER_BYTES or record[0] != FRAGMENT_CODE:
        return None
    index = int.from_bytes(record[2:4], "big")
    data = record[FRAGMENT_HEADER_BYTES:]
    if len(data) not in (0, CHECK_BYTES) if index == NO_FRAGMENT else not data:
        return None
    return Fragment(record[1] & _NUMBER, ListenHint(record[1] >> 6), index, data)


def decode_feedback(buffer: bytes, offset: int) -> tuple[Feedback, int] | None:
    """Decode a feedback at an offset; return it and its end, or None if it is invalid."""
    body = buffer[offset + 2 : offset + FEEDBACK_BYTES]
    if buffer[offset : offset + 1] != bytes((FEEDBACK_CODE,)) or not body:
        return None
    kind, transfer = buffer[offset + 1] >> 6, buffer[offset + 1] & _NUMBER
    begin = offset + 2
    if kind == 0 and len(body) >= 2:
        count = body[1]
        lacking = tuple(body[2 : 2 + count])
        if 1 <= count <= MOST_BLOCKS and len(lacking) == count:
            return Lacks(transfer, body[0], lacking), begin + 2 + count
    elif kind == 1 and len(body) >= CHECK_BYTES:
        return Complete(transfer, body[:CHECK_BYTES]), begin + CHECK_BYTES
    elif kind == 2:
        return Refused(transfer, body[0]), begin + 1
    elif kind == 3 and len(body) >= 2:
        return Headless(transfer, int.from_bytes(body[:2], "big")), begin + 2
    return None


def _read_fragment(buffer: bytes, offset: int) -> tuple[Fragment, int] | None:
    fragment = decode_fragment(buffer[offset:])
    return None if fragment is None else (fragment, len(buffer))


FORMS: Final[tuple[Form, ...]] = (
    Form(FRAGMENT_CODE, "FRAGMENT", _read_fragment, shows_end=False),
    Form(FEEDBACK_CODE, "FEEDBACK", decode_feedback),
)
