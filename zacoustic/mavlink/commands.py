"""Commands: from the ground station's messages to requests of services, and on to the autopilot.

What crosses, and as which message of a ground station:

========  ==================================  ==================================================
service   ground station                      autopilot
========  ==================================  ==================================================
arm       COMPONENT_ARM_DISARM                the same, as COMMAND_LONG
mode      DO_SET_MODE, the message SET_MODE   DO_SET_MODE, as COMMAND_LONG
waypoint  DO_REPOSITION, a MISSION_ITEM(_INT) DO_REPOSITION, as COMMAND_INT
          with current = 2
abort     NAV_RETURN_TO_LAUNCH, NAV_LAND      the same, as COMMAND_LONG
========  ==================================  ==================================================

An abort ends what the vehicle does and brings it to where people are: "return" home, or "land",
which ArduSub executes as SURFACE. DO_FLIGHTTERMINATION is not among them: what it does cannot be
undone, differs between vehicles, and stopping the motors is there already (a forced disarm). All
other commands are refused on shore as UNSUPPORTED, which costs nothing and is true of this link.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import msgspec

from zacoustic.mavlink.dialect import AUTOPILOT, Message, Received
from zacoustic.mavlink.entries import ACTIONS, FRAMES
from zacoustic.mavlink.telemetry import ARDUPILOT, PX4, is_number

NAV_WAYPOINT: Final = 16
NAV_RETURN_TO_LAUNCH: Final = 20
NAV_LAND: Final = 21
DO_SET_MODE: Final = 176
DO_REPOSITION: Final = 192
COMPONENT_ARM_DISARM: Final = 400
SET_MESSAGE_INTERVAL: Final = 511
SET_MODE: Final = 11
"""Id of the message SET_MODE, which ArduPilot acknowledges as if it were that of a command."""

_ABORTS: Final = {NAV_RETURN_TO_LAUNCH: ACTIONS[0], NAV_LAND: ACTIONS[1]}
_FORCED: Final = (21196, 2989)
_FRAMES: Final = {0: 0, 5: 0, 3: 1, 6: 1, 10: 2, 11: 2}  # MAV_FRAME, also as …_INT
_CHANGE_MODE: Final = 1  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
_GUIDED: Final = 2  # a MISSION_ITEM that is no part of a mission
_DEGREES_E7: Final = 1e7
_LAST_MAIN_MODE: Final = 2**16 - 1

RESULT_CODES: Final = {
    "accepted": 0, "temporarily_rejected": 1, "denied": 2, "unsupported": 3, "failed": 4,
    "cancelled": 6, "command_long_only": 7, "command_int_only": 8, "unsupported_mav_frame": 9,
    "not_in_control": 10,
}  # fmt: skip
"""MAV_RESULT."""
IN_PROGRESS: Final = 5
"""MAV_RESULT_IN_PROGRESS."""
_RESULT_NAMES: Final = {code: name for name, code in RESULT_CODES.items()}
# MAV_MISSION_RESULT; everything else is MAV_MISSION_ERROR.
_MISSION_CODES: Final = {"accepted": 0, "unsupported_mav_frame": 2, "unsupported": 3, "denied": 14}
_MISSION_ERROR: Final = 1


class Answer(msgspec.Struct, frozen=True):
    """What became of a command."""

    result: str
    """One of `entries.RESULTS`."""
    text: str = ""
    """Why, in the words of who refused it."""

    @property
    def code(self) -> int:
        """MAV_RESULT of a COMMAND_ACK.

        Without an answer of the autopilot it is FAILED if the command may have been executed, and
        TEMPORARILY_REJECTED if it was certainly not.
        """
        if self.result in ("no_autopilot", "superseded", "expired"):
            return RESULT_CODES["temporarily_rejected"]
        return RESULT_CODES.get(self.result, RESULT_CODES["failed"])

    @property
    def mission_code(self) -> int:
        """MAV_MISSION_RESULT of a MISSION_ACK."""
        return _MISSION_CODES.get(self.result, _MISSION_ERROR)


def answer_of_code(code: int, text: str = "") -> Answer:
    """Return the answer for a MAV_RESULT of an autopilot; an unknown one is a failure."""
    name = _RESULT_NAMES.get(code)
    if name is None:
        return Answer("failed", text or f"MAV_RESULT {code}")
    return Answer(name, text)


class _OfGround(msgspec.Struct, frozen=True, kw_only=True):
    """What came from a ground station and is to be acknowledged."""

    command: int
    """The command's id in a COMMAND_ACK."""
    form: str
    """Message in which it came: `COMMAND_LONG`, `COMMAND_INT`, `SET_MODE`, `MISSION_ITEM`, …"""
    target: int
    """System that it is for; 0: all."""
    sender: tuple[int, int]
    """System and component of the ground station."""

    @property
    def acknowledged_as(self) -> tuple[object, ...]:
        """Equal for commands that the ground station cannot tell apart by an acknowledgement."""
        is_item = self.form.startswith("MISSION_ITEM")
        return (self.sender, "MISSION_ACK" if is_item else self.command)

    def acknowledgement(self, answer: Answer) -> Message:
        """Return the message that ends it at the ground station."""
        if not self.form.startswith("MISSION_ITEM"):
            return acknowledgement(self.command, answer.code, self.sender)
        system, component = self.sender
        return Message(
            "MISSION_ACK",
            {"target_system": system, "target_component": component, "type": answer.mission_code},
        )


