"""The packed codec: the bits of every kind of field, and what is refused off the channel."""

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest

from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.payload import CborCodec, PackedCodec, PayloadError
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import ConfigError, PayloadInvalidError

VECTORS = json.loads(
    (Path(__file__).parent.parent / "golden" / "payload_packed.json").read_text(encoding="utf-8")
)["vectors"]
NAV = (
    {"name": "lat", "type": "float64", "range": (43.0, 43.2), "step": 1e-6},
    {"name": "lon", "type": "float64", "range": (15.0, 15.2), "step": 1e-6},
    {"name": "depth", "type": "float32", "range": (0, 1000), "step": 0.1},
    {"name": "heading", "type": "float32", "range": (0, 360), "step": 0.1, "wraps": True},
    {"name": "pitch", "type": "float32", "range": (-45, 45), "step": 0.1},
    {"name": "roll", "type": "float32", "range": (-45, 45), "step": 0.1},
    {"name": "speed", "type": "float32", "range": (-1, 4), "step": 0.01},
    {"name": "altitude", "type": "float32", "range": (0, 200), "step": 0.1},
    {"name": "yaw_rate", "type": "float32", "range": (-20, 20), "step": 0.1},
)


def type_of(*fields: dict[str, Any]) -> TypeSpec:
    return TypeSpec(name="T", fields=msgspec.convert(fields, tuple[FieldSpec, ...]))


def codec_of(**keys: Any) -> PackedCodec:
    return PackedCodec(type_of({"name": "f", **keys}))


@pytest.mark.parametrize("vector", VECTORS, ids=[vector["meaning"] for vector in VECTORS])
def test_golden_vector(vector: dict[str, Any]) -> None:
    table = TypeTable(
        TypeSpec(name=entry["name"], fields=msgspec.convert(entry["fields"], tuple[FieldSpec, ...]))
        for entry in vector["types"]
    )
    codec = PackedCodec(table["T"])
    payload = bytes.fromhex(vector["hex"])
    assert codec.encode(vector["value"]) == payload
    decoded = codec.decode(payload)
    assert codec.encode(decoded) == payload
    assert codec.measure(b"\x01" + payload + b"\xff", 1) == 1 + len(payload)


def test_a_navigation_sample_is_fourteen_bytes() -> None:
    codec = PackedCodec(type_of(*NAV))
    assert codec.largest_bits == codec.smallest_bits == 111
    assert (codec.smallest_bytes, codec.largest_bytes) == (14, 14)


@pytest.mark.parametrize(
    ("keys", "smallest", "largest"),
    [
        ({"type": "bool"}, 1, 1),
        ({"type": "enum", "values": ["a"]}, 1, 1),
        ({"type": "enum", "values": ["a", "b", "c"]}, 2, 2),
        ({"type": "uint64"}, 64, 64),
        ({"type": "uint16", "range": [100, 355]}, 8, 8),
        ({"type": "int16", "range": [0, 256], "wraps": True}, 8, 8),
        ({"type": "float64"}, 64, 64),
        ({"type": "float32", "range": [0, 1]}, 32, 32),
        ({"type": "float64", "step": 0.1}, 6, 57),
        ({"type": "float32", "range": [0, 25.4], "step": 0.1, "outside": "escape"}, 8, 40),
        ({"type": "string"}, 9, None),
        ({"type": "string", "max_length": 15}, 5, 125),
        ({"type": "uint8", "length": 3}, 24, 24),
        ({"type": "uint8", "max_length": 3}, 2, 26),
        ({"type": "uint8", "optional": True}, 1, 9),
    ],
)
def test_sizes_in_bits(keys: dict[str, Any], smallest: int, largest: int | None) -> None:
    codec = codec_of(**keys)
    assert (codec.smallest_bits, codec.largest_bits) == (smallest, largest)


