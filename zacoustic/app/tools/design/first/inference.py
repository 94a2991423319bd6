"""From some values of a topic to a type that accepts them, and more.

A few seconds of listening do not show the range of a value, so every bound is generous: integers
get a type for eight times the observed values, floats ten times, texts twice. A step is only set if
the values themselves have few decimals, or the name is known (a latitude). The observed values
stand beside each field, so that a user who knows the vehicle can do better.
"""

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any, Final

import msgspec

INTEGER_HEADROOM: Final = 8
"""Ratio of an integer type's range to the observed values."""
FLOAT_HEADROOM: Final = 10
"""Ratio of a range of floats to the observed values."""
SHORTEST_TEXT_BYTES: Final = 16
"""Least bound of a text."""
MOST_WORDS: Final = 8
"""A text with no more distinct values might be an enum."""
_MOST_DECIMALS: Final = 6
_MAX_DEPTH: Final = 8
_IDENTIFIER: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")

# Names with a common meaning: low, high, step, unit, whether the ends meet.
_KNOWN: Final[dict[str, tuple[float, float, float, str, bool]]] = {
    **dict.fromkeys(("lat", "latitude"), (-90.0, 90.0, 1e-6, "deg", False)),
    **dict.fromkeys(("lon", "lng", "longitude"), (-180.0, 180.0, 1e-6, "deg", False)),
    **dict.fromkeys(("heading", "yaw", "course", "bearing"), (0.0, 360.0, 0.1, "deg", True)),
}


class NoTypeError(Exception):
    """The values fit no type; the text has the reason."""


class InferredField(msgspec.Struct, frozen=True, kw_only=True):
    """One field, in the form of the file."""

    keys: dict[str, Any]
    """`name`, `type` and other keys of a field, in the order of writing."""
    remark: str
    """The observed values, for people."""


class InferredType(msgspec.Struct, frozen=True, kw_only=True):
    """One type, in the form of the file."""

    name: str
    """Its name."""
    fields: tuple[InferredField, ...]
    """Its fields."""


def infer_type(name: str, values: Sequence[object]) -> list[InferredType]:
    """Infer the types of some values.

    Args:
        name: Name of the outermost type.
        values: The values of a topic, at least one.

    Returns:
        The nested types first, the outermost last.

    Raises:
        NoTypeError: The values are not maps, or a part of them has no type.
    """
    types: list[InferredType] = []
    _infer(name, values, types, depth=1)
    return types


def _infer(name: str, values: Sequence[object], types: list[InferredType], depth: int) -> None:
    if depth > _MAX_DEPTH:
        raise NoTypeError("maps are nested too deep")
    maps = [value for value in values if isinstance(value, dict)]
    if len(maps) != len(values) or not any(maps):
        raise NoTypeError("the values are no maps of fields")
    names = dict.fromkeys(key for each in maps for key in each)
    fields = []
    for field in names:
        if not (isinstance(field, str) and _IDENTIFIER.fullmatch(field)):
            raise NoTypeError(f"{field!r} is no name of a field")
        seen = [each[field] for each in maps if field in each and each[field] is not None]
        keys, remark = _field(name, field, seen, types, depth)
        if len(seen) < len(maps):
            keys["optional"] = True
        fields.append(InferredField(keys={"name": field, **keys}, remark=remark))
    types.append(InferredType(name=name, fields=tuple(fields)))


def _field(
    owner: str, field: str, seen: list[Any], types: list[InferredType], depth: int
) -> tuple[dict[str, Any], str]:
    if not seen:
        return {"type": "string", "max_length": SHORTEST_TEXT_BYTES}, "only null was seen: EDIT"
    if all(isinstance(value, list) for value in seen):
        return _array(owner, field, seen, types, depth)
    if all(isinstance(value, dict) for value in seen):
        nested = f"{owner}{_camel(field)}"
        _infer(nested, seen, types, depth + 1)
        return {"type": nested}, ""
    return _scalar(field, seen)


