"""Closures that write validated values as CBOR items, one per field, made once per type.

They take what `TypeSpec.validate` returned, and do not check it again.
"""

import math
import struct
from collections.abc import Callable
from typing import Any, Final

from zacoustic.core.values.payload.items import (
    BYTES,
    FALSE,
    NULL,
    TEXT,
    TRUE,
    UNSIGNED,
    float_item,
    head,
    integer_item,
)
from zacoustic.core.values.types import FieldSpec, TypeSpec

Write = Callable[[bytearray, Any], None]
"""Appends the items of a value."""
MakeScalar = Callable[[FieldSpec], Write]
"""Makes the writer of a field of a scalar type."""

_SINGLE: Final = struct.Struct(">f")

# Most counts have two bytes or less; the table spares them the arithmetic.
_SMALL: Final = {number: integer_item(number) for number in range(-256, 256)}


def compile_writer(
    type_spec: TypeSpec, scalar: MakeScalar | None = None, empty: bytes = b""
) -> Write:
    """Make the writer of the values of a type.

    Args:
        type_spec: The type.
        scalar: Makes the writers of scalars; None: those of the native wire.
        empty: The bytes of a type without fields.
    """
    make_scalar = scalar or _scalar_writer
    plan = [
        (field.name, _field_writer(type_spec, field, make_scalar, empty))
        for field in type_spec.fields
    ]

    def write(payload: bytearray, value: dict[str, Any]) -> None:
        for name, write_field in plan:
            write_field(payload, value[name])

    def write_empty(payload: bytearray, value: object) -> None:
        payload += empty

    return write if plan else write_empty


def _field_writer(type_spec: TypeSpec, field: FieldSpec, scalar: MakeScalar, empty: bytes) -> Write:
    if field.is_nested:
        write = compile_writer(type_spec.nested_type(field.type), scalar, empty)
    else:
        write = scalar(field)
    if field.is_array:
        write = _array_writer(write, counted=field.is_bounded_array)
    return _optional_writer(write) if field.optional else write


def _array_writer(write_element: Write, *, counted: bool) -> Write:
    def write(payload: bytearray, elements: list[Any]) -> None:
        if counted:
            payload += head(UNSIGNED, len(elements))
        for element in elements:
            write_element(payload, element)

    return write


def _optional_writer(write_value: Write) -> Write:
    def write(payload: bytearray, value: object) -> None:
        if value is None:
            payload.append(NULL)
        else:
            write_value(payload, value)

    return write


def _scalar_writer(field: FieldSpec) -> Write:
    if field.step is not None:
        return _step_writer(field)
    if field.is_integer:
        return _write_integer
    if field.type == "float32":
        return _single_writer(field)
    if field.type == "enum":
        return enum_writer(field)
    return _PLAIN_WRITERS[field.type]


def enum_writer(field: FieldSpec) -> Write:
    """Make the writer of an enum value's position."""
    items = {name: integer_item(index) for index, name in enumerate(field.values)}

    def write(payload: bytearray, name: str) -> None:
        payload += items[name]

    return write


def _write_integer(payload: bytearray, number: int) -> None:
    payload += _SMALL.get(number) or integer_item(number)


def _write_float(payload: bytearray, number: float) -> None:
    payload += float_item(number)


def write_bool(payload: bytearray, value: bool) -> None:
    """Write true or false."""
    payload.append(TRUE if value else FALSE)


def write_text(payload: bytearray, text: str) -> None:
    """Write a text in UTF-8."""
    content = text.encode()
    payload += head(TEXT, len(content))
    payload += content


def _write_bytes(payload: bytearray, content: bytes) -> None:
    payload += head(BYTES, len(content))
    payload += content


_PLAIN_WRITERS: Final[dict[str, Write]] = {
    "float64": _write_float,
    "bool": write_bool,
    "string": write_text,
    "bytes": _write_bytes,
}


def _step_writer(field: FieldSpec) -> Write:
    count = field.counting.count

    def write(payload: bytearray, number: float) -> None:
        steps = count(number)
        payload += _SMALL.get(steps) or integer_item(steps)

    if field.is_integer or not (field.escapes or field.nan):
        return write
    low, high = field.bounds
    exactly = _single_writer(field) if field.type == "float32" else _write_float

    def write_either(payload: bytearray, number: float) -> None:
        (write if low <= number <= high else exactly)(payload, number)

    return write_either


def _single_writer(field: FieldSpec) -> Write:
    # Rounded to float32, a value just below the top of a field that wraps can become the top, which
    # is the bottom.
    low, high = field.range if field.range is not None and field.wraps else (None, None)

    def write(payload: bytearray, number: float) -> None:
        single = _SINGLE.unpack(_SINGLE.pack(number))[0]
        if high is not None and high <= single < math.inf:
            single = _SINGLE.unpack(_SINGLE.pack(low))[0]
        payload += float_item(single)

    return write
