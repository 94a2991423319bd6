"""The entries of the stream table that the bridges need, and how they find them in a file.

Bounds and steps are those of the MAVLink messages. The position of HIGH_LATENCY2 has a step of
1e-6° in place of 1e-7°: eleven centimetres, finer than what any vehicle under water knows, and a
byte less. A fleet may choose other bounds, steps, priorities and lifespans: the bridges use the
names of streams and fields, and nothing else of the entries.
"""

import json
from typing import Any, Final

import msgspec

from zacoustic.config import Config
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.errors import ConfigError

TELEMETRY: Final = "high_latency2"
"""Last part of the name of the topic with the vehicle's state."""
GROUND: Final = "ground"
"""Last part of the name of the topic that says that a ground station is there."""
ABORT: Final = "abort"
"""Last part of the name of the service that ends what the vehicle does."""
SERVICES: Final = ("arm", "mode", "waypoint", ABORT)
"""Last parts of the names of the services."""
TIMEOUT_S: Final = 60
"""Time-out of the services, s."""
CLOCK: Final = "clock"
"""Field of the telemetry: the time of the vehicle's bridge, ms (`vehicletime`)."""
GIVEN: Final = "given"
"""Field of a request: when it was given, ms, by that clock."""

RESULTS: Final = (
    "accepted", "temporarily_rejected", "denied", "unsupported", "failed", "cancelled",
    "command_long_only", "command_int_only", "unsupported_mav_frame", "not_in_control",
    "no_answer", "no_autopilot", "superseded", "expired",
)  # fmt: skip
"""What became of a command: results of the autopilot, and the last four in place of one."""
FRAMES: Final = ("global", "relative", "terrain")
"""What an altitude is above: the sea, home, the ground."""
ACTIONS: Final = ("return", "land")
"""What an abort does."""
TEXT_BYTES: Final = 50
"""Longest text of an answer: that of a STATUSTEXT."""

_UINT16: Final = 2**16 - 1
_UINT32: Final = 2**32 - 1


class Names(msgspec.Struct, frozen=True, kw_only=True):
    """The streams of one vehicle in a table."""

    prefix: str
    """What their names begin with, such as `auv1/mavlink`."""
    streams: dict[str, Stream]
    """By the last part of the name."""

    def of(self, name: str) -> str:
        """Return the full name of a stream."""
        return f"{self.prefix}/{name}"

    def type_of(self, name: str) -> str:
        """Return the name of the type of a topic, or of the request of a service."""
        spec = self.streams[name].type
        assert spec is not None
        return spec.name

    def answer_of(self, name: str) -> str:
        """Return the name of the type of the answer of a service."""
        spec = self.streams[name].response_type
        assert spec is not None
        return spec.name


def ground_addresses(names: Names) -> tuple[int, ...]:
    """Return the acoustic addresses of the nodes that have a ground station."""
    spec = names.streams[GROUND].spec
    return (spec.publishers or ()) if isinstance(spec, TopicSpec) else ()


def find_names(config: Config, prefix: str | None, *, source: str) -> Names:
    """Find the streams of one vehicle.

    Args:
        config: The file.
        prefix: What their names begin with; None: the only one in the file.
        source: The file, for errors.

    Raises:
        ConfigError: The file lacks them, has them for several vehicles, or they have other fields.
    """
    by_name = {stream.name: stream for stream in config.table}
    if prefix is None:
        prefix = _only_prefix([*by_name], source)
    wanted = (TELEMETRY, GROUND, *SERVICES)
    missing = [f"{prefix}/{name}" for name in wanted if f"{prefix}/{name}" not in by_name]
    if missing:
        raise ConfigError(f"{source}: no stream {', '.join(missing)}", hint=_ADD)
    names = Names(prefix=prefix, streams={name: by_name[f"{prefix}/{name}"] for name in wanted})
    for name in wanted:
        _check_fields(names, name, source)
    return names


_ADD: Final = "zacoustic mavlink streams prints the entries to add to the file"


