"""Single CBOR items (RFC 8949), written and read in their shortest form only.

Why not cbor2: values by position need the offset at which each item ends, and a received length
must be compared with what remains *before* anything is allocated. cbor2 offers the first only
through a stream object, and decides the second by itself; it also decodes what never belongs here
(tags, shared references, indefinite lengths). And the shortest form of a float is wire format: the
versions of cbor2 that we accept differ on 65504.0, a half or a single. This file is the part of
CBOR that is used. In the tests, cbor2 reads and writes the same bytes.

Readers index beyond the end of a truncated buffer on purpose: the codec catches `IndexError` and
`struct.error` once and raises a `PayloadError`. Slices, which never fail, are checked here.
"""

import struct
from typing import Final

from zacoustic.core.values.payload.codec import PayloadError

UNSIGNED: Final = 0
NEGATIVE: Final = 1
BYTES: Final = 2
TEXT: Final = 3

FALSE: Final = 0xF4
TRUE: Final = 0xF5
NULL: Final = 0xF6
_HALF: Final = 0xF9
_SINGLE: Final = 0xFA
_DOUBLE: Final = 0xFB
_SIMPLE_BYTES: Final = {FALSE: 1, TRUE: 1, NULL: 1, _HALF: 3, _SINGLE: 5, _DOUBLE: 9}

_HALF_ITEM: Final = struct.Struct(">Be")
_SINGLE_ITEM: Final = struct.Struct(">Bf")
_DOUBLE_ITEM: Final = struct.Struct(">Bd")
_HALF_MAX: Final = 65504.0
_CANONICAL_NAN: Final = bytes([_HALF, 0x7E, 0x00])

# Additional information 24…27: the argument follows in 1, 2, 4, 8 bytes, and is shortest from this
# value on.
_ARGUMENTS: Final = {
    24: (struct.Struct(">B"), 24),
    25: (struct.Struct(">H"), 1 << 8),
    26: (struct.Struct(">I"), 1 << 16),
    27: (struct.Struct(">Q"), 1 << 32),
}
_HEADS: Final = ((1 << 8, 24, ">BB"), (1 << 16, 25, ">BH"), (1 << 32, 26, ">BI"))


def head(major: int, argument: int) -> bytes:
    """Return the head of an item: its major type and an argument of 0…2**64-1."""
    initial = major << 5
    if argument < 24:
        return bytes((initial | argument,))
    for bound, information, layout in _HEADS:
        if argument < bound:
            return struct.pack(layout, initial | information, argument)
    return struct.pack(">BQ", initial | 27, argument)


def head_bytes(argument: int) -> int:
    """Return the size of a head with that argument, bytes."""
    return len(head(UNSIGNED, argument))


def integer_item(number: int) -> bytes:
    """Return an integer of -2**64…2**64-1 as an item."""
    return head(UNSIGNED, number) if number >= 0 else head(NEGATIVE, -1 - number)


def integer_bytes(low: int, high: int) -> tuple[int, int]:
    """Return the sizes of the smallest and largest item of the integers `low` to `high`, bytes."""
    nearest = min(max(low, 0), high)
    return len(integer_item(nearest)), max(len(integer_item(low)), len(integer_item(high)))


def float_item(number: float) -> bytes:
    """Return a float as the shortest item that holds it exactly."""
    if number != number:
        return _CANONICAL_NAN
    try:
        single = _SINGLE_ITEM.pack(_SINGLE, number)
    except OverflowError:
        return _DOUBLE_ITEM.pack(_DOUBLE, number)
    if _SINGLE_ITEM.unpack(single)[1] != number:
        return _DOUBLE_ITEM.pack(_DOUBLE, number)
    if -_HALF_MAX <= number <= _HALF_MAX or number - number != 0:
        half = _HALF_ITEM.pack(_HALF, number)
        if _HALF_ITEM.unpack(half)[1] == number:
            return half
    return single


def read_argument(buffer: bytes, offset: int) -> tuple[int, int]:
    """Read the head at `offset`; return its argument and the offset after it."""
    information = buffer[offset] & 0x1F
    if information < 24:
        return information, offset + 1
    if information > 27:
        raise PayloadError(f"a head of indefinite or reserved length, {buffer[offset]:#04x}")
    layout, least = _ARGUMENTS[information]
    argument: int = layout.unpack_from(buffer, offset + 1)[0]
    if argument < least:
        raise PayloadError(f"{argument} in a longer form than needed")
    return argument, offset + 1 + layout.size


def read_integer(buffer: bytes, offset: int) -> tuple[int, int]:
    """Read an integer item; return its value and the offset after it."""
    initial = buffer[offset]
    if initial < 0x18:
        return initial, offset + 1
    if initial >= 0x40:
        raise PayloadError(f"{initial:#04x} where an integer is expected")
    argument, end = read_argument(buffer, offset)
    return (argument if initial < 0x20 else -1 - argument), end


def read_length(buffer: bytes, offset: int, major: int) -> tuple[int, int]:
    """Read the head of bytes, a text or a count; return its number and the offset after it."""
    if buffer[offset] >> 5 != major:
        raise PayloadError(f"{buffer[offset]:#04x} where major type {major} is expected")
    return read_argument(buffer, offset)


def read_content(buffer: bytes, offset: int, major: int) -> tuple[bytes, int]:
    """Read bytes or a text; return the content and the offset after it."""
    length, start = read_length(buffer, offset, major)
    end = start + length
    if end > len(buffer):
        raise PayloadError(f"{length} bytes announced, {len(buffer) - start} there")
    return buffer[start:end], end


def read_float(buffer: bytes, offset: int) -> tuple[float, int]:
    """Read a float item; return its value and the offset after it."""
    initial = buffer[offset]
    if initial == _HALF:
        layout = _HALF_ITEM
    elif initial == _SINGLE:
        layout = _SINGLE_ITEM
    elif initial == _DOUBLE:
        layout = _DOUBLE_ITEM
    else:
        raise PayloadError(f"{initial:#04x} where a float is expected")
    number: float = layout.unpack_from(buffer, offset)[1]
    end = offset + layout.size
    if (initial != _HALF or number != number) and buffer[offset:end] != float_item(number):
        raise PayloadError(f"{number} in a longer form than needed")
    return number, end


def skip_item(buffer: bytes, offset: int) -> int:
    """Return the offset after the item at `offset`, of any kind that fields use."""
    initial = buffer[offset]
    size = _SIMPLE_BYTES.get(initial)
    if size is None:
        major = initial >> 5
        if major > TEXT:
            raise PayloadError(f"{initial:#04x} where no field is expected")
        argument, end = read_argument(buffer, offset)
        if major >= BYTES:
            end += argument
    else:
        end = offset + size
    if end > len(buffer):
        raise PayloadError("the payload ends inside an item")
    return end
