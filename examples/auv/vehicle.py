"""The vehicle as a Zenoh client; it knows nothing of sound.

Zenoh calls on threads of its own: they put what came into a queue, and one thread does everything.
It advances the `Craft` ten times a second, reports, and answers. On standard output it tells what
happens, one JSON object in a line; it ends when its standard input does::

    python -m examples.auv.vehicle tcp/127.0.0.1:7448
"""

import json
import queue
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import msgspec
import zenoh

from examples.auv.craft import Craft
from examples.auv.messages import (
    ARM,
    GOTO,
    HOLD,
    JOINTS,
    NAV,
    PHOTO,
    STATUS,
    STOP,
    TAKE_PHOTO,
    Arm,
    Done,
    Hold,
    Setpoint,
    Waypoint,
)
from examples.auv.session import CBOR, from_cbor, open_session, to_cbor
from examples.auv.start import NAV_PERIOD_S, START, STATUS_PERIOD_S

TICK_S: Final = 0.1
PROGRESS_PERIOD_S: Final = 15.0
_SHORE_LOST: Final = "@acoustic/2/peer/1/lost"
_SHORTEST_PAUSE_S: Final = 0.001

Act = Callable[[], None]


def tell(event: str, **said: object) -> None:
    """Write a line."""
    print(json.dumps({"event": event, **said}), flush=True)


class Vehicle:
    """Carries words between a craft and Zenoh.

    Args:
        session: Zenoh's.
        craft: The vehicle.
    """

    def __init__(self, session: zenoh.Session, craft: Craft) -> None:
        self._session = session
        self._craft = craft
        self._acts: queue.SimpleQueue[Act | None] = queue.SimpleQueue()
        self._goal_id: Any = None
        self._ended: dict[Any, dict[str, Any]] = {}
        self._waiting: dict[Any, list[zenoh.Query]] = {}
        for topic in (STOP, *JOINTS, _SHORE_LOST):
            session.declare_subscriber(topic, self._later(self._hear))
        for service in (ARM, HOLD, TAKE_PHOTO):
            session.declare_queryable(service, self._later(self._serve))
        session.declare_queryable(f"{GOTO}/_action/*", self._later(self._pursue))

    def run(self) -> None:
        """Live until `end`."""
        begun = time.monotonic()
        due = {self._report: 1.0, self._status: 2.0, self._progress: PROGRESS_PERIOD_S}
        periods = {
            self._report: NAV_PERIOD_S,
            self._status: STATUS_PERIOD_S,
            self._progress: PROGRESS_PERIOD_S,
        }
        while True:
            now_s = time.monotonic() - begun
            self._craft.advance(now_s)
            while (ended := self._craft.poll_goal()) is not None:
                status = "succeeded" if ended.reached else "aborted"
                place = self._craft.motion
                tell("goal", status=status, text=ended.text, north_m=place.north_m,
                     east_m=place.east_m, depth_m=place.depth_m)  # fmt: skip
                self._finish(status, ended.result, ended.text)
            for act, at_s in due.items():
                if now_s >= at_s:
                    due[act] = at_s + periods[act]
                    act()
            try:
                wanted = self._acts.get(timeout=max(_SHORTEST_PAUSE_S, TICK_S))
            except queue.Empty:
                continue
            if wanted is None:
                return
            self._craft.advance(time.monotonic() - begun)
            wanted()

    def end(self) -> None:
        """Let `run` return; from any thread."""
        self._acts.put(None)

    def _later(self, act: Callable[[Any], None]) -> Callable[[Any], None]:
        return lambda given: self._acts.put(lambda: act(given))

    def _hear(self, sample: zenoh.Sample) -> None:
        topic = str(sample.key_expr)
        if topic == _SHORE_LOST:
            lost = json.loads(sample.payload.to_string())["lost"]
            (self._craft.shore_lost if lost else self._craft.shore_found)()
            tell("shore", lost=lost)
        elif topic == STOP:
            self._craft.stop()
            tell("stopped")
        else:
            value = msgspec.convert(from_cbor(sample.payload), Setpoint).data
            self._craft.set_joint(topic, value)
            tell("set-point", topic=topic, value=value)

    def _serve(self, query: zenoh.Query) -> None:
        with query:
            key, request = str(query.key_expr), from_cbor(query.payload)
            picture = b""
            if key == ARM:
                done = self._craft.arm(msgspec.convert(request, Arm).armed)
            elif key == HOLD:
                done = self._craft.hold(msgspec.convert(request, Hold))
            else:
                picture, done = self._craft.take_photo(), Done(True)
            tell("served", service=key, accepted=done.accepted, reason=done.reason)
            query.reply(key, to_cbor(done), encoding=CBOR)
        if picture:
            self._session.put(PHOTO, picture)

    def _pursue(self, query: zenoh.Query) -> None:
        """One of the three questions of an action."""
        asked = from_cbor(query.payload)
        goal_id = asked["goal_id"]
        match str(query.key_expr).rpartition("/")[2]:
            case "send_goal":
                refusal = self._craft.goto(msgspec.convert(asked["goal"], Waypoint))
                if not refusal:
                    # What was pursued before has been given up by that.
                    while (given_up := self._craft.poll_goal()) is not None:
                        self._finish("aborted", given_up.result, given_up.text)
                    self._goal_id = goal_id
                self._reply(query, {"accepted": not refusal, "text": refusal})
            case "cancel_goal":
                is_mine = goal_id == self._goal_id
                if is_mine:
                    self._craft.cancel_goto()
                    while (given_up := self._craft.poll_goal()) is not None:
                        self._finish("canceled", given_up.result, given_up.text)
                self._reply(query, {"accepted": is_mine, "text": ""})
            case "get_result":
                if goal_id in self._ended:
                    self._reply(query, self._ended[goal_id])
                else:
                    self._waiting.setdefault(goal_id, []).append(query)
            case other:
                with query:
                    query.reply_err(f"{other} is not asked here")

    def _finish(self, status: str, result: object, text: str) -> None:
        goal_id, self._goal_id = self._goal_id, None
        if goal_id is None:
            return
        answer = {"status": status, "result": msgspec.to_builtins(result), "text": text}
        self._ended = {**self._ended, goal_id: answer}
        for query in self._waiting.pop(goal_id, []):
            self._reply(query, answer)

    def _reply(self, query: zenoh.Query, answer: object) -> None:
        with query:
            query.reply(query.key_expr, to_cbor(answer), encoding=CBOR)

    def _report(self) -> None:
        nav = self._craft.nav()
        self._session.put(NAV, to_cbor(nav), encoding=CBOR)
        place = self._craft.motion
        tell("place", north_m=place.north_m, east_m=place.east_m, depth_m=place.depth_m,
             mode=nav.mode.value)  # fmt: skip

    def _status(self) -> None:
        self._session.put(STATUS, to_cbor(self._craft.status()), encoding=CBOR)

    def _progress(self) -> None:
        progress = self._craft.progress
        if progress is not None and self._goal_id is not None:
            said = {"goal_id": self._goal_id, "feedback": msgspec.to_builtins(progress)}
            self._session.put(f"{GOTO}/_action/feedback", to_cbor(said), encoding=CBOR)


def main(endpoint: str) -> None:
    """Open a session, live, and end with the input."""
    with open_session(endpoint) as session:
        vehicle = Vehicle(session, Craft(START))

        def wait_for_end() -> None:
            sys.stdin.read()
            vehicle.end()

        threading.Thread(target=wait_for_end, daemon=True).start()
        tell("ready")
        vehicle.run()


if __name__ == "__main__":
    main(sys.argv[1])
