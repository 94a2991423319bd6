"""Types from annotated Python classes, and values back into them.

A `msgspec.Struct` states the kinds of its fields; `Annotated` adds what it cannot state, the
bounds::

    class Nav(msgspec.Struct):
        lat: Annotated[float, Bounds(-90, 90, step=1e-6, unit="deg")]
        mode: Literal["idle", "survey", "abort"]
        legs: Annotated[list[Leg], Bounds(max_length=8)]
        note: Annotated[str, Bounds(max_length=20)] | None = None

`int` is int64, `float` is float64 unless `Bounds.type` says less. A tuple of equal elements is a
`int` is int64, `float` is float64 unless `Bounds.type` is narrower. A tuple of equal elements is a
fixed array, a list needs a greatest length, an `Enum` or a `Literal` of texts is an enum, `X |
None` is optional, another Struct is nested. Of `msgspec.Meta` the bounds ``ge``, ``le``, ``gt`` and
``lt`` (integers), ``multiple_of`` (the step) and the lengths are used; a length of a text counts
bytes here, not characters.

This module imports nothing by name: a shell imports the module and attribute that a config names.
"""

import enum
import typing
from collections.abc import Callable, Mapping
from typing import Any, Literal

import msgspec

from zacoustic.core.values.types.annotations import Parts, annotations, bare, is_struct
from zacoustic.core.values.types.fields import INTEGER_LIMITS, FieldSpec
from zacoustic.core.values.types.scalars import enum_name
from zacoustic.core.values.types.spec import MAX_DEPTH, TypeSpec
from zacoustic.errors import ConfigError

Build = Callable[[Any], Any]
BuildStruct = Callable[[Mapping[str, Any]], msgspec.Struct]
"""Takes a decoded dict and returns an instance."""


def type_from_struct(cls: type[msgspec.Struct], *, name: str | None = None) -> TypeSpec:
    """Make the resolved type of a Struct class.

    Args:
        cls: The class; its field names, their order and annotations make the type.
        name: The type's name; None: the class's own name.

    Raises:
        ConfigError: A field has no meaning on the wire; states the class and the field.
    """
    return _spec_of(cls, name or cls.__name__, ())


def struct_builder(cls: type[msgspec.Struct]) -> BuildStruct:
    """Make the function that converts a decoded dict to an instance of `cls`, nested ones too."""
    builders = {name: _builder(annotation) for name, annotation in annotations(cls).items()}

    def build(value: Mapping[str, Any]) -> msgspec.Struct:
        return cls(**{name: make(value[name]) for name, make in builders.items()})

    return build


def _spec_of(cls: type[msgspec.Struct], name: str, outer: tuple[type, ...]) -> TypeSpec:
    if cls in outer or len(outer) >= MAX_DEPTH:
        raise ConfigError(f"{name}: contains itself, or is nested more than {MAX_DEPTH} deep")
    hints = annotations(cls)
    defaults = _defaults(cls)
    fields: list[FieldSpec] = []
    nested: dict[str, TypeSpec] = {}
    for field_name, annotation in hints.items():
        parts = Parts(annotation)
        try:
            fields.append(_field_of(field_name, parts, defaults.get(field_name)))
        except ConfigError as error:
            raise ConfigError(f"{name}.{field_name}: {error}") from None
        if is_struct(parts.element):
            inner = _spec_of(parts.element, parts.element.__name__, (*outer, cls))
            if nested.setdefault(inner.name, inner) != inner:
                raise ConfigError(f"{name}.{field_name}: a second class named {inner.name}")
    try:
        return TypeSpec(name=name, fields=tuple(fields), nested=tuple(nested.values()))
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None


