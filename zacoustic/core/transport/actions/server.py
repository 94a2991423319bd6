"""The goals that this node serves: each is given to the application once, and its end is kept."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.stats import count
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.actions.events import ActionEvent, CancelRequested, GoalReceived
from zacoustic.core.transport.actions.outbox import GoalLane, GoalOutbox
from zacoustic.core.transport.actions.servedgoal import CancelStage, ServedGoal, ServedStage
from zacoustic.core.transport.exchanges.journal import ExchangeJournal
from zacoustic.core.transport.exchanges.repeating import Repeater
from zacoustic.core.transport.exchanges.taken import TakenExchanges
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.goals import (
    UNKNOWN_RESULT,
    GoalFailure,
    GoalKey,
    GoalRefusal,
    GoalStatus,
    Message,
    Operation,
    decode_cancel,
    encode_result,
    is_later,
    shorten_result,
)
from zacoustic.errors import LocalError, PayloadInvalidError

_JOURNAL: Final = "goal/taken"
_WORTH_A_REMINDER_BYTES: Final = 8
"""From this size on, a reminder and the claim that sometimes follows cost less than one more copy
of a result."""


class GoalServer:
    """The goals that one node serves.

    Args:
        context: What the components of its engine share.
        outbox: Queues the records.
        repeater: Repeats the results.
    """

    def __init__(self, context: Context, outbox: GoalOutbox, repeater: Repeater) -> None:
        self._table = context.table
        self._outbox = outbox
        self._handshake = context.handshake
        self._lives = context.lives
        self._doubt = context.doubt
        self._stats = context.stats
        self._emit: Callable[[ActionEvent], None] = context.emit
        self._goals: TakenExchanges[ServedGoal] = TakenExchanges(
            ExchangeJournal(_JOURNAL, context.table, context.journal),
            context.timers,
            repeater,
            Due.SERVED_GOAL,
            context.sizes.goals,
            context.sizes.served_goals,
        )
        self.settling_ns = 0
        """Time in which every repetition of a frame arrives, ns."""

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the goals from before the restart; those that ran have an unknown outcome."""

        def restore(parts: list[int], state: list[Any]) -> ServedGoal:
            goal = ServedGoal(GoalKey(*parts))
            stage, answer = state
            goal.stage, goal.answer = ServedStage(stage), answer
            if goal.stage not in (ServedStage.REFUSED, ServedStage.ENDED):
                goal.stage, goal.answer = ServedStage.ENDED, UNKNOWN_RESULT
            return goal

        self._goals.recover(stored, restore)

    def link_up(self, now: int) -> None:
        """Start the timers of the goals from before the restart, and send their results."""
        for goal in self._goals.recovered():
            spec = self._spec(goal)
            goal.deadline_at = now + seconds_to_ns(spec.timeout_s)
            keeps_ns = seconds_to_ns(max(spec.timeout_s, spec.result_timeout_s))
            self._goals.forget_at(goal, now + keeps_ns + self.settling_ns)
            if goal.stage is ServedStage.ENDED:
                self._push(goal, now)

    # For the application

    def accept(self, key: GoalKey, now: int) -> bool:
        """Accept a goal; see `Actions.accept`."""
        goal = self._goals.get(key)
        if goal is None or goal.stage is not ServedStage.OFFERED or goal.deadline_at <= now:
            return False
        goal.stage = ServedStage.RUNS
        self._goals.forget_at(goal, None)
        self._say(goal, Operation.ACCEPTED, now)
        if goal.cancel is CancelStage.WANTED:
            self._ask_application(goal)
        return True

    def reject(self, key: GoalKey, failure: GoalFailure, text: str, now: int) -> bool:
        """Refuse a goal; see `Actions.reject`."""
        goal = self._goals.get(key)
        if goal is None or goal.stage is not ServedStage.OFFERED:
            return False
        self._refuse(goal, failure, text, now)
        return True

    def feed(self, key: GoalKey, value: object, now: int) -> bool:
        """Send feedback; see `Actions.publish_feedback`."""
        goal = self._goals.get(key)
        if goal is None or goal.stage is not ServedStage.RUNS:
            return False
        stream, spec = self._stream(goal), self._spec(goal)
        payload = stream.feedback_codec.encode(value)
        self._outbox.check_size(stream, payload)
        if self._is_wanted(goal):
            count(self._stats.published, stream.stream_id)
            self._outbox.feed(key, stream, key.client, payload, spec.feedback_interval_s, now)
        return True

    def finish(self, key: GoalKey, status: GoalStatus, value: object, now: int) -> bool:
        """End a goal; see `Actions.finish`."""
        goal = self._goals.get(key)
        if goal is None or goal.stage is not ServedStage.RUNS:
            return False
        stream = self._stream(goal)
        try:
            result = None if value is None else stream.response_codec.encode(value)
            self._outbox.check_size(stream, result or b"", status=True)
        except (PayloadInvalidError, LocalError):
            self._finish(goal, encode_result(GoalStatus.ABORTED, None), now)
            raise
        self._finish(goal, encode_result(status, result), now)
        return True

    def answer_cancel(self, key: GoalKey, accepted: bool, text: str, now: int) -> bool:
        """Answer a cancel; see `Actions.answer_cancel`."""
        goal = self._goals.get(key)
        if goal is None or goal.stage is not ServedStage.RUNS:
            return False
        if goal.cancel is not CancelStage.ASKED:
            return False
        goal.cancel = CancelStage.ACCEPTED if accepted else CancelStage.REFUSED
        goal.cancel_text = text
        self._say_cancel(goal, now)
        return True

    # For the channel

    def receive(self, source: int, stream: Stream, message: Message, now: int) -> str | None:
        """Take a client's record about a goal; return why it is dropped, or None."""
        present = self._handshake.peer(source).present_epoch
        epoch = present if message.epoch is None else message.epoch
        key = GoalKey(source, epoch, stream.stream_id, message.number)
        goal = self._goals.get(key)
        if goal is not None and epoch != present:
            goal.claimed_in = present
        match message.operation:
            case Operation.GOAL:
                if goal is not None:
                    self._answer_again(goal, now)
                    return "repeated_goal"
                if self._lives.is_over(source, present, now):
                    self._handshake.ask_for_proof(source, now)
                    return "former_life"
                return self._receive_goal(key, stream, message.payload, now)
            case Operation.CLAIM:
                if goal is None:
                    refusal = GoalRefusal(GoalFailure.UNKNOWN, "").encode()
                    lane, operation = GoalLane.ANSWER, Operation.REFUSED
                    self._outbox.say(key, stream, source, operation, lane, now, refusal)
                else:
                    self._answer_again(goal, now)
            case Operation.CANCEL | Operation.CANCEL_AGAIN:
                attempt = decode_cancel(message)
                if attempt is None:
                    return "payload"
                return self._receive_cancel(key, goal, attempt, now)
            case Operation.CONFIRM:
                if goal is not None and goal.stage is ServedStage.ENDED and goal.is_journalled:
                    self._result_confirmed(goal, now)
            case _:
                return "not_publisher"
        return None

    def client_restarted(self, client: int, now: int) -> None:
        """Stop repeating a client's goals of other epochs, unless it asks for them."""
        for goal in self._goals.of(client):
            if not self._is_wanted(goal):
                self._outbox.stop(goal.repetition, now)
                goal.repetition = None
                self._outbox.withdraw(
                    goal.key, client, GoalLane.ANSWER, GoalLane.CANCEL_ANSWER, GoalLane.FEEDBACK
                )

    def client_forgotten(self, client: int, now: int) -> None:
        """Forget all goals of a client; those that run continue, without a report of their end."""
        for goal in self._goals.of(client):
            self._goals.forget(goal, now)

    # Below the methods above

    def _stream(self, goal: ServedGoal) -> Stream:
        return self._table.by_id(goal.key.stream_id)

    def _spec(self, goal: ServedGoal) -> ActionSpec:
        spec = self._stream(goal).spec
        assert isinstance(spec, ActionSpec)
        return spec

    def _is_wanted(self, goal: ServedGoal) -> bool:
        """Return whether the client's present boot epoch knows, or may know, the goal."""
        present = self._handshake.peer(goal.key.client).epoch
        return present is None or present in (goal.key.epoch, goal.claimed_in)

    def _take(self, key: GoalKey, now: int) -> ServedGoal | None:
        """Add a new goal; return None when there are too many."""
        nodes = self._table.nodes
        if nodes and key.client not in nodes:
            return None
        goal = ServedGoal(key)
        goal.deadline_at = now + seconds_to_ns(self._spec(goal).timeout_s)
        present = self._handshake.peer(key.client).present_epoch
        goal.claimed_in = None if present == key.epoch else present
        is_taken = self._goals.take(goal, goal.deadline_at + self.settling_ns, now)
        return goal if is_taken else None

    def _receive_goal(self, key: GoalKey, stream: Stream, payload: bytes, now: int) -> str | None:
        assert isinstance(stream.spec, ActionSpec)
        if stream.spec.journal and self._doubt.suspends(stream.spec.timeout_s, now):
            return "suspended"
        goal = self._take(key, now)
        if goal is None:
            return "too_many_goals"
        try:
            value = stream.codec.decode(payload)
        except PayloadError:
            self._refuse(goal, GoalFailure.BAD_GOAL, "the goal does not decode", now)
            return "payload"
        if stream.spec.journal and self._doubt.covers(self._spec(goal).timeout_s, now):
            self._refuse(goal, GoalFailure.UNKNOWN, self._doubt.reason, now)
            return None
        count(self._stats.received, stream.stream_id)

        def kept(at: int) -> None:
            goal.stage = ServedStage.OFFERED
            received = GoalReceived(goal=key, value=value, deadline_at=goal.deadline_at)
            self._emit(received)
            self._say(goal, Operation.CONFIRM, at)

        self._keep(goal, kept, now)
        return None

    def _receive_cancel(
        self, key: GoalKey, goal: ServedGoal | None, attempt: int, now: int
    ) -> str | None:
        if goal is None:
            # The cancel overtook its goal: the goal must not begin when it comes.
            goal = self._take(key, now)
            if goal is None:
                return "too_many_goals"
            self._refuse(goal, GoalFailure.CANCELLED, "", now)
        elif goal.stage is ServedStage.TAKEN:
            self._refuse(goal, GoalFailure.CANCELLED, "", now)
        elif goal.stage not in (ServedStage.OFFERED, ServedStage.RUNS):
            self._answer_again(goal, now)
        elif goal.cancel is CancelStage.ACCEPTED:
            self._say_cancel(goal, now)
        elif goal.cancel is CancelStage.NONE or is_later(attempt, goal.cancel_attempt):
            self._attempt_cancel(goal, attempt)
        elif attempt != goal.cancel_attempt:
            return "old_cancel"
        elif goal.cancel is CancelStage.REFUSED:
            self._say_cancel(goal, now)
        return None

    def _attempt_cancel(self, goal: ServedGoal, attempt: int) -> None:
        """Take a further attempt to cancel; an answer that is already awaited serves it too."""
        goal.cancel_attempt = attempt
        if goal.stage is ServedStage.OFFERED:
            goal.cancel = CancelStage.WANTED
        elif goal.cancel is not CancelStage.ASKED:
            self._ask_application(goal)

    def _ask_application(self, goal: ServedGoal) -> None:
        goal.cancel = CancelStage.ASKED
        self._emit(CancelRequested(goal=goal.key))

    def _say_cancel(self, goal: ServedGoal, now: int) -> None:
        stream, client = self._stream(goal), goal.key.client
        operation, payload = Operation.CANCEL, b""
        if goal.cancel is CancelStage.REFUSED:
            operation = Operation.REFUSED
            refusal = GoalRefusal(GoalFailure.CANCEL_REFUSED, goal.cancel_text, goal.cancel_attempt)
            payload = refusal.encode()
        if self._is_wanted(goal):
            lane = GoalLane.CANCEL_ANSWER
            self._outbox.say(goal.key, stream, client, operation, lane, now, payload)

    def _say(self, goal: ServedGoal, operation: Operation, now: int) -> None:
        """Send the state of a goal to its client, if the client wants it."""
        if self._is_wanted(goal):
            payload = goal.answer if operation is Operation.REFUSED else b""
            stream, client = self._stream(goal), goal.key.client
            self._outbox.say(goal.key, stream, client, operation, GoalLane.ANSWER, now, payload)

    def _answer_again(self, goal: ServedGoal, now: int) -> None:
        """Answer again, since the client has not heard the state of a goal."""
        match goal.stage:
            case ServedStage.TAKEN:
                pass
            case ServedStage.OFFERED:
                self._say(goal, Operation.CONFIRM, now)
            case ServedStage.RUNS:
                self._say(goal, Operation.ACCEPTED, now)
            case ServedStage.REFUSED:
                if goal.is_journalled:
                    self._say(goal, Operation.REFUSED, now)
            case ServedStage.ENDED:
                if goal.repetition is not None:
                    self._outbox.again(goal.repetition)
                elif goal.is_journalled:
                    self._push(goal, now)

    def _refuse(self, goal: ServedGoal, failure: GoalFailure, text: str, now: int) -> None:
        goal.stage, goal.answer = ServedStage.REFUSED, GoalRefusal(failure, text).encode()
        self._goals.forget_at(goal, goal.deadline_at + self.settling_ns)
        self._outbox.withdraw(goal.key, goal.key.client, GoalLane.ANSWER)

        self._keep(goal, partial(self._say, goal, Operation.REFUSED), now)

    def _finish(self, goal: ServedGoal, answer: bytes, now: int) -> None:
        goal.stage, goal.answer = ServedStage.ENDED, answer
        keeps_until = now + seconds_to_ns(self._spec(goal).result_timeout_s)
        self._goals.forget_at(goal, max(goal.deadline_at, keeps_until) + self.settling_ns)
        # The result also says that the goal was accepted and has ended.
        self._outbox.withdraw(
            goal.key, goal.key.client, GoalLane.ANSWER, GoalLane.CANCEL_ANSWER, GoalLane.FEEDBACK
        )
        count(self._stats.published, goal.key.stream_id)

        self._keep(goal, partial(self._push, goal), now)

    def _push(self, goal: ServedGoal, now: int) -> None:
        """Repeat a result until it is confirmed or no longer wanted."""
        if goal.is_confirmed or not self._is_wanted(goal):
            return
        assert goal.forget_at is not None
        stream = self._stream(goal)
        if not self._outbox.fits(goal.answer):
            # The link has shrunk since the size was checked: the status alone still fits.
            goal.answer = encode_result(GoalStatus(goal.answer[0]), None)
        has_result = goal.answer[:1] < UNKNOWN_RESULT
        operation, payload = shorten_result(goal.answer)
        goal.repetition = self._outbox.repeat(
            goal.key,
            stream,
            goal.key.client,
            operation,
            GoalLane.RESULT,
            now,
            payload=payload,
            codec=stream.response_codec if has_result else None,
            until=goal.forget_at,
            is_reminded=len(payload) >= _WORTH_A_REMINDER_BYTES,
        )

    def _result_confirmed(self, goal: ServedGoal, now: int) -> None:
        self._outbox.stop(goal.repetition, now, answered=True, prompt=True)
        goal.repetition = None
        if not goal.is_confirmed:
            goal.is_confirmed = True
            # Its GOAL may come once more until its deadline, and must not run again.
            self._goals.forget_at(goal, max(now, goal.deadline_at) + self.settling_ns)

    def _keep(self, goal: ServedGoal, then: Callable[[int], None], now: int) -> None:
        self._goals.keep(goal, (goal.stage.value, goal.answer), then, now)