class GroundCommand(_OfGround, frozen=True, kw_only=True):
    """A command of a ground station."""

    service: str
    """The service that executes it."""
    value: dict[str, Any]
    """The request, without `entries.GIVEN`."""
    confirmation: int | None
    """How often it was repeated; None: the message does not say it."""

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for repetitions of one command."""
        return (self.sender, self.form, self.command, *sorted(self.value.items()))


class Refusal(_OfGround, frozen=True, kw_only=True):
    """A message of a ground station that cannot cross."""

    answer: Answer
    """Why."""


def acknowledgement(command: int, code: int, target: tuple[int, int]) -> Message:
    """Return a COMMAND_ACK; how far the execution is, is not known."""
    return Message(
        "COMMAND_ACK",
        {
            "command": command,
            "result": code,
            "progress": 255 if code == IN_PROGRESS else 0,
            "target_system": target[0],
            "target_component": target[1],
        },
    )


def read_command(received: Received) -> GroundCommand | Refusal | None:
    """Read a message of a ground station.

    Returns:
        A command that crosses; why one cannot; None: no command, or none for an autopilot.
    """
    name, fields = received.message.name, received.message.fields
    if name not in ("COMMAND_LONG", "COMMAND_INT", "SET_MODE", "MISSION_ITEM", "MISSION_ITEM_INT"):
        return None
    if fields.get("target_component", 0) not in (0, AUTOPILOT):
        return None
    if name.startswith("MISSION_ITEM") and fields["current"] != _GUIDED:
        return None  # of a mission, which does not cross
    command = SET_MODE if name == "SET_MODE" else int(fields["command"])
    found = _request_of(name, command, fields)
    sender, target = (received.system, received.component), int(fields["target_system"])
    if isinstance(found, Answer):
        return Refusal(command=command, form=name, target=target, answer=found, sender=sender)
    service, value = found
    return GroundCommand(
        service=service,
        value=value,
        command=command,
        form=name,
        target=target,
        confirmation=int(fields["confirmation"]) if "confirmation" in fields else None,
        sender=sender,
    )


def _request_of(
    form: str, command: int, fields: dict[str, Any]
) -> tuple[str, dict[str, Any]] | Answer:
    """Return the service and the request of a command, or why there is none."""
    if command == COMPONENT_ARM_DISARM:
        return _arm(fields)
    if command in (SET_MODE, DO_SET_MODE):
        return _mode(form, fields)
    if command == DO_REPOSITION or (command == NAV_WAYPOINT and form.startswith("MISSION_ITEM")):
        return _waypoint(form, fields)
    if command in _ABORTS:
        return "abort", {"action": _ABORTS[command]}
    return Answer("unsupported", f"command {command} does not cross")


def _arm(fields: dict[str, Any]) -> tuple[str, dict[str, Any]] | Answer:
    arm, force = fields["param1"], fields["param2"]
    if arm not in (0, 1):
        return Answer("denied", f"param1 {arm:g}; allowed: 0, 1")
    is_forced = is_number(force) and round(force) in _FORCED
    if not is_forced and is_number(force) and force != 0:
        return Answer("denied", f"param2 {force:g}; allowed: 0, 21196, 2989")
    return "arm", {"arm": arm == 1, "force": is_forced}


def _mode(form: str, fields: dict[str, Any]) -> tuple[str, dict[str, Any]] | Answer:
    if form == "SET_MODE":
        modes = [fields["base_mode"], fields["custom_mode"], 0]
    else:
        modes = [fields[f"param{place}"] for place in (1, 2, 3)]
        modes = [mode if place == 0 or is_number(mode) else 0 for place, mode in enumerate(modes)]
    limits = (2**8, 2**32, 2**8)
    for place, (mode, limit) in enumerate(zip(modes, limits, strict=True), start=1):
        if not (is_number(mode) and 0 <= mode < limit and mode == int(mode)):
            return Answer("denied", f"param{place} {mode:g}; allowed: 0..{limit - 1}")
    names = ("base_mode", "custom_mode", "custom_submode")
    return "mode", dict(zip(names, map(int, modes), strict=True))


def _waypoint(form: str, fields: dict[str, Any]) -> tuple[str, dict[str, Any]] | Answer:
    if form == "COMMAND_LONG":  # has no frame: that of the definition
        frame, east, north, up = 0, fields["param6"], fields["param5"], fields["param7"]
    else:
        frame, east, north, up = fields["frame"], fields["y"], fields["x"], fields["z"]
    if form.endswith("_INT"):
        east, north = east / _DEGREES_E7, north / _DEGREES_E7
    if frame not in _FRAMES:
        return Answer("unsupported_mav_frame", f"frame {frame}; allowed: 0, 3, 5, 6, 10, 11")
    if not (is_number(north) and is_number(east) and is_number(up)):
        return Answer("denied", "latitude, longitude or altitude is missing")
    if abs(north) > 90 or abs(east) > 180:
        return Answer("denied", f"position {north:.6f}, {east:.6f} is not on the globe")
    value: dict[str, Any] = {
        "latitude": round(north, 7),
        "longitude": round(east, 7),
        "altitude": up,
        "frame": FRAMES[_FRAMES[frame]],
        "change_mode": False,
    }
    if form.startswith("MISSION_ITEM"):  # its parameters have other meanings
        return "waypoint", value
    speed, flags, radius, yaw = (fields[f"param{place}"] for place in (1, 2, 3, 4))
    value["change_mode"] = is_number(flags) and bool(int(flags) & _CHANGE_MODE)
    if is_number(speed) and speed >= 0:
        value["speed"] = speed
    if is_number(radius) and radius > 0:
        value["radius"] = radius
    if is_number(yaw):
        value["yaw"] = math.degrees(yaw)
    return "waypoint", value


def command_for_autopilot(
    service: str, value: dict[str, Any], *, system: int, autopilot: int, confirmation: int
) -> Message:
    """Return the message that gives a command to an autopilot.

    Args:
        service: One of `entries.SERVICES`.
        value: The request.
        system: System id of the autopilot.
        autopilot: Its kind, MAV_AUTOPILOT.
        confirmation: How often it was repeated, 0..255.
    """
    match service:
        case "arm":
            # ArduPilot has another number for arming by force than MAVLink.
            forced = 2989 if value["arm"] and autopilot == ARDUPILOT else 21196
            parameters = [int(value["arm"]), forced if value.get("force") else 0]
            return _long(COMPONENT_ARM_DISARM, parameters, system, confirmation)
        case "mode":
            mode, submode = value["custom_mode"], value["custom_submode"]
            if autopilot == PX4 and mode > _LAST_MAIN_MODE:  # as in SET_MODE and HEARTBEAT
                mode, submode = mode >> 16 & 0xFF, mode >> 24
            parameters = [value["base_mode"], mode, submode]
            return _long(DO_SET_MODE, parameters, system, confirmation)
        case "abort":
            (command,) = (key for key, action in _ABORTS.items() if action == value["action"])
            return _long(command, [], system, confirmation)
        case _:
            return _reposition(value, system)


def message_interval(message: int, interval_s: float, *, system: int) -> Message:
    """Return the request to an autopilot to send a message periodically."""
    return _long(SET_MESSAGE_INTERVAL, [message, interval_s * 1e6], system, 0)


def _long(command: int, parameters: Sequence[float], system: int, confirmation: int) -> Message:
    padded = [*parameters, *[0.0] * (7 - len(parameters))]
    return Message(
        "COMMAND_LONG",
        {
            "target_system": system,
            "target_component": AUTOPILOT,
            "command": command,
            "confirmation": confirmation,
            **{f"param{place}": float(each) for place, each in enumerate(padded, start=1)},
        },
    )


def _reposition(value: dict[str, Any], system: int) -> Message:
    yaw, speed = value.get("yaw"), value.get("speed")
    return Message(
        "COMMAND_INT",
        {
            "target_system": system,
            "target_component": AUTOPILOT,
            "frame": (0, 3, 10)[FRAMES.index(value["frame"])],
            "command": DO_REPOSITION,
            "current": 0,
            "autocontinue": 0,
            "param1": -1.0 if speed is None else speed,
            "param2": float(_CHANGE_MODE if value["change_mode"] else 0),
            "param3": value.get("radius") or 0.0,
            "param4": math.nan if yaw is None else math.radians(yaw),
            "x": round(value["latitude"] * _DEGREES_E7),
            "y": round(value["longitude"] * _DEGREES_E7),
            "z": value["altitude"],
        },
    )


def command_id(message: Message) -> int:
    """Return the id of the command that a message to an autopilot gives."""
    return int(message.fields["command"])
