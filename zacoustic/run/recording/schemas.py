"""JSON schemas, as Foxglove reads them, of configured types and of our own records.

A message omits fields that are None, so a schema gives each field one kind and requires none.
"""

import math
import types
import typing
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from zacoustic.core.values.types import INTEGER_LIMITS, FieldSpec, TypeSpec

_DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"
_OCTETS: Final[dict[str, Any]] = {"type": "string", "contentEncoding": "base64"}
_WORDS: Final[dict[type, dict[str, Any]]] = {
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": "number"},
    str: {"type": "string"},
    bytes: _OCTETS,
}

_encoder: Final = msgspec.json.Encoder()


class OpaqueValue(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A sample without a type."""

    data: bytes
    """Its bytes."""
    size_bytes: int
    """Number of bytes."""
    encoding: str = ""
    """Zenoh encoding."""


def schema_of_type(spec: TypeSpec) -> bytes:
    """Return the schema of the values of a type."""
    return _encoder.encode({"$schema": _DIALECT, "title": spec.name, **_of_type(spec)})


def schema_of_struct(record: type[msgspec.Struct]) -> bytes:
    """Return the schema of a record of plain fields."""
    hints = typing.get_type_hints(record)
    properties = {name: _of_hint(hints[name]) for name in record.__struct_fields__}
    return _encoder.encode(
        {
            "$schema": _DIALECT,
            "title": record.__name__,
            "type": "object",
            "properties": properties,
        }
    )


def schema_of_anything(title: str, **properties: str) -> bytes:
    """Return the schema of objects with some known fields.

    Args:
        title: Its name.
        properties: JSON type of each known field.
    """
    known = {name: {"type": word} for name, word in properties.items()}
    return _encoder.encode(
        {"$schema": _DIALECT, "title": title, "type": "object", "properties": known}
    )


def as_json(value: object) -> bytes:
    """Write a value as JSON: bytes in base64, without None and NaN."""
    return _encoder.encode(_tidy(value))


def _tidy(value: object) -> object:
    if isinstance(value, msgspec.Struct):
        value = msgspec.structs.asdict(value)
    if isinstance(value, Mapping):
        tidy = {str(name): _tidy(part) for name, part in value.items()}
        return {name: part for name, part in tidy.items() if part is not None}
    if isinstance(value, list | tuple | set | frozenset):
        return [_tidy(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _of_type(spec: TypeSpec) -> dict[str, Any]:
    properties = {field.name: _of_field(spec, field) for field in spec.fields}
    return {"type": "object", "properties": properties}


def _of_field(spec: TypeSpec, field: FieldSpec) -> dict[str, Any]:
    one = _of_element(spec, field)
    if field.unit:
        one = {**one, "description": field.unit}
    return {"type": "array", "items": one} if field.is_array else one


def _of_element(spec: TypeSpec, field: FieldSpec) -> dict[str, Any]:
    if field.is_nested:
        return _of_type(spec.nested_type(field.type))
    if field.type == "enum":
        return {"type": "string", "enum": list(field.values)}
    if field.type in INTEGER_LIMITS:
        return {"type": "integer"}
    return dict(_WORDS[{"bool": bool, "string": str, "bytes": bytes}.get(field.type, float)])


def _of_hint(hint: Any) -> dict[str, Any]:  # noqa: ANN401 (a type or a type hint)
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        hint = next(each for each in typing.get_args(hint) if each is not type(None))
    if typing.get_origin(hint) in (tuple, list):
        return {"type": "array", "items": _of_hint(typing.get_args(hint)[0])}
    return dict(_WORDS.get(hint, {"type": "object"}))
