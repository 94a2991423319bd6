"""Goals for servers on a Zenoh network: sent, followed to their end, and cancelled."""

import asyncio
import os
from collections.abc import Callable
from functools import partial
from typing import Final, TypeVar

import zenoh

from zacoustic.core.base.qos import Priority
from zacoustic.core.engine.events import CallFailure, GoalFailure
from zacoustic.errors import PayloadInvalidError, ZacousticError
from zacoustic.run.inbox import crossing
from zacoustic.zenoh.ends.goals import Complain, GoalClient
from zacoustic.zenoh.session.asking.goals import GOAL_ID_BYTES, ActionForm, ActionKey, Verdict
from zacoustic.zenoh.session.asking.question import Question
from zacoustic.zenoh.session.session import ZenohSession

T = TypeVar("T")

RESULT_LIMIT_S: Final = 7 * 86400.0
"""Time limit of one query for a result, s; then it is repeated."""
CANCEL_LIMIT_S: Final = 600.0
"""Time limit for the answer to a cancel, s."""
_PAUSE_S: Final = 0.5
_LONGEST_PAUSE_S: Final = 10.0
# Zenoh's own time limit is above ours, because our error says more.
_BEHIND_S: Final = 1.0

_AS_GOAL: Final = {
    CallFailure.NO_SERVER: GoalFailure.NO_SERVER,
    CallFailure.BAD_REQUEST: GoalFailure.BAD_GOAL,
    CallFailure.TABLE_MISMATCH: GoalFailure.TABLE_MISMATCH,
    CallFailure.BAD_RESPONSE: GoalFailure.BAD_RESULT,
    CallFailure.TIMED_OUT: GoalFailure.TIMED_OUT,
    CallFailure.CANCELLED: GoalFailure.CANCELLED,
    CallFailure.UNKNOWN: GoalFailure.TIMED_OUT,  # it may run
}
_NOBODY_KNOWS: Final = (CallFailure.BAD_REQUEST, CallFailure.UNKNOWN)
"""Of a running goal: the server has restarted, or has ended."""


class ZenohServers:
    """The goals of one action for a Zenoh network; `hear` may be called by any thread.

    Args:
        zenoh_session: The session.
        name: The action.
        form: Decodes and encodes the messages.
        priority: Priority of the queries.
        patience_s: How long to look for the server when nobody answers for a result, s.
        complain: Takes what cannot be passed on.
        hears_marked: Also feedback from the channel.
    """

    def __init__(
        self,
        zenoh_session: ZenohSession,
        name: str,
        form: ActionForm,
        *,
        priority: Priority,
        patience_s: float,
        complain: Complain,
        hears_marked: bool,
    ) -> None:
        self.zenoh_session = zenoh_session
        self.name = name
        self.form = form
        self.priority = priority
        self.patience_s = patience_s
        self.complain = complain
        self.unreadable = 0
        """Samples that were no feedback."""
        self._hears_marked = hears_marked
        self._goals: dict[bytes, ZenohGivenGoal] = {}
        self._put = crossing(self._take)

    def give(
        self, value: object, client: GoalClient, *, limit_s: float, mark: bytes | None = None
    ) -> "ZenohGivenGoal":
        """Send a goal to its server.

        Args:
            value: The goal.
            client: Hears what becomes of it.
            limit_s: Time limit for the answer, s; then the goal is cancelled.
            mark: A gateway's mark of the origin.

        Raises:
            PayloadInvalidError: The encoding cannot carry it.
        """
        # Random, so that no two senders and no two boot epochs give two goals the same id.
        goal_id = os.urandom(GOAL_ID_BYTES)
        payload = self.form.write_asked(ActionKey.SEND_GOAL, goal_id, value)
        given = self._goals[goal_id] = ZenohGivenGoal(self, goal_id, client, mark)
        given.begin(payload, limit_s)
        return given

    def hear(self, sample: zenoh.Sample) -> None:
        """Take feedback; on Zenoh's thread."""
        attachment = sample.attachment
        is_marked = attachment is not None and self.form.is_marked(attachment.to_bytes())
        if self._hears_marked or not is_marked:
            self._put((sample.payload.to_bytes(), str(sample.encoding)))

    def forget(self, goal_id: bytes) -> None:
        """Forget a goal that has ended."""
        self._goals.pop(goal_id, None)

    def close(self) -> None:
        """Send no more queries."""
        for given in tuple(self._goals.values()):
            given.close()

    def _take(self, payload_and_encoding: tuple[bytes, str]) -> None:
        try:
            asked = self.form.read_asked(ActionKey.FEEDBACK, *payload_and_encoding)
        except PayloadInvalidError:
            self.unreadable += 1
            return
        given = self._goals.get(asked.goal_id)
        if given is not None:
            given.feed(asked.value)


