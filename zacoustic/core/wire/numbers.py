"""Sequence numbers of samples in records, and the content of an ACK."""

from typing import Final

import msgspec

from zacoustic.core.base.sizes import SIZES

NUMBERS: Final = SIZES.samples.count
"""How many numbers one byte of a record distinguishes."""
WINDOW: Final = SIZES.samples.window
"""The most numbers that an ACK covers (`zacoustic.core.base.sizes.SampleNumbering`)."""
NUMBER_BYTES: Final = 1
IN_RHYTHM: Final = 0x80
"""Bit of the number byte of a sample in rhythm (`zacoustic.core.transport.reliable.rhythm`)."""

_FLOORS: Final = 1 << 24
_BITS: Final = 7
_MORE: Final = 0x80


_UNKNOWN: Final = b"\x80\x00"
"""Content of the ACK of a receiver that does not know the lineage."""
LONGEST_ACK_BYTES: Final = 1 - (1 - WINDOW) // _BITS
"""The longest content of an ACK, for a whole window, bytes."""


class Ack(msgspec.Struct, frozen=True):
    """What a receiver has of one publisher's key."""

    expected: int
    """The next number that it awaits, modulo `NUMBERS`."""
    held: int = 0
    """Bit i: it holds number expected + 1 + i."""
    knows: bool = True
    """Whether it knows the lineage; otherwise it asks for SYNC, and the rest has no meaning."""

    def encode(self, most_bytes: int = LONGEST_ACK_BYTES) -> bytes:
        """Return the content after stream id and wildcards: one byte, then seven bits in each byte.

        Args:
            most_bytes: Room, at least 1: the last held numbers are left out.
        """
        held = self.held & (1 << _BITS * (most_bytes - 1)) - 1
        if not self.knows:
            return _UNKNOWN
        if not held:
            return bytes((self.expected % NUMBERS,))
        content = bytearray((_MORE | self.expected % NUMBERS,))
        while held >= 1 << _BITS:
            content.append(_MORE | held & (_MORE - 1))
            held >>= _BITS
        content.append(held)
        return bytes(content)


def measure_ack(buffer: bytes, offset: int) -> int | None:
    """Find the end of an ACK's content; None if it shows none."""
    longest = buffer[offset : offset + LONGEST_ACK_BYTES]
    return next((offset + size for size, byte in enumerate(longest, 1) if byte < _MORE), None)


def decode_ack(content: bytes) -> Ack | None:
    """Decode the content of an ACK; None if it is invalid."""
    if measure_ack(content, 0) != len(content):
        return None
    expected = content[0] % NUMBERS
    if not content[0] & _MORE:
        return Ack(expected)
    held = 0
    for index, byte in enumerate(content[1:]):
        held |= (byte & (_MORE - 1)) << _BITS * index
    if content == _UNKNOWN:
        return Ack(0, knows=False)
    if not content[-1] or held >> (WINDOW - 1):
        return None
    return Ack(expected, held)


def resolve_floor(floor: int, expected: int) -> int:
    """Return the number with this floor modulo 2^24 that is nearest to the expected one."""
    ahead = (floor - expected) % _FLOORS
    return expected + (ahead if ahead < _FLOORS // 2 else ahead - _FLOORS)
