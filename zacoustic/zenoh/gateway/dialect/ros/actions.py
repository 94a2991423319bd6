"""Actions of ROS 2: three services and two topics, as in rmw_zenoh.

On the channel a goal has a number of one byte, and each message about it is one record. On the
client's network the gateway turns them into the messages of a ROS server: answers, feedback, and
after each change the status of all goals, a latched topic. On the server's network it is a client:
it asks for the result as soon as a goal is accepted; the rest arrives by itself.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

from zacoustic.core.base.clock import Clock
from zacoustic.core.engine.events import GoalStatus
from zacoustic.core.streams.table import Stream
from zacoustic.errors import PayloadInvalidError
from zacoustic.ros.attachment import read_attachment
from zacoustic.ros.streams import RosAction
from zacoustic.ros.tokens import Entity
from zacoustic.zenoh.gateway.dialect.dialects import Declared
from zacoustic.zenoh.gateway.dialect.ros.graph import Graph
from zacoustic.zenoh.gateway.dialect.ros.services import ServiceEnds
from zacoustic.zenoh.gateway.dialect.ros.topics import CDR, Teller
from zacoustic.zenoh.session.asking.goals import (
    GOAL_ID_BYTES,
    ActionForm,
    ActionKey,
    Asked,
    Ending,
    GoalState,
    Verdict,
)
from zacoustic.zenoh.session.latching import LatchedPublisher
from zacoustic.zenoh.session.session import ZenohSession

STATUS_CODES: Final = {
    "unknown": 0,
    "executing": 2,
    "canceling": 3,
    "succeeded": 4,
    "canceled": 5,
    "aborted": 6,
}
"""Numbers of ``action_msgs/msg/GoalStatus`` by this project's words."""

_ENDINGS: Final = {4: GoalStatus.SUCCEEDED, 5: GoalStatus.CANCELED, 6: GoalStatus.ABORTED}
_REJECTED: Final = 1
_NS_PER_S: Final = 1_000_000_000
_SERVICES: Final = (ActionKey.SEND_GOAL, ActionKey.CANCEL_GOAL, ActionKey.GET_RESULT)