class ZenohGivenGoal:
    """A goal for a server on a Zenoh network."""

    def __init__(
        self, servers: ZenohServers, goal_id: bytes, client: GoalClient, mark: bytes | None
    ) -> None:
        self._servers = servers
        self._form = servers.form
        self._goal_id = goal_id
        self._client = client
        self._mark = mark
        self._loop = asyncio.get_running_loop()
        self._questions: set[Question] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._unanswered_since_s: float | None = None
        self._is_accepted = False
        self._is_over = False

    def begin(self, payload: bytes, limit_s: float) -> None:
        """Send the goal; cancel it if it is not answered within `limit_s`, s."""
        self._timer = self._loop.call_later(limit_s, self._expire, limit_s)
        self._ask(ActionKey.SEND_GOAL, payload, limit_s + _BEHIND_S, self._take_verdict)

    def cancel(self) -> bool:
        """Ask the server to end the goal; False: it has ended."""
        if self._is_over:
            return False
        payload = self._form.write_asked(ActionKey.CANCEL_GOAL, self._goal_id)
        self._ask(ActionKey.CANCEL_GOAL, payload, CANCEL_LIMIT_S, self._take_cancel)
        return True

    def feed(self, value: object) -> None:
        """Pass feedback to the client."""
        try:
            self._client.feed(value)
        except ZacousticError as error:
            self._servers.complain(self._servers.name, "feedback", str(error))

    def close(self) -> None:
        """Send no more queries."""
        self._end()
        questions, self._questions = self._questions, set()
        for question in questions:
            question.cancel()

    # Below the methods above

    def _ask(
        self, key: ActionKey, payload: bytes, timeout_s: float, take: Callable[[Question], None]
    ) -> None:
        question = Question(
            self._servers.zenoh_session,
            self._form.key(key),
            partial(self._settle, take),
            payload,
            encoding=self._form.encoding,
            priority=self._servers.priority,
            timeout_s=timeout_s,
            attachment=self._form.question_mark(key, self._mark),
        )
        self._questions.add(question)

    def _settle(self, take: Callable[[Question], None], question: Question) -> None:
        self._questions.discard(question)
        if not self._is_over:
            take(question)

    def _take_verdict(self, question: Question) -> None:
        self._stop_timer()
        verdict = self._read(question, partial(self._form.read_verdict, ActionKey.SEND_GOAL))
        if verdict is None:
            self._lose(question)
        elif not verdict.accepted:
            self.close()
            self._client.reject(verdict.failure or GoalFailure.REJECTED, verdict.text)
        else:
            self._is_accepted = True
            if not self._client.accept():
                self.cancel()
            self._ask_result()

    def _ask_result(self) -> None:
        if self._is_over:
            return
        payload = self._form.write_asked(ActionKey.GET_RESULT, self._goal_id)
        self._ask(ActionKey.GET_RESULT, payload, RESULT_LIMIT_S, self._take_result)

    def _take_result(self, question: Question) -> None:
        ending = self._read(question, self._form.read_ending)
        if ending is not None:
            self.close()
            try:
                self._client.finish(ending.status, ending.result, ending.text)
            except ZacousticError as error:  # the engine has aborted the goal
                self._servers.complain(self._servers.name, "result", str(error))
            return
        failure, _ = _failure(question)
        now_s = self._loop.time()
        if failure not in (CallFailure.NO_SERVER, CallFailure.TIMED_OUT):
            self._lose(question)
            return
        # The serving program or the router may be restarting.
        since_s, patience_s = self._unanswered_since_s, self._servers.patience_s
        if since_s is None or now_s - since_s > patience_s + _LONGEST_PAUSE_S:
            since_s = self._unanswered_since_s = now_s
        elif now_s - since_s > patience_s:
            self._lose(question)
            return
        pause_s = min(max(_PAUSE_S, now_s - since_s), _LONGEST_PAUSE_S)
        self._timer = self._loop.call_later(pause_s, self._ask_result)

    def _take_cancel(self, question: Question) -> None:
        verdict = self._read(question, partial(self._form.read_verdict, ActionKey.CANCEL_GOAL))
        if verdict is None:
            verdict = Verdict(accepted=False, text=_failure(question)[1])
        self._client.answer_cancel(verdict.accepted, verdict.text)

    def _read(self, question: Question, read: Callable[[bytes, str], T]) -> T | None:
        if question.good is None:
            return None
        try:
            return read(*question.good)
        except PayloadInvalidError as error:
            question.error = (CallFailure.BAD_RESPONSE, str(error))
            return None

    def _expire(self, limit_s: float) -> None:
        """Give the goal up, and let the server end it if it has begun."""
        self.cancel()
        self._end()
        self._client.lose(GoalFailure.TIMED_OUT, f"no answer within {limit_s:g} s")

    def _lose(self, question: Question) -> None:
        failure, text = _failure(question)
        self.close()
        if self._is_accepted and failure in _NOBODY_KNOWS:
            self._client.lose(GoalFailure.UNKNOWN, text)
        else:
            self._client.lose(_AS_GOAL.get(failure, GoalFailure.REJECTED), text)

    def _end(self) -> None:
        self._is_over = True
        self._stop_timer()
        self._servers.forget(self._goal_id)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _failure(question: Question) -> tuple[CallFailure, str]:
    return question.error or (CallFailure.NO_SERVER, "nobody serves it on this Zenoh network")
