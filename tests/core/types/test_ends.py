"""The ends of a range in single precision, in all that checks floats."""

import math
import struct

import pytest

from zacoustic.core.values.dense.model.layout import Layout
from zacoustic.core.values.payload import CborCodec, PackedCodec, PayloadError
from zacoustic.core.values.types import Ends, FieldSpec, TypeSpec
from zacoustic.errors import PayloadInvalidError


def single(number: float) -> float:
    return float(struct.unpack("f", struct.pack("f", number))[0])


@pytest.mark.parametrize("kind", ["float32", "float64"])
@pytest.mark.parametrize("step", [None, 0.01])
@pytest.mark.parametrize("outside", ["reject", "clamp", "escape"])
def test_the_single_of_an_end_is_the_end(kind: str, step: float | None, outside: str) -> None:
    for n in range(1, 31):
        top = n / 100
        field = FieldSpec(name="a", type=kind, range=(-top, top), step=step, outside=outside)
        spec = TypeSpec(name="T", fields=(field,))
        for codec in (CborCodec(spec), PackedCodec(spec)):
            for end in (top, -top):
                exact = codec.encode({"a": end})
                near = codec.encode({"a": single(end)})
                if abs(single(end)) > top or kind == "float32" or step is not None:
                    assert near == exact
                assert abs(codec.decode(near)["a"] - end) < 1e-7
            assert not codec.outside.clamped
            assert not codec.outside.escaped
            beyond = math.nextafter(single(top) + 1e-7, 1)
            if outside == "reject":
                with pytest.raises(PayloadInvalidError):
                    codec.encode({"a": beyond})


def test_yaw_of_pi_is_pi() -> None:
    yaw = FieldSpec(name="a", type="float32", range=(-math.pi, math.pi), step=0.001)
    around = FieldSpec(name="a", type="float32", range=(-math.pi, math.pi), step=0.001, wraps=True)
    for field, expected in ((yaw, math.pi), (around, -math.pi)):
        spec = TypeSpec(name="T", fields=(field,))
        for codec in (CborCodec(spec), PackedCodec(spec)):
            got = codec.decode(codec.encode({"a": single(math.pi)}))["a"]
            assert got == pytest.approx(expected, abs=0.0005)


def test_the_greatest_single_is_one() -> None:
    codec = PackedCodec(TypeSpec(name="T", fields=(FieldSpec(name="a", type="float32"),)))
    assert codec.decode(codec.encode({"a": 3.4028235e38})) == {"a": (2 - 2**-23) * 2.0**127}
    with pytest.raises(PayloadInvalidError):
        codec.encode({"a": 3.5e38})


def test_an_end_of_the_range_has_no_longer_form() -> None:
    field = FieldSpec(name="a", type="float32", range=(0, 0.05), step=0.01, outside="escape")
    codec = PackedCodec(TypeSpec(name="T", fields=(field,)))
    with pytest.raises(PayloadError, match="longer form"):
        codec.decode(bytes.fromhex("c7a99999a0"))
    assert Ends(field).value(0.0500000006) == 0.05
    assert Ends(field).value(0.0500001) is None


@pytest.mark.parametrize("more", [{}, {"wraps": True}, {"outside": "escape"}, {"length": 2}])
def test_no_value_takes_a_bit_or_two(more: dict[str, object]) -> None:
    field = FieldSpec(name="a", type="float32", range=(0, 360), step=0.5, nan=True, **more)  # type: ignore[arg-type]
    bare = FieldSpec(name="a", type="float32", range=(0, 360), step=0.5, **more)  # type: ignore[arg-type]
    codec, plain = (PackedCodec(TypeSpec(name="T", fields=(each,))) for each in (field, bare))
    count = field.length or 1
    assert codec.largest_bits == (plain.largest_bits or 0) + count
    assert codec.smallest_bits == 2 * count
    layout = Layout(codec.type_spec)
    for number in (1.5, math.nan, math.inf, -math.inf):
        value = {"a": [number] * count if field.is_array else number}
        for each in (codec, CborCodec(codec.type_spec)):
            assert repr(each.decode(each.encode(value))) == repr(value)
        normal = codec.normalised(value)
        assert repr(layout.join(*layout.split(normal))) == repr(value)
    assert not codec.outside.escaped
