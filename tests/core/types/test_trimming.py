"""What is more than a type says is cut down to it where `outside` says so, and counted."""

from typing import Any

import msgspec
import pytest

from zacoustic.config import config_from_mapping
from zacoustic.core.values.payload import PackedCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.errors import ConfigError, PayloadInvalidError

LEG = TypeSpec(
    name="Leg",
    fields=(
        FieldSpec(name="speed", type="float64", range=(0, 2), step=0.1),
        FieldSpec(name="mode", type="enum", values=("idle", "survey", "other"), default="other"),
    ),
)
PLAN = TypeSpec(
    name="Plan",
    fields=(
        FieldSpec(name="note", type="string", max_length=5),
        FieldSpec(name="raw", type="bytes", max_length=2),
        FieldSpec(name="legs", type="Leg", max_length=2),
        FieldSpec(name="state", type="enum", values=("a", "b"), optional=True),
        FieldSpec(name="turn", type="float64", range=(0, 360), step=1.0, wraps=True),
        FieldSpec(name="counts", type="int8", max_length=2),
    ),
    nested=(LEG,),
)
FITS: dict[str, Any] = {
    "note": "abcd",
    "raw": b"ab",
    "legs": [{"speed": 1.0, "mode": "idle"}] * 2,
    "state": "a",
    "turn": 1.0,
    "counts": [1, 2],
}
NEW: dict[str, Any] = {
    "note": "abcdé",
    "raw": b"abc",
    "legs": [{"speed": 9.0, "mode": "hover", "depth": 3}] * 3,
    "state": "c",
    "turn": 361.0,
    "counts": [1, 2, 3],
    "battery": 0.5,
}


def test_a_value_with_more_than_its_type_crosses_as_far_as_the_type_says() -> None:
    codec = PackedCodec(PLAN.clamping())
    got = codec.decode(codec.encode(NEW))
    assert got == FITS | {
        "legs": [{"speed": 2.0, "mode": "other"}] * 2,
        "state": None,
    }
    assert codec.outside.trimmed == {
        "note": 1, "raw": 1, "legs": 1, "legs[].depth": 2, "legs[].mode": 2, "state": 1,
        "counts": 1, "battery": 1,
    }  # fmt: skip
    assert codec.outside.clamped == {"legs[].speed": 2}
    assert codec.type_spec.validate(NEW)["note"] == "abcd"


def test_a_value_that_fits_is_as_it_was() -> None:
    codec = PackedCodec(PLAN.clamping())
    assert codec.encode(FITS) == PackedCodec(PLAN).encode(FITS)
    assert codec.type_spec.canonical() == PLAN.canonical()
    assert not codec.outside.trimmed


@pytest.mark.parametrize("change", [{"note": 5}, {"legs": 3}, {"raw": None}, {"state": 7}])
def test_what_is_wrong_otherwise_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(PayloadInvalidError):
        PLAN.clamping().validate(FITS | change)
    with pytest.raises(PayloadInvalidError, match="Plan is 5"):
        PLAN.clamping().validate(5)


def test_a_struct_with_more_members_is_cut_too() -> None:
    class Wide(msgspec.Struct):
        speed: float = 1.0
        mode: str = "idle"
        depth: float = 3.0

    assert LEG.clamping().validate(Wide()) == {"speed": 1.0, "mode": "idle"}
    with pytest.raises(PayloadInvalidError, match="has no field 'depth'"):
        LEG.validate(Wide())


def test_an_enum_without_a_substitute_refuses() -> None:
    with pytest.raises(ConfigError, match=r'outside: "clamp" .* enum with default or optional'):
        FieldSpec(name="a", type="enum", values=("x",), outside="clamp")
    spec = TypeSpec(name="T", fields=(FieldSpec(name="a", type="enum", values=("x",)),))
    with pytest.raises(PayloadInvalidError, match="a is 'y'"):
        spec.clamping().validate({"a": "y"})


def test_a_stream_says_it_for_its_type() -> None:
    section: dict[str, Any] = {
        "address": 1,
        "types": [{"name": "T", "fields": [{"name": "depth", "type": "uint8"}]}],
        "streams": [{"id": 1, "topic": "t", "type": "T", "outside": "clamp"}],
    }
    (stream,) = config_from_mapping(section, source="test").table
    assert stream.codec.decode(stream.codec.encode({"depth": 1, "heading": 2})) == {"depth": 1}
    del section["streams"][0]["outside"]
    (strict,) = config_from_mapping(section, source="test").table
    assert strict.digest == stream.digest
    for wrong in ("escape", "cut"):
        section["streams"][0]["outside"] = wrong
        with pytest.raises(ConfigError, match=r"outside.*allowed: reject, clamp"):
            config_from_mapping(section, source="test")
