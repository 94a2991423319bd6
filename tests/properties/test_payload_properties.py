"""Laws of payload codecs, over arbitrary types, values and bytes."""

import math
import struct
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tests.conftest import SOAK
from zacoustic.core.values.payload import CborCodec, PackedCodec, PayloadError, TypedCodec
from zacoustic.core.values.types import INTEGER_LIMITS, FieldSpec, TypeSpec, TypeTable
from zacoustic.core.values.types.fields import OUTSIDE_WORDS
from zacoustic.errors import ConfigError

STEPS = (1e-6, 1e-3, 0.01, 0.05, 0.1, 0.25, 0.3, 0.5, 1.0, 2.5, 7.0)
LEAF = "Leaf"

settings.register_profile(
    "payload",
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    max_examples=150 if SOAK else 60,
)
QUICK = settings.get_profile("payload")
BOTH = pytest.mark.parametrize("codec_type", [CborCodec, PackedCodec])


def single(number: float) -> float:
    return float(struct.unpack(">f", struct.pack(">f", number))[0])


def _four_digits(number: float) -> float:
    return round(number, 4)


@st.composite
def number_keys(draw: st.DrawFn) -> dict[str, Any]:
    kind = draw(st.sampled_from([*INTEGER_LIMITS, "float32", "float64"]))
    keys: dict[str, Any] = {"type": kind}
    if kind in INTEGER_LIMITS:
        low, high = INTEGER_LIMITS[kind]
        ends: st.SearchStrategy[float] = st.integers(low, high)
        steps: st.SearchStrategy[float] = st.integers(1, 100)
    else:
        ends = st.floats(-1e6, 1e6, allow_nan=False).map(_four_digits)
        steps = st.sampled_from(STEPS)
    if draw(st.booleans()):
        keys["range"] = tuple(sorted(draw(st.lists(ends, min_size=2, max_size=2, unique=True))))
        keys["wraps"] = draw(st.booleans())
    if draw(st.booleans()):
        keys["step"] = draw(steps)
    if "range" in keys and not keys["wraps"]:
        keys["outside"] = draw(st.sampled_from(OUTSIDE_WORDS))
    if kind not in INTEGER_LIMITS:
        keys["nan"] = draw(st.booleans())
    return keys


ENUM_KEYS = st.integers(1, 30).map(
    lambda count: {"type": "enum", "values": tuple(f"v{i}" for i in range(count))}
)
TEXT_KEYS = st.builds(
    lambda kind, longest, shortest: {
        "type": kind,
        "max_length": longest,
        "min_length": None if shortest is None else min(shortest, longest or shortest),
    },
    st.sampled_from(["string", "bytes"]),
    st.none() | st.integers(1, 40),
    st.none() | st.integers(1, 40),
)


@st.composite
def fields(draw: st.DrawFn, name: str, *, nested: bool) -> FieldSpec:
    choices = [number_keys(), ENUM_KEYS, TEXT_KEYS, st.just({"type": "bool"})]
    keys = dict(draw(st.one_of(*choices, *([st.just({"type": LEAF})] if nested else []))))
    shape = draw(st.sampled_from(["one", "one", "fixed", "bounded"]))
    if shape == "fixed":
        keys["length"] = draw(st.integers(1, 4))
    elif shape == "bounded" and keys["type"] not in ("string", "bytes"):
        keys["max_length"] = draw(st.integers(1, 30))
    try:
        return FieldSpec(name=name, optional=draw(st.booleans()), **keys)
    except ConfigError:  # a step that does not fit the range: another example will do
        assume(False)
        raise


@st.composite
def types(draw: st.DrawFn) -> TypeSpec:
    inner = [draw(fields(f"i{n}", nested=False)) for n in range(draw(st.integers(1, 2)))]
    outer = [draw(fields(f"o{n}", nested=True)) for n in range(draw(st.integers(1, 4)))]
    try:
        return TypeTable(
            [TypeSpec(name="T", fields=tuple(outer)), TypeSpec(name=LEAF, fields=tuple(inner))]
        )["T"]
    except ConfigError:  # an optional type that starts with an optional field
        assume(False)
        raise


def scalars(field: FieldSpec) -> st.SearchStrategy[Any]:
    if field.nan:
        numbers = scalars(msgspec.structs.replace(field, nan=False))
        return numbers | st.sampled_from([math.nan, math.inf, -math.inf])
    if field.outside != "reject":  # now and then a number outside
        anything = msgspec.structs.replace(field, range=None, step=None, outside="reject")
        within = msgspec.structs.replace(field, outside="reject")
        return scalars(within) | scalars(anything)
    if field.is_integer and field.limits is not None:
        return st.integers(int(field.limits[0]), int(field.limits[1]))
    if field.is_numeric:
        if field.limits is not None:
            return st.floats(float(field.limits[0]), float(field.limits[1]))
        return st.floats(width=32 if field.type == "float32" else 64, allow_nan=False)
    shortest, longest = field.min_length or 0, field.max_length
    by_type: dict[str, st.SearchStrategy[Any]] = {
        "bool": st.booleans(),
        "enum": st.sampled_from(field.values or ("",)),
        "bytes": st.binary(min_size=shortest, max_size=50 if longest is None else longest),
        "string": st.text(max_size=20)
        .map(lambda text: text + "_" * (shortest - len(text.encode())))
        .filter(lambda text: longest is None or len(text.encode()) <= longest),
    }
    return by_type[field.type]


