"""What a value of a type may be, and what is wrong with another one."""

import math
from collections import defaultdict
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import pytest

from tests.core.types.made import Level, Mode, one
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import PayloadInvalidError

NAV = TypeTable(
    [
        TypeSpec(
            name="Nav",
            fields=(
                FieldSpec(name="depth", type="float32", range=(0, 1000), step=0.1, unit="m"),
                FieldSpec(name="mode", type="enum", values=("idle", "survey")),
                FieldSpec(name="legs", type="Leg", max_length=2),
                FieldSpec(name="count", type="uint8", default=7),
                FieldSpec(name="note", type="string", max_length=4, optional=True),
            ),
        ),
        TypeSpec(
            name="Leg",
            fields=(FieldSpec(name="xy", type="float64", range=(-1, 1), length=2),),
        ),
    ]
)["Nav"]
GOOD: dict[str, Any] = {"depth": 3, "mode": "idle", "legs": [{"xy": (0, 1)}]}


def test_value_is_normalised_with_defaults_in_the_order_of_the_type() -> None:
    value = NAV.validate({"legs": [{"xy": (0, 1)}], "mode": Mode.SURVEY, "depth": 3})
    assert list(value) == ["depth", "mode", "legs", "count", "note"]
    assert value == {
        "depth": 3.0,
        "mode": "survey",
        "legs": [{"xy": [0.0, 1.0]}],
        "count": 7,
        "note": None,
    }
    assert isinstance(value["depth"], float)
    assert NAV.validate(MappingProxyType(GOOD)) == NAV.validate(GOOD)


def test_validation_does_not_change_the_application_s_value() -> None:
    given: defaultdict[str, Any] = defaultdict(int, GOOD)
    NAV.validate(given)
    assert dict(given) == GOOD


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"depth": 1000.1}, "Nav.depth is 1000.1 m; allowed: 0..1000 m"),
        ({"depth": float("nan")}, "Nav.depth is nan m; allowed: 0..1000 m"),
        ({"depth": "3"}, "Nav.depth is '3'; allowed: 0..1000 m"),
        ({"depth": None}, "Nav.depth is None; allowed: 0..1000 m"),
        ({"depth": True}, "Nav.depth is True; allowed: 0..1000 m"),
        ({"depth": 10**400}, "Nav.depth is an integer of 1329 bits m; allowed: 0..1000 m"),
        ({"mode": "abort"}, "Nav.mode is 'abort'; allowed: idle, survey"),
        ({"mode": 1}, "Nav.mode is 1; allowed: idle, survey"),
        ({"mode": ["idle"]}, "Nav.mode is list of 1; allowed: idle, survey"),
        ({"legs": 3}, "Nav.legs is 3; allowed: a list of at most 2 elements"),
        ({"legs": GOOD["legs"] * 3}, "Nav.legs has 3 elements; allowed: at most 2 elements"),
        ({"legs": [{"xy": [0, 2]}]}, "Nav.legs[0].xy[1] is 2; allowed: -1..1"),
        ({"legs": [{"xy": [0]}]}, "Nav.legs[0].xy has 1 elements; allowed: 2 elements"),
        ({"legs": [{}]}, "Nav.legs[0].xy is missing; allowed: -1..1"),
        ({"legs": [4]}, "Nav.legs[0] is 4; allowed: a mapping of field names to values"),
        ({"count": 256}, "Nav.count is 256; allowed: 0..255"),
        ({"count": 3.0}, "Nav.count is 3.0; allowed: 0..255"),
        ({"count": False}, "Nav.count is False; allowed: 0..255"),
        ({"note": "über"}, "Nav.note has 5 bytes; allowed: at most 4 bytes"),
        ({"note": b"x"}, "Nav.note is b'x'; allowed: string of at most 4 bytes"),
        ({"note": "\ud800"}, "allowed: text without lone surrogates"),
        ({"dpeth": 3}, "Nav has no field 'dpeth'; allowed: depth, mode, legs, count, note"),
        ({"dpeth": 3}, 'did you mean "depth"?'),
        ({4: 3}, "Nav has no field 4; allowed: depth"),
    ],
)
def test_refused_value_names_type_path_value_and_what_is_allowed(
    changed: dict[Any, Any], message: str
) -> None:
    with pytest.raises(PayloadInvalidError) as caught:
        NAV.validate({**GOOD, **changed})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200


