"""The goal server of a local network: queries about goals, and their answers.

A program executes the goals, or a gateway does so for a remote server. A goal begins once, however
often it is sent. A query for its result waits for the end, or is answered from the stored one.
"""

import time
from collections.abc import Callable
from typing import Final, Protocol

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.engine.events import CallFailure, GoalStatus
from zacoustic.errors import PayloadInvalidError, ZacousticError
from zacoustic.zenoh.session.asking.goals import (
    ActionForm,
    ActionKey,
    Asked,
    Ending,
    GoalState,
    Verdict,
)
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery

GOALS_LIMIT: Final = 256
"""Known goals of one action at once; the oldest of the ended ones makes room."""


class Pursuer(Protocol):
    """Executes the goals of a goal server."""

    def begin(self, goal_id: bytes, value: object, held: HeldQuery) -> None:
        """Begin a goal; `answer` or `fail` follows.

        Args:
            goal_id: Its id.
            value: The goal, a value of its type.
            held: The query that brought it.

        Raises:
            ZacousticError: It cannot be begun.
        """
        ...

    def cancel(self, goal_id: bytes) -> None:
        """End a goal; `answer_cancel`, `end` or `fail` follows."""
        ...


Put = Callable[[ActionKey, bytes], None]
"""Puts feedback or status on the local network."""


class _Known:
    """A known goal."""

    def __init__(self, goal_id: bytes) -> None:
        self.goal_id = goal_id
        self.state: GoalState | None = None
        self.verdict: Verdict | None = None
        self.ending: Ending | None = None
        self.failure: tuple[CallFailure, str] | None = None
        self.over_at: int | None = None
        self.waiting: dict[ActionKey, list[HeldQuery]] = {
            key: [] for key in (ActionKey.SEND_GOAL, ActionKey.CANCEL_GOAL, ActionKey.GET_RESULT)
        }