def _array(
    owner: str, field: str, seen: list[list[Any]], types: list[InferredType], depth: int
) -> tuple[dict[str, Any], str]:
    elements = [element for each in seen for element in each]
    longest = max(len(each) for each in seen)
    if not elements or any(isinstance(element, list | str | bytes) for element in elements):
        what = "lists of lists or texts" if elements else "empty lists only"
        raise NoTypeError(f"{field} has {what}")
    if any(element is None for element in elements):
        raise NoTypeError(f"{field} has lists with null in them")
    keys, remark = _field(owner, field, elements, types, depth)
    keys["max_length"] = max(4, 2 * longest)
    return keys, f"at most {longest} elements seen" + (f", {remark}" if remark else "")


def _scalar(field: str, seen: list[Any]) -> tuple[dict[str, Any], str]:
    kinds = {type(value) for value in seen}
    if kinds == {bool}:
        return {"type": "bool"}, ""
    if kinds == {int}:
        return _integer(seen)
    if kinds <= {int, float}:
        return _float(field, [float(value) for value in seen])
    if kinds == {str}:
        return _text(seen)
    if kinds == {bytes}:
        longest = max(len(value) for value in seen)
        return {"type": "bytes", "max_length": _bound(longest)}, f"at most {longest} bytes seen"
    raise NoTypeError(f"{field} is of {len(kinds)} kinds, or of one that has no type")


def _integer(seen: list[int]) -> tuple[dict[str, Any], str]:
    low, high = min(seen), max(seen)
    largest = INTEGER_HEADROOM * max(abs(low), abs(high))
    remark = f"seen {_span(low, high)}"
    if largest < 1 << 31:
        return {"type": "int32"}, remark
    if max(abs(low), abs(high)) < 1 << 63:
        return {"type": "int64"}, remark
    if low >= 0 and high < 1 << 64:
        return {"type": "uint64"}, remark
    raise NoTypeError(f"{high} does not fit 64 bits")


def _float(field: str, seen: list[float]) -> tuple[dict[str, Any], str]:
    if not all(math.isfinite(value) for value in seen):
        return {"type": "float64"}, "NaN or infinity seen: no range, no step"
    low, high = min(seen), max(seen)
    remark = f"seen {_span(low, high)}"
    known = _KNOWN.get(field.lower())
    if known is not None and known[0] <= low and high <= known[1]:
        keys = {"type": "float64", "range": [known[0], known[1]], "step": known[2]}
        return {**keys, "unit": known[3], **({"wraps": True} if known[4] else {})}, remark
    largest = max(abs(low), abs(high))
    decimals = _decimals(seen)
    if largest == 0.0 or largest > 1e12 or decimals is None:
        return {"type": "float64"}, f"{remark}: a range and a step make it smaller: EDIT"
    bound = _nice(FLOAT_HEADROOM * largest)
    step = 10.0**-decimals
    return {"type": "float64", "range": [-bound, bound], "step": step}, f"{remark}: EDIT"


def _text(seen: list[str]) -> tuple[dict[str, Any], str]:
    longest = max(len(value.encode(errors="replace")) for value in seen)
    words = sorted(set(seen))
    keys = {"type": "string", "max_length": _bound(longest)}
    if len(words) <= MOST_WORDS and all(word.isprintable() and word for word in words):
        listed = ", ".join(words)
        return keys, f"seen: {listed}; type enum with values [...] costs one byte"
    return keys, f"at most {longest} bytes seen"


def _decimals(seen: Iterable[float]) -> int | None:
    """Return the most decimals of the values; None: more than a few, as in measurements."""
    for decimals in range(_MOST_DECIMALS + 1):
        if all(math.isclose(value, round(value, decimals), rel_tol=1e-12) for value in seen):
            return decimals
    return None


def _nice(number: float) -> float:
    """Return the next of 1, 2, 5, 10, … that is not below."""
    power = 10.0 ** math.floor(math.log10(number))
    nice = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= number * 0.999999)
    return float(f"{nice:.3g}")


def _bound(longest: int) -> int:
    """Return a power of two that is at least twice the longest text."""
    return max(SHORTEST_TEXT_BYTES, 1 << (2 * longest - 1).bit_length()) if longest else 16


def _span(low: float, high: float) -> str:
    return f"{low:.9g}" if low == high else f"{low:.9g}..{high:.9g}"


def _camel(text: str) -> str:
    return "".join(part[:1].upper() + part[1:] for part in re.split(r"[^A-Za-z0-9]+", text))