@pytest.mark.parametrize(
    ("keys", "payload", "reason"),
    [
        ({"type": "uint8"}, "", "ends inside"),
        ({"type": "uint8"}, "0101", "1 bytes behind the value"),
        ({"type": "bool"}, "81", "padding"),
        ({"type": "enum", "values": ["a", "b", "c"]}, "c0", "f is 3; allowed: 0..2"),
        ({"type": "float64"}, "7ff8000000000001", "nan with content"),
        ({"type": "float32", "range": [0, 1]}, "40000000", "f is 2.0; allowed: 0.0..1.0"),
        ({"type": "float32", "range": [0, 1], "wraps": True}, "3f800000", "f is 1.0"),
        ({"type": "float64", "step": 0.1}, "fc", "f has 63 bits"),
        ({"type": "string"}, "400000", "length in a longer form"),
        ({"type": "string", "max_length": 2}, "2080", "ASCII in a longer form"),
        ({"type": "string", "max_length": 2}, "3ff0", "not UTF-8"),
        ({"type": "string", "max_length": 2}, "f0", "f has 3 elements; allowed: 2"),
        ({"type": "bytes"}, "ffffffff7f", "elements in"),
        (
            {"type": "int16", "range": [0, 2], "outside": "escape"},
            "e0004000",
            "f is 1 in a longer form",
        ),
    ],
)
def test_what_is_refused_off_the_channel(keys: dict[str, Any], payload: str, reason: str) -> None:
    with pytest.raises(PayloadError, match=reason.replace("(", r"\(")):
        codec_of(**keys).decode(bytes.fromhex(payload))


@pytest.mark.parametrize("codec_type", [CborCodec, PackedCodec])
def test_numbers_outside_are_refused_clamped_or_escape_as_the_field_says(
    codec_type: type[PackedCodec],
) -> None:
    def codec(outside: str) -> PackedCodec:
        keys = {"type": "float64", "range": [0, 10], "step": 0.1, "outside": outside}
        return codec_type(type_of({"name": "f", "length": 2, **keys}))

    with pytest.raises(PayloadInvalidError):
        codec("reject").encode({"f": [-0.2, 1.0]})
    clamping = codec("clamp")
    assert clamping.decode(clamping.encode({"f": [-0.2, math.inf]})) == {"f": [0.0, 10.0]}
    assert clamping.outside.clamped == {"f[]": 2}
    with pytest.raises(PayloadInvalidError):
        clamping.encode({"f": [math.nan, 1.0]})
    escaping = codec("escape")
    value = {"f": [-0.2000001, 1.0]}
    assert escaping.decode(escaping.encode(value)) == value
    assert escaping.outside.escaped == {"f[]": 1}


def test_a_nested_number_is_counted_under_its_path() -> None:
    table = TypeTable(
        [
            TypeSpec(name="T", fields=(FieldSpec(name="legs", type="Leg", max_length=4),)),
            TypeSpec(
                name="Leg",
                fields=(FieldSpec(name="v", type="int8", range=(0, 5), outside="clamp"),),
            ),
        ]
    )
    codec = PackedCodec(table["T"])
    assert codec.decode(codec.encode({"legs": [{"v": 9}, {"v": 1}]})) == {
        "legs": [{"v": 5}, {"v": 1}]
    }
    assert codec.outside.clamped == {"legs[].v": 1}


@pytest.mark.parametrize(
    "keys",
    [
        {"type": "float64", "outside": "clamp"},
        {"type": "float64", "range": (0, 1), "wraps": True, "outside": "escape"},
        {"type": "float64", "range": (0, 1), "outside": "explode"},
        {"type": "bool", "outside": "clamp"},
    ],
)
def test_what_outside_can_be(keys: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"^outside: "):
        FieldSpec(name="f", **keys)


def test_the_codec_and_escaping_are_in_the_digest_and_clamping_is_not() -> None:
    def digest(codec: str, **keys: Any) -> bytes:
        field = FieldSpec(name="f", type="float64", range=(0, 1), step=0.1, **keys)
        types = TypeTable([TypeSpec(name="T", fields=(field,))])
        spec = TopicSpec(stream_id=1, name="a", type_name="T", codec=codec)
        return StreamTable([spec], types=types).digest

    digests = {digest("cbor"), digest("packed"), digest("packed", outside="escape")}
    assert len(digests) == 3
    assert digest("packed", outside="clamp") == digest("packed")
    with pytest.raises(ConfigError, match='codec: "zip"'):
        digest("zip")
