"""Sequence numbers of samples in records, and the content of an ACK."""

from typing import Final

import msgspec

NUMBERS: Final = 1 << 7
"""How many numbers one byte of a record distinguishes."""
WINDOW: Final = 32
"""A sample without SYNC is less than this many numbers ahead of the one that its receiver awaits,
and at most this many are under way. The other 96 numbers are old: a late repetition is never taken
for a new sample."""
PACE: Final = 64
"""The most numbers that come into use within one settling time, so that a late repetition is always
among the old ones."""
NUMBER_BYTES: Final = 1
IN_RHYTHM: Final = 0x80
"""Bit of the number byte of a sample in rhythm (`zacoustic.core.transport.reliable.rhythm`)."""

_FLOORS: Final = 1 << 24
_BITS: Final = 7
_MORE: Final = 0x80


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
        if self.knows and not held:
            return bytes((self.expected % NUMBERS,))
        content = bytearray((_MORE | self.expected % NUMBERS,))
        held = held if self.knows else 0
        while held >= 1 << _BITS:
            content.append(_MORE | held & (_MORE - 1))
            held >>= _BITS
        content.append(held)
        return bytes(content)


def measure_ack(buffer: bytes, offset: int) -> int | None:
    """Find the end of an ACK's content; None if there is none."""
    end = offset + 1
    if end > len(buffer):
        return None
    if buffer[offset] & _MORE:
        while end < len(buffer) and end - offset < LONGEST_ACK_BYTES and buffer[end] & _MORE:
            end += 1
        end += 1
    return end if end <= len(buffer) else None


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
    if held >> (WINDOW - 1):
        return None
    return Ack(expected, held, knows=held != 0)


def resolve(low: int, expected: int) -> int:
    """Return the number with these seven bits that is nearest to the expected one."""
    ahead = (low - expected) % NUMBERS
    return expected + (ahead if ahead < WINDOW else ahead - NUMBERS)


def resolve_expected(low: int, known: int) -> int:
    """Return the number that an ACK expects; up to a whole window may be unreported."""
    return resolve(low - 1, known) + 1


def resolve_floor(floor: int, expected: int) -> int:
    """Return the number with this floor modulo 2^24 that is nearest to the expected one."""
    ahead = (floor - expected) % _FLOORS
    return expected + (ahead if ahead < _FLOORS // 2 else ahead - _FLOORS)
