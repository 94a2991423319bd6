"""Scenes of `tests/golden/edges.json` with a model or a quaternion, and refused blocks."""

import math
from collections.abc import Callable
from typing import Any, Final

from tests.golden.edgescene import AGAINST, BY_MODEL, STREAM, Scene, Value, mode
from tests.golden.edgetypes import Numbers, drawn, learnt, number, plain_prior, type_of
from zacoustic.core.values.dense import Model
from zacoustic.core.values.dense.coder.shares import ends_of
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.model.prior import Companion, First
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.types import FieldSpec, TypeSpec


def _companions() -> dict[str, Any]:
    """Of an earlier stream, of a later one, and of the stream itself; known, kept and missing."""
    deep = type_of(
        "Deep",
        number("depth", 0, 500, 0.5),
        number("height", 0, 500, 0.5, optional=True),
        number("above", 0, 600, 0.5),
    )
    press = type_of("Press", number("bar", 0, 60, 0.01), number("near", 0, 600, 0.5))
    any_value = First(center=4000, scale=1 << 20)

    def beside(stream_id: int, column: int) -> First:
        companion = Companion(
            stream_id=stream_id, column=column, slope=1 << 15, offset=77, scale=2 << 12
        )
        return First(center=4000, scale=1 << 20, companion=companion)

    own = beside(STREAM, 2)
    model = Model(
        streams={
            str(STREAM): plain_prior(
                deep, firsts=(any_value, First(center=0, scale=0), any_value, own)
            ),
            "3": plain_prior(press, firsts=(beside(STREAM, 0), beside(STREAM, 0))),
            "9": plain_prior(press, firsts=(beside(STREAM, 2), beside(STREAM, 2))),
        }
    )
    scene = Scene({STREAM: deep, 3: press, 9: press}, model)

    def value(n: int, height: float | None) -> tuple[int, Value, int]:
        return STREAM, {"depth": 100.0 + n, "height": height, "above": 30.0 + n}, 1

    def bar(stream_id: int, n: float) -> tuple[int, Value, int]:
        return stream_id, {"bar": 5.0 + n, "near": 50.0 + n}, 1

    with mode(BY_MODEL):
        last = scene.say([bar(3, 1), value(1, 60.0), bar(9, 1)])
        last = scene.say([bar(3, 2), value(2, None), bar(9, 2)], last)
        last = scene.say([bar(9, 3)], last)
        last = scene.say([value(3, 61.0), value(4, None), value(5, None), bar(9, 4)], last)
        scene.say([value(6, None), bar(9, 5)])
    return scene.told("companions: z is what this row has, or the state of the other's last sample")


def _learnt() -> dict[str, Any]:
    """Classes that have not been learnt, next to a learnt one, further away, and between two."""
    spec = type_of(
        "Glider",
        number("depth", 0, 200, 0.5),
        number("pitch", -40, 40, 0.5),
        number("heading", 0, 360, 0.5, wraps=True),
    )
    prior = plain_prior(
        spec,
        learnt={str(place): drawn(spec, 7 + place) for place in (0, 1, 3, 5, 6, 7)},
        steadiness=(300, 65279, 1000),
    )
    scene, rng = Scene({STREAM: spec}, Model(streams={str(STREAM): prior})), Numbers(11)
    depth, heading, values = 200, 100, []
    for tick in range(40):
        depth, heading = depth + rng.below(5) - 1, (heading + rng.below(9) - 3) % 720
        pitch = (rng.below(21) - 10) * 0.5
        values.append({"depth": depth * 0.5, "pitch": pitch, "heading": heading * 0.5})
        if tick % 7 == 6:
            depth -= 20
    with mode(AGAINST):
        scene.chain(values, (1, 1, 12, 7, 3, 2, 16, 5, 1, 9, 4, 3, 8, 30, 2))
        # Next to one learnt class only, further away only, and as near to one as to another.
        several = (1, 1, 1, 7, 3, 2), (1, 1, 2, 4), (1, 1, 12, 3), (1, 1, 30, 12), (3, 3, 3, 1)
        for place, steps in enumerate(several):
            scene.chain(values[7 * place + 1 :][: len(steps)], steps)
    return scene.told("classes of a model that have not been learnt")


def _alone() -> dict[str, Any]:
    """A model with one class, of which the others are made."""
    spec = type_of("Few", number("n", -50, 50, 1.0), number("m", 0, 9000, 1.0))
    prior = plain_prior(spec, learnt={"5": drawn(spec, 3)})
    scene, rng = Scene({STREAM: spec}, Model(streams={str(STREAM): prior})), Numbers(5)
    with mode(AGAINST):
        scene.chain(
            [{"n": float(rng.below(9)), "m": float(n * 11 + rng.below(3))} for n in range(12)],
            (1, 6, 1, 16, 8),
        )
    return scene.told("a model with one class")


