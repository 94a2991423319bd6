"""Checks an application's values against the fields of their type.

`compile_validator` makes one closure per field when the type is made, and one for the whole: every
sample is validated, and everything that a closure needs is known long before. A closure returns the
normalised value (a float for an integer in a float field, the name for a member of an `Enum`, a
folded heading) or raises a refusal. Each level on the way out adds its part of the path; the
outermost makes it a `PayloadInvalidError` of one line.
"""

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any

import msgspec

from zacoustic.core.values.types.fields import FieldSpec
from zacoustic.core.values.types.scalars import Check, RefusedError, scalar_check, shown
from zacoustic.errors import PayloadInvalidError


def compile_validator(
    type_name: str, fields: tuple[FieldSpec, ...], nested: Mapping[str, Check]
) -> Callable[[object], dict[str, Any]]:
    """Make the function that checks and normalises values of a type.

    Args:
        type_name: The type's name, for errors.
        fields: The fields, in order.
        nested: `compile_fields` of every nested type by its name.

    Returns:
        A function from a Mapping or `msgspec.Struct` to a dict with every field, in order. It
        raises `PayloadInvalidError` that states type, field path, value and what is allowed.
    """
    check = compile_fields(fields, nested)

    def validate(value: object) -> dict[str, Any]:
        try:
            result: dict[str, Any] = check(value)
        except RefusedError as refusal:
            message = f"{type_name}{refusal.path}{refusal.reason}"
            raise PayloadInvalidError(message, hint=refusal.hint) from None
        return result

    return validate


def compile_fields(fields: tuple[FieldSpec, ...], nested: Mapping[str, Check]) -> Check:
    """Make the check of a value that has these fields."""
    plan = [(field.name, _field_check(field, nested), field) for field in fields]
    checks = [(name, check_field) for name, check_field, _ in plan]

    def check(value: object) -> dict[str, Any]:
        given = _as_mapping(value)
        # Nearly all values have exactly these fields and are valid.
        if type(given) is dict and len(given) == len(checks):
            try:
                return {name: check_field(given[name]) for name, check_field in checks}
            except (KeyError, RefusedError):
                pass  # the fault is found below
        result: dict[str, Any] = {}
        found = len(given)
        for name, check_field, field in plan:
            if name in given:
                raw = given[name]
            else:
                if not field.optional and field.default is None:
                    _check_known(given, fields)  # a misspelt name explains why one is missing
                    raise RefusedError(f" is missing; allowed: {field.allowed}", f".{name}")
                raw = field.default
                found += 1
            try:
                result[name] = check_field(raw)
            except RefusedError as refusal:
                refusal.path = f".{name}{refusal.path}"
                raise
        if found != len(plan):
            _check_known(given, fields)
        return result

    return check


def _as_mapping(value: object) -> Mapping[Any, Any]:
    if type(value) is dict or isinstance(value, Mapping):
        return value
    if isinstance(value, msgspec.Struct):
        return {name: getattr(value, name) for name in value.__struct_fields__}
    raise RefusedError(f" is {shown(value)}; allowed: a mapping of field names to values")


def _check_known(given: Mapping[Any, Any], fields: tuple[FieldSpec, ...]) -> None:
    names = [field.name for field in fields]
    unknown = [name for name in given if name not in names]
    if not unknown:
        return
    close = get_close_matches(unknown[0], names, 1) if isinstance(unknown[0], str) else []
    raise RefusedError(
        f" has no field {shown(unknown[0])}; allowed: {', '.join(names) or 'no field'}",
        hint=f'did you mean "{close[0]}"?' if close else "",
    )


def _field_check(field: FieldSpec, nested: Mapping[str, Check]) -> Check:
    element = nested[field.type] if field.is_nested else scalar_check(field)
    check = _array_check(field, element) if field.is_array else element
    if not field.optional:
        return check
    return lambda value: None if value is None else check(value)


def _array_check(field: FieldSpec, check_element: Check) -> Check:
    low, high = field.length or 0, field.capacity
    allowed = f"{high} elements" if low else f"at most {high} elements"

    def check(value: object) -> list[Any]:
        if not isinstance(value, list | tuple):
            raise RefusedError(f" is {shown(value)}; allowed: a list of {allowed}")
        if not low <= len(value) <= high:
            raise RefusedError(f" has {len(value)} elements; allowed: {allowed}")
        result: list[Any] = []
        try:
            for element in value:
                result.append(check_element(element))  # noqa: PERF401 (its length is the index)
        except RefusedError as refusal:
            refusal.path = f"[{len(result)}]{refusal.path}"
            raise
        return result

    return check
