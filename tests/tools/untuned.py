"""Three systems of twelve topics that nobody has tuned: JSON, CBOR, and a stand-in for ROS 2.

Ten topics are published on the vehicle, and to two (``abort`` and ``cmd/mode``) it only subscribes:
the shore publishes them. The vehicle dives while it is observed, so that values vary.
"""

import json
import math
from collections.abc import Callable
from typing import Any, Final

import cbor2
import msgspec

from zacoustic.app.tools.design.first.survey import SeenTopic, Survey

Value = Any
OBSERVED_S: Final = 125.0


class Published(msgspec.Struct, frozen=True, kw_only=True):
    """A topic."""

    name: str
    """Its name; a key, or a name of ROS with a leading slash."""
    every_s: float
    """Its period, s."""
    value: Callable[[int], Value]
    """The value of the sample with a number."""
    interface: str = ""
    """Its type in ROS."""
    is_ordered: bool = False
    """The shore publishes it."""


class System(msgspec.Struct, frozen=True, kw_only=True):
    """A system."""

    name: str
    """What it is."""
    topics: tuple[Published, ...]
    """Its topics."""
    encoding: str
    """Zenoh encoding of its values that are maps."""
    write: Callable[[Value], bytes]
    """Makes a payload of a value that is a map."""

    def payload(self, value: Value) -> tuple[bytes, str]:
        """Return a payload and its encoding."""
        if isinstance(value, bytes):
            return value, "zenoh/bytes"
        if isinstance(value, str):
            return value.encode(), "text/plain"
        return self.write(value), self.encoding


def _nav(n: int) -> Value:
    return {
        "lat": 43.09 + n * 1.7e-6, "lon": 5.95 + n * 2.3e-6, "depth": 12.0 + 5 * math.sin(n / 9),
        "heading": (90 + 1.37 * n) % 360, "speed": 1.2 + 0.1 * math.sin(n), "seq": n,
    }  # fmt: skip