def _only_prefix(names: list[str], source: str) -> str:
    ending = f"/{TELEMETRY}"
    found = sorted(name.removesuffix(ending) for name in names if name.endswith(ending))
    if not found:
        raise ConfigError(f"{source}: no topic …{ending}", hint=_ADD)
    if len(found) > 1:
        raise ConfigError(
            f"{source}: streams of several vehicles; allowed: --prefix with one of "
            f"{', '.join(found)}"
        )
    return found[0]


def _check_fields(names: Names, name: str, source: str) -> None:
    """Check that a stream has the fields that the bridges read and write."""
    stream = names.streams[name]
    wanted = [(stream.type, _TYPES[_TYPE_OF[name]])]
    if name in SERVICES:
        wanted.append((stream.response_type, _ANSWER))
    for spec, fields in wanted:
        there = set() if spec is None else {field.name for field in spec.fields}
        missing = [field["name"] for field in fields if field["name"] not in there]
        if spec is None or missing:
            told = ", ".join(missing) or "a type"
            raise ConfigError(f"{source}: stream {names.of(name)} lacks {told}", hint=_ADD)


def entries(
    prefix: str, *, vehicle: int, shore: int, first_id: int
) -> dict[str, list[dict[str, Any]]]:
    """Return the entries `types` and `streams` for one vehicle.

    Args:
        prefix: What the names begin with.
        vehicle: Acoustic address of the vehicle.
        shore: Acoustic address of the node with the ground station.
        first_id: First of six stream ids.
    """
    types = [{"name": name, "fields": fields} for name, fields in _TYPES.items()]
    types.append({"name": _ANSWER_NAME, "fields": _ANSWER})
    streams: list[dict[str, Any]] = [
        {
            "topic": f"{prefix}/{TELEMETRY}", "type": _TYPE_OF[TELEMETRY], "codec": "dense",
            "publishers": [vehicle], "subscribers": [shore], "stamp": "age", "lifespan_s": 60,
        },
        {
            "topic": f"{prefix}/{GROUND}", "type": _TYPE_OF[GROUND], "publishers": [shore],
            "subscribers": [vehicle], "lifespan_s": 20,
        },
    ]  # fmt: skip
    priorities = {ABORT: "real_time", "waypoint": "data_high"}
    streams += [
        {
            "service": f"{prefix}/{name}", "request": _TYPE_OF[name], "response": _ANSWER_NAME,
            "server": vehicle, "codec": "packed", "timeout_s": TIMEOUT_S,
            "priority": priorities.get(name, "interactive_high"),
        }
        for name in SERVICES
    ]  # fmt: skip
    numbered = [{"id": first_id + at, **stream} for at, stream in enumerate(streams)]
    return {"types": types, "streams": numbered}


def entries_text(made: dict[str, list[dict[str, Any]]]) -> str:
    """Return the entries as JSON5, to put into `plugins.acoustic`."""
    lines = ["// add these to plugins.acoustic of the fleet's file, the same at all nodes"]
    lines.append("types: [")
    for each in made["types"]:
        lines.append(f"  {{ name: {_written(each['name'])}, fields: [")
        lines += [f"    {_written(field)}," for field in each["fields"]]
        lines.append("  ] },")
    lines += ["],", "streams: ["]
    lines += [f"  {_written(stream)}," for stream in made["streams"]]
    lines.append("],")
    return "\n".join(lines)


def _written(value: object) -> str:
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key}: {_written(each)}' for key, each in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return json.dumps(value)


def _number(name: str, kind: str, low: float, high: float, **more: object) -> dict[str, Any]:
    return {"name": name, "type": kind, "range": [low, high], **more}


# Absent in calls of other programs, which are always executed.
_GIVEN: Final = {"name": GIVEN, "type": "uint32", "unit": "ms", "optional": True}

# Speeds are multiples of 0.2 m/s in a byte, directions of 2°.
_SPEED: Final = {"step": 0.2, "unit": "m/s"}
_DIRECTION: Final = {"step": 2, "unit": "deg", "wraps": True}

