"""What names say: the unit and precision of a number, and how urgent a topic is.

A name is split into words (``battery_voltage``, ``batteryVoltage`` and ``battery/voltage`` are the
same two), and the first rule with one of them holds. What a name promises is checked against the
values: a heading of 1.57 that never exceeds 2π is in radians, a ``lat`` of 4312 is no latitude.
"""

import math
import re
from collections.abc import Iterable
from typing import Final

import msgspec

_WORD: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")
_TURN: Final = 2 * math.pi


class Quantity(msgspec.Struct, frozen=True, kw_only=True):
    """What the numbers of a name usually are."""

    unit: str
    """Unit for people; empty: none, or unknown."""
    step: float
    """Useful precision, in the unit."""
    low: float
    """Usual least value."""
    high: float
    """Usual greatest value."""
    is_firm: bool = False
    """The ends are those of the quantity itself: no headroom beyond them."""
    wraps: bool = False
    """The ends are the same value."""


_LATITUDE: Final = Quantity(unit="deg", step=1e-6, low=-90, high=90, is_firm=True)
_LONGITUDE: Final = Quantity(unit="deg", step=1e-6, low=-180, high=180, is_firm=True)
_COURSE: Final = Quantity(unit="deg", step=0.1, low=0, high=360, is_firm=True, wraps=True)
_COURSE_RAD: Final = Quantity(unit="rad", step=0.001, low=-_TURN, high=_TURN, is_firm=True)
_TILT: Final = Quantity(unit="deg", step=0.1, low=-180, high=180, is_firm=True)
_PERCENT: Final = Quantity(unit="%", step=0.5, low=0, high=100, is_firm=True)
_SHARE: Final = Quantity(unit="", step=0.001, low=0, high=100, is_firm=True)
_METRES: Final = Quantity(unit="m", step=0.01, low=0, high=1000)
_PLACE: Final = Quantity(unit="m", step=0.01, low=-1000, high=1000)
_SPEED: Final = Quantity(unit="m/s", step=0.01, low=-10, high=10)
_CELSIUS: Final = Quantity(unit="degC", step=0.01, low=-50, high=100)
_VOLTS: Final = Quantity(unit="V", step=0.01, low=0, high=100)
_AMPERES: Final = Quantity(unit="A", step=0.01, low=-100, high=100)
_PRESSURE: Final = Quantity(unit="", step=0.01, low=0, high=10_000)
_SALT: Final = Quantity(unit="", step=0.001, low=0, high=100)
_PART_OF_ONE: Final = Quantity(unit="", step=0.001, low=-1, high=1, is_firm=True)
_TURNING: Final = Quantity(unit="rad/s", step=0.001, low=-_TURN, high=_TURN)
_TURNS: Final = Quantity(unit="rpm", step=1, low=-10_000, high=10_000)

_ACCELERATION: Final = Quantity(unit="m/s^2", step=0.001, low=-100, high=100)
_TURNING_DEG: Final = Quantity(unit="deg/s", step=0.1, low=-360, high=360)

_TURNED: Final = frozenset({"roll", "pitch", "yaw", "heading", "course", "turn", "angular"})
_RATES: Final = frozenset({"rate", "speed", "velocity", "vel"})
_RATES_OF_TURN: Final = re.compile(r"(roll|pitch|yaw|heading|turn)(rate|speed|vel)")
"""Rates of turn that are written as one word, as in MAVLink."""
_AXES: Final = frozenset({"x", "y", "z"})
_PLACES: Final = frozenset(
    {"position", "pos", "pose", "point", "translation", "location", "origin", "place", "offset"}
)
"""What has axes in metres; those of a force or a field have not."""

# By word, the first that matches; angles twice: in degrees, and in radians.
_QUANTITIES: Final[tuple[tuple[frozenset[str], Quantity, Quantity | None], ...]] = (
    (frozenset({"acceleration", "accel"}), _ACCELERATION, None),
    (frozenset({"angular", "gyro"}), _TURNING, None),
    (frozenset({"lat", "latitude"}), _LATITUDE, None),
    (frozenset({"lon", "lng", "longitude"}), _LONGITUDE, None),
    (frozenset({"heading", "yaw", "course", "bearing", "azimuth"}), _COURSE, _COURSE_RAD),
    (frozenset({"roll", "pitch", "rudder", "elevation"}), _TILT, _COURSE_RAD),
    (frozenset({"percent", "percentage", "pct", "soc"}), _PERCENT, None),
    (frozenset({"depth", "altitude", "alt", "height", "range", "distance"}), _METRES, None),
    (frozenset({"speed", "velocity", "vx", "vy", "vz", "surge", "sway", "heave"}), _SPEED, None),
    (frozenset({"temp", "temperature"}), _CELSIUS, None),
    (frozenset({"voltage", "volt", "volts"}), _VOLTS, None),
    (frozenset({"current", "amps", "ampere"}), _AMPERES, None),
    (frozenset({"pressure"}), _PRESSURE, None),
    (frozenset({"salinity", "conductivity", "turbidity", "oxygen", "chlorophyll"}), _SALT, None),
    (frozenset({"rpm"}), _TURNS, None),
    (frozenset({"orientation", "quaternion", "rotation"}), _PART_OF_ONE, None),
    (frozenset({"linear"}), _SPEED, None),
    (frozenset({"north", "east", "down"}), _PLACE, None),
)

