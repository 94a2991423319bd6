"""Floats as rmw_desert writes them: single precision, and half where it takes that to be the same.

Integers, booleans and texts are those of `zacoustic.core.payload.items`: both write the shortest
form. A float64 becomes a float32 first, whatever that costs. With e the exponent and m the mantissa
of the float32, as they stand in its bits:

=============================  ====================================================================
e = 0, m a multiple of 8192    half, a zero with the sign: so these subnormals are lost
e = 255                        half, infinity or NaN with the upper bits of m
113 ≤ e ≤ 142, m as above      half, exact
103 ≤ e ≤ 112                  half, subnormal, from the exponent alone: most values come out wrong
else                           single; a double is never sent
=============================  ====================================================================

So nothing says in which form a float must be but this rule, and a float in another form was not
written by that sender: something has damaged it, and it is refused.

Source:
    Measured on the wire of rmw_desert 4.0.2, over all float32.
"""

import math
import struct
from typing import Final

from zacoustic.core.payload import PayloadError

_HALF: Final = 0xF9
_SINGLE: Final = 0xFA
_BITS: Final = struct.Struct(">I")
_FLOAT: Final = struct.Struct(">f")
_HALF_ITEM: Final = struct.Struct(">BH")
_SINGLE_ITEM: Final = struct.Struct(">BI")
_HALF_FLOAT: Final = struct.Struct(">e")
_HALF_BYTES: Final = 3
_SINGLE_BYTES: Final = 5

_MANTISSA_BITS: Final = 23
_LOST_BITS: Final = 13
_LOST: Final = (1 << _LOST_BITS) - 1
_SPECIAL: Final = 255
_BIAS: Final = 112  # of float32, less that of a half
_SUBNORMAL_ONES: Final = 0x3FF
_SUBNORMAL_HALVES: Final = frozenset(_SUBNORMAL_ONES >> shift for shift in range(10))


def float_item(number: float) -> bytes:
    """Return a float as the item that rmw_desert sends for it."""
    return single_item(single_bits(number))


def single_bits(number: float) -> int:
    """Return the bits of the float32 that a float64 becomes; too large ones are infinite."""
    try:
        single = _FLOAT.pack(number)
    except OverflowError:
        single = _FLOAT.pack(math.copysign(math.inf, number))
    bits: int = _BITS.unpack(single)[0]
    return bits


def single_item(bits: int) -> bytes:
    """Return a float32, given by its bits, as the item that rmw_desert sends for it."""
    sign = bits >> 31 << 15
    exponent = bits >> _MANTISSA_BITS & 0xFF
    mantissa = bits & ((1 << _MANTISSA_BITS) - 1)
    is_short = not mantissa & _LOST
    if exponent == 0 and is_short:
        return _HALF_ITEM.pack(_HALF, sign)
    if exponent == _SPECIAL:
        return _HALF_ITEM.pack(_HALF, sign | 0x7C00 | mantissa >> _LOST_BITS)
    if 113 <= exponent <= 142 and is_short:
        return _HALF_ITEM.pack(_HALF, sign | (exponent - _BIAS) << 10 | mantissa >> _LOST_BITS)
    if 103 <= exponent <= _BIAS:
        return _HALF_ITEM.pack(_HALF, sign | _SUBNORMAL_ONES >> (_BIAS - exponent))
    return _SINGLE_ITEM.pack(_SINGLE, bits)


def read_float(buffer: bytes, offset: int) -> tuple[float, int]:
    """Read a float item: its value and the offset behind it.

    Raises:
        PayloadError: There is none, or rmw_desert does not send this one.
        struct.error, IndexError: It is truncated.
    """
    initial = buffer[offset]
    number: float
    if initial == _HALF:
        half: int = _HALF_ITEM.unpack_from(buffer, offset)[1]
        if not half & 0x7C00 and half & 0x3FF and half & 0x3FF not in _SUBNORMAL_HALVES:
            raise PayloadError(f"the half {half:#06x}, which rmw_desert does not send")
        number = _HALF_FLOAT.unpack_from(buffer, offset + 1)[0]
        return number, offset + _HALF_BYTES
    if initial != _SINGLE:
        raise PayloadError(f"{initial:#04x} where a float is expected")
    bits: int = _SINGLE_ITEM.unpack_from(buffer, offset)[1]
    end = offset + _SINGLE_BYTES
    if single_item(bits) != buffer[offset:end]:
        raise PayloadError(f"the single {bits:#010x}, for which rmw_desert sends a half")
    number = _FLOAT.unpack_from(buffer, offset + 1)[0]
    return number, end
