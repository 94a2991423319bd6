"""Closures that read received CBOR items, one per field, made once per type.

A reader takes a buffer and an offset and returns the value and the offset after it. It trusts
nothing: a kind, form, bound or count that the type does not allow is a `PayloadError`. Beyond the
end of the buffer it may raise `IndexError` or `struct.error`, which the codec converts. Skippers
check only the structure; `measure` uses them.
"""

from collections.abc import Callable
from typing import Any

import msgspec

from zacoustic.core.values.payload.codec import PayloadError
from zacoustic.core.values.payload.items import (
    BYTES,
    FALSE,
    NULL,
    TEXT,
    TRUE,
    UNSIGNED,
    read_content,
    read_float,
    read_integer,
    read_length,
    skip_item,
)
from zacoustic.core.values.types import INTEGER_LIMITS, Ends, FieldSpec, Quantiser, TypeSpec

Read = Callable[[bytes, int], tuple[Any, int]]
Skip = Callable[[bytes, int], int]


def compile_reader(type_spec: TypeSpec) -> Read:
    """Make the reader of the values of a type."""
    plan = [(field.name, _field_reader(type_spec, field)) for field in type_spec.fields]

    def read(buffer: bytes, offset: int) -> tuple[dict[str, Any], int]:
        value: dict[str, Any] = {}
        for name, read_field in plan:
            value[name], offset = read_field(buffer, offset)
        return value, offset

    return read


def compile_skipper(type_spec: TypeSpec) -> Skip:
    """Make the function that finds the end of a value of a type."""
    plan = [_field_skipper(type_spec, field) for field in type_spec.fields]

    def skip(buffer: bytes, offset: int) -> int:
        for skip_field in plan:
            offset = skip_field(buffer, offset)
        return offset

    return skip


def _field_skipper(type_spec: TypeSpec, field: FieldSpec) -> Skip:
    element = compile_skipper(type_spec.nested_type(field.type)) if field.is_nested else skip_item
    if not field.is_array and not field.is_nested:
        return skip_item

    def skip(buffer: bytes, offset: int) -> int:
        if field.optional and buffer[offset] == NULL:
            return offset + 1
        count, offset = _count(field, buffer, offset) if field.is_array else (1, offset)
        for _ in range(count):
            offset = element(buffer, offset)
        return offset

    return skip


def _count(field: FieldSpec, buffer: bytes, offset: int) -> tuple[int, int]:
    """Return the number of elements of an array, and the offset of the first."""
    if field.length is not None:
        return field.length, offset
    count, offset = read_length(buffer, offset, UNSIGNED)
    if count > field.capacity:
        raise PayloadError(f"{field.name} has {count} elements; allowed: {field.capacity}")
    return count, offset


def _field_reader(type_spec: TypeSpec, field: FieldSpec) -> Read:
    if field.is_nested:
        read = compile_reader(type_spec.nested_type(field.type))
    else:
        read = _scalar_reader(field)
    if field.is_array:
        read = _array_reader(field, read)
    return _optional_reader(read) if field.optional else read


def _array_reader(field: FieldSpec, read_element: Read) -> Read:
    def read(buffer: bytes, offset: int) -> tuple[list[Any], int]:
        count, offset = _count(field, buffer, offset)
        if count > len(buffer) - offset:  # an element costs at least one byte
            raise PayloadError(f"{field.name} has {count} elements in {len(buffer) - offset} bytes")
        elements: list[Any] = []
        for _ in range(count):
            element, offset = read_element(buffer, offset)
            elements.append(element)
        return elements, offset

    return read


def _optional_reader(read_value: Read) -> Read:
    def read(buffer: bytes, offset: int) -> tuple[Any, int]:
        if buffer[offset] == NULL:
            return None, offset + 1
        return read_value(buffer, offset)

    return read


def _scalar_reader(field: FieldSpec) -> Read:
    if field.step is not None:
        return _step_reader(field)
    if field.is_integer:
        return _integer_reader(field)
    if field.is_numeric:
        return _single_reader(field) if field.type == "float32" else _double_reader(field)
    return {
        "bool": _bool_reader,
        "string": _text_reader,
        "bytes": _bytes_reader,
        "enum": _enum_reader,
    }[field.type](field)


def _out_of_bounds(field: FieldSpec, number: float) -> PayloadError:
    return PayloadError(f"{field.name} is {number}; allowed: {field.allowed}")


def _step_reader(field: FieldSpec) -> Read:
    quantiser = field.counting
    low, high, value = quantiser.low_count, quantiser.high_count, quantiser.value

    def read(buffer: bytes, offset: int) -> tuple[int | float, int]:
        count, offset = read_integer(buffer, offset)
        if low <= count <= high:
            return value(count), offset
        raise PayloadError(f"{field.name} is {count} steps; allowed: {low}..{high}")

    if field.is_integer:
        return _far_reader(field, read) if field.escapes else read
    return _float_or_steps_reader(field, read) if field.escapes or field.nan else read


