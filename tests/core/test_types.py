"""Types: what a field may be, what a value may be, and when two types are one."""

import enum
import json
import math
from collections import defaultdict
from fractions import Fraction
from types import MappingProxyType
from typing import Annotated, Any, Literal

import msgspec
import pytest

from zacoustic.core.types import (
    MAX_DEPTH,
    Bounds,
    FieldSpec,
    Quantiser,
    TypeSpec,
    TypeTable,
    check_agreement,
    struct_builder,
    type_from_struct,
)
from zacoustic.errors import ConfigError, PayloadInvalidError


def spec_of(*fields: FieldSpec, name: str = "T") -> TypeSpec:
    return TypeSpec(name=name, fields=fields)


def one(**keys: Any) -> TypeSpec:
    return spec_of(FieldSpec(name="f", **keys))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"name": "1st", "type": "bool"}, 'name: "1st"; allowed: letters, digits and underscores'),
        ({"type": ""}, 'type: ""; allowed: bool, int8'),
        ({"type": "float64", "range": (90, -90)}, "range: [90, -90]; allowed: low < high"),
        ({"type": "float64", "range": (1, 1)}, "range: [1, 1]; allowed: low < high"),
        (
            {"type": "uint8", "range": (0, 256)},
            "range: [0, 256] does not fit uint8; allowed: 0..255",
        ),
        ({"type": "float32", "range": (0, 1e39)}, "does not fit float32; allowed: -3.4"),
        ({"type": "int8", "range": (0.5, 3)}, "range: 0.5 for type int8; allowed: whole numbers"),
        ({"type": "float64", "range": (0, math.inf)}, "range: inf; allowed: finite numbers"),
        ({"type": "float64", "range": (0, 10**400)}, "allowed: finite numbers"),
        ({"type": "float64", "range": (False, True)}, "range: False; allowed: a number"),
        ({"type": "string", "range": (0, 1)}, "range: not for type string; allowed: numeric types"),
        ({"type": "enum", "values": ("a",), "step": 1}, "step: not for type enum"),
        ({"type": "bool", "wraps": True}, "wraps: not for type bool"),
        ({"type": "float64", "wraps": True}, "wraps: true without range"),
        ({"type": "float64", "step": 0}, "step: 0; allowed: above 0"),
        ({"type": "int8", "step": 0.5}, "step: 0.5 for type int8; allowed: whole numbers"),
        (
            {"type": "float64", "range": (0, 1), "step": 2},
            "step: 2.0 is more than the range; allowed: at most 1.0",
        ),
        (
            {"type": "float64", "range": (0, 1000), "step": 1e-15},
            "step: 1e-15 is too small for 0..1000; allowed: at least 8.88e-13",
        ),
        (
            {"type": "float64", "range": (0.06, 9.98), "step": 0.1, "wraps": True},
            "step: 0.1 does not divide range [0.06, 9.98], which wraps",
        ),
        ({"type": "enum"}, "values: missing; allowed: a list of names, at least one"),
        ({"type": "enum", "values": ("a", "a")}, 'values[1]: "a" a second time; allowed: once'),
        ({"type": "enum", "values": ("",)}, "values[0]: ''; allowed: printable names"),
        ({"type": "bool", "values": ("a",)}, "values: not for type bool; allowed: type enum"),
        ({"type": "bool", "length": 0}, "length: 0; allowed: 1..65535"),
        ({"type": "bool", "max_length": 70000}, "max_length: 70000; allowed: 1..65535"),
        ({"type": "bool", "max_length": 3, "length": 3}, "max_length: 3 beside length"),
        ({"type": "Other", "default": 3}, "default: not for arrays and nested types"),
    ],
)
def test_contradiction_in_a_field_is_one_line_that_starts_with_the_key(
    keys: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        FieldSpec(**{"name": "f", **keys})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_integers_and_floats_in_a_config_make_the_same_field() -> None:
    written = FieldSpec(name="f", type="float64", range=(-90, 90), step=1)
    assert written == FieldSpec(name="f", type="float64", range=(-90.0, 90.0), step=1.0)
    assert isinstance(written.step, float)
    whole = FieldSpec(name="f", type="uint8", range=(0.0, 90.0), step=2.0)
    assert whole.range == (0, 90)
    assert isinstance(whole.step, int)


def test_type_refuses_a_field_name_twice_and_a_bad_default() -> None:
    with pytest.raises(ConfigError, match=r'fields\[1\].name: "f" a second time; allowed: once'):
        spec_of(FieldSpec(name="f", type="bool"), FieldSpec(name="f", type="bool"))
    with pytest.raises(ConfigError, match=r"fields\[0\].default: T.f is 300 m; allowed: 0..255 m"):
        one(type="uint8", default=300, unit="m")
    with pytest.raises(ConfigError, match=r'name: "uint8"; allowed: a name'):
        TypeSpec(name="uint8")


def leaf(name: str = "Leaf") -> TypeSpec:
    return TypeSpec(name=name, fields=(FieldSpec(name="x", type="int8"),))


def uses(name: str, *types: str, **keys: Any) -> TypeSpec:
    fields = tuple(FieldSpec(name=f"f{i}", type=type_, **keys) for i, type_ in enumerate(types))
    return TypeSpec(name=name, fields=fields)


def test_table_resolves_types_in_any_order() -> None:
    table = TypeTable([uses("A", "B", "Leaf"), uses("B", "Leaf"), leaf()])
    assert [spec.name for spec in table] == ["A", "B", "Leaf"]
    assert table["A"].is_resolved
    assert table["A"].depth == 3
    assert table.by_name("A") is table["A"]
    assert "Leaf" in table
    assert "C" not in table
    assert len(table) == 3


@pytest.mark.parametrize(
    ("types", "message"),
    [
        ([leaf(), leaf()], 'types[1].name: "Leaf" a second time; allowed: once'),
        (
            [uses("A", "Laef"), leaf()],
            'types[0].fields[0].type: "Laef" is not known; allowed: bool',
        ),
        ([uses("A", "Laef"), leaf()], 'did you mean "Leaf"?'),
        ([uses("A", "A")], "types[0].fields[0].type: a cycle, A → A; allowed: types that end"),
        (
            [leaf(), uses("A", "bool", "B"), uses("B", "A")],
            "types[2].fields[0].type: a cycle, A → B → A",
        ),
        (
            [uses("A", "E"), TypeSpec(name="E")],
            'types[0].fields[0].type: "E" has no fields; allowed: at least one',
        ),
        (
            [uses("A", "B", optional=True), uses("B", "bool", optional=True)],
            'types[0].fields[0].optional: the first field of "B" is optional too',
        ),
        (
            [uses(f"T{i}", f"T{i + 1}") for i in range(MAX_DEPTH)] + [leaf(f"T{MAX_DEPTH}")],
            f"nested too deep; allowed: {MAX_DEPTH} types",
        ),
        (
            [leaf("T0")] + [uses(f"T{i + 1}", f"T{i}") for i in range(MAX_DEPTH)],
            f"types[{MAX_DEPTH}].fields: nested {MAX_DEPTH + 1} deep; allowed: {MAX_DEPTH}",
        ),
    ],
)
def test_table_names_the_key_path_of_what_is_wrong(types: list[TypeSpec], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        TypeTable(types)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_type_is_an_error_that_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r'type "Laef" is not known; allowed: Leaf \(did you'):
        TypeTable([leaf()]).by_name("Laef")
    with pytest.raises(ConfigError, match="allowed: none, types is empty"):
        TypeTable().by_name("Leaf")


def test_an_unresolved_type_cannot_validate() -> None:
    with pytest.raises(ConfigError, match=r'fields\[0\].type: "Leaf" is not known'):
        uses("A", "Leaf").validate({})


def test_an_unresolved_type_cannot_be_nested() -> None:
    with pytest.raises(ConfigError, match=r'fields\[0\].type: "B" is not resolved'):
        TypeSpec(name="A", fields=(FieldSpec(name="b", type="B"),), nested=(uses("B", "Leaf"),))


def test_optional_bounded_array_of_types_that_start_with_an_optional_is_told_apart() -> None:
    inner = TypeSpec(name="B", fields=(FieldSpec(name="x", type="bool", optional=True),))
    field = FieldSpec(name="b", type="B", max_length=2, optional=True)
    assert TypeSpec(name="A", fields=(field,), nested=(inner,)).starts_with_optional


def test_canonical_description_ignores_what_changes_no_value() -> None:
    plain = one(type="float64", range=(0, 1), step=0.1)
    assert one(type="float64", range=(0, 1.0), step=0.1, unit="m").canonical() == plain.canonical()
    assert one(type="float64", range=(0, 1), step=0.1, default=0.5).canonical() == plain.canonical()
    renamed = TypeSpec(name="Other", fields=plain.fields)
    assert renamed.canonical() == plain.canonical()
    minus_zero = one(type="float64", range=(-0.0, 1), step=0.1)
    assert minus_zero.canonical() == plain.canonical()


@pytest.mark.parametrize(
    "changed",
    [
        {"name": "g"},
        {"type": "float32"},
        {"range": (0, 2)},
        {"step": 0.2},
        {"wraps": True},
        {"length": 3},
        {"max_length": 3},
        {"optional": True},
    ],
)
def test_canonical_description_changes_with_everything_that_decoding_needs(
    changed: dict[str, Any],
) -> None:
    keys: dict[str, Any] = {"name": "f", "type": "float64", "range": (0, 1), "step": 0.1}
    before = spec_of(FieldSpec(**keys))
    after = spec_of(FieldSpec(**{**keys, **changed}))
    assert before.canonical() != after.canonical()


def test_canonical_description_depends_on_order_and_enum_values() -> None:
    a, b = FieldSpec(name="a", type="bool"), FieldSpec(name="b", type="bool")
    assert spec_of(a, b).canonical() != spec_of(b, a).canonical()
    assert (
        one(type="enum", values=("x", "y")).canonical()
        != one(type="enum", values=("y", "x")).canonical()
    )


def test_canonical_description_contains_nested_types_once() -> None:
    types = [uses(f"T{i}", f"T{i + 1}", f"T{i + 1}") for i in range(MAX_DEPTH - 1)]
    table = TypeTable([*types, leaf(f"T{MAX_DEPTH - 1}")])
    described = json.loads(table["T0"].canonical())
    assert len(described) == MAX_DEPTH
    twins = TypeTable([uses("A", "B", "C"), leaf("B"), leaf("C")])
    assert len(json.loads(twins["A"].canonical())) == 2
    other = TypeTable(
        [uses("A", "B"), TypeSpec(name="B", fields=(FieldSpec(name="x", type="int16"),))]
    )
    same_shape = TypeTable([uses("A", "Leaf"), leaf()])
    assert other["A"].canonical() != same_shape["A"].canonical()


def test_canonical_description_is_fixed() -> None:
    spec = spec_of(
        FieldSpec(name="lat", type="float64", range=(-90, 90), step=1e-6, unit="deg"),
        FieldSpec(name="mode", type="enum", values=("idle", "à")),
    )
    assert spec.canonical() == (
        b'[[["lat","float64",[-90.0,90.0],1e-06,false,[],null,null,false],'
        b'["mode","enum",null,null,false,["idle","\\u00e0"],null,null,false]]]'
    )


class Mode(enum.Enum):
    IDLE = "idle"
    SURVEY = "survey"


class Level(enum.IntEnum):
    LOW = 10
    HIGH = 20


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


class Leg(msgspec.Struct):
    x: Annotated[float, Bounds(0, 1, step=0.1)]


class Mission(msgspec.Struct):
    lat: Annotated[float, Bounds(-90, 90, step=1e-6, unit="deg")]
    heading: Annotated[float, Bounds(0, 360, wraps=True, type="float32")]
    mode: Mode
    level: Level
    kind: Literal["a", "b"]
    legs: Annotated[list[Leg], Bounds(max_length=8)]
    home: Leg
    xyz: tuple[float, float, float]
    raw: Annotated[bytes, msgspec.Meta(max_length=5)]
    readings: tuple[Annotated[int, "a note", msgspec.Meta(ge=0, lt=8), Bounds(max_length=4)], ...]
    marks: Annotated[list[bool], Bounds(max_length=2)] | None = None
    note: Annotated[str, Bounds(max_length=20)] | None = None
    battery: Annotated[int, msgspec.Meta(gt=0, le=100, multiple_of=5)] = 50
    armed: bool = False


def test_type_of_a_struct_class() -> None:
    spec = type_from_struct(Mission)
    assert spec.name == "Mission"
    expected = (
        FieldSpec(name="lat", type="float64", range=(-90, 90), step=1e-6, unit="deg"),
        FieldSpec(name="heading", type="float32", range=(0, 360), wraps=True),
        FieldSpec(name="mode", type="enum", values=("idle", "survey")),
        FieldSpec(name="level", type="enum", values=("LOW", "HIGH")),
        FieldSpec(name="kind", type="enum", values=("a", "b")),
        FieldSpec(name="legs", type="Leg", max_length=8),
        FieldSpec(name="home", type="Leg"),
        FieldSpec(name="xyz", type="float64", length=3),
        FieldSpec(name="raw", type="bytes", max_length=5),
        FieldSpec(name="readings", type="int64", range=(0, 7), max_length=4),
        FieldSpec(name="marks", type="bool", max_length=2, optional=True),
        FieldSpec(name="note", type="string", max_length=20, optional=True),
        FieldSpec(name="battery", type="int64", range=(1, 100), step=5, default=50),
        FieldSpec(name="armed", type="bool", default=False),
    )
    assert spec.fields == expected
    assert [nested.name for nested in spec.nested] == ["Leg"]


MISSION = Mission(
    lat=45.5,
    heading=90.0,
    mode=Mode.SURVEY,
    level=Level.HIGH,
    kind="b",
    legs=[Leg(0.5), Leg(1.0)],
    home=Leg(0.0),
    xyz=(1.0, 2.0, 3.0),
    raw=b"xyz",
    readings=(1, 2),
    marks=[True],
)


def test_struct_comes_back_from_its_dict() -> None:
    assert struct_builder(Mission)(type_from_struct(Mission).validate(MISSION)) == MISSION


def failing(annotation: object) -> type[msgspec.Struct]:
    return msgspec.defstruct("Bad", [("f", annotation)])


class LegOfAnotherKind(msgspec.Struct):
    y: bool


LegOfAnotherKind.__name__ = "Leg"


class Node(msgspec.Struct):
    inner: "Node | None" = None


class Forward(msgspec.Struct):
    f: "Nowhere"  # type: ignore[name-defined]  # noqa: F821


@pytest.mark.parametrize(
    ("cls", "message"),
    [
        (failing(dict[str, int]), "Bad.f: type: dict[str, int]; allowed: bool, int"),
        (failing(list[int]), "Bad.f: max_length: a list without; allowed: Bounds(max_length=…)"),
        (failing(tuple[int, str]), "Bad.f: type: tuple[int, str]; allowed"),
        (failing(int | str), "Bad.f: type: int | str; allowed"),
        (failing(Annotated[list[str], Bounds(max_length=3)]), "Bad.f: type: a list of texts"),
        (failing(Annotated[list[list[int]], Bounds(max_length=3)]), "Bad.f: type: list[int]"),
        (failing(Annotated[float, Bounds(low=0)]), "Bad.f: range: only one end; allowed: low and"),
        (failing(Annotated[float, msgspec.Meta(gt=0)]), "Bad.f: range: gt and lt for a float"),
        (failing(Annotated[float, Bounds(type="uint8")]), 'Bad.f: type: "uint8"; allowed: float32'),
        (failing(Annotated[str, Bounds(0, 1)]), "Bad.f: low: not for str; allowed: numbers"),
        (failing(Literal[1, 2]), "Bad.f: values: (1, 2); allowed: a Literal of texts"),
        (failing(Annotated[int, Bounds(5, 1)]), "Bad.f: range: [5, 1]; allowed: low < high"),
        (Node, "contains itself"),
        (Forward, "Forward: its annotations have no meaning: name 'Nowhere' is not defined"),
        (
            msgspec.defstruct("Two", [("a", Leg), ("b", LegOfAnotherKind)]),
            "Two.b: a second class named Leg",
        ),
        (
            msgspec.defstruct("D", [("a", Annotated[int, Bounds(0, 3)], 9)]),
            "D: fields[0].default: D.a is 9; allowed: 0..3",
        ),
    ],
)
def test_class_without_a_meaning_on_the_wire_is_refused(
    cls: type[msgspec.Struct], message: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        type_from_struct(cls)
    assert message in str(caught.value)


class Configured(msgspec.Struct):
    depth: float
    count: Annotated[int, Bounds(0, 10)]
    leg: Leg


def configured(**changed: Any) -> TypeSpec:
    count: dict[str, Any] = {"name": "count", "type": "uint8", "range": (0, 10), **changed}
    fields = (
        FieldSpec(name="depth", type="float32", range=(0, 1000), step=0.1),
        FieldSpec(**count),
        FieldSpec(name="leg", type="L"),
    )
    inner = TypeSpec(
        name="L", fields=(FieldSpec(name="x", type="float32", range=(0, 1), step=0.1),)
    )
    return TypeSpec(name="C", fields=fields, nested=(inner,))


def test_config_may_say_more_than_the_class() -> None:
    check_agreement(configured(), type_from_struct(Configured), path="types[0]")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"range": (0, 9)}, "types[0].fields[1].range: (0, 9); allowed: (0, 10), as the Python"),
        ({"range": None}, "types[0].fields[1].range: None; allowed: (0, 10)"),
        ({"type": "float32"}, 'types[0].fields[1].type: "float32"; allowed: "int64", as the'),
        ({"name": "cuont"}, 'types[0].fields[1].name: "cuont"; allowed: "count"'),
        ({"optional": True}, "types[0].fields[1].optional: True; allowed: False"),
        ({"length": 3}, "types[0].fields[1].length: 3; allowed: None"),
    ],
)
def test_config_and_class_that_differ_are_an_error_at_the_field(
    changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        check_agreement(configured(**changed), type_from_struct(Configured), path="types[0]")
    assert message in str(caught.value)


def test_config_and_class_with_different_fields_differ() -> None:
    short = TypeSpec(name="C", fields=configured().fields[:2])
    with pytest.raises(
        ConfigError, match=r"types\[0\].fields: 2 fields; allowed: 3 \(depth, count"
    ):
        check_agreement(short, type_from_struct(Configured), path="types[0]")


@pytest.mark.parametrize(
    ("step", "value", "text"),
    [(0.1, 45.4, "45.4"), (1e-6, 45.4, "45.4"), (0.3, 0.9, "0.9"), (0.05, 1.15, "1.15")],
)
def test_decimal_steps_come_back_as_clean_decimals(step: float, value: float, text: str) -> None:
    quantiser = Quantiser(step, (-90.0, 90.0))
    assert repr(quantiser.value(quantiser.count(value))) == text


def test_count_is_the_nearest_not_the_floor() -> None:
    quantiser = Quantiser(0.1, (-10.0, 10.0))
    assert [quantiser.count(v) for v in (0.16, 0.14, -0.16, -0.14)] == [2, 1, -2, -1]
    whole = Quantiser(10, (-100, 100))
    assert [whole.count(v) for v in (16, 14, -16, -14)] == [2, 1, -2, -1]


def test_ends_of_a_range_that_is_no_whole_number_of_steps_come_back_as_themselves() -> None:
    quantiser = Quantiser(0.1, (0.0, 0.26))
    assert quantiser.value(quantiser.count(0.26)) == 0.26
    assert quantiser.high_count == 3


def test_top_of_a_wrapping_range_is_its_bottom() -> None:
    quantiser = Quantiser(0.1, (0.0, 360.0), wraps=True)
    assert quantiser.count(359.96) == 0
    assert quantiser.high_count == 3599


def test_a_step_that_is_no_short_decimal_still_round_trips() -> None:
    quantiser = Quantiser(2.0**-60 / 3, (0.0, 1e-15))
    assert quantiser.value(quantiser.count(5e-16)) == pytest.approx(5e-16, abs=2.0**-60)
