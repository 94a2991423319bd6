"""MAVLink messages as the tests write them, and what an engine wants done."""

from typing import Any, Final

from zacoustic.mavlink.bridge import Engine
from zacoustic.mavlink.dialect import Message, Received
from zacoustic.mavlink.outputs import Call, Notice, Output, Publish, Reply, Send
from zacoustic.mavlink.telemetry import HIGH_LATENCY2, heartbeat

VEHICLE: Final = 7
GROUND: Final = (255, 190)
SECOND: Final = 1_000_000_000
SUBMARINE, ARDUPILOT, PX4 = 12, 3, 12
ARMED_GUIDED: Final = heartbeat(SUBMARINE, ARDUPILOT, base_mode=217, custom_mode=4)
STATION: Final = heartbeat(6, 8)


def report(**changed: int) -> Message:
    """A HIGH_LATENCY2 with a number in each field."""
    fields = {
        "timestamp": 61_000, "type": SUBMARINE, "autopilot": ARDUPILOT, "custom_mode": 4,
        "latitude": -378_123_450, "longitude": 1_449_631_230, "altitude": -21,
        "target_altitude": -20, "heading": 45, "target_heading": 179, "target_distance": 12,
        "throttle": 33, "airspeed": 1, "airspeed_sp": 2, "groundspeed": 6, "windspeed": 3,
        "wind_heading": 4, "eph": 7, "epv": 8, "temperature_air": -3, "climb_rate": -2,
        "battery": 87, "wp_num": 5, "failure_flags": 0x1000, "custom0": -39, "custom1": 1,
        "custom2": 2,
    }  # fmt: skip
    return Message(HIGH_LATENCY2, {**fields, **changed})


def of_vehicle(message: Message, *, component: int = 1, system: int = VEHICLE) -> Received:
    return Received(message=message, system=system, component=component)


def of_ground(message: Message) -> Received:
    return Received(message=message, system=GROUND[0], component=GROUND[1])


def command_long(command: int, *parameters: float, confirmation: int = 0) -> Message:
    padded = [*parameters, *[0.0] * (7 - len(parameters))]
    fields = {f"param{place}": each for place, each in enumerate(padded, start=1)}
    head = {"target_system": VEHICLE, "target_component": 1, "command": command}
    return Message("COMMAND_LONG", {**head, "confirmation": confirmation, **fields})


def command_int(command: int, *parameters: float, frame: int = 6) -> Message:
    params = {f"param{place}": each for place, each in enumerate(parameters[:4], start=1)}
    north, east, up = parameters[4:]
    head = {"target_system": VEHICLE, "target_component": 1, "command": command, "frame": frame}
    head |= {"current": 0, "autocontinue": 0}
    return Message("COMMAND_INT", {**head, **params, "x": north, "y": east, "z": up})


def ack(command: int, result: int) -> Message:
    return Message("COMMAND_ACK", {"command": command, "result": result, "target_system": 0})


class Done:
    """What an engine wanted done since the last time.

    Args:
        engine: The engine.
    """

    def __init__(self, engine: Engine) -> None:
        self.outputs: list[Output] = []
        while (output := engine.poll()) is not None:
            self.outputs.append(output)

    @property
    def sent(self) -> list[Message]:
        return [each.message for each in self.outputs if isinstance(each, Send)]

    def named(self, name: str) -> list[dict[str, Any]]:
        """Return the fields of the sent messages of a name."""
        return [each.fields for each in self.sent if each.name == name]

    @property
    def acks(self) -> list[tuple[int, int]]:
        return [(each["command"], each["result"]) for each in self.named("COMMAND_ACK")]

    @property
    def calls(self) -> list[Call]:
        return [each for each in self.outputs if isinstance(each, Call)]

    @property
    def replies(self) -> list[tuple[int, str, str]]:
        found = [each for each in self.outputs if isinstance(each, Reply)]
        return [(each.number, each.answer.result, each.answer.text) for each in found]

    @property
    def published(self) -> list[Publish]:
        return [each for each in self.outputs if isinstance(each, Publish)]

    @property
    def events(self) -> list[str]:
        return [each.event for each in self.outputs if isinstance(each, Notice)]


def run_until(engine: Engine, now: int, end: int) -> int:
    """Let the timers fire that are due until an instant; returns it."""
    while (due := engine.poll_timeout()) is not None and due <= end:
        assert due >= 0
        now = max(now, due)
        engine.handle_timeout(now)
    return end
