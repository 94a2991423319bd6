"""A goal request to the local server of its action: it sends, follows and cancels the goal."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Final, Protocol, TypeVar

import zenoh

from zacoustic.core.base.qos import Priority
from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import PayloadInvalidError
from zacoustic.run.inbox import crossing, tell_loop
from zacoustic.zenoh.session.asking.goals import ActionForm, ActionKey, Ending, Verdict
from zacoustic.zenoh.session.asking.question import Question
from zacoustic.zenoh.session.session import ZenohSession

T = TypeVar("T")

RESULT_LIMIT_S: Final = 7 * 86400.0
"""Time limit of one query for a result, s; then it is repeated."""
CANCEL_LIMIT_S: Final = 600.0
"""Time limit for the answer to a cancel, s."""
_PAUSE_S: Final = 0.5
_LONGEST_PAUSE_S: Final = 10.0


class GoalSender(Protocol):
    """The sender of a goal; all methods are called on the loop, at once."""

    def answered(self, goal_id: bytes, verdict: Verdict) -> None:
        """Take the answer to the goal; if it is accepted, `ended` or `lost` follows."""
        ...

    def cancel_answered(self, goal_id: bytes, verdict: Verdict) -> None:
        """Take the answer to a cancel."""
        ...

    def ended(self, goal_id: bytes, ending: Ending) -> None:
        """Take the end of the goal."""
        ...

    def lost(self, goal_id: bytes, failure: CallFailure, text: str) -> None:
        """Take the news that nothing more will be known of the goal."""
        ...


class LocalGoalRequest:
    """One goal for a local server; for the loop.

    Args:
        zenoh_session: The session.
        form: Decodes and encodes the messages.
        goal_id: Id of the goal.
        sender: Gets the outcome.
        priority: Priority of the queries.
        patience_s: How long to look for the server when nobody answers for the result, s.
        mark: A gateway's mark of the origin of the queries.
    """

    def __init__(
        self,
        zenoh_session: ZenohSession,
        form: ActionForm,
        goal_id: bytes,
        sender: GoalSender,
        *,
        priority: Priority,
        patience_s: float,
        mark: bytes | None = None,
    ) -> None:
        self._zenoh_session = zenoh_session
        self._form = form
        self._goal_id = goal_id
        self._sender = sender
        self._priority = priority
        self._patience_s = patience_s
        self._mark = mark
        self._loop = asyncio.get_running_loop()
        self._questions: set[Question] = set()
        self._retry: asyncio.TimerHandle | None = None
        self._unanswered_since_s: float | None = None
        self._is_closed = False

    def begin(self, value: object, timeout_s: float) -> None:
        """Send the goal.

        Raises:
            PayloadInvalidError: The encoding cannot carry it.
        """
        payload = self._form.write_asked(ActionKey.SEND_GOAL, self._goal_id, value)
        self._ask(ActionKey.SEND_GOAL, payload, timeout_s, self._take_verdict)

    def cancel(self) -> None:
        """Send a cancel."""
        payload = self._form.write_asked(ActionKey.CANCEL_GOAL, self._goal_id)
        self._ask(ActionKey.CANCEL_GOAL, payload, CANCEL_LIMIT_S, self._take_cancel)

    def close(self) -> None:
        """Send no more queries."""
        self._is_closed = True
        if self._retry is not None:
            self._retry.cancel()
        questions, self._questions = self._questions, set()
        for question in questions:
            self._zenoh_session.worker.submit(question.cancel)

    # Below the methods above

    def _ask(
        self,
        key: ActionKey,
        payload: bytes,
        timeout_s: float,
        take: Callable[[Question], None],
    ) -> None:
        def settle(question: Question) -> None:
            tell_loop(self._loop, partial(self._settle, question, take))

        question = Question(self._form.key(key), settle)
        self._questions.add(question)
        self._zenoh_session.worker.submit(
            partial(
                question.ask,
                self._zenoh_session,
                payload,
                encoding=self._form.encoding,
                priority=self._priority,
                timeout_s=timeout_s,
                attachment=self._form.question_mark(key, self._mark),
            )
        )

    def _settle(self, question: Question, take: Callable[[Question], None]) -> None:
        self._questions.discard(question)
        if not self._is_closed:
            take(question)

    def _take_verdict(self, question: Question) -> None:
        read = partial(self._form.read_verdict, ActionKey.SEND_GOAL)
        verdict = self._read(question, read)
        if verdict is None:
            self._sender.lost(self._goal_id, *_failure(question))
            return
        self._sender.answered(self._goal_id, verdict)
        if verdict.accepted and not self._is_closed:
            self._ask_result()

    def _ask_result(self) -> None:
        payload = self._form.write_asked(ActionKey.GET_RESULT, self._goal_id)
        self._ask(ActionKey.GET_RESULT, payload, RESULT_LIMIT_S, self._take_result)

    def _take_result(self, question: Question) -> None:
        ending = self._read(question, self._form.read_ending)
        if ending is not None:
            self._sender.ended(self._goal_id, ending)
            return
        failure, text = _failure(question)
        now_s = self._loop.time()
        if failure not in (CallFailure.NO_SERVER, CallFailure.TIMED_OUT):
            self._sender.lost(self._goal_id, failure, text)
            return
        # The serving program or the router may be restarting.
        since_s = self._unanswered_since_s
        if since_s is None or now_s - since_s > self._patience_s + _LONGEST_PAUSE_S:
            since_s = self._unanswered_since_s = now_s
        elif now_s - since_s > self._patience_s:
            self._sender.lost(self._goal_id, failure, text)
            return
        pause_s = min(max(_PAUSE_S, now_s - since_s), _LONGEST_PAUSE_S)
        self._retry = self._loop.call_later(pause_s, self._ask_result)

    def _take_cancel(self, question: Question) -> None:
        read = partial(self._form.read_verdict, ActionKey.CANCEL_GOAL)
        verdict = self._read(question, read)
        if verdict is None:
            verdict = Verdict(accepted=False, text=_failure(question)[1])
        self._sender.cancel_answered(self._goal_id, verdict)

    def _read(self, question: Question, read: Callable[[bytes, str], T]) -> T | None:
        if question.good is None:
            return None
        try:
            return read(*question.good)
        except PayloadInvalidError as error:
            question.error = (CallFailure.BAD_RESPONSE, str(error))
            return None


class FeedbackEar:
    """Subscribes to the local feedback of one action.

    Args:
        form: Reads it.
        hear: Takes the goal's id and the feedback, on the loop.
        hears_marked: Also feedback from the channel.
    """

    def __init__(
        self,
        form: ActionForm,
        hear: Callable[[bytes, object], None],
        *,
        hears_marked: bool,
    ) -> None:
        self.unreadable = 0
        """Samples that were no feedback."""
        self._form = form
        self._hear = hear
        self._hears_marked = hears_marked
        self._put = crossing(self._take)

    def take(self, sample: zenoh.Sample) -> None:
        """Take a sample; on Zenoh's thread."""
        attachment = sample.attachment
        is_ours = attachment is not None and self._form.is_marked(attachment.to_bytes())
        if is_ours and not self._hears_marked:
            return
        self._put((sample.payload.to_bytes(), str(sample.encoding)))

    def _take(self, payload_and_encoding: tuple[bytes, str]) -> None:
        try:
            asked = self._form.read_asked(ActionKey.FEEDBACK, *payload_and_encoding)
        except PayloadInvalidError:
            self.unreadable += 1
            return
        self._hear(asked.goal_id, asked.value)


def _failure(question: Question) -> tuple[CallFailure, str]:
    return question.error or (CallFailure.NO_SERVER, "nobody serves it on this Zenoh network")
