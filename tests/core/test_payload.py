"""Payload codecs: the bytes of every kind of field, and what is refused off the channel."""

import enum
import json
import math
from pathlib import Path
from typing import Annotated, Any

import cbor2
import msgspec
import pytest

from tests.golden.fields import in_json
from zacoustic.core.values.payload import CborCodec, OpaqueCodec, PayloadCodec, PayloadError
from zacoustic.core.values.types import Bounds, FieldSpec, TypeSpec, TypeTable, type_from_struct
from zacoustic.errors import ConfigError, PayloadInvalidError

VECTORS = json.loads(
    (Path(__file__).parent.parent / "golden" / "payload_cbor.json").read_text(encoding="utf-8")
)["vectors"]


def table_of(types: list[dict[str, Any]]) -> TypeTable:
    return TypeTable(
        TypeSpec(name=entry["name"], fields=msgspec.convert(entry["fields"], tuple[FieldSpec, ...]))
        for entry in types
    )


def codec_of(**keys: Any) -> CborCodec:
    return CborCodec(TypeSpec(name="T", fields=(FieldSpec(name="f", **keys),)))


@pytest.mark.parametrize("vector", VECTORS, ids=[vector["meaning"] for vector in VECTORS])
def test_golden_vector(vector: dict[str, Any]) -> None:
    codec = CborCodec(table_of(vector["types"])[vector["types"][0]["name"]])
    payload = bytes.fromhex(vector["hex"])
    decoded = codec.decode(payload)
    assert in_json(decoded) == vector["decoded"]
    assert codec.encode(decoded) == payload
    assert codec.measure(b"\x01" + payload + b"\xff", 1) == 1 + len(payload)
    assert (
        codec.largest_bytes is None or codec.smallest_bytes <= len(payload) <= codec.largest_bytes
    )
    if "value" in vector:
        assert codec.encode(vector["value"]) == payload


def test_a_sequence_of_items_is_what_another_cbor_library_reads() -> None:
    codec = CborCodec(
        TypeSpec(
            name="T",
            fields=(
                FieldSpec(name="a", type="int64"),
                FieldSpec(name="b", type="float64"),
                FieldSpec(name="c", type="string"),
                FieldSpec(name="d", type="bytes"),
                FieldSpec(name="e", type="bool"),
                FieldSpec(name="g", type="float64", optional=True),
            ),
        )
    )
    for number in (0, 23, 24, 255, 256, 65535, 65536, 2**32 - 1, 2**32, 2**63 - 1):
        for sign in (1, -1):
            for real in (0.0, -0.0, 1.5, 1024.0, 65536.0, 0.1, 1e300, 5e-324, 2.0**-24, 1e39):
                value = {"a": sign * number, "b": sign * real, "c": "ä" * 30, "d": b"x" * 300}
                value |= {"e": sign > 0, "g": None}
                expected = b"".join(cbor2.dumps(item, canonical=True) for item in value.values())
                assert codec.encode(value) == expected
                assert codec.decode(expected) == value


def test_special_floats_are_three_bytes() -> None:
    codec = codec_of(type="float64")
    assert codec.encode({"f": float("inf")}).hex() == "f97c00"
    assert codec.encode({"f": float("-inf")}).hex() == "f9fc00"
    assert codec.encode({"f": float("nan")}).hex() == "f97e00"
    assert codec.decode(bytes.fromhex("f97e00"))["f"] != codec.decode(bytes.fromhex("f97e00"))["f"]