def _lines() -> dict[str, Any]:
    spec = type_of(
        "Lines",
        FieldSpec(name="text", type="string"),
        FieldSpec(name="raw", type="bytes"),
    )
    said = ("xylem Ängström 1", "xylem Ängström 1", 'say "quartz"\\\t\n\x1b\x7f€', "xylem quiz")
    model = Model(streams={str(STREAM): plain_prior(spec, lines=said)})
    scene = Scene({STREAM: spec}, model)
    texts = (
        "xylem Ängström 2",
        'say "quartz"\\\t\n\x1b\x7f€',
        "xylem quiz",
        "INF mission: leg 1",
        "",
    )
    with mode(BY_MODEL):
        scene.chain([{"text": text, "raw": text.encode()} for text in texts])
    return scene.told(
        "`lines` of a model, for strings and not for bytes; each as often as it stands"
    )


def _habits() -> dict[str, Any]:
    spec = type_of("Bit", FieldSpec(name="on", type="bool"))
    model = Model(
        streams={
            "3": plain_prior(spec, present=100, more=(60000, 300)),
            str(STREAM): plain_prior(spec, present=65535, steadiness=(260,)),
            "9": plain_prior(spec, more=(5, 6), steadiness=(65300,)),
        },
        single=65000,
    )
    scene = Scene({3: spec, STREAM: spec, 9: spec}, model)
    several = [(3, {"on": n % 2 == 0}, 1) for n in range(14)]
    last = scene.say([*several, (STREAM, {"on": True}, 1), (9, {"on": False}, 1)])
    for n in range(9):
        last = scene.say([(9, {"on": n > 6}, 1)], last)
    last = scene.say([(STREAM, {"on": True}, 3), (3, {"on": True}, 2)], last)
    scene.say([(STREAM, {"on": n % 2 == 0}, 1) for n in range(40)], last)
    return scene.told("habits and steadiness of a model, and their limits")


def _firsts() -> dict[str, Any]:
    """Curves around an expected value: the center's bounds, wide numbers, and holds."""
    spec = type_of(
        "Firsts",
        number("low", 0, 9, 1.0),
        number("high", 0, 9, 1.0),
        number("held", 0, 99, 1.0),
        number("modulo", 0, 99, 1.0),
        number("wide", 0, 1 << 30, 1.0),
        number("end", 0, 1 << 30, 1.0),
        FieldSpec(name="one", type="enum", values=("only",)),
        number("flat", 0, 100, 1.0),
    )
    firsts = (
        First(center=-(1 << 20), scale=1 << 12),
        First(center=1 << 20, scale=1 << 12),
        First(center=800, scale=4 << 12, held=50, hold=65535),
        First(center=0, scale=0, held=142, hold=30000),
        First(center=(1 << 29) << 4, scale=900 << 12, held=(1 << 29) + 5, hold=40000),
        First(center=(1 << 31) << 4, scale=1 << 30, held=3, hold=0),
        First(center=0, scale=1 << 12),
        First(center=800, scale=(1 << 40) - 1, held=7, hold=0),
    )
    prior = plain_prior(spec, firsts=firsts)
    scene = Scene({STREAM: spec}, Model(streams={str(STREAM): prior}))
    base = 1 << 29
    rows = (
        (0, 9, 50, 42, base + 5, (1 << 30) - 7, 7),
        (9, 0, 51, 43, base + 4, (1 << 30) - (1 << 21), 93),
        (3, 4, 0, 42, base - (1 << 20), 1 << 30, 0),
    )
    with mode(BY_MODEL):
        for row in rows:
            names = ("low", "high", "held", "modulo", "wide", "end", "flat")
            value = {name: float(each) for name, each in zip(names, row, strict=True)}
            scene.say([(STREAM, {**value, "one": "only"}, 1)])
    return scene.told("by the model: bounds of the center, holds, and numbers of many values")


def _limits() -> dict[str, Any]:
    """Holds, widths and chances at their bounds."""
    spec = type_of("Limits", number("n", 0, 300, 1.0), number("m", 0, WIDE, 1.0))
    found = {
        "0": learnt(spec, weight=0, log_scale=4096, nearer=65536, width=8190, hold=65206),
        "1": learnt(spec, weight=0, log_scale=0, nearer=0, width=2, hold=30000),
        "2": learnt(spec, weight=0, log_scale=3000, nearer=0, width=8191, hold=65206),
        "4": learnt(spec, weight=0, log_scale=100, nearer=0, width=2048, hold=1),
    }
    prior = plain_prior(spec, learnt=found)
    scene = Scene({STREAM: spec}, Model(streams={str(STREAM): prior}))
    with mode(AGAINST):
        for steps in (1, 2, 4):
            last = scene.say([(STREAM, {"n": 8.0 + steps, "m": 5e9}, 1)])
            for n in (9, 9, 9, 290, 290, 0, 0, 0, 1):
                last = scene.say([(STREAM, {"n": float(n), "m": 5e9 + n * n}, steps)], last)
    return scene.told("holds and widths at their bounds")


