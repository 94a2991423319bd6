"""`TypeSpec`: a named list of fields, with the types nested in it.

A specification names the other types that it uses; `TypeTable` gives it their specifications in
`nested`. Only a *resolved* specification can validate, be described or have a codec.
"""

import json
import re
from collections.abc import Callable
from functools import cached_property
from typing import Any, Final

import msgspec

from zacoustic.core.values.types.fields import SCALAR_TYPES, FieldSpec
from zacoustic.core.values.types.scalars import Check
from zacoustic.core.values.types.trimming import compile_trim
from zacoustic.core.values.types.validation import compile_fields, compile_validator
from zacoustic.errors import ConfigError, PayloadInvalidError

# ROS messages nest four or five deep (odometry → pose with covariance → pose → point); sixteen is
# far from the recursion limit of any interpreter.
MAX_DEPTH: Final = 16
"""How deep types may nest, the outermost included."""

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*([/.][A-Za-z_][A-Za-z0-9_]*)*")


class TypeSpec(msgspec.Struct, frozen=True, kw_only=True, dict=True):
    """A type: which values a stream carries.

    Raises:
        ConfigError: Fields contradict each other; the message starts with the key.
    """

    name: str
    """Letters, digits, underscores, in parts joined by ``/`` or ``.``; not the name of a scalar."""
    fields: tuple[FieldSpec, ...] = ()
    """The fields in their order on the wire; none: a type with one value, of zero bytes."""
    nested: "tuple[TypeSpec, ...]" = ()
    """The resolved types that `fields` name."""
    drops_unknown: bool = False
    """Whether members that no field names are left out of a value, not a reason to refuse it."""
    is_hidden: bool = False
    """Whether it has members, none of which a foreign wire carries: no fields, and no bytes."""

    def __post_init__(self) -> None:
        """Check names, nested types and defaults.

        Raises:
            ConfigError: The message starts with the key.
        """
        if not _NAME.fullmatch(self.name) or self.name in SCALAR_TYPES:
            raise ConfigError(f'name: "{self.name}"; allowed: a name that is not a built-in type')
        known: set[str] = set()
        for index, field in enumerate(self.fields):
            key = f"fields[{index}]"
            if field.name in known:
                raise ConfigError(f'{key}.name: "{field.name}" a second time; allowed: once')
            known.add(field.name)
            if field.is_nested and self.is_resolved:
                self._check_nested(field, key)
            if field.default is not None:
                self._check_default(field, key)
        if self.is_resolved and self.depth > MAX_DEPTH:
            raise ConfigError(f"fields: nested {self.depth} deep; allowed: {MAX_DEPTH}")

    @cached_property
    def is_resolved(self) -> bool:
        """Whether every type that the fields name is in `nested`."""
        names = {spec.name for spec in self.nested}
        return all(field.type in names for field in self.fields if field.is_nested)

    @cached_property
    def depth(self) -> int:
        """How many types are inside each other, this one included."""
        return 1 + max((spec.depth for spec in self.nested), default=0)

    @cached_property
    def starts_with_optional(self) -> bool:
        """Whether the first item of a value may be the one that stands for None."""
        if not self.fields:
            return False
        first = self.fields[0]
        if first.is_bounded_array:
            return first.optional
        return first.optional or (
            first.is_nested and self.nested_type(first.type).starts_with_optional
        )

    def nested_type(self, name: str) -> "TypeSpec":
        """Return the type with that name that a field uses.

        Raises:
            ConfigError: It is not resolved.
        """
        for spec in self.nested:
            if spec.name == name:
                return spec
        index = next(i for i, field in enumerate(self.fields) if field.type == name)
        raise ConfigError(
            f'fields[{index}].type: "{name}" is not known; '
            f"allowed: {', '.join(SCALAR_TYPES)}, or a type of the table"
        )

    @cached_property
    def validate(self) -> Callable[[object], dict[str, Any]]:
        """Check a value and normalise it.

        Takes a Mapping or a `msgspec.Struct` with the fields as keys; returns a dict with every
        field in order: floats for integers in float fields, names for enum members, lists for
        arrays, dicts for nested types. Raises `PayloadInvalidError` in one line that states type,
        field path, value and allowed values.
        """
        check, trim = self.validate_trimmed, compile_trim(self, _no_note)
        return check if trim is None else lambda value: check(trim(value))

    @cached_property
    def validate_trimmed(self) -> Callable[[object], dict[str, Any]]:
        """The same, but nothing is cut or left out, whatever `outside` says of it."""
        nested = {spec.name: spec.check_fields for spec in self._used_types()}
        return compile_validator(self.name, self.fields, nested)

    @cached_property
    def check_fields(self) -> Check:
        """Called by `validate` of an enclosing type; raises refusals without a path."""
        nested = {spec.name: spec.check_fields for spec in self._used_types()}
        return compile_fields(self.fields, nested)

    def clamping(self) -> "TypeSpec":
        """Return the type with ``outside: "clamp"`` wherever a field says nothing and could.

        Members that it does not know are left out. What crosses is the same.
        """
        return TypeSpec(
            name=self.name,
            fields=tuple(
                msgspec.structs.replace(field, outside="clamp")
                if field.outside == "reject" and field.can_clamp
                else field
                for field in self.fields
            ),
            nested=tuple(spec.clamping() for spec in self.nested),
            drops_unknown=True,
            is_hidden=self.is_hidden,
        )

    def canonical(self) -> bytes:
        """Describe everything that changes decoding, in bytes that are equal for equal types.

        This is the JSON of a list of types, innermost first, each a list of fields; a nested type
        is the position of its description in the list. It includes field names and their order,
        types, ranges, steps, wrapping, enum values, lengths, optionality, and whether it may be no
        value; it excludes units,
        defaults and the names of types, which change no value. Of `outside` only "escape" changes
        decoding.
        """
        descriptions: list[str] = []
        self._describe(descriptions)
        return f"[{','.join(descriptions)}]".encode()

    def _describe(self, descriptions: list[str]) -> int:
        positions = {spec.name: spec._describe(descriptions) for spec in self._used_types()}
        description = json.dumps(
            [
                [
                    field.name,
                    positions[field.type] if field.is_nested else field.type,
                    field.range,
                    field.step,
                    field.wraps,
                    field.values,
                    field.length,
                    field.max_length,
                    field.optional,
                    *(["escape"] if field.escapes else []),
                    *(["nan"] if field.nan else []),
                    *([f"min_length {field.min_length}"] if field.min_length else []),
                ]
                for field in self.fields
            ],
            separators=(",", ":"),
        )
        if description not in descriptions:
            descriptions.append(description)
        return descriptions.index(description)

    def _used_types(self) -> "list[TypeSpec]":
        """Return the nested types in the order of their first use."""
        names = dict.fromkeys(field.type for field in self.fields if field.is_nested)
        return [self.nested_type(name) for name in names]

    def _check_nested(self, field: FieldSpec, key: str) -> None:
        spec = self.nested_type(field.type)
        if not spec.is_resolved:
            raise ConfigError(
                f'{key}.type: "{field.type}" is not resolved; allowed: resolved types'
            )
        if not spec.fields:
            raise ConfigError(f'{key}.type: "{field.type}" has no fields; allowed: at least one')
        if field.optional and not field.is_bounded_array and spec.starts_with_optional:
            raise ConfigError(
                f'{key}.optional: the first field of "{field.type}" is optional too, '
                "a missing one cannot be told apart; allowed: one of them"
            )

    def _check_default(self, field: FieldSpec, key: str) -> None:
        check = compile_validator(self.name, (field,), {})
        try:
            check({field.name: field.default})
        except PayloadInvalidError as error:
            raise ConfigError(f"{key}.default: {error}") from None


def _no_note(path: str) -> None:
    """Take the path of what was cut or left out, for nobody."""
