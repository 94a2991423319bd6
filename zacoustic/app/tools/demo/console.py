"""The console of the demo, on the shore: an ordinary Zenoh program that knows nothing of sound.

It listens to the vehicle, and after each report of navigation except the first it performs its next
task: it arms the vehicle, sends way-points, and arms it once more, which the vehicle refuses. It
sends right after it has heard the vehicle, as an operator does; if both modems transmitted at once,
both frames would be lost. It reports on standard output, one JSON object a line. It waits for the
line ``go``, and ends when its standard input does::

    python console.py tcp/127.0.0.1:7447
"""

import json
import queue
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import cbor2
import zenoh

CALL_LIMIT_S: Final = 30.0
"""How long to wait for an answer, s: Zenoh's own 10 s are short for sound."""
WAYPOINTS: Final = ((43.0955, 5.9510, 25.0), (43.0962, 5.9523, 40.0))
"""Latitude and longitude, degrees, and depth, m."""

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


class Console:
    """Listens, and performs one task after another."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._calls = 0
        self.heard: queue.SimpleQueue[int | None] = queue.SimpleQueue()
        """Counters of the reports of navigation; None at the end of input."""
        self.plan: list[Callable[[], None]] = [
            lambda: self.arm(True),
            lambda: self.send(0),
            lambda: self.send(1),
            lambda: self.arm(True),
        ]
        """Tasks, one for each report."""

    def hear_nav(self, sample: zenoh.Sample) -> None:
        """Take a report of navigation."""
        nav = cbor2.loads(sample.payload.to_bytes())
        tell("received", key=str(sample.key_expr), count=nav["count"], value=nav)
        self.heard.put(nav["count"])

    def hear_status(self, sample: zenoh.Sample) -> None:
        """Take a status."""
        status: dict[str, Any] = json.loads(sample.payload.to_string())
        tell("received", key=str(sample.key_expr), count=status["count"], value=status)

    def send(self, index: int) -> None:
        """Send a way-point."""
        lat, lon, depth = WAYPOINTS[index]
        waypoint = {"count": index, "lat": lat, "lon": lon, "depth": depth}
        tell("put", key="auv1/waypoint", count=index, value=waypoint)
        self._session.put("auv1/waypoint", cbor2.dumps(waypoint), encoding="application/cbor")

    def arm(self, armed: bool) -> None:
        """Call the service, and wait for the answer."""
        request = {"armed": armed}
        number, self._calls = self._calls, self._calls + 1
        tell("call", key="auv1/arm", count=number, value=request)
        answers = self._session.get(
            "auv1/arm", payload=cbor2.dumps(request), encoding="application/cbor",
            timeout=CALL_LIMIT_S,
        )  # fmt: skip
        for answer in answers:
            if answer.ok is not None:
                value = cbor2.loads(answer.ok.payload.to_bytes())
                tell("answer", key="auv1/arm", count=number, value=value)
            elif answer.err is not None:
                text = answer.err.payload.to_string()
                tell("refusal", key="auv1/arm", count=number, value=text)

    def wait_for_end(self) -> None:
        """Read standard input to its end."""
        sys.stdin.read()
        self.heard.put(None)


def main(endpoint: str) -> None:
    """Open a session, wait for the line `go`, run the plan, wait for the end of input."""
    with open_session(endpoint) as session:
        console = Console(session)
        session.declare_subscriber("auv1/nav", console.hear_nav)
        session.declare_subscriber("fleet/*/status", console.hear_status)
        tell("ready")
        if not sys.stdin.readline():
            return
        threading.Thread(target=console.wait_for_end, daemon=True).start()
        while (count := console.heard.get()) is not None:
            if count > 0 and console.plan:
                console.plan.pop(0)()
                if not console.plan:
                    tell("done")


if __name__ == "__main__":
    main(sys.argv[1])
