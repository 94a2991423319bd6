"""RELAY: the frame of another link inside a frame of this one; docs/wire.md has the normative text.

A frame that begins with `RELAY_CODE` has no records::

    BF  dmurrrrr  seq 1  age 1  frame
                                    the frame of route r = 1…31, one hop further; d: towards the
                                    first node of the path; m: another one follows at once; u: it is
                                    urgent; age: of the frame inside, as this one begins
    BF  0m000000  (d00rrrrr seq 1)+ these frames have arrived where nobody will transmit them again
    BF  00100000  run 1  number 1   a probe: whoever hears it counts it

The direction must be in the frame. Its sender does not tell it: who hears the next node of a path
transmit hears either its own frame one hop further, or a frame that comes the other way.
"""

from collections.abc import Sequence
from typing import Final, TypeAlias

import msgspec

from zacoustic.core.base.sizes import SIZES
from zacoustic.core.values.age import UNKNOWN
from zacoustic.core.wire.seal import LAST_PORT

RELAY_CODE: Final = 0xBF
"""First byte of a relayed frame; no sealed frame begins with it."""
LAST_ROUTE: Final = 31
"""Routes have the numbers from 1 to this one."""
FIRST_PORT: Final = LAST_PORT + 1 - LAST_ROUTE
"""In sealed frames a route has the number of a link: this one for the first route."""
HEADER_BYTES: Final = 4
"""Bytes before the frame of the route."""
NUMBERS: Final = SIZES.hops
"""The number of a frame is modulo this."""
MOST_PROBES: Final = 32
"""The most probes of a run; their numbers are below."""
PROBE_BYTES: Final = 4
"""A probe without envelope."""
_HOP_ACKS: Final = 0
_PROBE: Final = 0x20
_ENTRY_BYTES: Final = 2
_BACK: Final = 0x80
_MORE: Final = 0x40
_URGENT: Final = 0x20
_ROUTE: Final = 0x1F


class Number(msgspec.Struct, frozen=True):
    """Which frame of a route, within the lifetime of the route."""

    route: int
    """The route, 1…31."""
    is_back: bool
    """Whether it goes from the last node of the path to the first."""
    seq: int
    """Its number, 0…255."""

    def encode(self) -> bytes:
        """Return its two bytes."""
        return bytes((self.route | _BACK * self.is_back, self.seq))


class Relayed(msgspec.Struct, frozen=True):
    """A frame of a route."""

    number: Number
    """Which one."""
    content: bytes
    """The frame, as the link of the route gives it to its ends."""
    more: bool = False
    """Whether the sender transmits another frame of this route right after it."""
    is_urgent: bool = False
    """Whether it goes before all others."""
    age: int = UNKNOWN
    """Code of the time since its content was made."""

    def encode(self) -> bytes:
        """Return the content of the frame of one hop."""
        first, seq = self.number.encode()
        first |= _MORE * self.more | _URGENT * self.is_urgent
        return bytes((RELAY_CODE, first, seq, self.age)) + self.content


class HopAcks(msgspec.Struct, frozen=True):
    """Frames that have arrived at a node which will not transmit them again."""

    numbers: tuple[Number, ...]
    """Which ones."""
    more: bool = False
    """Whether the sender transmits a frame of a route right after it."""

    def encode(self) -> bytes:
        """Return the content of the frame."""
        return bytes((RELAY_CODE, _HOP_ACKS | _MORE * self.more)) + b"".join(
            each.encode() for each in self.numbers
        )


class Probe(msgspec.Struct, frozen=True):
    """A small frame that is counted by whoever hears it."""

    run: int
    """Of which run it is, 0…255; a run is of one node."""
    number: int
    """Its number in the run, 0…31."""

    def encode(self) -> bytes:
        """Return the content of the frame."""
        return bytes((RELAY_CODE, _PROBE, self.run, self.number))


RelayContent: TypeAlias = Relayed | HopAcks
"""What a frame that begins with `RELAY_CODE` holds."""


def hop_acks_in(room_bytes: int) -> int:
    """Return how many numbers fit a frame of hop acknowledgements."""
    return max(0, (room_bytes - 2) // _ENTRY_BYTES)


def is_relayed(content: bytes) -> bool:
    """Return whether the content of a frame is for relays and the ends of routes."""
    return content[:1] == bytes((RELAY_CODE,))


def decode_probe(content: bytes) -> Probe | None:
    """Decode a probe; None: the content of the frame is something else."""
    if len(content) != PROBE_BYTES or content[:2] != bytes((RELAY_CODE, _PROBE)):
        return None
    return Probe(content[2], content[3]) if content[3] < MOST_PROBES else None


def decode(content: bytes) -> RelayContent | None:
    """Decode the content of a frame that `is_relayed`; None: it is cut off, or not of this wire."""
    if len(content) < HEADER_BYTES:
        return None
    if content[1] & ~_MORE != _HOP_ACKS:
        first, seq, frame = content[1], content[2], content[HEADER_BYTES:]
        number = _number((first & ~(_MORE | _URGENT), seq))
        if number is None or not frame:
            return None
        return Relayed(number, frame, bool(first & _MORE), bool(first & _URGENT), content[3])
    entries = content[2:]
    if len(entries) % _ENTRY_BYTES:
        return None
    pairs = (entries[at : at + _ENTRY_BYTES] for at in range(0, len(entries), _ENTRY_BYTES))
    numbers = tuple(map(_number, pairs))
    if not all(numbers):
        return None
    return HopAcks(tuple(each for each in numbers if each), bool(content[1] & _MORE))


def _number(encoded: Sequence[int]) -> Number | None:
    first, seq = encoded
    is_valid = first & _ROUTE and not first & ~(_ROUTE | _BACK)
    return Number(first & _ROUTE, bool(first & _BACK), seq) if is_valid else None
