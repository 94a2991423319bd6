"""Types: what a field may be, and when two types are one."""

import json
import math
from typing import Any

import pytest

from tests.core.types.made import one, spec_of
from zacoustic.core.values.types import MAX_DEPTH, FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import ConfigError


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
        ({"type": "float64", "step": 0}, "step: 0; allowed: a number above 0"),
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
        ({"type": "bool", "length": 0}, "length: 0; allowed: a number, 1..65535"),
        ({"type": "bool", "max_length": 70000}, "max_length: 70000; allowed: a number, 1..65535"),
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
