"""Section 7: CBOR by position. Written from docs/wire.md alone."""

import math
import struct
from collections.abc import Mapping
from typing import Any

from tests.independent import numbers
from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError
from tests.independent.table import INTEGERS, Field, Types

Value = dict[str, Any]

_UNSIGNED, _NEGATIVE, _BYTES, _TEXT, _SIMPLE = 0, 1, 2, 3, 7
_FALSE, _TRUE, _ABSENT = b"\xf4", b"\xf5", b"\xf6"
_FORMS = {25: ">e", 26: ">f", 27: ">d"}
_NAN = b"\xf9\x7e\x00"


def read(types: Types, name: str, cursor: Cursor) -> Value:
    """Take the fields of a type. They show their end."""
    if name not in types:
        raise ReadError(f"no type {name}")
    return {field.name: _field(types, field, cursor) for field in types[name]}


def write(types: Types, name: str, value: Mapping[str, Any]) -> bytes:
    """Return the fields of a type one behind the other."""
    return b"".join(_written(types, field, value.get(field.name)) for field in types[name])


def skip(types: Types, name: str, cursor: Cursor) -> None:
    """Go to the end of the fields, whatever they say: by items in shortest form, and counts."""
    for field in types[name]:
        if field.optional and cursor.peek() == _ABSENT[0]:
            cursor.take(1)
            continue
        for _ in range(_count(field, cursor) if field.is_array else 1):
            if field.type in types:
                skip(types, field.type, cursor)
            else:
                _skip_item(cursor)


def _skip_item(cursor: Cursor) -> None:
    head = cursor.peek()
    if head is not None and head >> 5 == _SIMPLE:
        short = cursor.take(1)[0] & 31
        if bytes((head,)) not in (_FALSE, _TRUE, _ABSENT) and short not in _FORMS:
            raise ReadError("no such item")
        cursor.take(1 << short - 24 if short in _FORMS else 0)
        return
    major, length = _head(cursor)
    if major > _TEXT:
        raise ReadError("no such item")
    cursor.take(length if major in (_BYTES, _TEXT) else 0)


def _count(field: Field, cursor: Cursor) -> int:
    if field.length is not None:
        return field.length
    count = _whole(cursor)
    if not 0 <= count <= (field.max_length or 0):
        raise ReadError("too many items")
    return count


def _field(types: Types, field: Field, cursor: Cursor) -> Any:
    if field.optional and cursor.peek() == _ABSENT[0]:
        cursor.take(1)
        return None
    if not field.is_array:
        return _one(types, field, cursor)
    return [_one(types, field, cursor) for _ in range(_count(field, cursor))]


def _one(types: Types, field: Field, cursor: Cursor) -> Any:
    if field.type == "bool":
        item = cursor.take(1)
        if item not in (_FALSE, _TRUE):
            raise ReadError("no bool")
        return item == _TRUE
    if field.type == "enum":
        position = _whole(cursor)
        if not 0 <= position < len(field.values):
            raise ReadError("no such value")
        return field.values[position]
    if field.type in ("string", "bytes"):
        return _text(field, cursor)
    if field.type in INTEGERS or field.type in ("float32", "float64"):
        return _number(field, cursor)
    return read(types, field.type, cursor)


def _number(field: Field, cursor: Cursor) -> float:
    grid = numbers.grid(field)
    head = cursor.peek()
    is_float = head is not None and head >> 5 == _SIMPLE
    may_float = (field.escapes or field.nan) and field.type not in INTEGERS
    if grid is None or (is_float and may_float):
        value = _float(cursor, field)
        if field.nan and not math.isfinite(value):
            return value
        if grid is not None and not field.escapes:
            raise ReadError("a number is a multiple of its step")
        if grid is None:
            value = numbers.bounded(field, value)
        if grid is None and not field.escapes and not numbers.in_range(field, value):
            raise ReadError("outside of the range")
        if grid is not None and numbers.reaches(field, value):
            raise ReadError("a number within its range is a multiple of its step")
        return value
    multiple = _whole(cursor)
    if not grid.holds(multiple) and not (field.escapes and field.type in INTEGERS):
        raise ReadError("outside of the range")
    return grid.value(multiple)


