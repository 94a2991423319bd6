"""A made-up mission: a vehicle that mows the lawn at sea, and what it reports.

Nothing is right about its hydrodynamics; what matters to a codec is that position follows from
heading, speed and current, that pressure follows from depth and conductivity from temperature, that
turns come after long legs, that an operator holds a stick still for long, that sensors are noisy at
about the step that is asked for, and that a log says the same few things. A seed gives the mission.
"""

import math
import random
from collections.abc import Iterator

from tests.telemetry.streams import Sample, vehicle_types
from zacoustic.core.values.types import TypeSpec

_TICK_S = 0.5
_DEGREE_M = 111_200.0
_LINES = (
    "INF mission: leg {leg} started",
    "INF acomms: rx {number} B snr {small} dB",
    "WRN dvl: bottom lock lost {small}.{digit} s",
    "INF nav: gps fix age {number} s",
    "INF battery: {volts} V",
    "WRN thruster {digit}: current {small}.{digit} A",
    "INF ctd: cast {leg} stored",
)


class Mission:
    """What a vehicle reports in one mission.

    Args:
        seed: Gives place, pattern, water and noise.
        duration_s: Its length, s.
    """

    def __init__(self, seed: int, duration_s: float = 3600.0) -> None:
        rng = self._rng = random.Random(f"mission {seed}")
        self.lat, self.lon = rng.uniform(-60, 60), rng.uniform(-170, 170)
        self.types: dict[str, TypeSpec] = vehicle_types(self.lat, self.lon)
        self._leg_m = rng.uniform(250, 450)
        self._track = rng.uniform(0, 360)
        self._cruise = rng.uniform(1.0, 1.6)
        self._current = rng.uniform(0, 0.25), rng.uniform(0, math.tau)
        self._depth = rng.uniform(10, 120)
        self._yoyo_m = rng.choice((0.0, 0.0, rng.uniform(3, 10)))
        self._bottom_m = self._depth + rng.uniform(20, 60)
        self._surface_c, self._deep_c = rng.uniform(14, 22), rng.uniform(6, 10)
        self._layer_m = rng.uniform(20, 60)
        self.samples: list[Sample] = sorted(self._run(duration_s), key=lambda each: each[0])

    def _run(self, duration_s: float) -> Iterator[Sample]:
        rng, noise = self._rng, self._rng.gauss
        x = y = drift_x = drift_y = rate = roll = pitch = along = 0.0
        heading, speed, depth = self._track, 0.5, self._depth / 2
        voltage, leg, side, fault, battery = rng.uniform(25, 27), 0, 1, 0, rng.uniform(60, 99)
        stick = [0.0, 0.0, 0.0]
        wanted = self._track
        for tick in range(int(duration_s / _TICK_S)):
            t = tick * _TICK_S
            along += speed * _TICK_S
            if along > self._leg_m:
                along, leg, side = 0.0, leg + 1, -side
                wanted = self._track + (0 if side > 0 else 180)
                yield t, "wp", self._waypoint(x, y)
            error = (wanted - heading + 180) % 360 - 180
            rate += _TICK_S * (max(-8.0, min(8.0, 0.35 * error)) - rate) / 2 + noise(0, 0.25)
            heading += rate * _TICK_S
            speed += _TICK_S * (self._cruise - speed) / 8 + noise(0, 0.006)
            target = self._depth + self._yoyo_m * math.sin(t / 60)
            sink = max(-0.3, min(0.3, 0.1 * (target - depth)))
            depth = max(0.0, depth + (sink + noise(0, 0.01)) * _TICK_S)
            pitch += _TICK_S * (-12 * sink - pitch) / 3 + noise(0, 0.25)
            roll += _TICK_S * (0.4 * rate - roll) / 2 + noise(0, 0.3)
            course = math.radians(heading)
            x += (
                speed * math.sin(course) + self._current[0] * math.sin(self._current[1])
            ) * _TICK_S
            y += (
                speed * math.cos(course) + self._current[0] * math.cos(self._current[1])
            ) * _TICK_S
            drift_x += -drift_x * _TICK_S / 600 + noise(0, 0.04)
            drift_y += -drift_y * _TICK_S / 600 + noise(0, 0.04)
            altitude = self._bottom_m + 2 * math.sin(x / 60) + math.sin(y / 35) - depth
            angles = heading, pitch, roll
            if tick % 10 == 0:
                yield (
                    t,
                    "nav",
                    self._nav(x + drift_x, y + drift_y, depth, angles, speed, altitude, rate),
                )
            if tick % 10 == 5:
                yield t, "pose", self._pose(x, y, depth, angles)
            if tick % 4 == 1:
                yield t, "ctd", self._ctd(depth)
            if tick % 2 == 0:
                if rng.random() < 0.03:
                    stick[rng.randrange(3)] = rng.randint(-20, 20) / 20
                yield t, "cmd", dict(zip(("surge", "yaw", "heave"), stick, strict=True))
            if tick % 20 == 3:
                battery -= 0.03
                if rng.random() < 0.01:
                    fault ^= 1 << rng.randrange(16)
                value = {"mode": 2, "battery": int(battery), "voltage": voltage + noise(0, 0.05)}
                value |= {f"leak{n}": False for n in range(4)} | {"leg": leg, "fault": fault}
                yield t, "status", value
            if tick % 20 == 11:
                yield t, "usbl", self._usbl(x, y, depth)
            if rng.random() < 0.02:
                yield t, "log", {"text": self._line(leg, voltage)}
            voltage -= 0.0001

    def _place(self, x: float, y: float) -> dict[str, float]:
        width = _DEGREE_M * math.cos(math.radians(self.lat))
        return {"lat": self.lat + y / _DEGREE_M, "lon": self.lon + x / width}

    def _waypoint(self, x: float, y: float) -> dict[str, float]:
        way = math.radians(self._track)
        place = self._place(x + self._leg_m * math.sin(way), y + self._leg_m * math.cos(way))
        return {**place, "depth": self._depth, "speed": self._cruise}

    def _nav(
        self,
        x: float,
        y: float,
        depth: float,
        angles: tuple[float, float, float],
        speed: float,
        altitude: float,
        rate: float,
    ) -> dict[str, float]:
        noise = self._rng.gauss
        return {
            **self._place(x + noise(0, 0.05), y + noise(0, 0.05)),
            "depth": max(0.0, depth + noise(0, 0.02)),
            "heading": (angles[0] + noise(0, 0.15)) % 360,
            "pitch": angles[1] + noise(0, 0.1),
            "roll": angles[2] + noise(0, 0.1),
            "speed": speed + noise(0, 0.015),
            "altitude": max(0.0, min(200.0, altitude + noise(0, 0.08))),
            "yaw_rate": max(-20.0, min(20.0, rate + noise(0, 0.08))),
        }

    def _pose(
        self, x: float, y: float, depth: float, angles: tuple[float, float, float]
    ) -> dict[str, float]:
        noise = self._rng.gauss
        yaw, pitch, roll = (math.radians(angle + noise(0, 0.1)) / 2 for angle in angles)
        cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
        cy, sy = math.cos(yaw), math.sin(yaw)
        return {
            "x": x + noise(0, 0.05),
            "y": y + noise(0, 0.05),
            "z": -max(0.0, depth + noise(0, 0.02)),
            "qx": sr * cp * cy - cr * sp * sy,
            "qy": cr * sp * cy + sr * cp * sy,
            "qz": cr * cp * sy - sr * sp * cy,
            "qw": cr * cp * cy + sr * sp * sy,
        }

    def _ctd(self, depth: float) -> dict[str, float]:
        noise = self._rng.gauss
        share = 1 / (1 + math.exp((depth - self._layer_m) / 12))
        temperature = self._deep_c + (self._surface_c - self._deep_c) * share
        return {
            "temperature": temperature + noise(0, 0.0005),
            "conductivity": 28 + 0.95 * temperature + 0.0005 * depth + noise(0, 0.0006),
            "pressure": max(0.0, depth * 1.01 + noise(0, 0.008)),
        }

    def _usbl(self, x: float, y: float, depth: float) -> dict[str, float]:
        noise, distance = self._rng.gauss, math.hypot(x, y)
        return {
            "range": min(3000.0, math.hypot(distance, depth) + abs(noise(0, 0.15))),
            "bearing": (math.degrees(math.atan2(x, y)) + noise(0, 0.4)) % 360,
            "elevation": -math.degrees(math.atan2(depth, distance + 1)) + noise(0, 0.4),
            "sigma": min(10.0, 0.8 + abs(noise(0, 0.2))),
        }

    def _line(self, leg: int, voltage: float) -> str:
        rng = self._rng
        line = _LINES[min(int(rng.expovariate(0.6)), len(_LINES) - 1)]
        numbers = {"number": rng.randint(8, 60), "small": rng.randint(1, 19)}
        return line.format(leg=leg, digit=rng.randrange(10), volts=f"{voltage:.1f}", **numbers)