def test_missing_field_is_named_unless_a_misspelt_one_explains_it() -> None:
    with pytest.raises(PayloadInvalidError, match=r"Nav.depth is missing; allowed: 0..1000 m"):
        NAV.validate({})
    with pytest.raises(PayloadInvalidError, match=r"Nav has no field 'Depth'"):
        NAV.validate({"Depth": 3})


def test_not_a_mapping_is_refused() -> None:
    for value in (None, 3, "text", [1, 2], object()):
        with pytest.raises(PayloadInvalidError, match="allowed: a mapping of field names"):
            NAV.validate(value)


def test_bounds_are_inclusive() -> None:
    assert one(type="float64", range=(0, 1)).validate({"f": 1}) == {"f": 1.0}
    assert one(type="int8").validate({"f": -128}) == {"f": -128}
    with pytest.raises(PayloadInvalidError):
        one(type="int8").validate({"f": -129})


@pytest.mark.parametrize(
    ("value", "folded"),
    [(360, 0.0), (-1, 359.0), (725, 5.0), (359.99, 359.99), (-1e-20, 0.0), (0, 0.0)],
)
def test_a_wrapping_field_folds_into_its_range(value: float, folded: float) -> None:
    assert one(type="float32", range=(0, 360), wraps=True).validate({"f": value}) == {"f": folded}


def test_a_wrapping_integer_folds_and_infinity_does_not() -> None:
    assert one(type="int16", range=(-180, 180), wraps=True).validate({"f": 540}) == {"f": -180}
    for value in (math.inf, math.nan, "x"):
        with pytest.raises(PayloadInvalidError):
            one(type="float64", range=(0, 360), wraps=True).validate({"f": value})


def test_floats_without_bounds_take_nan_and_infinity_but_not_with_a_step() -> None:
    free = one(type="float32")
    assert free.validate({"f": math.inf}) == {"f": math.inf}
    assert math.isnan(free.validate({"f": math.nan})["f"])
    with pytest.raises(PayloadInvalidError, match="allowed: a number"):
        free.validate({"f": 1e39})
    for value in (math.inf, math.nan, 1e300):
        with pytest.raises(PayloadInvalidError, match="allowed: a finite number"):
            one(type="float64", step=0.1).validate({"f": value})


def test_numbers_of_other_libraries_count_by_what_they_are() -> None:
    assert one(type="float64").validate({"f": Fraction(1, 2)}) == {"f": 0.5}
    level = one(type="uint8").validate({"f": Level.HIGH})
    assert type(level["f"]) is int


def test_bytes_and_enum_members_are_normalised() -> None:
    assert one(type="bytes", max_length=3).validate({"f": bytearray(b"abc")}) == {"f": b"abc"}
    with pytest.raises(PayloadInvalidError, match="is 'abc'; allowed: bytes of at most 3 bytes"):
        one(type="bytes", max_length=3).validate({"f": "abc"})
    with pytest.raises(PayloadInvalidError, match="has 4 bytes; allowed: at most 3 bytes"):
        one(type="bytes", max_length=3).validate({"f": b"abcd"})
    assert one(type="enum", values=("LOW", "HIGH")).validate({"f": Level.HIGH}) == {"f": "HIGH"}
    assert one(type="bool").validate({"f": True}) == {"f": True}
    with pytest.raises(PayloadInvalidError, match="allowed: true, false"):
        one(type="bool").validate({"f": 1})


def test_type_without_fields_has_one_value() -> None:
    assert not TypeSpec(name="Empty").starts_with_optional
    assert TypeSpec(name="Empty").validate({}) == {}
    with pytest.raises(PayloadInvalidError, match="Empty has no field 'a'; allowed: no field"):
        TypeSpec(name="Empty").validate({"a": 1})