class RosActionForm(ActionForm):
    """Messages about the goals of one action.

    Args:
        stream: The action.
        action: Its ROS side.
        graph: Its endpoints.
        zenoh_session: The session.
        wall_clock: Returns UTC, ns since 1970.
    """

    encoding = CDR

    def __init__(
        self,
        stream: Stream,
        action: RosAction,
        graph: Graph,
        zenoh_session: ZenohSession,
        wall_clock: Clock,
    ) -> None:
        self._action = action
        self._graph = graph
        self._zenoh_session = zenoh_session
        self._wall_clock = wall_clock
        self._priority = stream.qos.priority
        said = {
            ActionKey.SEND_GOAL: action.send_goal,
            ActionKey.CANCEL_GOAL: action.cancel_goal,
            ActionKey.GET_RESULT: action.get_result,
        }
        topics = {ActionKey.FEEDBACK: action.feedback, ActionKey.STATUS: action.status}
        self.ends = {
            which: ServiceEnds(which.of(stream.name), service, graph, wall_clock)
            for which, service in said.items()
        }
        """Its services."""
        self._topics = {
            which: (topic.key(graph.domain, which.of(stream.name)), topic)
            for which, topic in topics.items()
        }
        self._keys = {which: str(ends.key) for which, ends in self.ends.items()}
        self._keys |= {which: str(key) for which, (key, _) in self._topics.items()}
        self._tellers = {
            which: Teller(graph.endpoint(Entity.PUBLISHER, key, topic.qos), wall_clock)
            for which, (key, topic) in self._topics.items()
        }
        self._subscriptions = [
            graph.endpoint(Entity.SUBSCRIPTION, key, topic.qos)
            for key, topic in self._topics.values()
        ]
        self._status = LatchedPublisher(
            zenoh_session, self._keys[ActionKey.STATUS], action.status.qos.depth, self._priority
        )

    def key(self, which: ActionKey) -> str:
        """Return a key of rmw_zenoh."""
        return self._keys[which]

    def served(self) -> tuple[str, ...]:
        """Return the keys of the three services."""
        return tuple(self._keys[which] for which in _SERVICES)

    def offer(self) -> Sequence[Declared]:
        """Announce a server; in the worker."""
        self._status.declare()
        shown = [token for which in _SERVICES for token in self.ends[which].offer()]
        tokens = [teller.token for teller in self._tellers.values()]
        return [self._status, *shown, *self._graph.announce(tokens)]

    def use(self) -> Sequence[Declared]:
        """Announce a client; in the worker."""
        shown = [token for which in _SERVICES for token in self.ends[which].use()]
        return [*shown, *self._graph.announce(self._subscriptions)]

    def put(self, which: ActionKey, payload: bytes) -> None:
        """Put feedback or status, on the loop."""
        attachment = self._tellers[which].attachment()
        if which is ActionKey.STATUS:
            self._status.put(payload, encoding=CDR, attachment=attachment)
            return
        self._zenoh_session.put(
            self.key(which),
            payload,
            encoding=CDR,
            priority=self._priority,
            attachment=attachment,
        )

    # Questions, feedback and status

    def write_asked(self, which: ActionKey, goal_id: bytes, value: object = None) -> bytes:
        """Write a request of one of the services, or feedback."""
        named = {"goal_id": {"uuid": goal_id}}
        match which:
            case ActionKey.SEND_GOAL:
                return self._action.send_goal.request.write(named | {"goal": value})
            case ActionKey.FEEDBACK:
                return self._action.feedback.message.write(named | {"feedback": value})
            case ActionKey.GET_RESULT:
                return self._action.get_result.request.write(named)
            case _:
                return self._action.cancel_goal.request.write({"goal_info": named})

    def read_asked(self, which: ActionKey, payload: bytes, encoding: str) -> Asked:
        """Read a request of one of the services, or feedback."""
        part = ""
        match which:
            case ActionKey.SEND_GOAL:
                said, part = self._action.send_goal.request.read(payload)[0], "goal"
            case ActionKey.FEEDBACK:
                said, part = self._action.feedback.message.read(payload)[0], "feedback"
            case ActionKey.GET_RESULT:
                said = self._action.get_result.request.read(payload)[0]
            case _:
                said = self._action.cancel_goal.request.read(payload)[0]["goal_info"]
                until_ns = said["stamp"]["sec"] * _NS_PER_S + said["stamp"]["nanosec"]
                goal_id = _goal_id(said)
                return Asked(
                    goal_id=goal_id,
                    value=None,
                    is_about_all=not any(goal_id),
                    accepted_until_ns=until_ns or None,
                )
        # A part without members is absent.
        return Asked(goal_id=_goal_id(said), value=said.get(part, {}) if part else None)

    def write_status(self, changed: GoalState, states: Sequence[GoalState]) -> bytes:
        """Write the status of all goals."""
        listed = [
            {
                "goal_info": _goal_info(state.goal_id, state.accepted_unix_ns),
                "status": STATUS_CODES[state.status],
            }
            for state in states
        ]
        return self._action.status.message.write({"status_list": listed})

    # Answers

    def write_verdict(self, which: ActionKey, goal_ids: Sequence[bytes], verdict: Verdict) -> bytes:
        """Write a response."""
        if which is ActionKey.SEND_GOAL:
            stamp = _time(self._wall_clock())
            said: dict[str, Any] = {"accepted": verdict.accepted, "stamp": stamp}
            return self._action.send_goal.response.write(said)
        now_ns = self._wall_clock()
        canceling = [_goal_info(each, now_ns) for each in goal_ids if verdict.accepted]
        code = 0 if verdict.accepted else _REJECTED
        said = {"return_code": code, "goals_canceling": canceling}
        return self._action.cancel_goal.response.write(said)

    def read_verdict(self, which: ActionKey, payload: bytes, encoding: str) -> Verdict:
        """Read a response."""
        if which is ActionKey.SEND_GOAL:
            said = self._action.send_goal.response.read(payload)[0]
            return Verdict(accepted=said["accepted"])
        said = self._action.cancel_goal.response.read(payload)[0]
        return Verdict(accepted=said["return_code"] == 0 and bool(said["goals_canceling"]))

    def write_ending(self, ending: Ending) -> bytes:
        """Write a response; without a result it contains zeros."""
        code = STATUS_CODES[ending.status.name.lower()]
        return self._action.get_result.response.write({"status": code, "result": ending.result})

    def read_ending(self, payload: bytes, encoding: str) -> Ending:
        """Read a response."""
        said = self._action.get_result.response.read(payload)[0]
        status = _ENDINGS.get(said["status"], GoalStatus.UNKNOWN)
        has_result = status is not GoalStatus.UNKNOWN
        return Ending(status=status, result=said.get("result", {}) if has_result else None)

    def write_refusal(self, which: ActionKey) -> bytes | None:
        """Write a negative response: clients of ROS ignore error replies."""
        if which is ActionKey.GET_RESULT:
            return self.write_ending(Ending(status=GoalStatus.UNKNOWN))
        return self.write_verdict(which, (), Verdict(accepted=False))

    # Attachments

    def question_mark(self, which: ActionKey, mark: bytes | None) -> bytes | None:
        """Return a number, and the gid of the gateway's client."""
        return self.ends[which].question_mark()

    def answer_mark(self, asked: bytes | None, mark: bytes | None) -> bytes | None:
        """Return number and gid of the query."""
        return self.ends[ActionKey.SEND_GOAL].answer_mark(asked)

    def is_marked(self, attachment: bytes) -> bool:
        """Return whether the gid belongs to a gateway."""
        read = read_attachment(attachment)
        return read is not None and self._graph.is_gateway(read.gid)


def putter(form: ActionForm) -> Callable[[ActionKey, bytes], None]:
    """Return a function that puts feedback and status of remote goals."""
    assert isinstance(form, RosActionForm)
    return form.put


def _goal_id(said: dict[str, Any]) -> bytes:
    goal_id = said["goal_id"]["uuid"]
    if not isinstance(goal_id, bytes) or len(goal_id) != GOAL_ID_BYTES:
        raise PayloadInvalidError(f"goal_id is {goal_id!r}; allowed: {GOAL_ID_BYTES} bytes")
    return goal_id


def _goal_info(goal_id: bytes, unix_ns: int) -> dict[str, Any]:
    return {"goal_id": {"uuid": goal_id}, "stamp": _time(unix_ns)}


def _time(unix_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(unix_ns, _NS_PER_S)
    return {"sec": seconds, "nanosec": nanoseconds}
