"""The frames of bonds; docs/wire.md has the normative text.

A frame of a bond begins like one of a route, and bonds and routes share their numbers::

    BF  0a0rrrrr  seq 1  age 1  frame
                                     frame number seq of bond r = 1…31; a: its receivers answer;
                                     age: of the frame inside, as this one begins
    BF  010rrrrr  seq 1              only asks for that answer

The answer is an extension of a frame of the bond, so it is as authentic as that::

    B2 n FF  (link 1  seq 1)+        these frames have come by these links, counted from 0 in the
                                     list of the bond
"""

from collections.abc import Iterable
from typing import Final

import msgspec

from zacoustic.core.values.age import UNKNOWN
from zacoustic.core.wire.controls import LAST_EXTENSION, Extension
from zacoustic.core.wire.relay import HEADER_BYTES, LAST_ROUTE, NUMBERS, RELAY_CODE

ANSWER_CODE: Final = LAST_EXTENSION
"""Code of the extension that answers."""
MOST_ANSWERS: Final = 16
"""The most frames that one extension answers."""
_QUESTION_BYTES: Final = 3
_WANTS_ANSWER: Final = 0x40
_NUMBER: Final = 0x1F

Answers = tuple[tuple[int, int], ...]
"""Index of the link and number of the frame, of each frame that is answered."""


class Bonded(msgspec.Struct, frozen=True):
    """A frame of a bond."""

    number: int
    """Number of the bond, 1…31."""
    seq: int
    """Number of the frame, 0…255."""
    content: bytes
    """The frame, as the bond gives it to its streams; empty: it only asks."""
    wants_answer: bool = False
    """Whether its receivers answer."""
    age: int = UNKNOWN
    """Code of the time since its content was made."""

    def encode(self) -> bytes:
        """Return the content of a frame of one of the links."""
        first = self.number | _WANTS_ANSWER * self.wants_answer
        inside = bytes((self.age,)) + self.content if self.content else b""
        return bytes((RELAY_CODE, first, self.seq)) + inside


def bond_of(content: bytes) -> int:
    """Return the number of the bond, or route, in the content of a frame that begins with BF."""
    return content[1] & _NUMBER if len(content) > 1 else 0


def decode(content: bytes) -> Bonded | None:
    """Decode the content of a frame of a bond; None: it is cut off, or not of this wire."""
    if len(content) < _QUESTION_BYTES or content[0] != RELAY_CODE:
        return None
    number = content[1] & _NUMBER
    if not 1 <= number <= LAST_ROUTE or content[1] & ~(_WANTS_ANSWER | _NUMBER):
        return None
    wants_answer = bool(content[1] & _WANTS_ANSWER)
    if len(content) == _QUESTION_BYTES:
        return Bonded(number, content[2], b"", True) if wants_answer else None
    if len(content) == HEADER_BYTES:
        return None
    return Bonded(number, content[2], content[HEADER_BYTES:], wants_answer, content[3])


def encode_answers(answers: Iterable[tuple[int, int]]) -> bytes:
    """Return the extension that answers frames, `MOST_ANSWERS` at the most."""
    body = b"".join(bytes((link, seq % NUMBERS)) for link, seq in answers)
    return Extension(ANSWER_CODE, body).encode()


def decode_answers(body: bytes) -> Answers | None:
    """Return what an extension answers; None: it is cut off or too long."""
    if len(body) % 2 or not 2 <= len(body) <= 2 * MOST_ANSWERS:
        return None
    return tuple((body[at], body[at + 1]) for at in range(0, len(body), 2))