def _far_reader(field: FieldSpec, read_count: Read) -> Read:
    """Make a reader that accepts counts outside of the range, as far as the integer type goes."""
    quantiser = field.counting
    low, high = quantiser.low_count, quantiser.high_count
    full = Quantiser(int(field.step or 1), INTEGER_LIMITS[field.type])

    def read(buffer: bytes, offset: int) -> tuple[int | float, int]:
        count, end = read_integer(buffer, offset)
        if low <= count <= high:
            return read_count(buffer, offset)
        if full.low_count <= count <= full.high_count:
            return full.value(count), end
        raise _out_of_bounds(field, count)

    return read


def _float_or_steps_reader(field: FieldSpec, read_count: Read) -> Read:
    """Make a reader that accepts a float itself, if it is outside of the range or no value."""
    ends = Ends(field)
    anything = msgspec.structs.replace(
        field, range=None, step=None, wraps=False, outside="reject", nan=False
    )
    read_exactly = _scalar_reader(anything)

    def read(buffer: bytes, offset: int) -> tuple[int | float, int]:
        if buffer[offset] < 0x40:
            return read_count(buffer, offset)
        number, offset = read_exactly(buffer, offset)
        if ends.least <= number <= ends.greatest:
            raise PayloadError(f"{field.name} is {number} in a longer form than needed")
        if not field.escapes and number - number == 0:
            raise _out_of_bounds(field, number)
        return number, offset

    return read


def _integer_reader(field: FieldSpec) -> Read:
    low, high = INTEGER_LIMITS[field.type] if field.escapes else map(int, field.bounds)
    if field.wraps:
        high -= 1  # the top is the bottom

    def read(buffer: bytes, offset: int) -> tuple[int, int]:
        number, offset = read_integer(buffer, offset)
        if low <= number <= high:
            return number, offset
        raise _out_of_bounds(field, number)

    return read


def _double_reader(field: FieldSpec) -> Read:
    if field.range is None or field.escapes:
        return read_float
    low, high = field.range

    def read(buffer: bytes, offset: int) -> tuple[float, int]:
        number, offset = read_float(buffer, offset)
        if field.nan and number - number != 0:
            return number, offset
        if not low <= number <= high or (field.wraps and number == high):
            raise _out_of_bounds(field, number)
        return number, offset

    return read


def _single_reader(field: FieldSpec) -> Read:
    ends = Ends(field) if field.range is not None and not field.escapes else None

    def read(buffer: bytes, offset: int) -> tuple[float, int]:
        if buffer[offset] == 0xFB:
            raise PayloadError(f"{field.name} is a double; allowed: half, single")
        number, offset = read_float(buffer, offset)
        if ends is None or (field.nan and number - number != 0):
            return number, offset
        if not ends.least <= number <= ends.greatest or (field.wraps and number >= ends.high):
            raise _out_of_bounds(field, number)
        return min(max(number, ends.low), ends.high), offset

    return read


def _bool_reader(field: FieldSpec) -> Read:
    def read(buffer: bytes, offset: int) -> tuple[bool, int]:
        initial = buffer[offset]
        if initial != TRUE and initial != FALSE:
            raise PayloadError(f"{field.name} is {initial:#04x}; allowed: true, false")
        return initial == TRUE, offset + 1

    return read


def _text_reader(field: FieldSpec) -> Read:
    read_bytes = _bytes_reader(field, TEXT)

    def read(buffer: bytes, offset: int) -> tuple[str, int]:
        content, offset = read_bytes(buffer, offset)
        try:
            return content.decode(), offset
        except UnicodeDecodeError:
            raise PayloadError(f"{field.name} is not UTF-8") from None

    return read


def _bytes_reader(field: FieldSpec, major: int = BYTES) -> Read:
    shortest, longest = field.min_length or 0, field.max_length

    def read(buffer: bytes, offset: int) -> tuple[bytes, int]:
        content, offset = read_content(buffer, offset, major)
        if len(content) < shortest or (longest is not None and len(content) > longest):
            allowed = field.allowed_bytes if shortest else longest
            raise PayloadError(f"{field.name} has {len(content)} bytes; allowed: {allowed}")
        return content, offset

    return read


def _enum_reader(field: FieldSpec) -> Read:
    values = field.values

    def read(buffer: bytes, offset: int) -> tuple[str, int]:
        index, offset = read_length(buffer, offset, UNSIGNED)
        if index >= len(values):
            raise PayloadError(f"{field.name} is {index}; allowed: 0..{len(values) - 1}")
        return values[index], offset

    return read