class LocalGoalServer:
    """The local goals of one action; for the loop.

    Args:
        form: Decodes and encodes the messages.
        pursuer: Executes the goals.
        put: Puts feedback and status.
        keep_s: How long the end of a goal is kept, s.
        clock: Source of instants.
        wall_clock: Returns UTC, ns since 1970.
        mark: A gateway's mark of the origin of each answer.
    """

    def __init__(
        self,
        form: ActionForm,
        pursuer: Pursuer,
        *,
        put: Put,
        keep_s: float,
        clock: Clock,
        wall_clock: Clock = time.time_ns,
        mark: bytes | None = None,
    ) -> None:
        self._form = form
        self._pursuer = pursuer
        self._put = put
        self._keep_ns = seconds_to_ns(keep_s)
        self._clock = clock
        self._wall_clock = wall_clock
        self._mark = mark
        self._goals: dict[bytes, _Known] = {}
        self._keys = {form.key(which): which for which in ActionKey}

    # From the local network

    def take(self, held: HeldQuery) -> None:
        """Take a query."""
        key = self._keys.get(str(held.query.key_expr))
        if key is None:
            text = f"a wildcard sends no goal, only {self._form.key(ActionKey.SEND_GOAL)} does"
            held.refuse(CallFailure.BAD_REQUEST, text)
            return
        if key in (ActionKey.FEEDBACK, ActionKey.STATUS):
            held.answer([])
            return
        query = held.query
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            asked = self._form.read_asked(key, payload, str(query.encoding))
        except PayloadInvalidError as error:
            self._refuse(held, key, CallFailure.BAD_REQUEST, str(error))
            return
        if key is ActionKey.SEND_GOAL:
            self._send(asked.goal_id, asked.value, held)
            return
        if asked.is_about_all:
            self._cancel_all(held, asked)
            return
        goal = self._goals.get(asked.goal_id)
        if goal is None:
            text = f"no goal {asked.goal_id.hex()} is known"
            self._refuse(held, key, CallFailure.BAD_REQUEST, text)
            return
        goal.waiting[key].append(held)
        if key is ActionKey.CANCEL_GOAL and goal.over_at is None:
            if len(goal.waiting[key]) == 1:
                self._pursuer.cancel(asked.goal_id)
        else:
            self._say(goal)

    # From the pursuer

    def adopt(self, goal_id: bytes) -> None:
        """Restore a goal from before the restart."""
        self._goals[goal_id] = _Known(goal_id)

    def answer(self, goal_id: bytes, verdict: Verdict) -> None:
        """Take the answer to a goal; a refused goal is over."""
        goal = self._goals.get(goal_id)
        if goal is None or goal.verdict is not None or goal.over_at is not None:
            return
        goal.verdict = verdict
        if verdict.accepted:
            self._put_status(goal, "executing")
        else:
            text = verdict.text or "the goal was rejected"
            self._is_over(goal, (CallFailure.BAD_REQUEST, text))
        self._say(goal)

    def answer_cancel(self, goal_id: bytes, verdict: Verdict) -> None:
        """Take the answer to a cancel."""
        goal = self._goals.get(goal_id)
        if goal is None:
            return
        if verdict.accepted:
            self._put_status(goal, "canceling")
        self._tell_verdict(goal, ActionKey.CANCEL_GOAL, verdict)

    def feed(self, goal_id: bytes, value: object) -> None:
        """Put feedback.

        Raises:
            PayloadInvalidError: The encoding cannot carry it.
        """
        self._put(ActionKey.FEEDBACK, self._form.write_asked(ActionKey.FEEDBACK, goal_id, value))

    def end(self, goal_id: bytes, ending: Ending) -> None:
        """Take the end of a goal.

        Raises:
            PayloadInvalidError: The encoding cannot carry the result.
        """
        goal = self._goals.get(goal_id)
        if goal is None or goal.over_at is not None:
            return
        self._form.write_ending(ending)
        goal.verdict = goal.verdict or Verdict(accepted=True)
        goal.ending = ending
        self._is_over(goal, None)
        self._put_status(goal, ending.status.name.lower())
        self._say(goal)

    def fail(self, goal_id: bytes, failure: CallFailure, text: str) -> None:
        """End a goal of which nothing more will be known."""
        goal = self._goals.get(goal_id)
        if goal is not None and goal.over_at is None:
            self._is_over(goal, (failure, text))
            self._say(goal)

    # Below the methods above

    def _send(self, goal_id: bytes, value: object, held: HeldQuery) -> None:
        goal = self._goals.get(goal_id)
        if goal is not None:
            goal.waiting[ActionKey.SEND_GOAL].append(held)
            self._say(goal)
            return
        self._make_room()
        if len(self._goals) >= GOALS_LIMIT:
            text = f"{GOALS_LIMIT} goals are under way already"
            self._refuse(held, ActionKey.SEND_GOAL, CallFailure.NO_SERVER, text)
            return
        goal = self._goals[goal_id] = _Known(goal_id)
        goal.waiting[ActionKey.SEND_GOAL].append(held)
        try:
            self._pursuer.begin(goal_id, value, held)
        except ZacousticError as error:
            del self._goals[goal_id]
            is_wrong = isinstance(error, PayloadInvalidError)
            failure = CallFailure.BAD_REQUEST if is_wrong else CallFailure.NO_SERVER
            self._refuse(held, ActionKey.SEND_GOAL, failure, str(error))

    def _cancel_all(self, held: HeldQuery, asked: Asked) -> None:
        until_ns = asked.accepted_until_ns
        running = [
            goal.goal_id
            for goal in self._goals.values()
            if goal.over_at is None
            and goal.state is not None
            and (until_ns is None or goal.state.accepted_unix_ns <= until_ns)
        ]
        verdict = Verdict(accepted=bool(running))
        payload = self._form.write_verdict(ActionKey.CANCEL_GOAL, running, verdict)
        self._answer(held, ActionKey.CANCEL_GOAL, payload)
        for goal_id in running:
            self._pursuer.cancel(goal_id)

    def _make_room(self) -> None:
        """Forget goals that ended long ago; if space is short, also the oldest ended ones."""
        now = self._clock()
        over = [
            (goal.over_at, goal_id)
            for goal_id, goal in self._goals.items()
            if goal.over_at is not None
        ]
        too_many = len(self._goals) - GOALS_LIMIT + 1
        for number, (over_at, goal_id) in enumerate(sorted(over)):
            if number < too_many or over_at + self._keep_ns <= now:
                del self._goals[goal_id]

    def _is_over(self, goal: _Known, failure: tuple[CallFailure, str] | None) -> None:
        goal.over_at = self._clock()
        goal.failure = failure

    def _say(self, goal: _Known) -> None:
        """Answer the queries that wait for the state of a goal."""
        if goal.verdict is not None:
            self._tell_verdict(goal, ActionKey.SEND_GOAL, goal.verdict)
        if goal.ending is not None:
            self._tell(goal, ActionKey.GET_RESULT, self._form.write_ending(goal.ending))
        if goal.over_at is None:
            return
        is_canceled = goal.ending is not None and goal.ending.status is GoalStatus.CANCELED
        text = "" if is_canceled else "the goal is over"
        over = Verdict(accepted=is_canceled, text=text)
        self._tell_verdict(goal, ActionKey.CANCEL_GOAL, over)
        if goal.failure is not None:
            for key in (ActionKey.SEND_GOAL, ActionKey.GET_RESULT):
                waiting, goal.waiting[key] = goal.waiting[key], []
                for held in waiting:
                    self._refuse(held, key, *goal.failure)

    def _tell_verdict(self, goal: _Known, key: ActionKey, verdict: Verdict) -> None:
        self._tell(goal, key, self._form.write_verdict(key, [goal.goal_id], verdict))

    def _tell(self, goal: _Known, key: ActionKey, payload: bytes) -> None:
        waiting, goal.waiting[key] = goal.waiting[key], []
        for held in waiting:
            self._answer(held, key, payload)

    def _answer(self, held: HeldQuery, key: ActionKey, payload: bytes) -> None:
        asked = held.query.attachment
        mark = self._form.answer_mark(asked.to_bytes() if asked is not None else None, self._mark)
        held.answer(
            [
                Answer(
                    key=self._form.key(key),
                    payload=payload,
                    encoding=self._form.encoding,
                    attachment=mark,
                )
            ]
        )

    def _refuse(self, held: HeldQuery, key: ActionKey, failure: CallFailure, text: str) -> None:
        payload = self._form.write_refusal(key)
        if payload is None:
            held.refuse(failure, text)
        else:
            self._answer(held, key, payload)

    def _put_status(self, goal: _Known, status: str) -> None:
        accepted_ns = goal.state.accepted_unix_ns if goal.state else self._wall_clock()
        goal.state = GoalState(goal_id=goal.goal_id, status=status, accepted_unix_ns=accepted_ns)
        states = [each.state for each in self._goals.values() if each.state is not None]
        self._put(ActionKey.STATUS, self._form.write_status(goal.state, states))
