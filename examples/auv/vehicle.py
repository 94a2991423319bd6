"""The vehicle as a Zenoh client, or as a node of ROS 2 on rmw_zenoh; it knows nothing of sound.

Zenoh calls on its own threads: they fill a queue, and one thread does everything.
It advances the `Craft` ten times a second, reports, and answers. On standard output it tells what
happens, one JSON object in a line; it ends when its standard input does::

    python -m examples.auv.vehicle tcp/127.0.0.1:7448
    python -m examples.auv.vehicle tcp/127.0.0.1:7448 --ros
"""

import argparse
import json
import queue
import sys
import threading
import time
from functools import partial
from typing import Final

import msgspec
import zenoh

from examples.auv.craft import Craft
from examples.auv.messages import GOTO, NAV, PHOTO, STATUS, STOP, Waypoint
from examples.auv.orders import SERVICES, TOPICS, execute, serve
from examples.auv.session import open_session
from examples.auv.speech import Act, Later, Question, Said, Speech, ZenohSpeech, said_of
from examples.auv.start import NAV_PERIOD_S, PLACE_PERIOD_S, START, STATUS_PERIOD_S, VEHICLE

TICK_S: Final = 0.1
PROGRESS_PERIOD_S: Final = 15.0
_SHORE_LOST: Final = "@acoustic/2/peer/1/lost"
_SHORTEST_PAUSE_S: Final = 0.001


def tell(event: str, **said: object) -> None:
    """Write a line."""
    print(json.dumps({"event": event, **said}), flush=True)


class Vehicle:
    """Carries messages between a craft and its network.

    Args:
        session: Zenoh's.
        craft: The vehicle.
        ros: Speak as a node of ROS 2.
    """

    def __init__(self, session: zenoh.Session, craft: Craft, *, ros: bool = False) -> None:
        self._craft = craft
        self._acts: queue.SimpleQueue[Act | None] = queue.SimpleQueue()
        self._goal_id: object = None
        self._ended: dict[object, Said] = {}
        self._waiting: dict[object, list[Question]] = {}
        self._speech = _speech(session, self._acts.put, ros=ros)
        for topic in TOPICS:
            self._speech.subscribe(topic, partial(self._hear, topic))
        for service in SERVICES:
            self._speech.serve(service, partial(self._serve, service))
        for part in ("send_goal", "cancel_goal", "get_result"):
            self._speech.serve(f"{GOTO}/_action/{part}", partial(self._pursue, part))
        session.declare_subscriber(_SHORE_LOST, self._hear_lost)

    def run(self) -> None:
        """Live until `end`."""
        begun = time.monotonic()
        due = {
            self._tell_place: PLACE_PERIOD_S,
            self._report: 1.0,
            self._status: 2.0,
            self._progress: PROGRESS_PERIOD_S,
        }
        periods = {
            self._tell_place: PLACE_PERIOD_S,
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

    def _hear_lost(self, sample: zenoh.Sample) -> None:
        lost = json.loads(sample.payload.to_string())["lost"]

        def act() -> None:
            (self._craft.shore_lost if lost else self._craft.shore_found)()
            tell("shore", lost=lost)

        self._acts.put(act)

    def _hear(self, topic: str, said: Said) -> None:
        execute(self._craft, topic, said)
        if topic == STOP:
            tell("stopped")
        else:
            tell("set-point", topic=topic, value=said["data"])

    def _serve(self, service: str, question: Question) -> None:
        done, picture = serve(self._craft, service, question.asked)
        tell("served", service=service, accepted=done.accepted, reason=done.reason)
        question.answer(said_of(done))
        if picture:
            self._speech.publish(PHOTO, picture)

    def _pursue(self, part: str, question: Question) -> None:
        """One of the three questions of an action."""
        goal_id = question.asked["goal_id"]
        match part:
            case "send_goal":
                refusal = self._craft.goto(msgspec.convert(question.asked["goal"], Waypoint))
                if not refusal:
                    # What was pursued before has been given up by that.
                    while (given_up := self._craft.poll_goal()) is not None:
                        self._finish("aborted", given_up.result, given_up.text)
                    self._goal_id = goal_id
                question.answer({"accepted": not refusal, "text": refusal})
            case "cancel_goal":
                is_mine = goal_id == self._goal_id
                if is_mine:
                    self._craft.cancel_goto()
                    while (given_up := self._craft.poll_goal()) is not None:
                        self._finish("canceled", given_up.result, given_up.text)
                question.answer({"accepted": is_mine, "text": ""})
            case _:
                if goal_id in self._ended:
                    question.answer(self._ended[goal_id])
                else:
                    self._waiting.setdefault(goal_id, []).append(question)

    def _finish(self, status: str, result: msgspec.Struct, text: str) -> None:
        goal_id, self._goal_id = self._goal_id, None
        if goal_id is None:
            return
        answer = {"status": status, "result": said_of(result), "text": text}
        self._ended = {**self._ended, goal_id: answer}
        for question in self._waiting.pop(goal_id, []):
            question.answer(answer)

    def _report(self) -> None:
        self._speech.publish(NAV, said_of(self._craft.nav()))

    def _tell_place(self) -> None:
        """Tell where it truly is; not what it reports."""
        place = self._craft.motion
        tell("place", north_m=place.north_m, east_m=place.east_m, depth_m=place.depth_m,
             mode=self._craft.mode.value)  # fmt: skip

    def _status(self) -> None:
        self._speech.publish(STATUS, said_of(self._craft.status()))

    def _progress(self) -> None:
        progress = self._craft.progress
        if progress is not None and self._goal_id is not None:
            said = {"goal_id": self._goal_id, "feedback": said_of(progress)}
            self._speech.publish(f"{GOTO}/_action/feedback", said)


def _speech(session: zenoh.Session, later: Later, *, ros: bool) -> Speech:
    if not ros:
        return ZenohSpeech(session, later)
    from examples.auv.rosspeech import RosSpeech  # needs the extra `ros`

    speech = RosSpeech(session, later, VEHICLE)
    speech.advertise(NAV, STATUS, PHOTO, f"{GOTO}/_action/feedback", f"{GOTO}/_action/status")
    return speech


def main() -> None:
    """Open a session, live, and end with the input."""
    parser = argparse.ArgumentParser(prog="python -m examples.auv.vehicle", description=__doc__)
    parser.add_argument("endpoint", help="of the local router")
    parser.add_argument("--ros", action="store_true", help="speak as a node of ROS 2")
    given = parser.parse_args()
    with open_session(given.endpoint, stamps=given.ros) as session:
        vehicle = Vehicle(session, Craft(START), ros=given.ros)

        def wait_for_end() -> None:
            sys.stdin.read()
            vehicle.end()

        threading.Thread(target=wait_for_end, daemon=True).start()
        tell("ready")
        vehicle.run()


if __name__ == "__main__":
    main()
