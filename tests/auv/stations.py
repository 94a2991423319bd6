"""A station whose clock stands still, and documents of a gateway to show it."""

from typing import Any

import msgspec

from examples.auv.controlstation import ControlStation
from examples.auv.messages import (
    GOTO,
    Mode,
    Nav,
    Waypoint,
)
from examples.auv.shore import Answer, Carrier, Shore

UNIX_S = 1.8e9


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def unix_s(self) -> float:
        return UNIX_S + self.now_s


class Recorder(Carrier):
    """Keeps what is ordered."""

    def __init__(self) -> None:
        self.said: list[tuple[str, msgspec.Struct]] = []
        self.answers: list[Answer] = []

    def put(self, topic: str, value: msgspec.Struct) -> None:
        self.said.append((topic, value))

    def call(self, service: str, value: msgspec.Struct) -> Answer:
        self.said.append((service, value))
        self.answers.append(Answer())
        return self.answers[-1]

    def send_goal(self, waypoint: Waypoint) -> Answer:
        return self.call(GOTO, waypoint)


def station_at(clock: Clock) -> tuple[ControlStation, Recorder]:
    station, carrier = ControlStation(Shore(), clock, clock.unix_s), Recorder()
    station.carrier = carrier
    return station, carrier


def nav(east: float = 30.0, mode: Mode = Mode.GOTO) -> Nav:
    return Nav(
        north=10.0, east=east, depth=12.34, heading=90.0, pitch=-3.0, roll=1.0, speed=1.5,
        turn=0.0, sigma=0.5, mode=mode,
    )  # fmt: skip


def streams(topic: str, **counts: int) -> dict[str, Any]:
    """Return the gateway's document about one reliable topic."""
    nothing = dict.fromkeys(
        ("published", "waiting", "delivering", "delivered", "superseded", "expired", "refused",
         "cancelled"), 0)  # fmt: skip
    return {"streams": [{"name": topic, **nothing, **counts}]}


LINK: dict[str, Any] = {
    "state": "up", "airtime_s": 0.0, "frames_transmitted": 3, "frames_received": 9,
    "capabilities": {"mtu_bytes": 64, "bit_rate_bps": 640.0, "preamble_s": 0.2,
                     "propagation_s": 1.5},
}  # fmt: skip


def frame(way: str, begun_s: float, *names: str, outcome: str = "") -> dict[str, Any]:
    return {"way": way, "peer": 2, "bytes": 12, "streams": list(names), "outcome": outcome,
            "begun_unix_s": UNIX_S + begun_s, "airtime_s": 0.4}  # fmt: skip


def topics(carrier: Recorder) -> list[str]:
    return [topic for topic, _ in carrier.said]
