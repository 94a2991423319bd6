"""Floats as rmw_desert writes them: single precision, or half where it considers that equal.

Integers, booleans and texts are those of `zacoustic.core.values.payload.items`: both write the
shortest form. A float64 becomes a float32 first, whatever precision that loses. With the exponent e
and the mantissa m of the float32, as in its bits:

=============================  ====================================================================
e = 0, m a multiple of 8192    half, a zero with the sign: so these subnormals are lost
e = 255                        half, infinity or NaN with the upper bits of m
113 ≤ e ≤ 142, m as above      half, exact
103 ≤ e ≤ 112                  half, subnormal, from the exponent alone: most values come out wrong
else                           single; a double is never sent
=============================  ====================================================================

Only this rule defines the form of a float. That sender does not write a float in another form, so
such a float is damaged, and it is refused.

Source:
    Measured on the wire of rmw_desert 4.0.2, over all float32.
"""

import math
import struct
from typing import Final

from zacoustic.core.values.payload import PayloadError

_HALF: Final = 0xF9
_SINGLE: Final = 0xFA
_SINGLE_HEAD: Final = bytes((_SINGLE,))
_FLOAT: Final = struct.Struct(">f")
_HALF_ITEM: Final = struct.Struct(">BH")
_HALF_FLOAT: Final = struct.Struct(">e")
_HALF_BYTES: Final = 3
_SINGLE_BYTES: Final = 5

_SPECIAL: Final = 255
_BIAS: Final = 112  # of float32, less that of a half
_SUBNORMAL_ONES: Final = 0x3FF
_SUBNORMAL_HALVES: Final = frozenset(_SUBNORMAL_ONES >> shift for shift in range(10))


def float_item(number: float) -> bytes:
    """Return a float as the item that rmw_desert sends for it."""
    try:
        return single_item(_FLOAT.pack(number))
    except OverflowError:  # C makes it infinite
        return single_item(_FLOAT.pack(math.copysign(math.inf, number)))


def single_item(single: bytes) -> bytes:
    """Return a float32, given as its four bytes, as the item that rmw_desert sends for it."""
    exponent = (single[0] & 0x7F) << 1 | single[1] >> 7
    if not _is_half(exponent, single):
        return _SINGLE_HEAD + single
    half = (single[0] & 0x80) << 8
    mantissa = (single[1] & 0x7F) << 3 | single[2] >> 5
    if exponent == _SPECIAL:
        half |= 0x7C00 | mantissa
    elif exponent > _BIAS:
        half |= (exponent - _BIAS) << 10 | mantissa
    elif exponent:
        half |= _SUBNORMAL_ONES >> (_BIAS - exponent)
    return _HALF_ITEM.pack(_HALF, half)


def read_float(buffer: bytes, offset: int) -> tuple[float, int]:
    """Read a float item; return its value and the offset after it.

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
    end = offset + _SINGLE_BYTES
    single = buffer[offset + 1 : end]
    number = _FLOAT.unpack(single)[0]
    if _is_half((single[0] & 0x7F) << 1 | single[1] >> 7, single):
        raise PayloadError(f"the single {single.hex()}, for which rmw_desert sends a half")
    return number, end


def _is_half(exponent: int, single: bytes) -> bool:
    """Return whether rmw_desert sends a half for a float32."""
    if 113 <= exponent <= 142 or not exponent:
        return not single[3] and not single[2] & 0x1F  # a mantissa that is a multiple of 8192
    return exponent == _SPECIAL or 103 <= exponent <= _BIAS