_URGENCIES: Final[tuple[tuple[str, frozenset[str]], ...]] = (
    ("real_time", frozenset({"abort", "stop", "estop", "emergency", "halt", "kill", "surface"})),
    (
        "interactive_high",
        frozenset({"cmd", "command", "commands", "alarm", "alert", "leak", "fault", "arm"}),
    ),
    (
        "data_low",
        frozenset({"health", "status", "diagnostics", "battery", "temperature", "heartbeat"}),
    ),
    (
        "background",
        frozenset(
            {"image", "photo", "camera", "picture", "map", "log", "rosout", "debug", "cloud"}
        ),
    ),
)
USUAL: Final = "data"
"""Priority of a topic whose name says nothing."""
COMMANDING: Final = ("real_time", "interactive_high")
"""Priorities of topics that must arrive."""


def words_in(name: str) -> list[str]:
    """Return the words of a name, small."""
    return [word.lower() for word in _WORD.findall(name)]


def quantity_of(name: str, values: Iterable[float]) -> Quantity | None:
    """Return what the numbers of a name are; None: the name says nothing, or the values deny it.

    Args:
        name: Name of the field.
        values: Its observed values, at least one, all finite.
    """
    seen = list(values)
    words = words_in(name)
    quantity = _named(words, seen)
    if quantity is None or _denies(quantity, seen):
        return None
    if quantity.is_firm and not all(quantity.low <= value <= quantity.high for value in seen):
        # A course may be told from -180 to 180.
        return (
            _TILT if quantity is _COURSE and all(-180 <= value <= 180 for value in seen) else None
        )
    return quantity


def priority_of(key: str) -> str:
    """Return the Zenoh priority that the words of a key suggest."""
    words = {*words_in(key)}
    return next((priority for priority, urgent in _URGENCIES if words & urgent), USUAL)


def _named(words: list[str], seen: list[float]) -> Quantity | None:
    """Return what the words name; None: nothing that is known."""
    if {"angular", "acceleration"} <= {*words}:
        return None  # no vehicle has a usual one
    if _is_rate_of_turn(words):
        return _TURNING_DEG if _is_in_degrees(words, seen) else _TURNING
    found = next((each for each in _QUANTITIES if each[0] & {*words}), None)
    if found is None:
        rest = {*words} - _AXES
        return _PLACE if {*words} & _AXES and rest <= _PLACES else None
    _, quantity, in_radians = found
    if in_radians is not None and _is_in_radians(words, seen):
        quantity = in_radians
    if quantity is _PERCENT and all(value <= 1 for value in seen):
        return _SHARE  # ROS, for one, calls a share a percentage
    return quantity


def _denies(quantity: Quantity, seen: list[float]) -> bool:
    """Tell whether the step is coarser than the values: they would all cross as zero."""
    largest = max(map(abs, seen))
    return not quantity.wraps and 0 < largest < 2 * quantity.step


def _is_rate_of_turn(words: list[str]) -> bool:
    return bool(_TURNED & {*words} and _RATES & {*words}) or any(
        _RATES_OF_TURN.fullmatch(word) for word in words
    )


def _is_in_degrees(words: list[str], seen: list[float]) -> bool:
    if "rad" in words or "deg" in words:
        return "deg" in words
    return any(abs(value) > _TURN for value in seen)  # a vehicle does not spin that fast


def _is_in_radians(words: list[str], seen: list[float]) -> bool:
    if "rad" in words or "deg" in words:
        return "rad" in words
    # Nobody sends whole and half degrees with many digits, nor radians beyond a turn.
    is_small = all(abs(value) <= _TURN for value in seen)
    return is_small and any(abs(value * 100 - round(value * 100)) > 1e-9 for value in seen)
