"""How small and how large the payload of a type can be, in CBOR by position."""

from typing import Final

import msgspec

from zacoustic.core.values.payload.items import head_bytes, integer_bytes
from zacoustic.core.values.types import FieldSpec, TypeSpec

_HALF_BYTES: Final = 3  # what NaN and the infinities take

Sizes = tuple[int, int | None]
"""Smallest and largest, bytes; None: no bound."""


def sizes_bytes(type_spec: TypeSpec) -> Sizes:
    """Return the sizes of the smallest and the largest payload of a type, bytes."""
    smallest, largest = 0, 0
    bounded = True
    for field in type_spec.fields:
        low, high = _field_bytes(type_spec, field)
        smallest += low
        largest += high or 0
        bounded = bounded and high is not None
    return smallest, largest if bounded else None


def _field_bytes(type_spec: TypeSpec, field: FieldSpec) -> Sizes:
    if field.is_nested:
        low, high = sizes_bytes(type_spec.nested_type(field.type))
    else:
        low, high = _scalar_bytes(field)
    if field.length is not None:
        low, high = low * field.length, None if high is None else high * field.length
    elif field.is_bounded_array:
        count_bytes = head_bytes(field.capacity)
        low, high = 1, None if high is None else count_bytes + high * field.capacity
    return (1 if field.optional else low), high


def _scalar_bytes(field: FieldSpec) -> Sizes:
    if field.nan:
        smallest, largest = _scalar_bytes(msgspec.structs.replace(field, nan=False))
        return min(smallest, _HALF_BYTES), max(largest or 0, _HALF_BYTES)
    if field.escapes:
        return _escaping_bytes(field)
    quantiser = field.quantiser
    if quantiser is not None:
        return integer_bytes(quantiser.low_count, quantiser.high_count)
    if field.is_integer:
        low, high = field.bounds
        return integer_bytes(int(low), int(high))
    if field.is_numeric:
        return 3, 5 if field.type == "float32" else 9
    if field.type == "enum":
        return integer_bytes(0, len(field.values) - 1)
    if field.type == "bool":
        return 1, 1
    shortest, longest = field.min_length or 0, field.max_length
    largest_text = None if longest is None else head_bytes(longest) + longest
    return head_bytes(shortest) + shortest, largest_text


def _escaping_bytes(field: FieldSpec) -> Sizes:
    within = _scalar_bytes(msgspec.structs.replace(field, outside="reject"))
    anything = {
        "range": None,
        "outside": "reject",
        "step": field.step if field.is_integer else None,
    }
    beyond = _scalar_bytes(msgspec.structs.replace(field, **anything))
    return min(within[0], beyond[0]), max(within[1] or 0, beyond[1] or 0)