def _defaults(cls: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the defaults that a `FieldSpec` can have."""
    pairs = ((field.name, field.default) for field in msgspec.structs.fields(cls))
    named = ((n, enum_name(d) if isinstance(d, enum.Enum) else d) for n, d in pairs)
    return {name: d for name, d in named if isinstance(d, bool | int | float | str)}


def _field_of(name: str, parts: Parts, default: object) -> FieldSpec:
    element, said = parts.element, dict(parts.said)
    keys: dict[str, Any] = {"optional": parts.optional, "length": parts.length}
    if isinstance(default, bool | int | float | str) and not parts.in_array:
        keys["default"] = default
    if element is bool:
        keys["type"] = "bool"
    elif element is int or element is float:
        keys.update(_number_keys("int64" if element is int else "float64", said))
    elif element is str or element is bytes:
        keys["type"] = "string" if element is str else "bytes"
    elif typing.get_origin(element) is Literal:
        keys.update(type="enum", values=_texts(typing.get_args(element)))
    elif isinstance(element, type) and issubclass(element, enum.Enum):
        keys.update(type="enum", values=tuple(enum_name(member) for member in element))
    elif is_struct(element):
        keys["type"] = element.__name__
    else:
        raise ConfigError(
            f"type: {_written(element)}; allowed: bool, int, float, str, bytes, a Literal, "
            "an Enum, a Struct, X | None, and a list or a tuple of one of these"
        )
    if parts.is_list and "max_length" not in said:
        raise ConfigError("max_length: a list without; allowed: Bounds(max_length=…)")
    if parts.is_list and element in (str, bytes):
        raise ConfigError("type: a list of texts; allowed: a list of Structs that hold them")
    keys["max_length"] = said.pop("max_length", None)
    keys["min_length"] = said.pop("min_length", None)
    keys["unit"] = said.pop("unit", "")
    keys["outside"] = said.pop("outside", "reject")
    keys["nan"] = said.pop("nan", False)
    if said:
        raise ConfigError(f"{next(iter(said))}: not for {_written(element)}; allowed: numbers")
    return FieldSpec(name=name, **keys)


def _number_keys(written_type: str, said: dict[str, Any]) -> dict[str, Any]:
    """Remove the bounds of a number from `said`, and return them as keys of `FieldSpec`."""
    chosen = said.pop("type", written_type)
    family = INTEGER_LIMITS if written_type == "int64" else ("float32", "float64")
    if chosen not in family:
        raise ConfigError(f'type: "{chosen}"; allowed: {", ".join(family)}')
    keys = {"type": chosen, "step": said.pop("step", None), "wraps": said.pop("wraps", False)}
    low, high = said.pop("low", None), said.pop("high", None)
    if chosen in INTEGER_LIMITS:
        least, greatest = INTEGER_LIMITS[chosen]
        low = said.pop("above") + 1 if "above" in said else low
        high = said.pop("below") - 1 if "below" in said else high
        if low is not None or high is not None:
            keys["range"] = (least if low is None else low, greatest if high is None else high)
        return keys
    if "above" in said or "below" in said:
        raise ConfigError("range: gt and lt for a float; allowed: ge and le")
    if (low is None) is not (high is None):
        raise ConfigError("range: only one end; allowed: low and high")
    if low is not None:
        keys["range"] = (low, high)
    return keys


def _texts(values: tuple[Any, ...]) -> tuple[str, ...]:
    if not all(isinstance(value, str) for value in values):
        raise ConfigError(f"values: {values}; allowed: a Literal of texts")
    return values


def _written(annotation: object) -> str:
    return annotation.__name__ if isinstance(annotation, type) else str(annotation)


def _builder(annotation: object) -> Build:
    parts = Parts(annotation)
    element: Build
    if is_struct(parts.element):
        element = struct_builder(parts.element)
    elif isinstance(parts.element, type) and issubclass(parts.element, enum.Enum):
        element = {enum_name(member): member for member in parts.element}.__getitem__
    else:
        element = _same
    if not parts.in_array:
        make = element
    elif parts.is_list and typing.get_origin(bare(annotation)) is list:
        make = _each(element)
    else:
        make = _each_of_tuple(element)
    return _unless_none(make) if parts.optional else make


def _same(value: object) -> object:
    return value


def _each(make: Build) -> Build:
    return lambda values: [make(value) for value in values]


def _each_of_tuple(make: Build) -> Build:
    return lambda values: tuple(make(value) for value in values)


def _unless_none(make: Build) -> Build:
    return lambda value: None if value is None else make(value)
