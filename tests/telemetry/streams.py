"""The streams of a survey vehicle, with the resolution at which they cross the channel."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from zacoustic.core.values.types import FieldSpec, TypeSpec

STREAM_IDS: Final = {
    "nav": 10,
    "status": 11,
    "ctd": 12,
    "cmd": 13,
    "wp": 14,
    "pose": 15,
    "usbl": 16,
    "log": 17,
}
"""Stream ids, by name."""

UPLINK: Final = ("nav", "status", "ctd", "log")
"""What a vehicle reports all the time."""

Sample = tuple[float, str, dict[str, Any]]
"""Time in seconds, name of the stream, value in full precision."""


def number(name: str, low: float, high: float, step: float, *, wraps: bool = False) -> FieldSpec:
    """Make a field of numbers."""
    return FieldSpec(name=name, type="float64", range=(low, high), step=step, wraps=wraps)


def vehicle_types(lat: float, lon: float) -> dict[str, TypeSpec]:
    """Make the types of a mission.

    Args:
        lat: Latitude of its datum, degrees.
        lon: Longitude of its datum, degrees.
    """
    place = (
        number("lat", round(lat - 0.1, 6), round(lat + 0.1, 6), 1e-6),
        number("lon", round(lon - 0.1, 6), round(lon + 0.1, 6), 1e-6),
        number("depth", 0, 1000, 0.1),
    )
    speed = number("speed", -1, 4, 0.01)
    types = {
        "nav": (
            *place,
            number("heading", 0, 360, 0.1, wraps=True),
            number("pitch", -45, 45, 0.1),
            number("roll", -45, 45, 0.1),
            speed,
            number("altitude", 0, 200, 0.1),
            number("yaw_rate", -20, 20, 0.1),
        ),
        "status": (
            _count("mode", 7),
            _count("battery", 100),
            number("voltage", 18, 30, 0.1),
            *(FieldSpec(name=f"leak{n}", type="bool") for n in range(4)),
            _count("leg", 255),
            _count("fault", 65535),
        ),
        "ctd": (
            number("temperature", -2, 35, 0.001),
            number("conductivity", 0, 70, 0.001),
            number("pressure", 0, 1100, 0.01),
        ),
        "cmd": tuple(number(name, -1, 1, 0.01) for name in ("surge", "yaw", "heave")),
        "wp": (*place, speed),
        "pose": (
            number("x", -5000, 5000, 0.01),
            number("y", -5000, 5000, 0.01),
            number("z", -1000, 0, 0.01),
            *(number(f"q{part}", -1, 1, 0.001) for part in "xyzw"),
        ),
        "usbl": (
            number("range", 0, 3000, 0.1),
            number("bearing", 0, 360, 0.1, wraps=True),
            number("elevation", -90, 90, 0.1),
            number("sigma", 0, 10, 0.1),
        ),
        "log": (FieldSpec(name="text", type="string", max_length=200),),
    }
    return {name: TypeSpec(name=name.title(), fields=fields) for name, fields in types.items()}


def by_id(types: Mapping[str, TypeSpec], names: Iterable[str] = ()) -> dict[int, TypeSpec]:
    """Give the types of some streams (none: of all) by stream id."""
    return {STREAM_IDS[name]: types[name] for name in names or types}


def is_near(type_spec: TypeSpec, value: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Tell whether every field is within half a step, or the same where it has none."""
    for field in type_spec.fields:
        one, two = value[field.name], other[field.name]
        if field.step is None or field.is_integer:
            if one != two:
                return False
            continue
        distance = abs(one - two)
        if field.wraps and field.range is not None:
            distance = min(distance, field.range[1] - field.range[0] - distance)
        if distance > field.step * 0.5000001:
            return False
    return True


def _count(name: str, most: int) -> FieldSpec:
    return FieldSpec(name=name, type="uint16", range=(0, most))
