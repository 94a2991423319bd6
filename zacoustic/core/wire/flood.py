"""FLOOD: a frame that every node passes on once; docs/wire.md has the normative text.

It begins like a relayed frame, with the number of no route::

    BF  1tt00000  origin 1  destination 1  seq 1  age 1  frame

tt is how many further nodes may pass it on; age is that of the frame inside. Both change on the
way, and nothing authenticates them.
"""

from typing import Final

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.values.age import UNKNOWN
from zacoustic.core.wire.relay import FIRST_PORT, RELAY_CODE

HEADER_BYTES: Final = 6
"""Bytes before the frame."""
MOST_HOPS: Final = 4
"""The most hops of a flooded frame."""
FLOOD_PORT: Final = FIRST_PORT - 1
"""In sealed frames flooded ones have the number of a link: this one."""
_FLOOD: Final = 0x80
_LEFT_SHIFT: Final = 5
_LEFT: Final = 0x60


class Flooded(msgspec.Struct, frozen=True):
    """A frame that is passed on by everybody."""

    origin: int
    """Address of the node that has made it, 1…254."""
    destination: int
    """Address of the node that it is for, or 255: all."""
    seq: int
    """Its number at its origin, 0…255."""
    left: int
    """How many further nodes may pass it on, 0…3."""
    content: bytes
    """The frame, as the origin gives it to its streams."""
    age: int = UNKNOWN
    """Code of the time since its content was made."""

    def encode(self) -> bytes:
        """Return the content of the frame of one hop."""
        head = (RELAY_CODE, _FLOOD | self.left << _LEFT_SHIFT)
        fields = (*head, self.origin, self.destination, self.seq, self.age)
        return bytes(fields) + self.content


def is_flooded(content: bytes) -> bool:
    """Return whether the content of a frame is for every node to pass on."""
    return len(content) > 1 and content[0] == RELAY_CODE and content[1] & ~_LEFT == _FLOOD


def decode(content: bytes) -> Flooded | None:
    """Decode the content of a frame that `is_flooded`; None: it is cut off, or of nobody."""
    if len(content) <= HEADER_BYTES or not is_flooded(content):
        return None
    _, first, origin, destination, seq, age = content[:HEADER_BYTES]
    if origin in (0, BROADCAST) or destination in (0, origin):
        return None
    left = (first & _LEFT) >> _LEFT_SHIFT
    return Flooded(origin, destination, seq, left, content[HEADER_BYTES:], age)
