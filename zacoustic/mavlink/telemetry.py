"""HIGH_LATENCY2 as the value of a topic, and back.

The topic has the units of people (degrees, metres, m/s); MAVLink packs them into bytes by factors.
A position beyond ±90° or ±180°, and a battery of -1, mean "not known" and cross as missing.
"""

import math
from collections.abc import Iterator
from typing import Any, Final

from zacoustic.mavlink.dialect import Message

HIGH_LATENCY2: Final = "HIGH_LATENCY2"
HIGH_LATENCY2_ID: Final = 235

ARDUPILOT: Final = 3
"""MAV_AUTOPILOT_ARDUPILOTMEGA."""
ACTIVE: Final = 4
"""MAV_STATE_ACTIVE."""
PX4: Final = 12
"""MAV_AUTOPILOT_PX4."""

# What a unit of MAVLink is in units of the topic.
_FACTORS: Final = {
    "latitude": 1e-7, "longitude": 1e-7, "heading": 2, "target_heading": 2, "target_distance": 10,
    "airspeed": 0.2, "airspeed_sp": 0.2, "groundspeed": 0.2, "windspeed": 0.2, "wind_heading": 2,
    "eph": 0.1, "epv": 0.1, "climb_rate": 0.1,
}  # fmt: skip
_AS_THEY_ARE: Final = (
    "timestamp", "type", "autopilot", "custom_mode", "altitude", "target_altitude", "throttle",
    "temperature_air", "battery", "wp_num", "failure_flags", "custom0", "custom1", "custom2",
)  # fmt: skip
# A ground station must know whether the vehicle is armed, and HIGH_LATENCY2 does not say it.
_OF_THE_HEARTBEAT: Final = ("base_mode", "system_status")
_LIMITS_DEG: Final = {"latitude": 90.0, "longitude": 180.0}
_DIRECTIONS: Final = ("heading", "target_heading", "wind_heading")
_UNKNOWN_VOLTAGE: Final = 2**16 - 1
# Of SYS_STATUS; no sensor counts as present, so none as broken.
_NOT_REPORTED: Final = (
    "onboard_control_sensors_present", "onboard_control_sensors_enabled",
    "onboard_control_sensors_health", "load", "drop_rate_comm", "errors_comm", "errors_count1",
    "errors_count2", "errors_count3", "errors_count4",
)  # fmt: skip
_UNKNOWN_POSITION: Final = 2**31 - 1


def value_of(message: Message, heartbeat: Message, system: int) -> dict[str, Any]:
    """Return the value of the topic.

    Args:
        message: The HIGH_LATENCY2.
        heartbeat: The latest HEARTBEAT of the autopilot.
        system: System id of the autopilot.
    """
    fields = message.fields
    value: dict[str, Any] = {"system": system}
    value |= {name: heartbeat.fields[name] for name in _OF_THE_HEARTBEAT}
    value |= {name: fields[name] for name in _AS_THEY_ARE}
    for name, factor in _FACTORS.items():
        value[name] = round(fields[name] * factor, 7)
    for name in _DIRECTIONS:
        value[name] %= 360
    for name, limit in _LIMITS_DEG.items():
        if abs(value[name]) > limit:
            value[name] = None
    if value["battery"] < 0:
        value["battery"] = None
    return value


def message_of(value: dict[str, Any]) -> Message:
    """Return the HIGH_LATENCY2 for a value of the topic; its system id is `value["system"]`."""
    fields: dict[str, Any] = {name: value[name] for name in _AS_THEY_ARE}
    for name, factor in _FACTORS.items():
        number = value[name]
        fields[name] = _UNKNOWN_POSITION if number is None else round(number / factor)
    for name in _DIRECTIONS:
        fields[name] %= 180
    if fields["battery"] is None:
        fields["battery"] = -1
    return Message(HIGH_LATENCY2, fields)


def instruments_of(value: dict[str, Any]) -> Iterator[Message]:
    """Yield what stations read that do not know HIGH_LATENCY2; times are those of the report.

    A position that is not known is not sent. HIGH_LATENCY2 has neither the height above home nor
    the velocity: `relative_alt` is the altitude, and the ground speed is along the heading.
    """
    heading, speed = value["heading"], value["groundspeed"]
    if value["latitude"] is not None and value["longitude"] is not None:
        yield Message(
            "GLOBAL_POSITION_INT",
            {
                "time_boot_ms": value["timestamp"],
                "lat": round(value["latitude"] * 1e7),
                "lon": round(value["longitude"] * 1e7),
                "alt": round(value["altitude"] * 1000),
                "relative_alt": round(value["altitude"] * 1000),
                "vx": round(100 * speed * math.cos(math.radians(heading))),
                "vy": round(100 * speed * math.sin(math.radians(heading))),
                "vz": round(-100 * value["climb_rate"]),
                "hdg": round(heading * 100) % 36_000,
            },
        )
    yield Message(
        "VFR_HUD",
        {
            "airspeed": value["airspeed"],
            "groundspeed": speed,
            "heading": round(heading) % 360,
            "throttle": value["throttle"],
            "alt": float(value["altitude"]),
            "climb": value["climb_rate"],
        },
    )
    unknown = dict.fromkeys(_NOT_REPORTED, 0)
    battery = -1 if value["battery"] is None else value["battery"]
    measured = {"voltage_battery": _UNKNOWN_VOLTAGE, "current_battery": -1}
    yield Message("SYS_STATUS", {**unknown, **measured, "battery_remaining": battery})


def heartbeat_of(value: dict[str, Any]) -> Message:
    """Return the HEARTBEAT of the vehicle for a value of the topic.

    HIGH_LATENCY2 has 16 bits of the mode: of PX4 the upper half, of others the lower one.
    """
    shift = 16 if value["autopilot"] == PX4 else 0
    return heartbeat(
        value["type"],
        value["autopilot"],
        base_mode=value["base_mode"],
        custom_mode=value["custom_mode"] << shift,
        status=value["system_status"],
    )


def heartbeat(
    kind: int,
    autopilot: int,
    *,
    base_mode: int = 0,
    custom_mode: int = 0,
    status: int = ACTIVE,
) -> Message:
    """Return a HEARTBEAT; the arguments are its fields."""
    return Message(
        "HEARTBEAT",
        {
            "type": kind,
            "autopilot": autopilot,
            "base_mode": base_mode,
            "custom_mode": custom_mode,
            "system_status": status,
            "mavlink_version": 3,
        },
    )


def is_number(value: object) -> bool:
    """Return whether a parameter of MAVLink has a value: NaN means that it has none."""
    return isinstance(value, int | float) and math.isfinite(value)
