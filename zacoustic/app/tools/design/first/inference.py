"""From some values of a topic to a type that accepts them, and more.

A few seconds of listening do not show the range of a value, so bounds are generous (ten times the
observed values, texts twice), and a number beyond them is not refused: it crosses in the full width
of its type (`outside: "escape"`). The step is that of the name, if it names a quantity (a latitude,
a depth); else that of the values' own decimals; else a thousandth of what varied. A number that did
not vary, and has no such name, keeps its full width: zeros say nothing of a step. The observed
values stand beside each field, so that a user who knows the vehicle can do better.
"""

import math
import re
import statistics
from collections.abc import Iterable, Sequence
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.first.guessing import Quantity, quantity_of, words_in
from zacoustic.core.values.types import FieldSpec
from zacoustic.errors import ConfigError

HEADROOM: Final = 10
"""Ratio of a range to the observed values."""
RESOLUTION: Final = 1000
"""Steps in what varied, of a measurement with many digits."""
LEAST_VALUES: Final = 8
"""So many different whole numbers make a float a count; fewer say nothing of its decimals."""
MOST_TEXTS: Final = 256
"""Most elements of a list of texts."""
SHORTEST_TEXT_BYTES: Final = 16
"""Least bound of a text."""
MOST_WORDS: Final = 8
"""A text with no more distinct values might be an enum."""
_LETTER_BYTES: Final = 4
_MOST_DECIMALS: Final = 6
_MAX_DEPTH: Final = 8
_LEAST_BOUND: Final = 100
_COUNTER_BOUND: Final = 1_000_000
_LARGEST: Final = 1e12
_LEAST_SPAN: Final = 1e-30
"""What varied less did not vary."""
_IDENTIFIER: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


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
    if elements and all(isinstance(element, str) for element in elements):
        return _texts(field, seen)
    if not elements or any(isinstance(element, list | str | bytes) for element in elements):
        what = "lists of lists, or of texts and others" if elements else "empty lists only"
        raise NoTypeError(f"{field} has {what}")
    if any(element is None for element in elements):
        raise NoTypeError(f"{field} has lists with null in them")
    keys, remark = _field(owner, field, elements, types, depth)
    keys["max_length"] = max(4, 2 * longest)
    return keys, f"at most {longest} elements seen" + (f", {remark}" if remark else "")


def _texts(field: str, seen: list[list[str]]) -> tuple[dict[str, Any], str]:
    """Return the keys of a list of texts: a fixed one, since of others no type tells the bounds."""
    sizes = {len(each) for each in seen}
    if len(sizes) > 1 or len(seen) < 2 or max(sizes) > MOST_TEXTS:
        raise NoTypeError(f"{field} has lists of texts, and not always as many")
    longest = max(len(text.encode(errors="replace")) for each in seen for text in each)
    most = _LETTER_BYTES if longest <= 1 else _bound(longest)
    keys = {"type": "string", "length": max(sizes), "max_length": most}
    return keys, f"always {max(sizes)} texts, of at most {longest} bytes"


def _scalar(field: str, seen: list[Any]) -> tuple[dict[str, Any], str]:
    kinds = {type(value) for value in seen}
    if kinds == {bool}:
        return {"type": "bool"}, ""
    if kinds == {int}:
        return _integer(field, seen)
    if kinds <= {int, float}:
        return infer_number(field, [float(value) for value in seen])
    if kinds == {str}:
        return _text(seen)
    if kinds == {bytes}:
        longest = max(len(value) for value in seen)
        return {"type": "bytes", "max_length": _bound(longest)}, f"at most {longest} bytes seen"
    raise NoTypeError(f"{field} is of {len(kinds)} kinds, or of one that has no type")


def _integer(field: str, seen: list[int]) -> tuple[dict[str, Any], str]:
    low, high = min(seen), max(seen)
    remark = f"seen {_span(low, high)}"
    if max(abs(low), abs(high)) >= 1 << 63:
        if low >= 0 and high < 1 << 64:
            return {"type": "uint64"}, remark
        raise NoTypeError(f"{high} does not fit 64 bits")
    bound = max(_LEAST_BOUND, int(_nice(HEADROOM * max(abs(low), abs(high), 1))))
    quantity = quantity_of(field, map(float, seen))
    if quantity is not None and quantity.step <= 1 and not quantity.wraps:
        ends = _ends(quantity, low, high)
        keys = _bounded("int32", math.floor(ends[0]), math.ceil(ends[1]), 1)
        if keys is not None:
            return {**keys, **_unit(quantity)}, remark
    if words_in(field)[-1:] in (["count"], ["seq"], ["sequence"], ["counter"], ["stamp"]):
        bound = max(bound, _COUNTER_BOUND)  # it grows as long as the program runs
    kind = "int32" if bound < 1 << 31 else "int64"
    keys = _bounded(kind, 0 if low >= 0 else -bound, bound, None)
    return keys or {"type": "int64"}, remark


