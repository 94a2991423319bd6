"""A Python class from a type: the reverse of `type_from_struct`."""

import types
from functools import cache
from typing import Annotated, Any, Literal

import msgspec

from zacoustic.core.values.types.annotations import Bounds
from zacoustic.core.values.types.fields import FieldSpec
from zacoustic.core.values.types.spec import TypeSpec


@cache
def struct_from_type(spec: TypeSpec) -> type[msgspec.Struct]:
    """Make a `msgspec.Struct` class whose `type_from_struct` is the type; the same one each time.

    Every field has a default: zero, or the number of its range nearest to zero, the first value of
    an enum, the shortest text, an empty list, and for nested types such an instance.

    Args:
        spec: The type, resolved.
    """
    fields: list[tuple[str, Any, Any]] = []
    for field in spec.fields:
        element, default = _element(spec, field)
        if field.length is not None:
            several = tuple(default() if field.is_nested else default for _ in range(field.length))
            annotation: Any = types.GenericAlias(tuple, (element,) * field.length)
            fields.append((field.name, annotation, several))
        elif field.is_bounded_array:
            listed: Any = types.GenericAlias(list, (element,))
            annotation = Annotated[listed, Bounds(max_length=field.max_length)]
            fields.append((field.name, annotation, msgspec.field(default_factory=list)))
        elif field.is_nested:
            fields.append((field.name, element, msgspec.field(default_factory=default)))
        else:
            fields.append((field.name, element, default))
        if field.optional:
            name, annotation, _ = fields.pop()
            fields.append((name, annotation | None, None))
    return msgspec.defstruct(spec.name, fields, kw_only=False)


def _element(spec: TypeSpec, field: FieldSpec) -> tuple[Any, Any]:
    """Return the annotation of one element, and its default."""
    if field.is_nested:
        cls = struct_from_type(spec.nested_type(field.type))
        return cls, cls
    if field.type == "enum":
        return Literal[field.values], field.values[0]
    if field.type == "bool":
        return bool, False
    if field.type in ("string", "bytes"):
        kind: Any = str if field.type == "string" else bytes
        shortest: Any = bytes(field.min_length or 0)
        if kind is str:
            shortest = " " * len(shortest)
        if field.max_length is None and field.min_length is None:
            return kind, shortest
        lengths = Bounds(max_length=field.max_length, min_length=field.min_length)
        return Annotated[kind, lengths], shortest
    low, high = field.range if field.range is not None else (None, None)
    bounds = Bounds(
        low=low,
        high=high,
        step=field.step,
        unit=field.unit,
        wraps=field.wraps,
        nan=field.nan,
        outside="" if field.outside == "reject" else field.outside,
        type=field.type,
    )
    kind = int if field.is_integer else float
    zero = kind(0 if low is None or high is None else min(max(0, low), high))
    return Annotated[kind, bounds], zero
