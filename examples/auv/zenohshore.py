"""The shore's side on Zenoh: an ordinary client that hears the vehicle and commands it.

Zenoh calls on threads of its own; what came waits in a queue until `drain`, so that the shore's
state belongs to one thread. Under `@acoustic/1/**` the gateway reports link, queue and channel.
"""

import contextlib
import json
import os
import queue
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Final

import msgspec
import zenoh

from examples.auv.account import unaccounted
from examples.auv.linkwatch import LinkWatch
from examples.auv.messages import (
    GOTO,
    NAV,
    PHOTO,
    STATUS,
    Done,
    Progress,
    Reached,
    Waypoint,
)
from examples.auv.roswords import from_ros, name_in_ros, to_ros
from examples.auv.session import CBOR, from_cbor, to_cbor
from examples.auv.shore import Answer, Carrier, Shore
from examples.auv.start import SHORE
from zacoustic.gateway import read_marker

CALL_LIMIT_S: Final = 100.0
ANSWER_LIMIT_S: Final = 2.0
_ANSWERS_KEPT: Final = 256
RESULT_LIMIT_S: Final = 3600.0
Take = Callable[[dict[str, Any]], None]
_ACTION: Final = f"{GOTO}/_action"
_HEALTH: Final = f"@acoustic/{SHORE}/"