def values(spec: TypeSpec) -> st.SearchStrategy[dict[str, Any]]:
    def of_field(field: FieldSpec) -> st.SearchStrategy[Any]:
        one = values(spec.nested_type(field.type)) if field.is_nested else scalars(field)
        if field.length is not None:
            one = st.lists(one, min_size=field.length, max_size=field.length)
        elif field.is_bounded_array:
            assert field.max_length is not None
            one = st.lists(one, max_size=min(3, field.max_length))
        return st.none() | one if field.optional else one

    return st.fixed_dictionaries({field.name: of_field(field) for field in spec.fields})


def each(spec: TypeSpec, left: Any, right: Any, check: Callable[..., None]) -> None:
    """Call `check` for every pair of scalars."""
    for field in spec.fields:
        pair = left[field.name], right[field.name]
        if pair[0] is None or pair[1] is None:
            assert pair == (None, None)
            continue
        pairs = zip(*pair, strict=True) if field.is_array else [pair]
        for one, other in pairs:
            if field.is_nested:
                each(spec.nested_type(field.type), one, other, check)
            else:
                check(field, one, other)


def within_half_a_step(field: FieldSpec, sent: Any, received: Any) -> None:
    if not field.is_numeric or sent != sent or (field.nan and math.isinf(sent)):
        assert repr(received) == repr(sent)
        return
    allowed: float = 0
    if field.outside == "clamp" and field.range is not None:
        sent = min(max(sent, field.range[0]), field.range[1])
    if field.step is not None:
        allowed = field.step / 2 * (1 + 1e-9) + abs(sent) * 1e-15
        if field.escapes and field.type == "float32":
            allowed += abs(single(sent) - sent) if math.isfinite(sent) else 0
    elif field.type == "float32":
        allowed = abs(single(sent) - sent) if math.isfinite(sent) else 0
    error = abs(received - sent) if received != sent else 0
    if field.wraps and field.range is not None:
        low, high = field.range
        assert low <= received < high
        error = min(error, abs(high - low - error))
    assert error <= allowed


@BOTH
@QUICK
@given(st.data(), types())
def test_every_value_comes_back_within_half_a_step(
    codec_type: type[TypedCodec], data: st.DataObject, spec: TypeSpec
) -> None:
    value = data.draw(values(spec))
    codec = codec_type(spec)
    payload = codec.encode(value)
    each(spec, spec.validate(value), codec.decode(payload), within_half_a_step)


@BOTH
@QUICK
@given(st.data(), types())
def test_what_was_decoded_encodes_to_the_same_payload(
    codec_type: type[TypedCodec], data: st.DataObject, spec: TypeSpec
) -> None:
    codec = codec_type(spec)
    payload = codec.encode(data.draw(values(spec)))
    decoded = codec.decode(payload)
    again = codec.encode(decoded)
    assert repr(codec.decode(again)) == repr(decoded)
    assert again == payload


@BOTH
@QUICK
@given(st.data(), types(), st.binary(max_size=8), st.binary(max_size=8))
def test_a_payload_is_measured_wherever_it_stands(
    codec_type: type[TypedCodec], data: st.DataObject, spec: TypeSpec, before: bytes, behind: bytes
) -> None:
    codec = codec_type(spec)
    payload = codec.encode(data.draw(values(spec)))
    end = len(before) + len(payload)
    assert codec.measure(before + payload + behind, len(before)) == end
    assert codec.smallest_bytes <= len(payload)
    assert codec.largest_bytes is None or len(payload) <= codec.largest_bytes


@BOTH
@QUICK
@given(types(), st.binary(max_size=64))
def test_any_bytes_are_a_value_or_a_payload_error(
    codec_type: type[TypedCodec], spec: TypeSpec, payload: bytes
) -> None:
    codec = codec_type(spec)
    end = codec.measure(payload, 0)
    assert end is None or 0 <= end <= len(payload)
    try:
        decoded = codec.decode(payload)
    except PayloadError:
        return
    assert repr(spec.validate(decoded)) == repr(decoded)
    assert end == len(payload)


@BOTH
@QUICK
@given(st.data(), types())
def test_damage_is_a_value_within_bounds_or_a_payload_error(
    codec_type: type[TypedCodec], data: st.DataObject, spec: TypeSpec
) -> None:
    codec = codec_type(spec)
    payload = bytearray(codec.encode(data.draw(values(spec))))
    assume(payload)
    for _ in range(data.draw(st.integers(1, 3))):
        payload[data.draw(st.integers(0, len(payload) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        decoded = codec.decode(bytes(payload))
    except PayloadError:
        return
    spec.validate(decoded)


@QUICK
@given(types(), types())
def test_equal_descriptions_mean_equal_decoding(one: TypeSpec, other: TypeSpec) -> None:
    assert one.canonical() == msgspec_copy(one).canonical()
    if one.fields != other.fields:
        assert one.canonical() != other.canonical()


def msgspec_copy(spec: TypeSpec) -> TypeSpec:
    """The same type, made again from what a config would hold."""
    copies = [
        TypeSpec(name=part.name, fields=tuple(FieldSpec(**keys(field)) for field in part.fields))
        for part in (spec, *spec.nested)
    ]
    return TypeTable(copies)[spec.name]


def keys(field: FieldSpec) -> dict[str, Any]:
    return {name: getattr(field, name) for name in reversed(field.__struct_fields__)}