@pytest.mark.parametrize(
    ("keys", "payload", "reason"),
    [
        ({"type": "uint8"}, "", "ends inside"),
        ({"type": "uint8"}, "18", "ends inside"),
        ({"type": "uint32"}, "1a0001", "ends inside"),
        ({"type": "uint8"}, "0101", "1 bytes behind the value"),
        ({"type": "uint8"}, "1817", "23 in a longer form"),
        ({"type": "uint8"}, "1900ff", "255 in a longer form"),
        ({"type": "uint8"}, "1a0000ffff", "65535 in a longer form"),
        ({"type": "uint8"}, "190100", "f is 256; allowed: 0..255"),
        ({"type": "uint8"}, "20", "f is -1; allowed: 0..255"),
        ({"type": "uint8"}, "1c", "indefinite or reserved"),
        ({"type": "uint8"}, "40", "0x40 where an integer is expected"),
        ({"type": "uint8"}, "f4", "0xf4 where an integer is expected"),
        ({"type": "int16", "range": [0, 360], "wraps": True}, "190168", "f is 360"),
        ({"type": "bool"}, "f6", "f is 0xf6; allowed: true, false"),
        ({"type": "bool"}, "01", "f is 0x01"),
        ({"type": "float64"}, "01", "0x01 where a float is expected"),
        ({"type": "float64"}, "f93c", "ends inside"),
        ({"type": "float64"}, "fa3fc00000", "1.5 in a longer form"),
        ({"type": "float64"}, "fb3ff8000000000000", "1.5 in a longer form"),
        ({"type": "float64"}, "f97e01", "nan in a longer form"),
        ({"type": "float64"}, "fb7ff8000000000000", "nan in a longer form"),
        ({"type": "float32"}, "fb3fb999999999999a", "f is a double; allowed: half, single"),
        ({"type": "float64", "range": [0, 1]}, "f94000", "f is 2.0; allowed: 0..1"),
        ({"type": "float64", "range": [0, 1]}, "f97e00", "f is nan"),
        ({"type": "float32", "range": [0, 1]}, "f94000", "f is 2.0; allowed: 0..1"),
        ({"type": "float64", "range": [0, 1], "wraps": True}, "f93c00", "f is 1.0"),
        ({"type": "float32", "range": [0, 1], "wraps": True}, "f93c00", "f is 1.0"),
        ({"type": "float64", "range": [0, 1], "step": 0.1}, "0b", "f is 11 steps; allowed: 0..10"),
        ({"type": "float64", "range": [0, 1], "step": 0.1}, "20", "f is -1 steps"),
        ({"type": "float64", "range": [0, 1], "step": 0.5, "wraps": True}, "02", "f is 2 steps"),
        ({"type": "float64", "range": [0, 1], "step": 0.1}, "f93c00", "where an integer"),
        ({"type": "string"}, "7a7fffffff", "2147483647 bytes announced, 0 there"),
        ({"type": "string"}, "7bffffffffffffffff61", "announced, 1 there"),
        ({"type": "string"}, "61ff", "f is not UTF-8"),
        ({"type": "string"}, "63eda080", "f is not UTF-8"),
        ({"type": "string"}, "7f6161ff", "indefinite or reserved"),
        ({"type": "string"}, "4161", "0x41 where major type 3 is expected"),
        ({"type": "string", "max_length": 2}, "63616161", "f has 3 bytes; allowed: 2"),
        ({"type": "bytes", "max_length": 2}, "43616161", "f has 3 bytes; allowed: 2"),
        ({"type": "enum", "values": ["a", "b"]}, "02", "f is 2; allowed: 0..1"),
        ({"type": "enum", "values": ["a", "b"]}, "20", "where major type 0 is expected"),
        ({"type": "uint8", "max_length": 3}, "0401020304", "f has 4 elements; allowed: 3"),
        ({"type": "uint8", "max_length": 65535}, "19ffff01", "f has 65535 elements in 1 bytes"),
        ({"type": "uint8", "max_length": 3}, "8101", "where major type 0 is expected"),
        ({"type": "uint8", "length": 60000}, "01" * 9, "f has 60000 elements in 9 bytes"),
        ({"type": "uint8", "optional": True}, "", "ends inside"),
        ({"type": "uint8", "optional": True}, "f7", "where an integer is expected"),
        ({"type": "uint8"}, "c201", "where an integer is expected"),
    ],
)
def test_what_the_type_does_not_allow_is_refused_off_the_channel(
    keys: dict[str, Any], payload: str, reason: str
) -> None:
    field = msgspec.convert({"name": "f", **keys}, FieldSpec)
    codec = CborCodec(TypeSpec(name="T", fields=(field,)))
    with pytest.raises(PayloadError, match=reason):
        codec.decode(bytes.fromhex(payload))


def test_nested_counts_do_not_multiply_into_work() -> None:
    types = [
        {"name": f"T{i}", "fields": [{"name": "f", "type": f"T{i + 1}", "length": 65535}]}
        for i in range(15)
    ]
    table = table_of([*types, {"name": "T15", "fields": [{"name": "f", "type": "bool"}]}])
    codec = CborCodec(table["T0"])
    assert codec.smallest_bytes == 65535**15
    with pytest.raises(PayloadError):
        codec.decode(b"\xf4" * 1000)
    assert codec.measure(b"\xf4" * 1000, 0) is None


def test_measure_answers_none_where_no_payload_starts() -> None:
    codec = codec_of(type="string", max_length=3)
    assert codec.measure(b"\x63ab", 0) is None
    assert codec.measure(b"", 0) is None
    assert codec.measure(b"\x63abc", 9) is None
    assert codec.measure(b"\xa0", 0) is None
    bounded = codec_of(type="bool", max_length=2)
    assert bounded.measure(b"\x03\xf4\xf4\xf4", 0) is None
    assert bounded.measure(b"\x02\xf4", 0) is None
    assert codec_of(type="float64").measure(b"\xf9\x00", 0) is None


def test_measure_looks_at_the_structure_only() -> None:
    # A value out of bounds costs its own record, not those behind it in the frame.
    codec = codec_of(type="uint8", range=(0, 10))
    assert codec.measure(bytes.fromhex("187f01"), 0) == 2
    with pytest.raises(PayloadError):
        codec.decode(bytes.fromhex("187f"))


