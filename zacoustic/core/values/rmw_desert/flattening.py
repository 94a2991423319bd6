"""A ROS message as a row of CBOR items: nested messages in place, no names, no markers.

=======================================  =========================================================
field                                    items
=======================================  =========================================================
bool, integers, enum (its position)      one
float32, float64                         one, by the rule of
                                         `zacoustic.core.values.rmw_desert.items`
string                                   one, UTF-8
another type                             those of its fields, in place
fixed array (`length`)                   those of its elements, in place; a count before strings
                                         is read, and not written
bounded array                            the number of elements, then theirs
bytes                                    as an array of uint8: their number, then one for each
no member at all                         one, a zero: ROS gives an empty message one member
nothing but octets                       none: it does not send octets
=======================================  =========================================================

`compile_writer` and `compile_reader` make closures, once per type. The writer checks nothing;
`compile_counter` finds what must not be sent, and counts the items: the receiver has room for 64
items in a packet, and for 127 bytes in a text.
"""

from collections.abc import Callable
from typing import Any, Final

from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.payload.items import (
    FALSE,
    TEXT,
    TRUE,
    UNSIGNED,
    head,
    integer_item,
    read_content,
    read_integer,
    read_length,
)
from zacoustic.core.values.payload.writers import Write, enum_writer, write_bool, write_text
from zacoustic.core.values.payload.writers import compile_writer as compile_walk
from zacoustic.core.values.rmw_desert.items import float_item, read_float
from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.core.values.types.fields import FLOAT_TYPES
from zacoustic.errors import PayloadInvalidError

TEXT_LIMIT_BYTES: Final = 127
"""Longest text that the receiver of rmw_desert survives, bytes."""

Read = Callable[[bytes, int], tuple[Any, int]]
"""Reads a value at an offset; returns it and the offset after it."""
Count = Callable[[Any, str], int]
"""Counts the items of a value at a path; refuses what must not be sent."""

EMPTY: Final = b"\x00"
"""The item of a message without fields."""


# Writing


def compile_writer(type_spec: TypeSpec) -> Write:
    """Make the writer of the values of a type, as `TypeSpec.validate` returns them."""
    return compile_walk(type_spec, _scalar_writer, b"" if type_spec.is_hidden else EMPTY)


def _scalar_writer(field: FieldSpec) -> Write:
    if field.is_integer:
        return _write_integer
    if field.type in FLOAT_TYPES:
        return _write_float
    return enum_writer(field) if field.type == "enum" else _WRITERS[field.type]


def _write_integer(payload: bytearray, number: int) -> None:
    payload += integer_item(number)


def _write_float(payload: bytearray, number: float) -> None:
    payload += float_item(number)


def _write_octets(payload: bytearray, content: bytes) -> None:
    payload += head(UNSIGNED, len(content))
    for octet in content:
        payload += integer_item(octet)


_WRITERS: Final[dict[str, Write]] = {
    "bool": write_bool,
    "string": write_text,
    "bytes": _write_octets,
}


# Reading


def compile_reader(type_spec: TypeSpec) -> Read:
    """Make the reader of the values of a type; the caller still validates them."""
    if not type_spec.fields:
        return _read_nothing if type_spec.is_hidden else _read_empty
    plan = [(field.name, _field_reader(type_spec, field)) for field in type_spec.fields]

    def read(buffer: bytes, offset: int) -> tuple[dict[str, Any], int]:
        value: dict[str, Any] = {}
        for name, read_field in plan:
            value[name], offset = read_field(buffer, offset)
        return value, offset

    return read


def _field_reader(type_spec: TypeSpec, field: FieldSpec) -> Read:
    if field.is_nested:
        read = compile_reader(type_spec.nested_type(field.type))
    else:
        read = _scalar_reader(field)
    return _array_reader(field, read) if field.is_array else read


def _array_reader(field: FieldSpec, read_element: Read) -> Read:
    # From rclpy a fixed array of strings comes with its count, from rclcpp without.
    is_text = field.type == "string"

    def read(buffer: bytes, offset: int) -> tuple[list[Any], int]:
        count = field.length or 0
        if field.is_bounded_array or (is_text and buffer[offset] >> 5 == UNSIGNED):
            counted, offset = _read_count(buffer, offset)
            if field.length not in (None, counted):
                raise PayloadError(f"{counted} elements where {field.length} are expected")
            count = counted
        elements = []
        for _ in range(count):
            element, offset = read_element(buffer, offset)
            elements.append(element)
        return elements, offset

    return read


def _read_count(buffer: bytes, offset: int) -> tuple[int, int]:
    """Read how many elements follow; each needs a byte at least."""
    count, offset = read_length(buffer, offset, UNSIGNED)
    if count > len(buffer) - offset:
        raise PayloadError(f"{count} elements announced, {len(buffer) - offset} bytes there")
    return count, offset