WIDE: Final = 1 << 42


def _quaternions() -> dict[str, Any]:
    def part(name: str, **more: Any) -> FieldSpec:
        return number(name, -1, 1, 0.001, **more)

    inner = type_of("Inner", *(part(f"q{axis}") for axis in "xyzw"))
    spec = TypeSpec(
        name="Attitudes",
        fields=(
            part("aX"),
            part("by"),
            part("Z"),
            part("spare_w"),
            FieldSpec(name="inner", type="Inner"),
            FieldSpec(name="both", type="Inner", length=2),
            *(part(f"o{axis}", optional=True) for axis in "xyzw"),
            *(number(f"coarse_{axis}", -1, 1, 0.2) for axis in "xyzw"),
            *(part(f"w{axis}") for axis in "wxyz"),
        ),
        nested=(inner,),
    )
    scene = Scene({STREAM: spec}, rounded=True)

    def turned(degrees: float, axis: int, sign: float = 1.0) -> list[float]:
        half = math.radians(degrees) / 2
        found = [0.0, 0.0, 0.0, math.cos(half)]
        found[axis] = math.sin(half)
        return [round(sign * each, 3) for each in found]

    def named(prefix: str, parts: list[float]) -> dict[str, float]:
        return {f"{prefix}{axis}": each for axis, each in zip("xyzw", parts, strict=True)}

    values = []
    for tick in range(6):
        first = turned(10.0 + 7 * tick, 2)
        other = turned(33.0 + tick, 0, -1.0 if tick == 3 else 1.0)
        odd = [0.25, 0.5, -0.125, 0.0] if tick == 2 else turned(90.0, 1)
        values.append(
            {
                **dict(zip(("aX", "by", "Z", "spare_w"), first, strict=True)),
                "inner": named("q", other),
                "both": [named("q", odd), named("q", turned(-20.0 - tick, 1))],
                **{f"o{axis}": None if tick == 4 else 0.5 for axis in "xyzw"},
                **named("coarse_", [0.2, -0.4, 0.6, 0.0]),
                **named("w", turned(40.0, 2)),
            }
        )
    scene.chain(values)
    return scene.told("quaternions: what is one, as angles and as four numbers")


def model_scenes() -> list[dict[str, Any]]:
    """Make them all."""
    return [
        _companions(),
        _learnt(),
        _alone(),
        _lines(),
        _habits(),
        _firsts(),
        _limits(),
        _quaternions(),
    ]


_PARTS: Final = type_of(
    "Parts",
    FieldSpec(name="text", type="string"),
    FieldSpec(name="exact", type="float64"),
    FieldSpec(name="count", type="int8", range=(0, 9), outside="escape"),
    FieldSpec(name="levels", type="int8", range=(0, 9), outside="escape", max_length=3),
)


def _by_hand(write: Callable[[Writer], None]) -> tuple[Scene, bytes]:
    """Return a block of one sample, coded plainly: the type has one column."""
    scene = Scene({STREAM: _PARTS})
    writer = Writer()
    writer.pick(ends_of(28, 3, 1), 2)
    writer.pick(ends_of(3, 1), 1)
    write(writer)
    writer.pick(ends_of(31, 1), 0)
    return scene, writer.finish(1, scene.codec._root.check)


def _parts(
    text: tuple[int, int], exact: int = 0, count: int = 0x80, level: int = 0
) -> Callable[[Writer], None]:
    def write(writer: Writer) -> None:
        writer.uniform(2, 0)  # the count escapes
        writer.raw(text[1], text[0])
        writer.raw(64, exact)
        writer.raw(8, count)
        writer.raw(2, 1)
        writer.raw(4, 10)
        writer.raw(8, level)

    return write


_TEXT: Final = (0b1_00000001_1100001, 16)
_UNMARKED: Final = (0b0_00000001_01100001, 17)


def plain_parts() -> dict[str, Any]:
    """Return a scene with parts whose form no encoder chooses: numbers that lie in their range."""
    scene, block = _by_hand(_parts(_TEXT, count=0x80 + 5))
    scene.hear(block)
    return scene.told("a number that escapes alone may lie in its range")


def refused_blocks() -> list[dict[str, Any]]:
    """Return blocks whose parts 7.1 does not allow."""
    found = []
    for why, write in (
        ("ASCII that is not marked as such", _parts(_UNMARKED)),
        ("another form of not a number", _parts(_TEXT, exact=0x7FF8000000000001)),
        ("a number in an array that lies in its range", _parts(_TEXT, level=0x80 + 5)),
    ):
        scene, block = _by_hand(write)
        try:
            scene.codec.decode(block)
        except PayloadError:
            found.append({"meaning": why, **_without_blocks(scene), "block": block.hex()})
        else:
            raise SystemExit(f"{why}: it is read")
    return found


def _without_blocks(scene: Scene) -> dict[str, Any]:
    told = scene.told("")
    return {key: told[key] for key in ("table_digest", "types", "streams")}
