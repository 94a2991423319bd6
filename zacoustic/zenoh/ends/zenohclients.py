"""Goals from clients on a Zenoh network: their queries, and the answers to them.

A goal begins once, however often it is sent. A query for its result waits for the end, or is
answered from the stored one.
"""

import time
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.engine.events import CallFailure, GoalFailure, GoalStatus
from zacoustic.errors import LocalError, PayloadInvalidError, ZacousticError
from zacoustic.zenoh.ends.goals import GoalHandler, TakenGoal
from zacoustic.zenoh.session.asking.goals import (
    ActionForm,
    ActionKey,
    Asked,
    Ending,
    GoalState,
    Verdict,
)
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery
from zacoustic.zenoh.session.marker import read_marker

GOALS_LIMIT: Final = 256
"""Known goals of one action at once; the oldest of the ended ones makes room."""

_AS_CALL: Final = {
    GoalFailure.TIMED_OUT: CallFailure.TIMED_OUT,
    GoalFailure.TABLE_MISMATCH: CallFailure.TABLE_MISMATCH,
    GoalFailure.BAD_RESULT: CallFailure.BAD_RESPONSE,
}

Put = Callable[[ActionKey, bytes], None]
"""Puts feedback or status on the local network."""


class ZenohClients:
    """The goals of one action that come from a Zenoh network.

    Args:
        form: Decodes and encodes the messages.
        handler: Takes the goals.
        put: Puts feedback and status.
        keep_s: How long the end of a goal is kept, s.
        clock: Source of instants.
        wall_clock: Returns UTC, ns since 1970.
        mark: A gateway's mark of the origin of each answer.
        takes_marked: Also goals from the channel.
    """

    def __init__(
        self,
        form: ActionForm,
        handler: GoalHandler,
        *,
        put: Put,
        keep_s: float,
        clock: Clock,
        wall_clock: Clock = time.time_ns,
        mark: bytes | None = None,
        takes_marked: bool,
    ) -> None:
        self.form = form
        self.put = put
        self.clock = clock
        self._handler = handler
        self._keep_ns = seconds_to_ns(keep_s)
        self._wall_clock = wall_clock
        self._mark = mark
        self._takes_marked = takes_marked
        self._goals: dict[bytes, ZenohTakenGoal] = {}
        self._keys = {form.key(which): which for which in ActionKey}

    def take(self, held: HeldQuery) -> None:
        """Take a query."""
        key = self._keys.get(str(held.query.key_expr))
        if key is None:
            text = f"a wildcard sends no goal, only {self.form.key(ActionKey.SEND_GOAL)} does"
            held.refuse(CallFailure.BAD_REQUEST, text)
            return
        if key in (ActionKey.FEEDBACK, ActionKey.STATUS):
            held.answer([])
            return
        query = held.query
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            asked = self.form.read_asked(key, payload, str(query.encoding))
        except PayloadInvalidError as error:
            self.refuse(held, key, CallFailure.BAD_REQUEST, str(error))
            return
        if key is ActionKey.SEND_GOAL:
            self._send(asked, held)
            return
        if asked.is_about_all:
            self._cancel_all(held, asked)
            return
        goal = self._goals.get(asked.goal_id)
        if goal is None:
            text = f"no goal {asked.goal_id.hex()} is known"
            self.refuse(held, key, CallFailure.BAD_REQUEST, text)
        elif goal.wait(key, held):
            self._handler.cancel(goal)

    def adopt(self, goal_id: bytes) -> "ZenohTakenGoal":
        """Restore a goal from before the restart."""
        goal = self._goals[goal_id] = ZenohTakenGoal(self, goal_id, None, None)
        return goal

    # For the goals

    def answer(self, held: HeldQuery, key: ActionKey, payload: bytes) -> None:
        """Answer a query."""
        asked = held.query.attachment
        mark = self.form.answer_mark(asked.to_bytes() if asked is not None else None, self._mark)
        held.answer(
            [
                Answer(
                    key=self.form.key(key),
                    payload=payload,
                    encoding=self.form.encoding,
                    attachment=mark,
                )
            ]
        )

    def refuse(self, held: HeldQuery, key: ActionKey, failure: CallFailure, text: str) -> None:
        """Answer a query with an error, in the words of its form."""
        payload = self.form.write_refusal(key)
        if payload is None:
            held.refuse(failure, text)
        else:
            self.answer(held, key, payload)

    def put_status(self, goal: "ZenohTakenGoal", status: str) -> None:
        """Put the new status of a goal."""
        accepted_ns = goal.state.accepted_unix_ns if goal.state else self._wall_clock()
        goal.state = GoalState(goal_id=goal.goal_id, status=status, accepted_unix_ns=accepted_ns)
        states = [each.state for each in self._goals.values() if each.state is not None]
        self.put(ActionKey.STATUS, self.form.write_status(goal.state, states))

    # Below the methods above

    def _send(self, asked: Asked, held: HeldQuery) -> None:
        goal = self._goals.get(asked.goal_id)
        if goal is not None:
            goal.wait(ActionKey.SEND_GOAL, held)
            return
        attachment = held.query.attachment
        self._make_room()
        try:
            if len(self._goals) >= GOALS_LIMIT:
                raise LocalError(f"{GOALS_LIMIT} goals are under way already")
            is_marked = attachment is not None and self.form.is_marked(attachment.to_bytes())
            if is_marked and not self._takes_marked:
                raise LocalError("the goal came off the channel, it does not go back")
            marker = read_marker(attachment)
            client = marker.acoustic if marker is not None else None
            goal = ZenohTakenGoal(self, asked.goal_id, asked.value, client)
            self._goals[asked.goal_id] = goal
            goal.wait(ActionKey.SEND_GOAL, held)
            self._handler.take(goal)
        except ZacousticError as error:
            self._goals.pop(asked.goal_id, None)
            is_wrong = isinstance(error, PayloadInvalidError)
            failure = CallFailure.BAD_REQUEST if is_wrong else CallFailure.NO_SERVER
            self.refuse(held, ActionKey.SEND_GOAL, failure, str(error))

    def _cancel_all(self, held: HeldQuery, asked: Asked) -> None:
        until_ns = asked.accepted_until_ns
        running = [
            goal
            for goal in self._goals.values()
            if goal.over_at is None
            and goal.state is not None
            and (until_ns is None or goal.state.accepted_unix_ns <= until_ns)
        ]
        verdict = Verdict(accepted=bool(running))
        ids = [goal.goal_id for goal in running]
        payload = self.form.write_verdict(ActionKey.CANCEL_GOAL, ids, verdict)
        self.answer(held, ActionKey.CANCEL_GOAL, payload)
        for goal in running:
            self._handler.cancel(goal)

    def _make_room(self) -> None:
        """Forget goals that ended long ago; if space is short, also the oldest ended ones."""
        now = self.clock()
        over = [
            (goal.over_at, goal_id)
            for goal_id, goal in self._goals.items()
            if goal.over_at is not None
        ]
        too_many = len(self._goals) - GOALS_LIMIT + 1
        for number, (over_at, goal_id) in enumerate(sorted(over)):
            if number < too_many or over_at + self._keep_ns <= now:
                del self._goals[goal_id]


