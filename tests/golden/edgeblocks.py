"""Scenes of `tests/golden/edges.json`: references, columns, habits, numbers and courses."""

from collections.abc import Mapping
from typing import Any, Final

import msgspec

from tests.golden.edgemodels import model_scenes, plain_parts
from tests.golden.edgescene import AGAINST, PLAINLY, STREAM, Scene, Value, mode, never_single
from tests.golden.edgetypes import Numbers, learnt, number, plain_prior, type_of
from zacoustic.core.values.dense import Model, Snapshot
from zacoustic.core.values.types import FieldSpec, TypeSpec

DEPTH: Final = type_of("Depth", number("depth", 0, 100, 0.5))


def _depth(value: float) -> list[tuple[int, Value, int]]:
    return [(STREAM, {"depth": value}, 1)]


def _range_ends() -> dict[str, Any]:
    scene = Scene(
        {
            STREAM: type_of(
                "Ends",
                number("down", 0, 1.275, 0.01),
                number("up", 0, 153.45, 0.3),
                number("far", 0, 0.575, 0.01, outside="escape"),
                number("turn", 0, 153.45, 0.3, wraps=True),
                number("sixth", 0, 1, 1 / 60000),
            )
        }
    )
    values = [
        {"down": 1.275, "up": 153.45, "far": 0.575, "turn": 153.4, "sixth": 1.0},
        {"down": 0.575, "up": 9.45, "far": 0.58, "turn": 9.45, "sixth": 0.5},
        {"down": 0.0, "up": 37.95, "far": 0.3, "turn": 0.1, "sixth": 1 / 60000},
    ]
    with mode(PLAINLY):
        scene.chain(values)
    scene.chain(values)
    return scene.told("range ends whose multiple depends on how it is rounded")


def _found(scene: Scene, reference: Snapshot, steps: int, *names: int) -> tuple[bytes, Snapshot]:
    """Return a block with one of these names: the first value that gives it."""
    for half in range(200):
        for name in names:
            block, snapshot = scene.make(
                [(STREAM, {"depth": half / 2}, steps)], reference, name=name
            )
            if snapshot.name == name:
                return block, snapshot
    raise SystemExit("no block has that name")


def _outdates(generations: int) -> dict[str, Any]:
    """`late` and `held` have one name; the reference of `late` is that many before `held`."""
    scene = Scene({STREAM: DEPTH})
    first = scene.say(_depth(10.0))
    last = first
    for place in range(generations - 1):
        last = scene.say(_depth(11.0 + place), last)
    held, is_held = _found(scene, last, 1, *range(38, 44))
    assert is_held.name is not None
    late, is_late = _found(scene, first, 1, is_held.name)
    scene.hear(held)
    scene.hear(late)
    meant = is_held if generations <= 16 else is_late
    scene.say(_depth(50.0), meant)
    what = "outdates" if generations <= 16 else "does not outdate"
    return scene.told(f"a block {what} one whose reference is {generations} before it")


def _not_outdated() -> dict[str, Any]:
    scene = Scene({STREAM: DEPTH})
    first = scene.say(_depth(10.0))
    held, is_held = _found(scene, first, 1, *range(38, 44))
    assert is_held.name is not None
    same, _ = _found(scene, first, 2, is_held.name)
    scene.hear(held)
    scene.hear(same)
    for half in range(200):  # independent ones have the name of their turn
        alone, is_alone = scene.make(_depth(half / 2))
        if is_alone.name == first.name and alone != bytes.fromhex(scene._blocks[0]["block"]):
            break
    scene.hear(alone)
    scene.say(_depth(3.5), is_alone)
    last = is_alone
    for place in range(37):
        last = scene.say(_depth(4.0 + place / 2), last)
    again, _ = _found(scene, last, 1, first.name or 0)
    scene.hear(again)
    scene.hear(alone)
    scene.say(_depth(9.0), is_alone)
    return scene.told("neither siblings nor independent blocks outdate, or are outdated")


