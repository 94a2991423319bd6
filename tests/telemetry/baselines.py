"""What others need for the same samples: bytes on the air, framing included, or bits.

- `rmw_desert_bytes`: that middleware's rules: floats of half or single precision, six bytes more.
- `cbor_map_bytes`, `json_bytes`: a map with names, two bytes of stream and length before it.
- `dccl_bits`: fields of fixed width by their bounds, as DCCL packs them; `dccl_bytes` with its id.
- `LaplaceCoder`: bits of an adaptive coder of differences, the plain coder that prediction must
  beat: each field less the one before it, on a Laplace distribution whose scale follows by 1/8.
"""

import math
import struct
from collections.abc import Mapping
from typing import Any, Final

import cbor2
import msgspec

from zacoustic.core.values.types import FieldSpec, Lattice, TypeSpec

RMW_DESERT_FRAMING: Final = 6
"""Two markers, length, type, topic id, end."""

_NARROWEST: Final = 0.05  # scale of the Laplace distribution, steps
_FLOOR: Final = 2.0**-12  # mass that all values share alike
_RATE: Final = 1 / 8


def rmw_desert_bytes(type_spec: TypeSpec, value: Mapping[str, Any]) -> int:
    """Size of a message of rmw_desert, of values rounded to the fields' steps."""
    rounded = quantised(type_spec, value)
    return RMW_DESERT_FRAMING + sum(_item_bytes(rounded[each.name]) for each in type_spec.fields)


def cbor_map_bytes(type_spec: TypeSpec, value: Mapping[str, Any]) -> int:
    """Size as a CBOR map of names."""
    return 2 + len(cbor2.dumps(quantised(type_spec, value)))


def json_bytes(type_spec: TypeSpec, value: Mapping[str, Any]) -> int:
    """Size as JSON, numbers with as many digits as their step has."""
    short = {}
    for field in type_spec.fields:
        number = value[field.name]
        if field.step is not None and not field.is_integer:
            number = round(number, max(0, math.ceil(-math.log10(field.step))))
        short[field.name] = number
    return 2 + len(msgspec.json.encode(short))


def dccl_bits(type_spec: TypeSpec, value: Mapping[str, Any]) -> int:
    """Size of the fields in DCCL, bits."""
    return sum(_dccl_field_bits(field, value[field.name]) for field in type_spec.fields)


def dccl_bytes(type_spec: TypeSpec, value: Mapping[str, Any]) -> int:
    """Size of a message of DCCL."""
    return 1 + (dccl_bits(type_spec, value) + 7) // 8


def quantised(type_spec: TypeSpec, value: Mapping[str, Any]) -> dict[str, Any]:
    """Give a value with its numbers on their steps."""
    found = {}
    for field in type_spec.fields:
        quantiser, each = field.quantiser, value[field.name]
        found[field.name] = each if quantiser is None else quantiser.value(quantiser.count(each))
    return found


class LaplaceCoder:
    """An adaptive coder of differences.

    Args:
        type_spec: Of the samples; fields with a lattice only.
    """

    def __init__(self, type_spec: TypeSpec) -> None:
        self._lattices = [(field.name, Lattice(field)) for field in type_spec.fields]
        self._scales = [max(1.0, lattice.size / 64) for _, lattice in self._lattices]
        self._last: list[int] | None = None

    def bits(self, value: Mapping[str, Any]) -> float | None:
        """Give what a sample costs, bits; None for the first one."""
        row = [lattice.index(value[name]) for name, lattice in self._lattices]
        last, self._last = self._last, row
        if last is None:
            return None
        bits = 0.0
        for n, (_, lattice) in enumerate(self._lattices):
            change = row[n] - last[n]
            if lattice.wraps:
                change = (change + lattice.size // 2) % lattice.size - lattice.size // 2
            scale, far = max(self._scales[n], _NARROWEST), abs(change)
            if far:
                share = math.exp(-(far - 0.5) / scale) * (1 - math.exp(-1 / scale)) / 2
            else:
                share = 1 - math.exp(-0.5 / scale)
            bits -= math.log2(share * (1 - _FLOOR) + _FLOOR / lattice.size)
            self._scales[n] += _RATE * (far - self._scales[n])
        return bits


def _item_bytes(value: Any) -> int:
    """Size of one of rmw_desert's CBOR items."""
    if isinstance(value, bool):
        return 1
    if isinstance(value, int):
        return _head_bytes(value if value >= 0 else -1 - value)
    if isinstance(value, str):
        size = len(value.encode())
        return _head_bytes(size) + size
    (pattern,) = struct.unpack(">I", struct.pack(">f", value))
    exponent, mantissa = pattern >> 23 & 0xFF, pattern & 0x7FFFFF
    is_exact = mantissa % 8192 == 0 and (exponent == 0 or 113 <= exponent <= 142)
    return 3 if is_exact or exponent == 255 or 103 <= exponent <= 112 else 5


def _head_bytes(number: int) -> int:
    for limit, size in ((24, 1), (1 << 8, 2), (1 << 16, 3), (1 << 32, 5)):
        if number < limit:
            return size
    return 9


def _dccl_field_bits(field: FieldSpec, value: Any) -> int:
    if field.type == "string":
        return 8 + 8 * len(value.encode())
    if field.type == "bool":
        return 1
    assert field.range is not None
    values = round((field.range[1] - field.range[0]) / (field.step or 1)) + 1
    return (values - 1).bit_length()