def _scalar_reader(field: FieldSpec) -> Read:
    if field.is_integer:
        return read_integer
    if field.type in FLOAT_TYPES:
        return _float_reader(field)
    if field.type != "enum":
        return _READERS[field.type]

    def read(buffer: bytes, offset: int) -> tuple[str, int]:
        position, offset = read_integer(buffer, offset)
        if not 0 <= position < len(field.values):
            raise PayloadError(f"{position} of {len(field.values)} values")
        return field.values[position], offset

    return read


def _float_reader(field: FieldSpec) -> Read:
    """Make a reader that returns the end of a range for that end rounded to a float32."""
    if field.range is None:
        return read_float
    ends = {float_item(end): float(end) for end in field.range}

    def read(buffer: bytes, offset: int) -> tuple[float, int]:
        number, behind = read_float(buffer, offset)
        return ends.get(buffer[offset:behind], number), behind

    return read


def _read_nothing(buffer: bytes, offset: int) -> tuple[dict[str, Any], int]:
    return {}, offset


def _read_empty(buffer: bytes, offset: int) -> tuple[dict[str, Any], int]:
    number, end = read_integer(buffer, offset)
    if number:
        raise PayloadError(f"{number} where the zero of an empty message is expected")
    return {}, end


def _read_bool(buffer: bytes, offset: int) -> tuple[bool, int]:
    if buffer[offset] not in (FALSE, TRUE):
        raise PayloadError(f"{buffer[offset]:#04x} where true or false is expected")
    return buffer[offset] == TRUE, offset + 1


def _read_text(buffer: bytes, offset: int) -> tuple[str, int]:
    content, end = read_content(buffer, offset, TEXT)
    try:
        return content.decode(), end
    except UnicodeDecodeError:
        raise PayloadError("a text that is not UTF-8") from None


def _read_octets(buffer: bytes, offset: int) -> tuple[bytes, int]:
    count, offset = _read_count(buffer, offset)
    content = bytearray()
    for _ in range(count):
        number, offset = read_integer(buffer, offset)
        if not 0 <= number <= 255:
            raise PayloadError(f"{number} where a byte is expected")
        content.append(number)
    return bytes(content), offset


_READERS: Final[dict[str, Read]] = {
    "bool": _read_bool,
    "string": _read_text,
    "bytes": _read_octets,
}


# Counting


def compile_counter(type_spec: TypeSpec) -> Count:
    """Make the function that counts the items of a value.

    It raises `PayloadInvalidError` for what would crash the receiver or arrive as something else: a
    text above `TEXT_LIMIT_BYTES` or with a NUL, and a sequence of booleans.
    """
    if not type_spec.fields:
        return lambda value, path: 0 if type_spec.is_hidden else 1
    plan = [(field.name, _field_counter(type_spec, field)) for field in type_spec.fields]

    def count(value: dict[str, Any], path: str) -> int:
        return sum(count_field(value[name], f"{path}.{name}") for name, count_field in plan)

    return count


def _field_counter(type_spec: TypeSpec, field: FieldSpec) -> Count:
    if field.is_bounded_array and field.type == "bool":
        return _refuse_booleans
    count: Count
    if field.is_nested:
        count = compile_counter(type_spec.nested_type(field.type))
    elif field.type == "string":
        count = _count_text
    elif field.type == "bytes":
        count = _count_octets
    else:
        count = _count_one
    return _array_counter(count, counted=field.is_bounded_array) if field.is_array else count


def _array_counter(count_element: Count, *, counted: bool) -> Count:
    def count(elements: list[Any], path: str) -> int:
        items = (count_element(each, f"{path}[{index}]") for index, each in enumerate(elements))
        return counted + sum(items)

    return count


def _count_one(value: object, path: str) -> int:
    return 1


def _count_octets(content: bytes, path: str) -> int:
    return 1 + len(content)


def _count_text(text: str, path: str) -> int:
    size_bytes = len(text.encode())
    if size_bytes > TEXT_LIMIT_BYTES:
        raise PayloadInvalidError(
            f"{path} has {size_bytes} bytes; allowed: at most {TEXT_LIMIT_BYTES} bytes",
            hint="a longer text crashes the receiver of rmw_desert, or arrives empty",
        )
    if "\0" in text:
        raise PayloadInvalidError(
            f"{path} has a NUL; allowed: text without one",
            hint="the receiver of rmw_desert cuts the text there",
        )
    return 1


def _refuse_booleans(elements: list[bool], path: str) -> int:
    raise PayloadInvalidError(
        f"{path} is a sequence of booleans; allowed: a fixed array, or a sequence of uint8",
        hint="it crashes the receiver of rmw_desert",
    )