@pytest.mark.parametrize(
    ("keys", "sizes"),
    [
        ({"type": "bool"}, (1, 1)),
        ({"type": "uint8"}, (1, 2)),
        ({"type": "int64"}, (1, 9)),
        ({"type": "int16", "range": (300, 400)}, (3, 3)),
        ({"type": "int16", "range": (-400, -300)}, (3, 3)),
        ({"type": "float32"}, (3, 5)),
        ({"type": "float64"}, (3, 9)),
        ({"type": "float64", "range": (-90, 90), "step": 1e-6}, (1, 5)),
        ({"type": "float64", "step": 0.1}, (1, 9)),
        ({"type": "enum", "values": tuple("abc")}, (1, 1)),
        ({"type": "enum", "values": tuple(str(i) for i in range(30))}, (1, 2)),
        ({"type": "string"}, (1, None)),
        ({"type": "string", "max_length": 30}, (1, 32)),
        ({"type": "bytes", "max_length": 10, "length": 2}, (2, 22)),
        ({"type": "uint8", "length": 3}, (3, 6)),
        ({"type": "uint8", "max_length": 3}, (1, 7)),
        ({"type": "uint8", "length": 3, "optional": True}, (1, 6)),
    ],
)
def test_sizes_follow_from_the_type(keys: dict[str, Any], sizes: tuple[int, int | None]) -> None:
    codec = codec_of(**keys)
    assert (codec.smallest_bytes, codec.largest_bytes) == sizes


def test_type_without_fields_is_no_bytes() -> None:
    codec = CborCodec(TypeSpec(name="Empty"))
    assert codec.encode({}) == b""
    assert codec.decode(b"") == {}
    assert codec.measure(b"abc", 1) == 1
    assert (codec.smallest_bytes, codec.largest_bytes) == (0, 0)


def test_codec_needs_a_resolved_type() -> None:
    with pytest.raises(ConfigError):
        CborCodec(TypeSpec(name="T", fields=(FieldSpec(name="f", type="Leg"),)))


def test_value_that_the_type_refuses_is_not_encoded() -> None:
    with pytest.raises(PayloadInvalidError, match=r"T\.f is 300; allowed: 0\.\.255"):
        codec_of(type="uint8").encode({"f": 300})


def test_float32_in_a_range_that_ends_between_float32_values() -> None:
    codec = codec_of(type="float32", range=(-0.1, 0.1))
    for end in (-0.1, 0.1):
        payload = codec.encode({"f": end})
        assert codec.decode(payload) == {"f": end}
        assert codec.encode(codec.decode(payload)) == payload
    circle = codec_of(type="float32", range=(0, 0.1), wraps=True)
    just_below = math.nextafter(0.1, 0)
    assert circle.decode(circle.encode({"f": just_below})) == {"f": 0.0}


class Mode(enum.Enum):
    IDLE = "idle"
    GO = "go"


class Leg(msgspec.Struct):
    x: Annotated[float, Bounds(0, 1, step=0.1)]


class Goto(msgspec.Struct):
    mode: Mode
    legs: Annotated[list[Leg], Bounds(max_length=3)]
    xy: tuple[float, float] = (0.0, 0.0)
    home: Leg | None = None


class Checked(msgspec.Struct):
    x: Annotated[int, Bounds(0, 10)]

    def __post_init__(self) -> None:
        if self.x == 7:
            raise ValueError("seven")


def test_value_comes_back_as_the_python_class() -> None:
    codec = CborCodec(type_from_struct(Goto))
    value = Goto(Mode.GO, [Leg(0.5)], (1.0, 2.0), Leg(1.0))
    assert codec.decode_as(codec.encode(value), Goto) == value
    assert codec.decode_as(codec.encode(Goto(Mode.IDLE, [])), Goto) == Goto(Mode.IDLE, [])


def test_another_python_class_is_refused() -> None:
    codec = CborCodec(type_from_struct(Leg))
    with pytest.raises(PayloadInvalidError, match=r"Goto is not this stream's type: Leg.fields\[0"):
        codec.decode_as(codec.encode({"x": 0.5}), Goto)
    with pytest.raises(PayloadInvalidError, match="Leg is not the type of this stream"):
        OpaqueCodec().decode_as(b"", Leg)


def test_refusal_of_the_python_class_is_a_payload_error() -> None:
    codec = CborCodec(type_from_struct(Checked))
    with pytest.raises(PayloadError, match="Checked refuses the value: seven"):
        codec.decode_as(b"\x07", Checked)


def test_opaque_bytes_pass_as_they_are() -> None:
    codec: PayloadCodec = OpaqueCodec()
    assert codec.encode(bytearray(b"abc")) == b"abc"
    assert codec.encode(memoryview(b"abc")) == b"abc"
    assert codec.decode(b"abc") == b"abc"
    assert not codec.delimits_itself
    assert codec.measure(b"abc", 0) is None
    assert (codec.smallest_bytes, codec.largest_bytes) == (0, None)
    with pytest.raises(PayloadInvalidError, match="payload is 'abc'; allowed: bytes"):
        codec.encode("abc")


def test_opaque_bytes_can_be_bounded() -> None:
    codec = OpaqueCodec(largest_bytes=2)
    assert codec.encode(b"ab") == b"ab"
    with pytest.raises(PayloadInvalidError, match="payload has 3 bytes; allowed: at most 2"):
        codec.encode(b"abc")
    with pytest.raises(PayloadError):
        codec.decode(b"abc")
