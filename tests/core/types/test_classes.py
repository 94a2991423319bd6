"""Types out of classes of Python, and whether the configuration agrees with them."""

from typing import Annotated, Any, Literal

import msgspec
import pytest

from tests.core.types.made import Level, Mode
from zacoustic.core.values.types import (
    Bounds,
    FieldSpec,
    TypeSpec,
    check_agreement,
    struct_builder,
    type_from_struct,
)
from zacoustic.errors import ConfigError


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
