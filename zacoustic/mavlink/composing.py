"""HIGH_LATENCY2 out of other messages, for an autopilot that does not send it.

Small boards are built without it. The bridge then asks for a few of the messages that every
autopilot has, and composes. Only messages of the last interval count; without a position, or
without speeds, there is no HIGH_LATENCY2. What nobody knows has the value with which PX4 says so.
"""

from collections.abc import Mapping
from typing import Any, Final

from zacoustic.mavlink.dialect import Message
from zacoustic.mavlink.telemetry import ARDUPILOT, HIGH_LATENCY2, PX4

SOURCES: Final[Mapping[str, int]] = {
    "GLOBAL_POSITION_INT": 33, "VFR_HUD": 74, "SYS_STATUS": 1, "MISSION_CURRENT": 42,
    "NAV_CONTROLLER_OUTPUT": 62,
}  # fmt: skip
"""Messages that are used, with their ids."""

# MAV_SYS_STATUS_SENSOR and the HL_FAILURE_FLAG of the same thing.
_FLAGS: Final = {
    0x20: 1, 0x10: 2, 0x08: 4, 0x02: 8, 0x01: 16, 0x04: 32, 0x400000: 64, 0x2000000: 128,
    0x10000: 256, 0x100000: 2048,
}  # fmt: skip
_NO_HEADING: Final = 65535
_UNKNOWN: Final = {"eph": 255, "epv": 255, "temperature_air": -128, "wp_num": 65535, "battery": -1}


class Composer:
    """Keeps the last message of each kind.

    Args:
        window_ns: How old a message may be, ns.
    """

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._last: dict[str, tuple[int, dict[str, Any]]] = {}

    def take(self, message: Message, now: int) -> None:
        """Note a message; those of other kinds are ignored."""
        if message.name in SOURCES:
            self._last[message.name] = (now, message.fields)

    def compose(self, heartbeat: Message, now: int) -> Message | None:
        """Return the HIGH_LATENCY2 of this instant; None: too little is known.

        Args:
            heartbeat: The latest HEARTBEAT.
            now: The instant.
        """
        known = {
            name: each for name, (at, each) in self._last.items() if now - at < self._window_ns
        }
        if "GLOBAL_POSITION_INT" not in known or "VFR_HUD" not in known:
            return None
        position, hud = known["GLOBAL_POSITION_INT"], known["VFR_HUD"]
        altitude_m = position["alt"] / 1000
        has_heading = position["hdg"] != _NO_HEADING
        heading = position["hdg"] / 100 if has_heading else hud["heading"]
        fields = {
            **_modes(heartbeat.fields),
            **_UNKNOWN,
            "timestamp": position["time_boot_ms"],
            "latitude": position["lat"],
            "longitude": position["lon"],
            "altitude": _within(altitude_m, -32768, 32767),
            "heading": _direction(heading),
            "throttle": _within(hud["throttle"], 0, 100),
            "airspeed": _within(hud["airspeed"] * 5, 0, 255),
            "airspeed_sp": 0,
            "groundspeed": _within(hud["groundspeed"] * 5, 0, 255),
            "windspeed": 0,
            "wind_heading": 0,
            "climb_rate": _within(hud["climb"] * 10, -128, 127),
            "failure_flags": 0,
            "custom1": 0,
            "custom2": 0,
            **_target(known.get("NAV_CONTROLLER_OUTPUT"), altitude_m, heading),
        }
        if "MISSION_CURRENT" in known:
            fields["wp_num"] = known["MISSION_CURRENT"]["seq"]
        if "SYS_STATUS" in known:
            fields |= _status(known["SYS_STATUS"])
        return Message(HIGH_LATENCY2, fields)


def _modes(heartbeat: dict[str, Any]) -> dict[str, int]:
    autopilot, mode, base_mode = (
        heartbeat[name] for name in ("autopilot", "custom_mode", "base_mode")
    )
    return {
        "type": heartbeat["type"],
        "autopilot": autopilot,
        "custom_mode": (mode >> 16 if autopilot == PX4 else mode) & 0xFFFF,
        # As ArduPilot itself has it; a byte with a sign.
        "custom0": (base_mode ^ 0x80) - 0x80 if autopilot == ARDUPILOT else 0,
    }


def _target(output: dict[str, Any] | None, altitude_m: float, heading: float) -> dict[str, int]:
    """Return where it goes: without knowledge, where it is."""
    output = output or {"alt_error": 0, "target_bearing": heading, "wp_dist": 0}
    return {
        "target_altitude": _within(altitude_m + output["alt_error"], -32768, 32767),
        "target_heading": _direction(output["target_bearing"]),
        "target_distance": _within(output["wp_dist"] / 10, 0, 65535),
    }


def _status(status: dict[str, Any]) -> dict[str, int]:
    broken = status["onboard_control_sensors_enabled"] & ~status["onboard_control_sensors_health"]
    flags = sum(flag for sensor, flag in _FLAGS.items() if broken & sensor)
    return {"failure_flags": flags, "battery": status["battery_remaining"]}


def _direction(degrees: float) -> int:
    """Return a direction in units of 2°."""
    return round(degrees % 360 / 2) % 180


def _within(number: float, low: int, high: int) -> int:
    return round(min(max(number, low), high)) if number == number else 0