_PLAIN: Final = (
    Published(name="auv1/nav", every_s=1.0, value=_nav),
    Published(
        name="auv1/attitude", every_s=0.5,
        value=lambda n: {"roll": 2 * math.sin(n / 3), "pitch": -5.123 + math.cos(n / 7),
                         "yaw": (90 + 1.37 * n) % 360},
    ),
    Published(
        name="auv1/battery", every_s=2.0,
        value=lambda n: {"voltage": 25.13 - n * 0.01, "current": 3.2 + 0.1 * math.sin(n),
                         "percent": 87.5, "cells": [4.18, 4.17, 4.19, 4.18, 4.17, 4.18]},
    ),
    Published(
        name="auv1/ctd", every_s=1.0,
        value=lambda n: {"temperature": 13.456789 + 0.01 * n, "salinity": 38.123456 - 0.001 * n,
                         "pressure": 2.2345678 + 0.02 * n},
    ),
    Published(
        name="auv1/status", every_s=2.0,
        value=lambda n: {"mode": "survey", "leg": n // 8, "ok": True, "error": None},
    ),
    Published(name="auv1/altitude", every_s=1.0, value=lambda n: {"altitude": 8.0 + (n % 5) / 10}),
    Published(
        name="auv1/goal", every_s=5.0,
        value=lambda n: {"waypoint": {"north": 120.5, "east": -33.25}, "remaining": 400 - n},
    ),
    Published(name="auv1/leak", every_s=5.0, value=lambda n: {"leak": False, "sensor": 2}),
    Published(name="auv1/heartbeat", every_s=1.0, value=lambda n: {"count": n}),
    Published(name="auv1/image", every_s=60.0, value=lambda n: bytes([(7 * n) % 256]) * 150),
    Published(name="auv1/abort", every_s=30.0, value=lambda n: b"\x01", is_ordered=True),
    Published(name="auv1/cmd/mode", every_s=20.0, value=lambda n: b"survey", is_ordered=True),
)  # fmt: skip


def _header(n: int) -> Value:
    return {"stamp": {"sec": 1_700_000_000 + n, "nanosec": 5}, "frame_id": "base_link"}


def _vector(x: float, y: float, z: float) -> Value:
    return {"x": x, "y": y, "z": z}


_ROS: Final = (
    Published(
        name="/auv1/fix", every_s=1.0, interface="sensor_msgs/msg/NavSatFix",
        value=lambda n: {"header": _header(n), "latitude": 43.09 + n * 1.7e-6,
                         "longitude": 5.95 + n * 2.3e-6, "altitude": -12.0 - n * 0.1},
    ),
    Published(
        name="/auv1/odom", every_s=0.5, interface="nav_msgs/msg/Odometry",
        value=lambda n: {
            "header": _header(n), "child_frame_id": "auv1",
            "pose": {"pose": {"position": _vector(1.234567 * n, 3 + math.sin(n), -12.3),
                              "orientation": {**_vector(0.0, 0.0, math.sin(n / 9)), "w": 0.9}}},
            "twist": {"twist": {"linear": _vector(1.2 + 0.1 * math.sin(n), 0.0, 0.05)}},
        },
    ),
    Published(
        name="/auv1/battery", every_s=2.0, interface="sensor_msgs/msg/BatteryState",
        value=lambda n: {"header": _header(n), "voltage": 25.0 - 0.01 * n, "percentage": 0.87},
    ),
    Published(
        name="/auv1/temperature", every_s=1.0, interface="sensor_msgs/msg/Temperature",
        value=lambda n: {"header": _header(n), "temperature": 13.4 + 0.01 * n},
    ),
    Published(
        name="/auv1/pressure", every_s=1.0, interface="sensor_msgs/msg/FluidPressure",
        value=lambda n: {"header": _header(n), "fluid_pressure": 223_456.7 + 10 * n},
    ),
    Published(
        name="/auv1/depth", every_s=0.5, interface="std_msgs/msg/Float64",
        value=lambda n: {"data": 12.0 + 5 * math.sin(n / 9)},
    ),
    Published(
        name="/auv1/altitude", every_s=0.5, interface="sensor_msgs/msg/Range",
        value=lambda n: {"header": _header(n), "range": 8.0 + 0.1 * (n % 5), "max_range": 100.0},
    ),
    Published(
        name="/auv1/state", every_s=2.0, interface="std_msgs/msg/String",
        value=lambda n: {"data": "survey"},
    ),
    Published(
        name="/auv1/leak", every_s=5.0, interface="std_msgs/msg/Bool",
        value=lambda n: {"data": False},
    ),
    Published(
        name="/auv1/leg", every_s=2.0, interface="std_msgs/msg/Int32",
        value=lambda n: {"data": n // 8},
    ),
    Published(
        name="/auv1/abort", every_s=30.0, interface="std_msgs/msg/Bool",
        value=lambda n: {"data": True}, is_ordered=True,
    ),
    Published(
        name="/auv1/cmd_vel", every_s=20.0, interface="geometry_msgs/msg/Twist",
        value=lambda n: {"linear": _vector(1.0, 0.0, 0.0)}, is_ordered=True,
    ),
)  # fmt: skip

SYSTEMS: Final = (
    System(
        name="json",
        topics=_PLAIN,
        encoding="application/json",
        write=lambda value: json.dumps(value).encode(),
    ),
    System(name="cbor", topics=_PLAIN, encoding="application/cbor", write=cbor2.dumps),
)
"""The systems without ROS."""
ROS: Final = System(name="ros", topics=_ROS, encoding="application/cdr", write=cbor2.dumps)
"""The stand-in for ROS 2; its payloads are those of `tests.gateway.rosnode`."""


def survey_of(system: System) -> Survey:
    """Return what listening to the system for a while observes."""
    seen = []
    for number, topic in enumerate(system.topics):
        if topic.is_ordered:
            continue
        count = max(1, int(OBSERVED_S / topic.every_s))
        written = [system.payload(topic.value(n)) for n in range(count)]
        payloads = tuple(payload for payload, _ in written)
        seen.append(
            SeenTopic(
                key=topic.name,
                samples=count,
                rate_hz=count / OBSERVED_S,
                encoding=written[0][1],
                smallest_bytes=min(map(len, payloads)),
                largest_bytes=max(map(len, payloads)),
                payloads=payloads,
                period_s=topic.every_s,
                last_s=0.37 * number,
            )
        )
    return Survey(
        endpoint="tcp/127.0.0.1:7447",
        listened_s=OBSERVED_S,
        topics=tuple(seen),
        services=(),
        tells_services=True,
        subscribed=tuple(topic.name for topic in system.topics if topic.is_ordered),
    )
