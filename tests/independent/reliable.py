"""Section 11: SYNC, ACK and numbers of reliable topics. Written from docs/wire.md alone."""

from dataclasses import dataclass

from tests.independent.cursor import Cursor
from tests.independent.errors import EndedError, ReadError

SYNC, ACK = 0xB8, 0xB9
RHYTHM = 0x80
_MORE = 0x80
_MOST_BYTES = 5
_FARTHEST = 31
_BITS = 7


@dataclass(frozen=True)
class Sync:
    """A lineage, and a number modulo 2^24: floor, awaited number, or count."""

    lineage: int
    number: int

    def write(self) -> bytes:
        return bytes((SYNC,)) + self.lineage.to_bytes(2, "big") + self.number.to_bytes(3, "big")


@dataclass(frozen=True)
class Holding:
    """What an ACK says: the awaited number's lower seven bits, and which distances are held."""

    awaited: int
    beyond: tuple[int, ...] = ()
    knows_lineage: bool = True

    def numbers(self, awaited: int) -> tuple[int, ...]:
        """Return the numbers that are held, for the whole awaited number."""
        return tuple(awaited + distance for distance in self.beyond)

    def write(self) -> bytes:
        if not self.knows_lineage:
            return b"\x80\x00"
        if not self.beyond:
            return bytes((self.awaited & 127,))
        bits = sum(1 << (distance - 1) for distance in self.beyond)
        groups = bytearray()
        while bits:
            groups.append(_MORE | bits & 127)
            bits >>= _BITS
        groups[-1] &= 127
        return bytes((_MORE | self.awaited & 127,)) + bytes(groups)


def read_sync(cursor: Cursor) -> Sync:
    """Take the body of SYNC."""
    return Sync(cursor.number(2), cursor.number(3))


def read_holding(cursor: Cursor) -> Holding:
    """Take what an ACK says that is held. It shows its end."""
    first = cursor.take(1)[0]
    if not first & _MORE:
        return Holding(first)
    bits = 0
    for place in range(_MOST_BYTES):
        byte = cursor.take(1)[0]
        bits |= (byte & 127) << (_BITS * place)
        if not byte & _MORE:
            break
    else:
        raise ReadError("at most five bytes say what is held")
    if first == _MORE and not bits and not place:
        return Holding(0, (), knows_lineage=False)
    if not byte:
        raise EndedError("a byte that says nothing")
    if bits >> _FARTHEST:
        raise EndedError("no number so far ahead is in use")
    beyond = tuple(bit + 1 for bit in range(bits.bit_length()) if bits >> bit & 1)
    return Holding(first & 127, beyond)


def whole_number(low: int, near: int) -> int:
    """Return the number that seven bits stand for: from 96 behind the awaited one to 31 ahead."""
    return near - 96 + (low - (near - 96)) % 128


def whole_awaited(low: int, last: int) -> int:
    """Return the awaited number of an ACK: from 95 behind the last one to 32 ahead."""
    return last - 95 + (low - (last - 95)) % 128