class ZenohShore(Carrier):
    """Carries words between a `Shore` and Zenoh.

    Args:
        session: Zenoh's.
        shore: What is known of the vehicle.
        watch: Keeps the gateway's health.
        ros: Use the table of `fleet_ros.json5`.
        wake: Called, by any thread, when something waits for `drain`.
    """

    def __init__(
        self,
        session: zenoh.Session,
        shore: Shore,
        watch: LinkWatch | None = None,
        *,
        ros: bool = False,
        wake: Callable[[], None] | None = None,
    ) -> None:
        self._session = session
        self._ros = ros
        self._wake = wake
        self._shore = shore
        self._watch = LinkWatch() if watch is None else watch
        self._came: queue.SimpleQueue[Callable[[float], None]] = queue.SimpleQueue()
        self.published: Counter[str] = Counter()
        """Samples that were put, by stream."""
        self.answers: deque[Answer] = deque(maxlen=_ANSWERS_KEPT)
        """Of the newest calls and goals."""
        self.goal_id: bytes | None = None
        """Of the goal that was sent last."""
        for topic in (NAV, STATUS, PHOTO, f"{_ACTION}/feedback"):
            session.declare_subscriber(topic, self._hear)
        session.declare_subscriber(f"{_HEALTH}**", self._hear_health)
        # What has not changed since is not put again.
        handler = zenoh.handlers.Callback(self._hear_answer, lambda: None)
        session.get(f"{_HEALTH}**", handler)

    def ask_gateway(self) -> None:
        """Ask whether the gateway runs; `LinkWatch.answered_at_s` has the answer."""

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                text = reply.ok.payload.to_string()
                self._later(lambda now_s: self._watch.answered(text, now_s))

        handler = zenoh.handlers.Callback(hear, lambda: None)
        with contextlib.suppress(zenoh.ZError):  # no answer is one
            self._session.get(f"{_HEALTH}clock", handler, timeout=ANSWER_LIMIT_S)

    def drain(self, now_s: float) -> None:
        """Take in all that came; `now_s` is the instant."""
        while not self._came.empty():
            self._came.get()(now_s)

    def put(self, topic: str, value: msgspec.Struct) -> None:
        """Publish."""
        name, said = topic, msgspec.to_builtins(value)
        if self._ros:
            name, said = name_in_ros(topic), to_ros(topic, said)
        self.published[name] += 1
        self._session.put(name, to_cbor(said), encoding=CBOR)

    def call(self, service: str, value: msgspec.Struct) -> Answer:
        """Call a service of the vehicle."""
        answer = self._new_answer()

        def answered(said: dict[str, Any]) -> None:
            answer.answered(msgspec.convert(said, Done))

        self._ask(service, value, CALL_LIMIT_S, answered, answer)
        return answer

    def send_goal(self, waypoint: Waypoint) -> Answer:
        """Send a way-point to the vehicle."""
        answer = self._new_answer()
        goal_id = self.goal_id = os.urandom(16)

        def accepted(said: dict[str, Any]) -> None:
            answer.accepted = said["accepted"]
            if not answer.accepted:
                answer.failed(said.get("text") or str(said.get("failure")))
                return
            question = {"goal_id": goal_id}
            self._ask(f"{_ACTION}/get_result", question, RESULT_LIMIT_S, ended, answer)

        def ended(said: dict[str, Any]) -> None:
            if said["status"] == "succeeded":
                answer.reached(msgspec.convert(said["result"], Reached))
            else:
                answer.failed(said["text"] or said["status"])

        question = {"goal_id": goal_id, "goal": msgspec.to_builtins(waypoint)}
        self._ask(f"{_ACTION}/send_goal", question, CALL_LIMIT_S, accepted, answer)
        return answer

    def cancel_goal(self) -> Answer | None:
        """Ask for the end of the goal that was sent last; None: there is none."""
        if self.goal_id is None:
            return None
        answer = Answer()

        def answered(said: dict[str, Any]) -> None:
            refusal = said.get("text") or "it was over"
            answer.answered(Done(said["accepted"], "" if said["accepted"] else refusal))

        question = {"goal_id": self.goal_id}
        self._ask(f"{_ACTION}/cancel_goal", question, CALL_LIMIT_S, answered, answer)
        return answer

    def unaccounted(self) -> list[str]:
        """Return the shore's commands without an outcome; nothing: all have one."""
        return unaccounted(self.published, self.answers, self._watch.documents.get("streams"))

    def _new_answer(self) -> Answer:
        answer = Answer()
        self.answers.append(answer)
        return answer

    def _ask(
        self,
        key: str,
        value: object,
        limit_s: float,
        take: Callable[[dict[str, Any]], None],
        answer: Answer,
    ) -> None:
        """Ask, and take the answer when it is drained; a failure ends `answer`."""
        replies: list[zenoh.Reply] = []

        def over(_: float) -> None:
            for reply in replies:
                if reply.ok is not None:
                    take(from_cbor(reply.ok.payload))
                    return
            errors = [reply.err.payload.to_string() for reply in replies if reply.err is not None]
            answer.failed(errors[0] if errors else "no answer")

        handler = zenoh.handlers.Callback(replies.append, lambda: self._later(over))
        self._session.get(key, handler, payload=to_cbor(value), encoding=CBOR, timeout=limit_s)

    def _later(self, take: Callable[[float], None]) -> None:
        self._came.put(take)
        if self._wake is not None:
            self._wake()

    def _hear(self, sample: zenoh.Sample) -> None:
        topic, payload = str(sample.key_expr), sample.payload
        marker = read_marker(sample.attachment)
        age_s = None if marker is None else marker.age_s

        def take(now_s: float) -> None:
            shore, way_s = self._shore, self._watch.way_s
            said: Any = payload.to_bytes()
            if self._ros or topic != PHOTO:
                said = from_cbor(payload)
            if self._ros:
                said = from_ros(topic, said)
            if topic in (NAV, STATUS, PHOTO):
                if age_s is None:
                    shore.hear(topic, said, now_s, way_s=way_s)
                else:
                    shore.hear(topic, said, now_s, age_s, 0.0)
            else:
                shore.progress = msgspec.convert(said["feedback"], Progress)

        self._later(take)

    def _hear_health(self, sample: zenoh.Sample, *, is_answer: bool = False) -> None:
        name, text = str(sample.key_expr).removeprefix(_HEALTH), sample.payload.to_string()

        def take(now_s: float) -> None:
            # An answer may be older than what was put meanwhile. What is no such document is
            # nobody's: anyone on this network can put one.
            if not (is_answer and name in self._watch.documents):
                with contextlib.suppress(ValueError, LookupError, TypeError, AttributeError):
                    self._watch.take(name, json.loads(text), now_s)

        self._later(take)

    def _hear_answer(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._hear_health(reply.ok, is_answer=True)
