"""The vehicle of the demo: an ordinary Zenoh program that knows nothing of sound.

It publishes its position (CBOR) and its state (JSON), follows way-points, and serves `auv1/arm`. It
reports on standard output, one JSON object a line. It waits for the line ``go``, and ends when its
standard input does::

    python vehicle.py tcp/127.0.0.1:7448 30
"""

import json
import math
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import cbor2
import zenoh

PERIOD_S: Final = 4.0
"""Period of reports of navigation, s: a frame takes 0.4 s, its answer needs time to return."""
SPEED_DEG_S: Final = 2.0e-5
"""Speed of the vehicle, degrees of latitude per second: about 2 m/s."""

_told = threading.Lock()


def tell(event: str, **said: object) -> None:
    """Write a line; one at a time, since Zenoh calls back on its own threads."""
    with _told:
        print(json.dumps({"event": event, "at": time.monotonic(), **said}), flush=True)


def open_session(endpoint: str) -> zenoh.Session:
    """Open a session as a client of the router at an endpoint."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "10000")
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


class Vehicle:
    """Its position, its state and its tasks."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._goal = {"lat": 43.095, "lon": 5.95, "depth": 20.0}
        self._place = {"lat": 43.094, "lon": 5.949, "depth": 2.0}
        self._heading = 0.0
        self._armed = False
        self._count = 0

    def follow(self, sample: zenoh.Sample) -> None:
        """Take a way-point."""
        waypoint = cbor2.loads(sample.payload.to_bytes())
        tell("received", key=str(sample.key_expr), count=waypoint["count"], value=waypoint)
        self._goal = {name: waypoint[name] for name in self._goal}

    def arm(self, query: zenoh.Query) -> None:
        """Switch the thrusters on or off; refuse a request that changes nothing."""
        with query:
            wanted = cbor2.loads(query.payload.to_bytes())["armed"] if query.payload else False
            refusal = "" if wanted != self._armed else "armed already" if wanted else "not armed"
            answer = refusal or {"armed": wanted, "volts": 29.4}
            tell("served", key=str(query.key_expr), value={"armed": wanted}, answer=answer)
            if refusal:
                query.reply_err(refusal)
                return
            self._armed = wanted
            query.reply(query.key_expr, cbor2.dumps(answer), encoding="application/cbor")

    def report(self) -> None:
        """Publish status and navigation; the status first: it waits for others in its frame."""
        status = {
            "count": self._count, "battery": 87.5 - self._count, "leak": False,
            "mode": "transit" if self._armed else "idle",
        }  # fmt: skip
        self._put("fleet/auv1/status", status, json.dumps(status).encode(), "application/json")
        nav = {"count": self._count, **self._place, "heading": self._heading}
        self._put("auv1/nav", nav, cbor2.dumps(nav), "application/cbor")
        self._count += 1

    def move(self, elapsed_s: float) -> None:
        """Move towards the goal, if the thrusters are on."""
        north = self._goal["lat"] - self._place["lat"]
        east = self._goal["lon"] - self._place["lon"]
        if not self._armed or not (north or east):
            return
        part = min(1.0, SPEED_DEG_S * elapsed_s / math.hypot(north, east))
        for name, goal in self._goal.items():
            self._place[name] += part * (goal - self._place[name])
        self._heading = math.degrees(math.atan2(east, north)) % 360

    def _put(self, key: str, value: dict[str, Any], payload: bytes, encoding: str) -> None:
        tell("put", key=key, count=value["count"], value=value)
        self._session.put(key, payload, encoding=encoding)


def wait_for_end(then: Callable[[], object]) -> None:
    """Read standard input to its end."""
    sys.stdin.read()
    then()


def main(endpoint: str, duration_s: float) -> None:
    """Open a session, wait for the line `go`, report for a while, wait for the end of input."""
    with open_session(endpoint) as session:
        vehicle = Vehicle(session)
        session.declare_queryable("auv1/arm", vehicle.arm)
        session.declare_subscriber("auv1/waypoint", vehicle.follow)
        tell("ready")
        ended = threading.Event()
        if sys.stdin.readline():
            threading.Thread(target=wait_for_end, args=[ended.set], daemon=True).start()
            for _ in range(int(duration_s / PERIOD_S)):
                vehicle.report()
                if ended.wait(PERIOD_S):
                    return
                vehicle.move(PERIOD_S)
            tell("done")
            ended.wait()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
