"""The smallest and largest size of a type's message in a packet of rmw_desert: bytes, items."""

from zacoustic.core.values.payload.items import head_bytes, integer_bytes
from zacoustic.core.values.rmw_desert.flattening import EMPTY
from zacoustic.core.values.types import FLOAT_TYPES, FieldSpec, TypeSpec

Sizes = tuple[int, int | None]
"""Smallest and largest, bytes; None: no bound."""

_OCTET_BYTES = 2


def sizes_bytes(type_spec: TypeSpec) -> Sizes:
    """Return the sizes of the smallest and largest message of a type, bytes, without its head."""
    if not type_spec.fields:
        size_bytes = 0 if type_spec.is_hidden else len(EMPTY)
        return size_bytes, size_bytes
    sizes = [_field_bytes(type_spec, field) for field in type_spec.fields]
    largest = [high for _, high in sizes if high is not None]
    is_bounded = len(largest) == len(sizes)
    return sum(low for low, _ in sizes), sum(largest) if is_bounded else None


def _field_bytes(type_spec: TypeSpec, field: FieldSpec) -> Sizes:
    if field.is_nested:
        low, high = sizes_bytes(type_spec.nested_type(field.type))
    else:
        low, high = _scalar_bytes(field)
    if field.length is not None:
        return low * field.length, None if high is None else high * field.length
    if field.is_bounded_array:
        count_bytes = head_bytes(field.capacity)
        return 1, None if high is None else count_bytes + high * field.capacity
    return low, high


def _scalar_bytes(field: FieldSpec) -> Sizes:
    if field.is_integer:
        low, high = field.bounds
        return integer_bytes(int(low), int(high))
    if field.type in FLOAT_TYPES:
        return 3, 5
    if field.type == "enum":
        return integer_bytes(0, len(field.values) - 1)
    if field.type == "bool":
        return 1, 1
    if field.max_length is None:
        return 1, None
    each_bytes = _OCTET_BYTES if field.type == "bytes" else 1
    return 1, head_bytes(field.max_length) + each_bytes * field.max_length


def item_counts(type_spec: TypeSpec) -> Sizes:
    """Return the least and most items of a type's message, without its head; None: no bound."""
    if not type_spec.fields:
        count = 0 if type_spec.is_hidden else 1
        return count, count
    counts = [_field_items(type_spec, field) for field in type_spec.fields]
    most = [high for _, high in counts if high is not None]
    is_bounded = len(most) == len(counts)
    return sum(low for low, _ in counts), sum(most) if is_bounded else None


def _field_items(type_spec: TypeSpec, field: FieldSpec) -> Sizes:
    low: int
    high: int | None
    low, high = 1, 1
    if field.is_nested:
        low, high = item_counts(type_spec.nested_type(field.type))
    elif field.type == "bytes":
        return 1, None if field.max_length is None else 1 + field.max_length
    if field.length is not None:
        return low * field.length, None if high is None else high * field.length
    if field.is_bounded_array:
        return 1, None if high is None else 1 + high * field.capacity
    return low, high