class ZenohTakenGoal(TakenGoal):
    """A goal from a Zenoh network, and the queries that wait for its answer, cancel and result."""

    def __init__(
        self, clients: ZenohClients, goal_id: bytes, value: object, client: int | None
    ) -> None:
        super().__init__(value, client)
        self.goal_id = goal_id
        self.state: GoalState | None = None
        """Its state as last put; None: none yet."""
        self.over_at: int | None = None
        """Instant of its end, ns; None: it goes on."""
        self._clients = clients
        self._verdict: Verdict | None = None
        self._ending: Ending | None = None
        self._failure: tuple[CallFailure, str] | None = None
        self._waiting: dict[ActionKey, list[HeldQuery]] = {
            key: [] for key in (ActionKey.SEND_GOAL, ActionKey.CANCEL_GOAL, ActionKey.GET_RESULT)
        }

    def wait(self, key: ActionKey, held: HeldQuery) -> bool:
        """Let a query wait for its answer; True: it is the first request to cancel the goal."""
        self._waiting[key].append(held)
        if key is ActionKey.CANCEL_GOAL and self.over_at is None:
            return len(self._waiting[key]) == 1
        self._say()
        return False

    def accept(self) -> bool:
        """Tell the client that the goal runs."""
        if self._verdict is None and self.over_at is None:
            self._verdict = Verdict(accepted=True)
            self._clients.put_status(self, "executing")
            self._say()
        return True

    def reject(self, failure: GoalFailure, text: str) -> bool:
        """Tell the client that the goal does not run; it is over."""
        if self._verdict is None and self.over_at is None:
            self._verdict = Verdict(accepted=False, failure=failure, text=text)
            reason = text or "the goal was rejected"
            self._is_over((CallFailure.BAD_REQUEST, reason))
        return True

    def feed(self, value: object) -> bool:
        """Put feedback."""
        form = self._clients.form
        payload = form.write_asked(ActionKey.FEEDBACK, self.goal_id, value)
        self._clients.put(ActionKey.FEEDBACK, payload)
        return True

    def answer_cancel(self, accepted: bool, text: str) -> bool:
        """Answer the requests to cancel."""
        if accepted:
            self._clients.put_status(self, "canceling")
        self._tell_verdict(ActionKey.CANCEL_GOAL, Verdict(accepted=accepted, text=text))
        return True

    def finish(self, status: GoalStatus, value: object, text: str = "") -> bool:
        """Store the end of the goal, and answer with it."""
        if self.over_at is not None:
            return False
        ending = Ending(status=status, result=value, text=text)
        self._clients.form.write_ending(ending)  # raises before anything changes
        self._verdict = self._verdict or Verdict(accepted=True)
        self._ending = ending
        self._clients.put_status(self, status.name.lower())
        self._is_over(None)
        return True

    def lose(self, failure: GoalFailure, text: str) -> bool:
        """Tell the client that the outcome is unknown, or why there will be none."""
        if failure is GoalFailure.UNKNOWN:
            return self.finish(GoalStatus.UNKNOWN, None, text)
        if self.over_at is not None:
            return False
        self._is_over((_AS_CALL.get(failure, CallFailure.NO_SERVER), text))
        return True

    # Below the methods above

    def _is_over(self, failure: tuple[CallFailure, str] | None) -> None:
        self.over_at = self._clients.clock()
        self._failure = failure
        self._say()

    def _say(self) -> None:
        """Answer the queries that wait for the state of the goal."""
        if self._verdict is not None:
            self._tell_verdict(ActionKey.SEND_GOAL, self._verdict)
        if self._ending is not None:
            self._tell(ActionKey.GET_RESULT, self._clients.form.write_ending(self._ending))
        if self.over_at is None:
            return
        is_canceled = self._ending is not None and self._ending.status is GoalStatus.CANCELED
        text = "" if is_canceled else "the goal is over"
        self._tell_verdict(ActionKey.CANCEL_GOAL, Verdict(accepted=is_canceled, text=text))
        if self._failure is not None:
            for key in (ActionKey.SEND_GOAL, ActionKey.GET_RESULT):
                for held in self._take_waiting(key):
                    self._clients.refuse(held, key, *self._failure)

    def _tell_verdict(self, key: ActionKey, verdict: Verdict) -> None:
        self._tell(key, self._clients.form.write_verdict(key, [self.goal_id], verdict))

    def _tell(self, key: ActionKey, payload: bytes) -> None:
        for held in self._take_waiting(key):
            self._clients.answer(held, key, payload)

    def _take_waiting(self, key: ActionKey) -> list[HeldQuery]:
        waiting, self._waiting[key] = self._waiting[key], []
        return waiting