def _forms() -> dict[str, Any]:
    spec = type_of("Forms", number("n", 0, 400, 1.0))
    scene = Scene({STREAM: spec, 9: spec})
    last: Snapshot | None = None
    for place in range(12):
        samples = [(STREAM, {"n": float(7 * place % 5 + n)}, 4 if n == 0 else 2) for n in range(3)]
        if place % 3 == 2:
            samples.append((9, {"n": float(place)}, (1, 9, 16, 40)[place // 3]))
        block, snapshot = scene.make(samples, last, form=place % 6 if last is not None else 0)
        scene.hear(block)
        last = snapshot if snapshot.name is not None else last
    block, _ = scene.make(samples, last)
    scene.hear(block)
    return scene.told("every form; the distance of a block of several samples is rounded up")


def _arrays() -> dict[str, Any]:
    pair = type_of("Pair", number("x", -5, 5, 0.5), number("y", -5, 5, 0.5))
    three = type_of("Three", msgspec.structs.replace(number("x", -5, 5, 0.5), length=3))
    maybe = type_of("Maybe", FieldSpec(name="n", type="uint8", max_length=3))
    scene = Scene(
        {
            STREAM: TypeSpec(
                name="Arrays",
                fields=(
                    FieldSpec(name="five", type="Pair", length=5),
                    FieldSpec(name="six", type="Pair", length=6),
                    FieldSpec(name="four", type="Three", length=4),
                    FieldSpec(name="threes", type="Three", length=5),
                    FieldSpec(name="ten", type="Maybe", length=10),
                    FieldSpec(name="eleven", type="Maybe", length=11),
                    FieldSpec(name="sixteen", type="bool", length=16),
                    FieldSpec(name="seventeen", type="bool", length=17),
                ),
                nested=(pair, three, maybe),
            )
        }
    )
    rng = Numbers()

    def halves(count: int) -> list[float]:
        return [(rng.below(21) - 10) * 0.5 for _ in range(count)]

    values = [
        {
            "five": [dict(zip("xy", halves(2), strict=True)) for _ in range(5)],
            "six": [dict(zip("xy", halves(2), strict=True)) for _ in range(6)],
            "four": [{"x": halves(3)} for _ in range(4)],
            "threes": [{"x": halves(3)} for _ in range(5)],
            "ten": [{"n": [rng.below(256)] * rng.below(3)} for _ in range(10)],
            "eleven": [{"n": [rng.below(256)] * rng.below(3)} for _ in range(11)],
            "sixteen": [rng.below(3) == 0 for _ in range(16)],
            "seventeen": [rng.below(3) == 0 for _ in range(17)],
        }
        for _ in range(3)
    ]
    scene.chain(values)
    return scene.told("fixed arrays: which of them make columns")


def _missing() -> dict[str, Any]:
    scene = Scene(
        {
            STREAM: type_of(
                "Missing",
                number("level", 0, 10, 0.5, outside="escape", optional=True),
                FieldSpec(name="count", type="int8", range=(0, 9), outside="escape", optional=True),
                FieldSpec(name="mode", type="enum", values=("a", "b", "c"), optional=True),
                FieldSpec(name="note", type="string", optional=True),
            )
        }
    )
    values: list[Value] = [
        {"level": None, "count": None, "mode": None, "note": None},
        {"level": 3.5, "count": 4, "mode": "b", "note": "leak"},
        {"level": None, "count": None, "mode": None, "note": None},
        {"level": 77.25, "count": -7, "mode": "c", "note": "leak"},
        {"level": None, "count": 4, "mode": None, "note": None},
        {"level": 4.0, "count": None, "mode": "c", "note": "hull"},
        {"level": None, "count": 5, "mode": "a", "note": "leak"},
    ]
    for chosen in (AGAINST, PLAINLY):
        with mode(chosen):
            scene.chain(values)
    return scene.told("optional numbers that escape, missing; symbols unknown before")


def _single() -> dict[str, Any]:
    spec = type_of("Bit", FieldSpec(name="on", type="bool"), FieldSpec(name="n", type="uint8"))
    scene = Scene({3: spec, STREAM: spec, 9: spec})

    def one(stream_id: int, count: int) -> tuple[int, Value, int]:
        return stream_id, {"on": count % 3 == 0, "n": count}, 1

    with never_single():
        last = scene.say([one(3, 1)])
        for count in range(4):
            last = scene.say([one(STREAM, count)], last)
    last = scene.say([one(9, 7)], last)
    last = scene.say([one(3, 2), one(9, 8)], last)
    last = scene.say([one(3, 3)], last)
    block, last = scene.make([one(9, 200)], single=True, name=None)
    scene.hear(block)
    last = scene.say([one(9, 201)], last)
    last = scene.say([one(3, 9), one(STREAM, 9), one(9, 9)], last)
    scene.say([one(STREAM, 10)], last)
    return scene.told("`single` changes by whether exactly one stream was there")


def _kept() -> dict[str, Any]:
    scene = Scene(
        {
            STREAM: type_of(
                "Kept",
                FieldSpec(name="text", type="string"),
                FieldSpec(name="raw", type="bytes", max_length=12),
                FieldSpec(name="exact", type="float64"),
                FieldSpec(name="counts", type="int8", max_length=4),
            )
        }
    )
    texts = ["xylem 1", "xylem 1", "xylem 1", "zygote", "quartz", "jig", "vex", "fjord", "wyvern"]
    texts += ["xylem 1", "xylem 1", *(f"{n} sphinx" for n in range(8)), "xylem 2", "0 sphinx"]
    # The same six letters at the begin and elsewhere, also with a number as one digit.
    texts += ["xyle12A xyle34B", "xyle56A", "12ylemsA 3ylemsB", "7ylemsA"]
    values = [
        {
            "text": text,
            "raw": text.encode()[:12] if place % 3 else b"xylem 1",
            "exact": (0.0, -0.0, float("nan"), 1.5)[place // 2 % 4],
            "counts": [place // 3] * (place // 3 % 4),
        }
        for place, text in enumerate(texts)
    ]
    last = scene.chain(values)
    with mode(PLAINLY):
        last = scene.chain([{**values[5], "text": "plain sphinx"}], last=last)
    scene.chain([{**values[6], "text": "plain sphinx 2"}, values[7]], last=last)
    return scene.told("kept texts: a value that comes again takes another place")


def _no_values() -> dict[str, Any]:
    """Floats that may be no value, and bytes and texts of at least so many."""
    scene = Scene(
        {
            STREAM: type_of(
                "Maybe",
                number("depth", -5, 5, 0.5, nan=True),
                number("turn", 0, 360, 0.5, wraps=True, nan=True),
                number("level", -5, 5, 0.5, nan=True, outside="escape"),
                FieldSpec(name="exact", type="float32", nan=True),
                number("legs", 0, 100, 1.0, nan=True, length=3),
                FieldSpec(name="few", type="float32", range=(0, 8), nan=True, max_length=2),
                FieldSpec(name="id", type="bytes", min_length=4, max_length=4),
                FieldSpec(name="text", type="string", min_length=2),
                # No quaternion.
                *(number(f"q{part}", -1, 1, 0.02, nan=part == "w") for part in "xyzw"),
            )
        }
    )
    nan, above, below = float("nan"), float("inf"), float("-inf")
    values = [
        {
            "depth": (1.5, 2.0, nan, nan, 2.5, above, below, 3.0)[place % 8],
            "turn": (359.5, nan, 0.5)[place % 3],
            "level": (0.5, 7.25, nan, -6.5, below)[place % 5],
            "exact": (1.25, nan, 1.25, above)[place % 4],
            "legs": [float(place), (nan, 3.0)[place % 2], 1.0],
            "few": [nan, 1.5][: place % 3],
            "id": bytes((1, 2, 3, place // 3)),
            "text": ("ab", "abc 12", "xyle")[place % 3],
            **{f"q{part}": 0.0 for part in "xyz"},
            "qw": (1.0, nan)[place % 2],
        }
        for place in range(16)
    ]
    with mode(PLAINLY):
        scene.chain(values[:2])
    scene.chain(values)
    return scene.told("floats that may be no value; bytes and texts of at least so many")


def _long_texts() -> dict[str, Any]:
    scene = Scene({STREAM: type_of("Long", FieldSpec(name="text", type="string"))})
    long = "INF mission: leg 1 of 12 started. " * 30
    values = [{"text": text} for text in (long + "abcd", long + "abcde", "Öl €", "")]
    scene.chain(values)
    return scene.told("a text of 1024 bytes, and one of 1025")


WIDE: Final = 1 << 42


def _scales() -> dict[str, Any]:
    """A model that predicts far too much. From 2^20 steps on reciprocals are 0: no scale grows."""
    spec = type_of("Wide", number("far", 0, WIDE, 1.0))
    prior = plain_prior(spec)
    model = Model(
        streams={
            str(STREAM): msgspec.structs.replace(
                prior,
                learnt={
                    "0": learnt(spec, weight=1 << 37, log_scale=32768, nearer=65536, width=0),
                    "1": learnt(spec, weight=1 << 37, log_scale=32700, nearer=65536, width=0),
                },
            )
        }
    )
    scene = Scene({STREAM: spec}, model)
    base = 1 << 41
    with mode(AGAINST):
        scene.chain([{"far": float(base + n * (1 << 25) + n * n * 99999)} for n in range(8)])
    return scene.told("log scales of 32768, whose reciprocal is 0")


def _far() -> dict[str, Any]:
    scene = Scene({STREAM: type_of("Ramp", number("n", 0, 2000, 1.0), number("m", 0, 39, 1.0))})
    ramp = [{"n": float(n), "m": float(n % 40)} for n in range(36)]
    last = scene.chain(ramp)
    jumps: list[Value] = [{"n": 1900.0, "m": 35.0}, {"n": 3.0, "m": 0.0}, {"n": 2000.0, "m": 39.0}]
    with mode(AGAINST):
        last = scene.chain(jumps, last=last)
    still: list[Value] = [{"n": 7.0, "m": 7.0}] * 9
    scene.chain([*still, {"n": 8.0, "m": 7.0}, {"n": 0.0, "m": 39.0}], last=last)
    return scene.told("numbers far from their prediction, on both sides")


def _broken() -> list[dict[str, Any]]:
    """E of exactly -2^32 and next to it, and beyond on both sides."""
    spec = type_of("Broken", number("n", 0, 2000, 1.0), number("far", 0, WIDE, 1.0))
    blocks: list[dict[str, Any]] = []
    for weight in (-(1 << 38), -(1 << 38) + 64, -(1 << 40) + 1, (1 << 40) - 1):
        prior = msgspec.structs.replace(
            plain_prior(spec),
            learnt={"0": learnt(spec, weight=weight, log_scale=9000, nearer=65536, width=2048)},
        )
        scene = Scene({STREAM: spec}, Model(streams={str(STREAM): prior}))
        with mode(AGAINST):
            scene.chain([{"n": 10.0 + n, "far": 1e12 + 3 * n} for n in range(4)])
        blocks.append(scene.told(f"a prediction of {(1024 * weight) >> 16}"))
    return blocks


def _strides() -> dict[str, Any]:
    spec = type_of(
        "Strides",
        number("far", 0, WIDE, 1.0),
        number("near", 0, 1000, 1.0),
        number("edge", 0, (1 << 22) - 1, 1.0),
        number("wide", -(1 << 30), 1 << 30, 1.0),
        number("turn", 0, 1 << 30, 1.0, wraps=True),
        number("maybe", 0, 1 << 25, 1.0, optional=True),
    )
    scene = Scene({STREAM: spec})
    pace = 1 << 22

    def value(n: int, more: int = 0) -> Value:
        return {
            "far": float(5 * pace + n * pace + 3 * n + more),
            "near": float(100 + n),
            "edge": float((n + 1) % 3),
            "wide": float((1 << 29) - n * pace),
            "turn": float((n * (1 << 28) + n) % (1 << 30)),
            "maybe": None if n % 4 == 2 else float(n * (1 << 20)),
        }

    with mode(PLAINLY):
        last = scene.chain([value(n) for n in range(3)])
        last = scene.say([(STREAM, value(6), 3)], last)
    with mode(AGAINST):
        last = scene.chain([value(7), value(8, 5), value(10), value(11)], (1, 1, 2, 1), last)
    with mode(PLAINLY):
        last = scene.chain([value(11, 1 << 19), value(11, (1 << 19) + (1 << 20))], last=last)
    with mode(AGAINST):
        scene.chain([value(11, (1 << 19) + (1 << 21)), value(11)], last=last)
    return scene.told("strides, velocities of a plain sample, ways of more than 2^24 steps")


def _vehicle(*speeds: FieldSpec) -> TypeSpec:
    return type_of(
        "Vehicle",
        *speeds,
        number("lon", 0, 50000, 1.0),
        number("course", 0, 360, 0.5, wraps=True),
        number("lat", 0, 40000, 1.0),
        number("turn", 0, 360, 2.0, wraps=True),
    )


_SPEEDS: Final[Mapping[str, tuple[FieldSpec, ...]]] = {
    "without a speed": (),
    "with a speed at its lowest index": (number("Speed", -1, 3, 0.25),),
    "with a field ground_speed, which is no speed": (number("ground_speed", -1, 3, 0.25),),
    "with two speeds, the second first in coding order": (
        number("surge", -2, 6, 0.125),
        number("sog", -1, 3, 0.25),
    ),
    "with a speed that is sometimes missing": (number("speed", -1, 3, 0.25, optional=True),),
    "with a speed that is coded behind a position": (number("velocity", -50000, 50000, 1.0),),
}


def _courses() -> list[dict[str, Any]]:
    found = []
    for what, speeds in _SPEEDS.items():
        scene, rng = Scene({STREAM: _vehicle(*speeds)}), Numbers()
        lat, lon, heading = 20000, 25000, 100
        values = []
        for tick in range(28):
            heading = (heading + rng.below(5) - 2 + (90 if tick % 9 == 8 else 0)) % 720
            lat, lon = lat + 30 + rng.below(3) - heading % 50, lon + heading % 40
            value: dict[str, Any] = {
                "lat": float(lat),
                "lon": float(lon),
                "course": heading * 0.5,
                "turn": float(heading % 360 // 2 * 2),
            }
            for place, each in enumerate(speeds):
                low, _ = each.bounds
                is_least = tick % 4 == 3
                value[each.name] = low if is_least else 1.0 + (tick + place) % 3 * 0.5
                if each.optional and tick % 5 == 4:
                    value[each.name] = None
                if each.name == "velocity":
                    value[each.name] = float(rng.below(9))
            values.append(value)
        with mode(AGAINST):
            scene.chain(values, (1, 1, 2))
        found.append(scene.told(f"a course {what}"))
    return found


def scenes() -> list[dict[str, Any]]:
    """Make them all."""
    return [
        _range_ends(),
        _outdates(2),
        _outdates(16),
        _outdates(17),
        _not_outdated(),
        _forms(),
        _arrays(),
        _missing(),
        _single(),
        _kept(),
        _no_values(),
        _long_texts(),
        _scales(),
        _far(),
        *_broken(),
        _strides(),
        *_courses(),
        *model_scenes(),
        plain_parts(),
    ]
