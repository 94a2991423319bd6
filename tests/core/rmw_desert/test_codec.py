"""Values: bounds, defaults, enums, bytes, floats over all their rules."""

import math
import random
import struct
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.core.rmw_desert import peer
from tests.core.rmw_desert.vectors import read_vectors
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.core.values.rmw_desert.items import float_item, read_float, single_item
from zacoustic.core.values.rmw_desert.messages import decode_message
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable


def codec(*fields: FieldSpec, **nested: tuple[FieldSpec, ...]) -> RmwDesertCodec:
    types = [TypeSpec(name=name, fields=inner) for name, inner in nested.items()]
    return RmwDesertCodec(TypeTable([*types, TypeSpec(name="T", fields=fields)]).by_name("T"))


def test_every_float_is_written_as_measured_and_read_as_it_was_meant(
    count: Callable[[int], int],
) -> None:
    dice = random.Random(3)
    edges = [e << 23 | m for e in range(256) for m in (0, 1, 0x2000, 0x7FE000, 0x7FFFFF)]
    drawn = [dice.getrandbits(31) for _ in range(count(1_000_000))]
    for bits in (*edges, *drawn):
        for signed in (bits, bits | 1 << 31):
            item = single_item(signed.to_bytes(4, "big"))
            assert item == peer._float(signed)
            number, end = read_float(item, 0)
            assert end == len(item)
            assert float_item(number) == item or math.isnan(number)
            if len(item) == 5:
                assert struct.pack(">f", number) == signed.to_bytes(4, "big")


@given(st.binary(min_size=1, max_size=5))
def test_a_float_that_its_sender_does_not_write_is_refused(data: bytes) -> None:
    for initial in (0xF9, 0xFA, 0xFB):
        item = bytes((initial,)) + data
        try:
            number, end = read_float(item, 0)
        except (PayloadError, struct.error, IndexError):
            continue
        assert math.isnan(number) or float_item(number) == item[:end]


def test_bounds_are_checked_on_both_ways_but_for_the_rounding_of_their_ends() -> None:
    bounded = codec(FieldSpec(name="f", type="float64", range=(-0.3, 0.1)))
    fields = bounded.encode({"f": 0.1})
    assert fields == bytes.fromhex("fa3dcccccd")  # 0.10000000149
    assert bounded.decode(fields) == {"f": 0.1}
    assert bounded.decode(bounded.encode({"f": -0.3})) == {"f": -0.3}
    with pytest.raises(PayloadError, match=r"T\.f is 0\.5"):
        bounded.decode(float_item(0.5))
    with pytest.raises(PayloadError, match=r"T\.f is nan"):
        bounded.decode(float_item(math.nan))


def test_a_heading_is_folded_and_a_clamped_number_clamped() -> None:
    heading = codec(FieldSpec(name="f", type="float32", range=(0, 360), step=0.1, wraps=True))
    assert heading.decode(float_item(-90.0)) == {"f": 270.0}
    depth = codec(FieldSpec(name="f", type="int16", range=(0, 100), outside="clamp"))
    assert depth.decode(b"\x20") == {"f": 0}
    assert depth.encode({"f": 200}) == bytes.fromhex("1864")


def test_steps_do_not_apply() -> None:
    stepped = codec(FieldSpec(name="f", type="float64", range=(-90, 90), step=1e-6))
    assert stepped.encode({"f": 45.406434}) == bytes.fromhex("fa4235a030")


def test_an_enum_is_its_position_and_bytes_are_a_sequence() -> None:
    both = codec(
        FieldSpec(name="mode", type="enum", values=("idle", "survey")),
        FieldSpec(name="raw", type="bytes", max_length=10),
    )
    assert both.encode({"mode": "survey", "raw": b"\x01\xff"}) == bytes.fromhex("01020118ff")
    assert both.decode(bytes.fromhex("01020118ff")) == {"mode": "survey", "raw": b"\x01\xff"}
    for wrong in ("0200", "2000", "000201", "0001190100"):
        with pytest.raises(PayloadError):
            both.decode(bytes.fromhex(wrong))


def test_a_sequence_of_messages_is_counted_and_a_fixed_array_is_not() -> None:
    point = (FieldSpec(name="x", type="int8"), FieldSpec(name="y", type="int8"))
    nested = codec(
        FieldSpec(name="path", type="Point", max_length=3),
        FieldSpec(name="corners", type="Point", length=2),
        FieldSpec(name="labels", type="string", length=2),
        Point=point,
    )
    value = {
        "path": [{"x": 1, "y": 2}],
        "corners": [{"x": 3, "y": 4}, {"x": 5, "y": 6}],
        "labels": ["a", "b"],
    }
    fields = nested.encode(value)
    assert fields == bytes.fromhex("01 0102 0304 0506 6161 6162")
    assert nested.decode(fields) == value
    with pytest.raises(PayloadError, match="at most 3 elements"):
        nested.decode(bytes.fromhex("04 0102 0102 0102 0102 0304 0506 6161 6162"))


def test_fixed_arrays_of_strings_are_read_as_rclpy_and_as_rclcpp_send_them() -> None:
    labels = codec(FieldSpec(name="labels", type="string", length=2))
    vectors = {vector.name: vector for vector in read_vectors()}
    for name in ("arr_str_2_cpp", "arr_str_2_c"):
        fields = decode_message(vectors[name].payload).fields
        assert labels.decode(fields) == {"labels": ["ab", "c"]}
    assert labels.encode({"labels": ["ab", "c"]}) == bytes.fromhex("6261626163")
    for wrong in ("03626162616361", "016261626163", "02626162", ""):
        with pytest.raises(PayloadError):
            labels.decode(bytes.fromhex(wrong))


@pytest.mark.parametrize(
    "wrong",
    [
        "",
        "1817",
        "1900ff",
        "f4",
        "f90000",
        "c101",
        "8101",
        "0101",
        "1a",
        "41aa",
        "fb3ff8000000000000",
    ],
)
def test_what_its_sender_does_not_write_is_refused(wrong: str) -> None:
    with pytest.raises(PayloadError):
        codec(FieldSpec(name="f", type="uint32")).decode(bytes.fromhex(wrong))


@pytest.mark.parametrize("wrong", ["00", "f6", "f5f5", ""])
def test_a_bool_is_true_or_false(wrong: str) -> None:
    with pytest.raises(PayloadError):
        codec(FieldSpec(name="f", type="bool")).decode(bytes.fromhex(wrong))


def test_sizes_hold_what_is_written() -> None:
    made = codec(
        FieldSpec(name="a", type="uint16"),
        FieldSpec(name="b", type="string", max_length=10),
        FieldSpec(name="c", type="float64", max_length=3),
        FieldSpec(name="d", type="bytes", max_length=4),
    )
    least: dict[str, Any] = {"a": 0, "b": "", "c": [], "d": b""}
    most = {"a": 65535, "b": "x" * 10, "c": [0.1] * 3, "d": b"\xff" * 4}
    assert len(made.encode(least)) == made.smallest_bytes == 4
    assert len(made.encode(most)) == made.largest_bytes == 3 + 11 + 16 + 9
    assert codec(FieldSpec(name="a", type="string")).largest_bytes is None
    assert codec().encode({}) == b"\x00"
    assert (codec().smallest_bytes, codec().largest_bytes) == (1, 1)
    assert made.measure(made.encode(most) + b"rest", 0) == made.largest_bytes
    assert made.measure(b"\x40", 0) is None