_TYPES: Final[dict[str, list[dict[str, Any]]]] = {
    "MavlinkHighLatency2": [
        _number("system", "uint8", 1, 255),
        _number("timestamp", "uint32", 0, _UINT32, step=1000, unit="ms"),
        _number("type", "uint8", 0, 255),
        _number("autopilot", "uint8", 0, 255),
        _number("base_mode", "uint8", 0, 255),
        _number("system_status", "uint8", 0, 255),
        _number("custom_mode", "uint16", 0, _UINT16),
        _number("latitude", "float64", -90, 90, step=1e-6, unit="deg", optional=True),
        _number("longitude", "float64", -180, 180, step=1e-6, unit="deg", optional=True),
        _number("altitude", "int16", -32768, 32767, unit="m"),
        _number("target_altitude", "int16", -32768, 32767, unit="m"),
        _number("heading", "float32", 0, 360, **_DIRECTION),
        _number("target_heading", "float32", 0, 360, **_DIRECTION),
        _number("target_distance", "float32", 0, 655350, step=10, unit="m"),
        _number("throttle", "uint8", 0, 255, unit="%"),
        _number("airspeed", "float32", 0, 51, **_SPEED),
        _number("airspeed_sp", "float32", 0, 51, **_SPEED),
        _number("groundspeed", "float32", 0, 51, **_SPEED),
        _number("windspeed", "float32", 0, 51, **_SPEED),
        _number("wind_heading", "float32", 0, 360, **_DIRECTION),
        _number("eph", "float32", 0, 25.5, step=0.1, unit="m"),
        _number("epv", "float32", 0, 25.5, step=0.1, unit="m"),
        _number("temperature_air", "int8", -128, 127, unit="degC"),
        _number("climb_rate", "float32", -12.8, 12.7, step=0.1, unit="m/s"),
        _number("battery", "int8", 0, 127, unit="%", optional=True),
        _number("wp_num", "uint16", 0, _UINT16),
        _number("failure_flags", "uint16", 0, _UINT16),
        _number("custom0", "int8", -128, 127),
        _number("custom1", "int8", -128, 127),
        _number("custom2", "int8", -128, 127),
        _number(CLOCK, "uint32", 0, _UINT32, step=1000, unit="ms"),
    ],
    "MavlinkGround": [],
    "MavlinkArm": [
        {"name": "arm", "type": "bool"},
        {"name": "force", "type": "bool", "default": False},
        _GIVEN,
    ],
    "MavlinkMode": [
        {"name": "base_mode", "type": "uint8", "default": 1},
        {"name": "custom_mode", "type": "uint32"},
        {"name": "custom_submode", "type": "uint8", "default": 0},
        _GIVEN,
    ],
    "MavlinkWaypoint": [
        _number("latitude", "float64", -90, 90, step=1e-7, unit="deg"),
        _number("longitude", "float64", -180, 180, step=1e-7, unit="deg"),
        _number("altitude", "float32", -12000, 12000, step=0.1, unit="m"),
        {"name": "frame", "type": "enum", "values": [*FRAMES], "default": FRAMES[0]},
        {"name": "change_mode", "type": "bool", "default": True},
        _number("speed", "float32", 0, 51, step=0.1, unit="m/s", optional=True),
        _number("yaw", "float32", -180, 180, step=1, unit="deg", wraps=True, optional=True),
        _number("radius", "float32", 0, 10000, step=1, unit="m", optional=True),
        _GIVEN,
    ],
    "MavlinkAbort": [{"name": "action", "type": "enum", "values": [*ACTIONS]}, _GIVEN],
}
"""Fields of the topics and requests."""
_TYPE_OF: Final = {
    TELEMETRY: "MavlinkHighLatency2", GROUND: "MavlinkGround", "arm": "MavlinkArm",
    "mode": "MavlinkMode", "waypoint": "MavlinkWaypoint", ABORT: "MavlinkAbort",
}  # fmt: skip

_ANSWER_NAME: Final = "MavlinkAnswer"
_ANSWER: Final[list[dict[str, Any]]] = [
    # What `lost_contact` of a gateway looks at, as in std_srvs/Trigger.
    {"name": "success", "type": "bool"},
    {"name": "result", "type": "enum", "values": [*RESULTS]},
    {"name": "text", "type": "string", "max_length": TEXT_BYTES, "optional": True},
]