def infer_number(field: str, seen: list[float]) -> tuple[dict[str, Any], str]:
    """Return the keys of a number with a fraction, and a remark on its values.

    Args:
        field: Its name.
        seen: Its observed values, at least one.
    """
    finite = [value for value in seen if math.isfinite(value)]
    if not finite:
        return {"type": "float64", "nan": True}, "only NaN or infinity seen: no range, no step"
    if len(finite) < len(seen):
        of_numbers, remark = infer_number(field, finite)
        return {**of_numbers, "nan": True}, f"{remark}, NaN or infinity too"
    low, high = min(seen), max(seen)
    remark = f"seen {_span(low, high)}"
    quantity = quantity_of(field, seen)
    if quantity is not None:
        if quantity.wraps:
            keys: dict[str, Any] | None = {
                "type": "float64", "range": [quantity.low, quantity.high],
                "step": quantity.step, "wraps": True,
            }  # fmt: skip
        else:
            keys = _bounded("float64", *_ends(quantity, low, high), quantity.step)
        if keys is not None:
            return {**keys, **_unit(quantity)}, remark
    largest = max(abs(low), abs(high))
    decimals = _decimals(seen)
    is_count = decimals == 0 and len({*seen}) < LEAST_VALUES  # whole so far, by chance perhaps
    if decimals is not None and largest < _LARGEST and low < high and not is_count:
        step = 10.0**-decimals
    elif _LEAST_SPAN < high - low < math.inf:
        # One value far from the others must not round these away.
        usual = statistics.median(abs(value) for value in seen if value) * HEADROOM
        step = _nice_below(min(high - low, max(usual, _LEAST_SPAN)) / RESOLUTION)
        remark += f", step is {step:g} of what varied"
    else:
        return {"type": "float64"}, f"{remark}, it did not vary: no range, no step"
    bound = _nice(HEADROOM * max(largest, step))
    keys = _bounded("float64", 0.0 if low >= 0 else -bound, bound, step)
    return keys or {"type": "float64"}, remark


def _ends(quantity: Quantity, low: float, high: float) -> tuple[float, float]:
    """Return the ends of a range: those of the quantity, or with headroom if they are too near."""
    if quantity.is_firm:
        return quantity.low, quantity.high
    least = quantity.low if low >= quantity.low / 2 else -_nice(HEADROOM * abs(low))
    greatest = quantity.high if high <= quantity.high / 2 else _nice(HEADROOM * abs(high))
    return least, greatest


def _bounded(kind: str, low: float, high: float, step: float | None) -> dict[str, Any] | None:
    """Return the keys of a bounded number; None: the type has no such range."""
    keys: dict[str, Any] = {"type": kind, "range": [low, high], "outside": "escape"}
    if step is not None and not (step == 1 and kind != "float64"):
        keys["step"] = step
    try:
        FieldSpec(name="x", **{**keys, "range": (low, high)})
    except ConfigError:
        return None
    return keys


def _unit(quantity: Quantity) -> dict[str, str]:
    return {"unit": quantity.unit} if quantity.unit else {}


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


def _nice_below(number: float) -> float:
    """Return the next of 1, 2, 5, 10, … that is not above."""
    power = 10.0 ** math.floor(math.log10(number))
    nice = max(factor * power for factor in (1, 2, 5) if factor * power <= number * 1.000001)
    return float(f"{nice:.3g}")


def _bound(longest: int) -> int:
    """Return a power of two that is at least twice the longest text."""
    return max(SHORTEST_TEXT_BYTES, 1 << (2 * longest - 1).bit_length()) if longest else 16


def _span(low: float, high: float) -> str:
    return f"{low:.9g}" if low == high else f"{low:.9g}..{high:.9g}"


def _camel(text: str) -> str:
    return "".join(part[:1].upper() + part[1:] for part in re.split(r"[^A-Za-z0-9]+", text))
