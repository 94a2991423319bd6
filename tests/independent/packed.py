"""Section 7.1: values as bits, and bytes without a type. Written from docs/wire.md alone."""

import math
import struct
from collections.abc import Mapping
from typing import Any

from tests.independent import numbers, texts
from tests.independent.cursor import BitOutput, Bits, Cursor
from tests.independent.errors import ReadError
from tests.independent.table import INTEGERS, Field, Types

Value = dict[str, Any]

_NANS = {4: 0x7FC00000, 8: 0x7FF8000000000000}
_MARK = 0x00
_CODED = 0xC0


def width(count: int) -> int:
    """Return the width of a number of values: the bits of the greatest, at least one."""
    return max(1, (count - 1).bit_length())


def read(types: Types, name: str, cursor: Cursor) -> Value:
    """Take the fields of a type, and the padding behind them."""
    bits = Bits(cursor)
    value = _fields(types, name, bits)
    bits.end()
    return value


def skip(types: Types, name: str, cursor: Cursor) -> None:
    """Go to the end of the fields, whatever they say: by lengths within their bounds."""
    _skip_fields(types, name, Bits(cursor))


def _skip_fields(types: Types, name: str, bits: Bits) -> None:
    for field in types[name]:
        if field.optional and not bits.take(1):
            continue
        count = 1
        if field.is_array:
            count = field.length if field.length is not None else _length(field, bits)
        for _ in range(count):
            _skip_one(types, field, bits)


def _skip_one(types: Types, field: Field, bits: Bits) -> None:
    if field.type == "string":
        size = 7 if bits.take(1) else 8
        _skip_bits(size * _length(field, bits), bits)
    elif field.type == "bytes":
        _skip_bits(8 * _length(field, bits), bits)
    elif field.type in ("bool", "enum"):
        bits.take(1 if field.type == "bool" else width(len(field.values)))
    elif field.type in INTEGERS or field.type in ("float32", "float64"):
        _skip_number(field, bits)
    else:
        _skip_fields(types, field.type, bits)


def _skip_number(field: Field, bits: Bits) -> None:
    if field.nan and not bits.take(1):
        bits.take(bits.take(1))
        return
    grid = numbers.grid(field)
    full = 32 if field.type == "float32" else 64
    if field.type in INTEGERS:
        least, greatest = INTEGERS[field.type]
        full = width(greatest - least + 1)
    if grid is None:
        bits.take(full)
    elif grid.is_free:
        bits.take(bits.take(6))
    elif bits.take(width(grid.count + field.escapes)) == grid.count and field.escapes:
        bits.take(full)


def _skip_bits(count: int, bits: Bits) -> None:
    if count > bits.left:
        raise ReadError("too long")
    bits.take(count)


def write(types: Types, name: str, value: Mapping[str, Any]) -> bytes:
    """Return the fields of a type as bits."""
    writer = BitOutput()
    _put_fields(types, name, value, writer)
    return writer.done()


def read_bytes(payload: bytes) -> bytes:
    """Return the bytes that a packed payload without a type stands for."""
    if not payload or _MARK < payload[0] < _CODED:
        return payload
    if payload[0] >= _CODED:
        return texts.read_block(payload)
    plain = payload[1:]
    if not plain or _MARK < plain[0] < _CODED:
        raise ReadError("a mark that is not needed")
    return plain


def write_bytes(plain: bytes) -> bytes:
    """Return the shortest packed payload without a type."""
    needed = bool(plain) and not _MARK < plain[0] < _CODED
    marked = bytes((_MARK,)) + plain if needed else plain
    block = texts.write_block(plain) if texts.fits(plain) else marked
    return block if len(block) < len(marked) else marked


def _fields(types: Types, name: str, bits: Bits) -> Value:
    if name not in types:
        raise ReadError(f"no type {name}")
    return {field.name: read_field(types, field, bits) for field in types[name]}


def read_field(types: Types, field: Field, bits: Bits) -> Any:
    if field.optional and not bits.take(1):
        return None
    if not field.is_array:
        return _one(types, field, bits)
    count = field.length if field.length is not None else _length(field, bits)
    return [_one(types, field, bits) for _ in range(count)]


def _one(types: Types, field: Field, bits: Bits) -> Any:
    if field.type == "bool":
        return bool(bits.take(1))
    if field.type == "enum":
        position = bits.take(width(len(field.values)))
        if position >= len(field.values):
            raise ReadError("no such value")
        return field.values[position]
    if field.type == "string":
        return _string(field, bits)
    if field.type == "bytes":
        return bits.bytes(_length(field, bits))
    if field.type in INTEGERS or field.type in ("float32", "float64"):
        return _number(field, bits)
    return _fields(types, field.type, bits)


def _number(field: Field, bits: Bits) -> float:
    if not field.nan:
        return _value(field, bits)
    if not bits.take(1):
        if not bits.take(1):
            return math.nan
        return -math.inf if bits.take(1) else math.inf
    value = _value(field, bits)
    if not math.isfinite(value):
        raise ReadError("no value in a longer form")
    return value


def _value(field: Field, bits: Bits) -> float:
    grid = numbers.grid(field)
    if grid is None:
        value = numbers.bounded(field, _float(field, bits))
        if not field.escapes and not numbers.in_range(field, value):
            raise ReadError("outside of the range")
        return value
    if grid.is_free:
        multiple = _signed(bits)
        if not grid.holds(multiple):
            raise ReadError("outside of the range")
        return grid.value(multiple)
    escape = field.escapes
    index = bits.take(width(grid.count + escape))
    if index < grid.count:
        return grid.value(grid.least + index)
    if index != grid.count or not escape:
        raise ReadError("outside of the range")
    value = _full(field, bits)
    if numbers.reaches(field, value):
        raise ReadError("a number within its range has an index")
    return value


