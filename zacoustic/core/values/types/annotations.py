"""Annotations of Python classes, split into parts, and `Bounds`, which they contain."""

import types
import typing
from typing import Annotated, Any, TypeGuard, Union

import msgspec

from zacoustic.core.values.types.fields import Number
from zacoustic.errors import ConfigError


class Bounds(msgspec.Struct, frozen=True):
    """Properties of a field that a Python annotation lacks; the names are those of `FieldSpec`."""

    low: Number | None = None
    """Least allowed value, in `unit`; together with `high`."""
    high: Number | None = None
    """Greatest allowed value, in `unit`."""
    step: Number | None = None
    """Values cross as the nearest multiple of this, in `unit`; 1 / 60000 is taken exactly."""
    unit: str = ""
    """Unit, for people."""
    wraps: bool = False
    """Whether `low` and `high` are the same value."""
    max_length: int | None = None
    """The most elements of a list; for a text or bytes, the most bytes."""
    min_length: int | None = None
    """The fewest bytes of a text or bytes."""
    outside: str = ""
    """Treatment of a number outside of the range: ``clamp`` or ``escape``; default: refused."""
    nan: bool = False
    """Whether the number may be no value: not a number, or an infinity."""
    type: str | None = None
    """A narrower type: ``uint8``, ``float32`` and the like."""


class Parts:
    """The parts of an annotation: the element, its bounds, and the containers around it."""

    def __init__(self, annotation: object) -> None:
        self.optional = False
        self.length: int | None = None
        self.is_list = False
        self.said: dict[str, Any] = {}
        self.element = self._peel(annotation)

    def _peel(self, annotation: Any) -> Any:  # noqa: ANN401 (annotations have no type)
        origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
        if origin is Annotated:
            for metadata in arguments[1:]:
                self.said.update(_said(metadata))
            return self._peel(arguments[0])
        if origin in (Union, types.UnionType) and type(None) in arguments and not self.in_array:
            self.optional = True
            rest = [argument for argument in arguments if argument is not type(None)]
            return self._peel(rest[0]) if len(rest) == 1 else annotation
        if origin is list and not self.in_array:
            self.is_list = True
            return self._peel(arguments[0])
        if origin is tuple and arguments and not self.in_array:
            if len(arguments) == 2 and arguments[1] is Ellipsis:
                self.is_list = True
            elif all(argument == arguments[0] for argument in arguments):
                self.length = len(arguments)
            else:
                return annotation
            return self._peel(arguments[0])
        return annotation

    @property
    def in_array(self) -> bool:
        """Whether the rest of the annotation is inside an array: no field is an array of arrays."""
        return self.is_list or self.length is not None


def _said(metadata: object) -> dict[str, Any]:
    """Return the values of `Bounds` or `msgspec.Meta`, under the names of `Bounds`."""
    if isinstance(metadata, Bounds):
        pairs = {name: getattr(metadata, name) for name in metadata.__struct_fields__}
    elif isinstance(metadata, msgspec.Meta):
        pairs = {
            "low": metadata.ge,
            "high": metadata.le,
            "above": metadata.gt,
            "below": metadata.lt,
            "step": metadata.multiple_of,
            "max_length": metadata.max_length,
            "min_length": metadata.min_length or None,
        }
    else:
        return {}
    return {name: value for name, value in pairs.items() if not _is_unsaid(value)}


def _is_unsaid(value: object) -> bool:
    return value is None or value is False or value == ""


def annotations(cls: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the annotations of a class by field, in order, with names resolved.

    Raises:
        ConfigError: An annotation uses a name that its module lacks.
    """
    try:
        hints = typing.get_type_hints(cls, include_extras=True)
    except (NameError, AttributeError, TypeError) as error:
        raise ConfigError(f"{cls.__name__}: its annotations have no meaning: {error}") from error
    return {name: hints[name] for name in cls.__struct_fields__}


def is_struct(element: object) -> TypeGuard[type[msgspec.Struct]]:
    """Return whether an annotation is a `msgspec.Struct` class."""
    return isinstance(element, type) and issubclass(element, msgspec.Struct)


def bare(annotation: object) -> object:
    """Return the annotation without `Annotated` and `| None`."""
    while True:
        origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
        if origin is Annotated:
            annotation = arguments[0]
        elif origin in (Union, types.UnionType):
            annotation = next(a for a in arguments if a is not type(None))
        else:
            return annotation
