"""Checks of single values, one closure per scalar field; `validation` is composed of them."""

import enum
import math
import numbers
from collections.abc import Callable, Mapping
from typing import Any, Final

from zacoustic.core.values.types.ends import Ends, single
from zacoustic.core.values.types.fields import (
    FLOAT32_MAX,
    FLOAT_TYPES,
    INTEGER_LIMITS,
    FieldSpec,
)

Check = Callable[[object], Any]
"""Takes a value and returns it normalised, or raises `RefusedError`."""

_SHOWN_CHARACTERS: Final = 60  # of a refused value: enough to recognise it, and still one line


class RefusedError(Exception):
    """A value is not allowed; becomes a `PayloadInvalidError` once the path is complete."""

    def __init__(self, reason: str, path: str = "", hint: str = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.path = path
        self.hint = hint


def _refused(field: FieldSpec, value: object) -> RefusedError:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    unit = f" {field.unit}" if field.unit and is_number else ""
    is_none = isinstance(value, float) and not math.isfinite(value)
    hint = "nan: true lets it be no value" if is_none and field.type in FLOAT_TYPES else ""
    return RefusedError(f" is {shown(value)}{unit}; allowed: {field.allowed}", hint=hint)


def _bool_check(field: FieldSpec) -> Check:
    def check(value: object) -> bool:
        if value is True or value is False:
            return bool(value)
        raise _refused(field, value)

    return check


def _integer_check(field: FieldSpec) -> Check:
    low, high = (int(limit) for limit in field.bounds)
    if field.outside != "reject" and not field.wraps:
        low, high = INTEGER_LIMITS[field.type]
    span = high - low if field.wraps else 0

    def check(value: object) -> int:
        if type(value) is not int:
            if isinstance(value, bool) or not isinstance(value, numbers.Integral):
                raise _refused(field, value)
            value = int(value)
        number: int = low + (value - low) % span if span else value
        if low <= number <= high:
            return number
        raise _refused(field, value)

    return check


def _float_check(field: FieldSpec) -> Check:
    unbounded = (-FLOAT32_MAX, FLOAT32_MAX) if field.type == "float32" else None
    is_open = field.outside != "reject" and field.range is not None
    limits = (None if is_open else field.limits) or unbounded
    # Without limits NaN and infinity are values as well.
    any_float = field.limits is None or field.escapes or field.nan
    if is_open and not field.escapes:
        limits = None
    low, high = limits or (-math.inf, math.inf)
    stands_for = _end_check(field)

    def check(value: object) -> float:
        number = value if type(value) is float else _as_float(field, value)
        if low <= number <= high:
            return number
        if any_float and number - number != 0:  # NaN and the infinities
            return number
        end = stands_for(number)
        if end is None:
            raise _refused(field, value)
        return end

    return check


def _end_check(field: FieldSpec) -> Callable[[float], float | None]:
    """Make the function that returns which end of the range a number stands for."""
    if field.limits is not None:
        return Ends(field).value
    # Of float32, the greatest numbers are ends too.
    return lambda number: None if math.isinf(end := single(number)) or end != end else end


def _folding_check(field: FieldSpec) -> Check:
    low, high = field.bounds
    span = high - low
    stands_for = Ends(field).value

    def check(value: object) -> float:
        number = value if type(value) is float else _as_float(field, value)
        if low <= number < high:
            return number
        if number - number != 0:
            if field.nan:
                return number
            raise _refused(field, value)
        if stands_for(number) in (low, high):
            return low
        folded = low + (number - low) % span
        # The remainder of a tiny negative number is rounded up to the span itself.
        return folded if folded < high else low

    return check


def _as_float(field: FieldSpec, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise _refused(field, value)
    try:
        return float(value)
    except OverflowError:
        raise _refused(field, value) from None


def _string_check(field: FieldSpec) -> Check:
    shortest, longest = field.min_length or 0, field.max_length

    def check(value: object) -> str:
        if not isinstance(value, str):
            raise _refused(field, value)
        try:
            size_bytes = len(value) if value.isascii() else len(value.encode())
        except UnicodeEncodeError:
            raise RefusedError(
                f" is {shown(value)}; allowed: text without lone surrogates"
            ) from None
        if size_bytes < shortest or (longest is not None and size_bytes > longest):
            raise RefusedError(f" has {size_bytes} bytes; allowed: {field.allowed_bytes}")
        return str(value)

    return check


def _bytes_check(field: FieldSpec) -> Check:
    shortest, longest = field.min_length or 0, field.max_length

    def check(value: object) -> bytes:
        if not isinstance(value, bytes | bytearray | memoryview):
            raise _refused(field, value)
        content = bytes(value)
        if len(content) < shortest or (longest is not None and len(content) > longest):
            raise RefusedError(f" has {len(content)} bytes; allowed: {field.allowed_bytes}")
        return content

    return check


def _enum_check(field: FieldSpec) -> Check:
    known = {value: value for value in field.values}

    def check(value: object) -> str:
        value = enum_of(value)
        name = known.get(value) if isinstance(value, str) else None
        if name is None:
            raise _refused(field, value)
        return name

    return check


def enum_of(value: object) -> object:
    """Return the name of an `Enum` member, or the value as it is."""
    return enum_name(value) if isinstance(value, enum.Enum) else value


def enum_name(member: enum.Enum) -> str:
    """Return the name of an `Enum` member: its value if that is text, else its name."""
    return member.value if isinstance(member.value, str) else member.name


def scalar_check(field: FieldSpec) -> Check:
    """Make the check of one element of a field of a scalar type."""
    return _SCALAR_CHECKS[_kind(field)](field)


def _kind(field: FieldSpec) -> str:
    if field.is_integer:
        return "integer"
    if field.is_numeric:
        return "folding" if field.wraps else "float"
    return field.type


_SCALAR_CHECKS: Final[dict[str, Callable[[FieldSpec], Check]]] = {
    "bool": _bool_check,
    "integer": _integer_check,
    "float": _float_check,
    "folding": _folding_check,
    "string": _string_check,
    "bytes": _bytes_check,
    "enum": _enum_check,
}


def shown(value: object) -> str:
    """Return the value as an error shows it: one line, not too long."""
    # Containers may be huge or contain themselves: show only their kind.
    if isinstance(value, Mapping | list | tuple | set | frozenset | bytearray | memoryview):
        return f"{type(value).__name__} of {len(value)}"
    if isinstance(value, str | bytes):
        text = repr(value[:_SHOWN_CHARACTERS])
        return text if len(value) <= _SHOWN_CHARACTERS else f"{text}… ({len(value)} long)"
    if isinstance(value, int) and value.bit_length() > 128:
        return f"an integer of {value.bit_length()} bits"
    if value is None or isinstance(value, int | float):
        return repr(value)
    return type(value).__name__