def _full(field: Field, bits: Bits) -> float:
    if field.type not in INTEGERS:
        return _float(field, bits)
    least, greatest = INTEGERS[field.type]
    return least + bits.take(width(greatest - least + 1))


def _float(field: Field, bits: Bits) -> float:
    size = 4 if field.type == "float32" else 8
    raw = bits.take(8 * size)
    value = float(struct.unpack(">f" if size == 4 else ">d", raw.to_bytes(size, "big"))[0])
    if math.isnan(value) and raw != _NANS[size]:
        raise ReadError("another NaN")
    if field.is_finite and not math.isfinite(value):
        raise ReadError("no value in a longer form")
    return value


def _signed(bits: Bits) -> int:
    size = bits.take(6)
    if not size:
        return 0
    negative = bits.take(1)
    magnitude = 1 << (size - 1) | bits.take(size - 1)
    return -magnitude if negative else magnitude


def _string(field: Field, bits: Bits) -> str:
    ascii_only = bits.take(1)
    length = _length(field, bits)
    if ascii_only:
        if 7 * length > bits.left:
            raise ReadError("too long")
        return "".join(chr(bits.take(7)) for _ in range(length))
    raw = bits.bytes(length)
    try:
        text = raw.decode()
    except UnicodeDecodeError as error:
        raise ReadError("no UTF-8") from error
    if text.isascii():
        raise ReadError("ASCII takes seven bits")
    return text


def _length(field: Field, bits: Bits) -> int:
    if field.max_length is not None:
        spread = field.max_length - field.min_length
        length = bits.take(width(spread + 1)) if spread or not field.min_length else 0
        if length > spread:
            raise ReadError("too long")
        return field.min_length + length
    length = 0
    shift = 0
    more = 1
    while more:
        more = bits.take(1)
        group = bits.take(7)
        if shift and not more and not group:
            raise ReadError("not in shortest form")
        length |= group << shift
        shift += 7
    return field.min_length + length


def _put_fields(types: Types, name: str, value: Mapping[str, Any], writer: BitOutput) -> None:
    for field in types[name]:
        put_field(types, field, value.get(field.name), writer)


def put_field(types: Types, field: Field, value: Any, writer: BitOutput) -> None:
    if field.optional:
        writer.put(int(value is not None), 1)
        if value is None:
            return
    if value is None:
        raise ReadError(f"no {field.name}")
    if not field.is_array:
        _put_one(types, field, value, writer)
        return
    if field.length is None:
        _put_length(field, len(value), writer)
    for one in value:
        _put_one(types, field, one, writer)


def _put_one(types: Types, field: Field, value: Any, writer: BitOutput) -> None:
    if field.type == "bool":
        writer.put(int(value), 1)
    elif field.type == "enum":
        writer.put(field.values.index(value), width(len(field.values)))
    elif field.type == "string":
        _put_string(field, value, writer)
    elif field.type == "bytes":
        _put_length(field, len(value), writer)
        writer.put(int.from_bytes(value, "big"), 8 * len(value))
    elif field.type in INTEGERS or field.type in ("float32", "float64"):
        _put_number(field, value, writer)
    else:
        _put_fields(types, field.type, value, writer)


def _put_number(field: Field, value: float, writer: BitOutput) -> None:
    if field.nan and not math.isfinite(value):
        writer.put(0, 1)
        writer.put(int(math.isinf(value)), 1)
        if math.isinf(value):
            writer.put(int(value < 0), 1)
        return
    if field.nan:
        writer.put(1, 1)
    value = numbers.at_end(field, value)
    grid = numbers.grid(field)
    if grid is None:
        _put_float(field, numbers.fold(field, value), writer)
        return
    if grid.is_free:
        if not math.isfinite(value):
            raise ReadError("no number")
        _put_signed(grid.multiple(value), writer)
        return
    value = numbers.escaped(field, value)
    if grid.takes(value):
        index = grid.multiple(value) - grid.least
        writer.put(index, width(grid.count + field.escapes))
        return
    if not field.escapes:
        raise ReadError("outside of the range")
    writer.put(grid.count, width(grid.count + 1))
    if field.type in INTEGERS:
        least, greatest = INTEGERS[field.type]
        writer.put(int(value) - least, width(greatest - least + 1))
    else:
        _put_float(field, value, writer)


def _put_float(field: Field, value: float, writer: BitOutput) -> None:
    size = 4 if field.type == "float32" else 8
    if math.isnan(value):
        raw = _NANS[size]
    elif size == 4:
        raw = int.from_bytes(struct.pack(">f", numbers.single(value)), "big")
    else:
        raw = int.from_bytes(struct.pack(">d", value), "big")
    writer.put(raw, 8 * size)


def _put_signed(multiple: int, writer: BitOutput) -> None:
    size = abs(multiple).bit_length()
    writer.put(size, 6)
    if size:
        writer.put(int(multiple < 0), 1)
        writer.put(abs(multiple) & ((1 << (size - 1)) - 1), size - 1)


def _put_string(field: Field, value: str, writer: BitOutput) -> None:
    raw = value.encode()
    writer.put(int(value.isascii()), 1)
    _put_length(field, len(raw), writer)
    for byte in raw:
        writer.put(byte, 7 if value.isascii() else 8)


def _put_length(field: Field, length: int, writer: BitOutput) -> None:
    length -= field.min_length
    if field.max_length is not None:
        spread = field.max_length - field.min_length
        if spread or not field.min_length:
            writer.put(length, width(spread + 1))
        return
    while length > 127:
        writer.put(1 << 7 | length & 127, 8)
        length >>= 7
    writer.put(length, 8)
