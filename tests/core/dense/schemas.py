"""Types of every kind of field, and values of them, for properties."""

import math
from typing import Any

import hypothesis
from hypothesis import strategies as st

from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.errors import ConfigError

_STEPS = (1e-6, 0.001, 0.01, 0.1, 0.25, 1 / 60, 1.0, 7.0)


@st.composite
def _number(draw: st.DrawFn, name: str) -> tuple[FieldSpec, st.SearchStrategy[Any]]:
    step = draw(st.sampled_from(_STEPS))
    low = draw(st.integers(-1000, 1000)) * step
    size = draw(st.sampled_from((2, 3, 9, 400, 30_000, 5_000_000)))
    high = low + size * step
    outside = draw(st.sampled_from(("reject", "clamp", "escape")))
    wraps = outside == "reject" and draw(st.booleans())
    try:
        field = FieldSpec(
            name=name, type="float64", range=(low, high), step=step, wraps=wraps, outside=outside
        )
    except ConfigError:  # -0.30000000000000004 is no multiple of 0.1, so this circle has a seam
        hypothesis.reject()
    values = st.floats(low, high)
    if outside != "reject":
        values |= st.floats(-1e9, 1e9)
    return field, values


@st.composite
def _field(draw: st.DrawFn, name: str) -> tuple[FieldSpec, st.SearchStrategy[Any]]:
    kind = draw(st.sampled_from(("number", "number", "integer", "bool", "enum", "exact", "text",
                                 "bytes", "array", "list")))  # fmt: skip
    if kind == "number":
        return draw(_number(name))
    if kind == "integer":
        low = draw(st.integers(-(1 << 31), 1000))
        high = low + draw(st.sampled_from((1, 30, 70_000, (1 << 30))))
        return (
            FieldSpec(name=name, type="int64", range=(low, high)),
            st.integers(low, high),
        )
    if kind == "bool":
        return FieldSpec(name=name, type="bool"), st.booleans()
    if kind == "enum":
        names = tuple("abcde"[: draw(st.integers(1, 5))])
        return FieldSpec(name=name, type="enum", values=names), st.sampled_from(names)
    if kind == "exact":
        return FieldSpec(name=name, type="float64"), st.floats(allow_nan=False)
    if kind == "text":
        return FieldSpec(name=name, type="string"), st.text(max_size=12)
    if kind == "bytes":
        return FieldSpec(name=name, type="bytes", max_length=9), st.binary(max_size=9)
    if kind == "array":
        length = draw(st.integers(1, 4))
        field = FieldSpec(name=name, type="float64", range=(0, 10), step=0.5, length=length)
        return field, st.lists(st.floats(0, 10), min_size=length, max_size=length)
    field = FieldSpec(name=name, type="uint8", max_length=5)
    return field, st.lists(st.integers(0, 255), max_size=5)


@st.composite
def schemas(draw: st.DrawFn) -> tuple[TypeSpec, list[dict[str, Any]]]:
    """A type, and some values of it."""
    fields, strategies = [], {}
    for n in range(draw(st.integers(1, 6))):
        field, values = draw(_field(f"f{n}"))
        if draw(st.integers(0, 4)) == 0:
            field = FieldSpec(**{**_parts(field), "optional": True})
            values |= st.none()
        fields.append(field)
        strategies[field.name] = values
    values = st.fixed_dictionaries(strategies)
    return (
        TypeSpec(name="Any", fields=tuple(fields)),
        draw(st.lists(values, min_size=1, max_size=5)),
    )


def is_close(field: FieldSpec, found: Any, expected: Any) -> bool:
    """Tell whether a value is the one that was sent, within half a step."""
    if expected is None or found is None:
        return found is expected
    if isinstance(expected, list):
        return len(found) == len(expected) and all(
            is_close(field, one, other) for one, other in zip(found, expected, strict=True)
        )
    if field.step is None or field.is_integer or not isinstance(expected, float):
        return bool(found == expected)
    assert field.range is not None
    low, high = field.range
    slack = 0.5 * field.step * (1 + 1e-6) + 1e-12 * abs(expected)
    if field.wraps:
        around = high - low
        distance = abs(found - expected) % around
        return bool(min(distance, around - distance) <= slack)
    if low <= expected <= high:
        return bool(abs(found - expected) <= slack)
    if field.outside == "clamp":
        return bool(abs(found - min(max(expected, low), high)) <= slack)
    return bool(math.isclose(found, expected) or abs(found - expected) <= slack)


def _parts(field: FieldSpec) -> dict[str, Any]:
    return {name: getattr(field, name) for name in field.__struct_fields__}