def _text(field: Field, cursor: Cursor) -> str | bytes:
    wanted = _TEXT if field.type == "string" else _BYTES
    major, length = _head(cursor)
    if major != wanted:
        raise ReadError(f"no {field.type}")
    raw = cursor.take(length)
    if field.max_length is not None and length > field.max_length:
        raise ReadError("too long")
    if length < field.min_length:
        raise ReadError("too short")
    if wanted == _BYTES:
        return raw
    try:
        return raw.decode()
    except UnicodeDecodeError as error:
        raise ReadError("no UTF-8") from error


def _head(cursor: Cursor) -> tuple[int, int]:
    first = cursor.take(1)[0]
    major, short = first >> 5, first & 31
    if short < 24:
        return major, short
    if short > 27:
        raise ReadError("no such head")
    size = 1 << (short - 24)
    value = cursor.number(size)
    least = 24 if size == 1 else 1 << (4 * size)
    if value < least:
        raise ReadError("not in shortest form")
    return major, value


def _whole(cursor: Cursor) -> int:
    major, value = _head(cursor)
    if major not in (_UNSIGNED, _NEGATIVE):
        raise ReadError("no integer")
    return value if major == _UNSIGNED else -1 - value


def _float(cursor: Cursor, field: Field) -> float:
    first = cursor.take(1)[0]
    form = _FORMS.get(first & 31)
    if first >> 5 != _SIMPLE or form is None:
        raise ReadError("no float")
    raw = cursor.take(1 << (first & 31) - 24)
    value = float(struct.unpack(form, raw)[0])
    if field.type == "float32" and form == ">d":
        raise ReadError("a float32 is at most a single")
    if _float_item(value) != bytes((first,)) + raw:
        raise ReadError("not in shortest form")
    return value


def _item(major: int, value: int) -> bytes:
    if value < 24:
        return bytes((major << 5 | value,))
    for short, size in ((24, 1), (25, 2), (26, 4), (27, 8)):
        if value < 1 << (8 * size):
            return bytes((major << 5 | short,)) + value.to_bytes(size, "big")
    raise ReadError("too large")


def _whole_item(value: int) -> bytes:
    return _item(_UNSIGNED, value) if value >= 0 else _item(_NEGATIVE, -1 - value)


def _float_item(value: float) -> bytes:
    if math.isnan(value):
        return _NAN
    for short, form in _FORMS.items():
        raw = numbers.pack(form, value)
        if raw is not None:
            return bytes((_SIMPLE << 5 | short,)) + raw
    raise ReadError("no float")


def _written(types: Types, field: Field, value: Any) -> bytes:
    if value is None and field.optional:
        return _ABSENT
    if value is None:
        raise ReadError(f"no {field.name}")
    if not field.is_array:
        return _written_one(types, field, value)
    head = b"" if field.length is not None else _whole_item(len(value))
    return head + b"".join(_written_one(types, field, one) for one in value)


def _written_one(types: Types, field: Field, value: Any) -> bytes:
    if field.type == "bool":
        return _TRUE if value else _FALSE
    if field.type == "enum":
        return _whole_item(field.values.index(value))
    if field.type == "string":
        raw = str(value).encode()
        return _item(_TEXT, len(raw)) + raw
    if field.type == "bytes":
        raw = bytes(value)
        return _item(_BYTES, len(raw)) + raw
    if field.type in INTEGERS or field.type in ("float32", "float64"):
        return _written_number(field, value)
    return write(types, field.type, value)


def _written_number(field: Field, value: float) -> bytes:
    if field.nan and not math.isfinite(value):
        return _float_item(value)
    value = numbers.at_end(field, value)
    grid = numbers.grid(field)
    if grid is None:
        value = numbers.fold(field, value)
        return _float_item(numbers.single(value) if field.type == "float32" else value)
    value = numbers.escaped(field, value)
    outside = not grid.takes(value)
    if outside and not field.escapes:
        raise ReadError("outside of the range")
    if outside and field.type not in INTEGERS:
        return _float_item(numbers.single(value) if field.type == "float32" else value)
    return _whole_item(grid.multiple(value))
