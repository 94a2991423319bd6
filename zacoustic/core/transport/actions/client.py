"""The goals that this node has sent: repeated, claimed, cancelled, and each ended once."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.stats import count
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.actions.clientgoal import ClientGoal, ClientStage
from zacoustic.core.transport.actions.clientjournal import ClientJournal
from zacoustic.core.transport.actions.clientrequests import ClientRequests
from zacoustic.core.transport.actions.events import (
    ActionEvent,
    CancelAnswered,
    FeedbackReceived,
    GoalAnswered,
    GoalFailed,
    GoalRecovered,
    ResultReceived,
)
from zacoustic.core.transport.actions.outbox import GoalLane, GoalOutbox
from zacoustic.core.transport.exchanges.numbers import NumberWindow
from zacoustic.core.transport.exchanges.taken import NEVER
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.goals import (
    REMINDER,
    GoalFailure,
    GoalKey,
    GoalStatus,
    Message,
    Operation,
    decode_refusal,
    decode_result,
)
from zacoustic.errors import JournalUnavailableError, QueueFullError


class GoalClient:
    """The goals that one node has sent.

    Args:
        context: What the components of its engine share.
        outbox: Queues the records.
    """

    def __init__(self, context: Context, outbox: GoalOutbox) -> None:
        self._address = context.address
        self._table = context.table
        self._numbering = context.sizes.goals
        self._outbox = outbox
        self._requests = ClientRequests(context.table, outbox)
        self._journal = ClientJournal(context.address, context.table, context.journal)
        self._handshake = context.handshake
        self._epoch = context.epoch
        self._timers = context.timers
        self._stats = context.stats
        self._emit: Callable[[ActionEvent], None] = context.emit
        self._goals: dict[GoalKey, ClientGoal] = {}
        self._numbers: dict[int, NumberWindow] = {}
        self.settling_ns = 0
        """Time in which every repetition of a frame arrives, ns."""

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the goals from before the restart and report them."""
        for goal in self._journal.recover(stored):
            self._goals[goal.key] = goal
            self._emit(GoalRecovered(goal=goal.key, tag=goal.tag))

    def link_up(self, now: int) -> None:
        """Ask for the outcomes of the goals from before the restart."""
        for goal in self._goals.values():
            if goal.stage is ClientStage.FOUND and goal.deadline_at == NEVER:
                goal.deadline_at = now + self._patience_ns(goal)
                self._claim(goal, now)

    # For the application

    def send(
        self,
        stream: Stream,
        spec: ActionSpec,
        value: object,
        now: int,
        timeout_s: float,
        tag: bytes,
    ) -> GoalKey:
        """Send a goal; see `Actions.send_goal`."""
        payload = stream.codec.encode(value)
        self._outbox.check_size(stream, payload)
        if spec.journal and self._journal.failure:
            raise JournalUnavailableError(
                f"{stream.name}: not accepted: the journal cannot be written: "
                f"{self._journal.failure}",
                hint="what is accepted has to survive a restart",
            )
        numbers = self._numbers_for(stream, spec, now)
        index, number = numbers.take()
        key = GoalKey(self._address, self._handshake.epoch, stream.stream_id, number)
        # After that the server no longer remembers the number.
        deadline_at = now + seconds_to_ns(min(timeout_s, spec.timeout_s))
        goal = ClientGoal(key, spec.server, ClientStage.OFFERED, deadline_at, tag)
        goal.numbers, goal.index = numbers, index
        self._goals[key] = goal
        self._arm(goal)
        # Drop what still waits about the last goal with this number.
        self._outbox.withdraw(key, spec.server, GoalLane.ANSWER)
        count(self._stats.published, stream.stream_id)
        if self._handshake.differs(spec.server, stream.stream_id):
            self._mismatch(goal, now)
            return key

        def kept(at: int) -> None:
            if goal.stage is not ClientStage.OFFERED:
                return
            self._requests.offer(goal, payload, at)

        self._journal.keep(goal, kept, now)
        return key

    def cancel(self, key: GoalKey, now: int) -> bool:
        """Cancel a goal; see `Actions.cancel_goal`."""
        goal = self._goals.get(key)
        if goal is None or goal.stage is ClientStage.ENDED:
            return False
        if goal.is_unsent:
            event = GoalAnswered(goal=key, accepted=False, failure=GoalFailure.CANCELLED)
            self._end(goal, now, event)
            return True
        if goal.cancel_stands:
            self._emit(CancelAnswered(goal=key, accepted=True))
        elif not goal.cancel_wanted:
            goal.cancel_wanted = True
            # Stop the GOAL: the goal must not begin any more.
            self._requests.stop_offer(goal, now)
            self._attempt_cancel(goal, now)
        return True

    # For the channel

    def receive(self, source: int, stream: Stream, message: Message, now: int) -> str | None:
        """Take a server's record about a goal; return why it is dropped, or None."""
        epoch = message.epoch
        if epoch is None:
            server = self._handshake.peer(source)
            if not server.knows_us and not server.confirms_now:
                # The record may be meant for an earlier boot epoch of this node.
                self._handshake.heard_too_short(source, now)
                return "unconfirmed"
            epoch = self._handshake.epoch
        elif epoch == self._handshake.epoch:
            self._handshake.heard_too_long(source, now)
        key = GoalKey(self._address, epoch, stream.stream_id, message.number)
        goal = self._goals.get(key)
        if goal is None:
            if message.operation is Operation.RESULT:
                self._confirm(key, stream, source, now)
            return "unexpected_answer"
        if goal.stage is ClientStage.ENDED:
            return "unexpected_answer"
        match message.operation:
            case Operation.REFUSED:
                return self._receive_refusal(goal, message.payload, now)
            case Operation.RESULT if message.payload == REMINDER:
                self._prove(goal, now)
                self._requests.stop_offer(goal, now, answered=True)
                self._requests.insist(goal, now)
                self._arm(goal)
            case Operation.RESULT:
                return self._receive_result(goal, stream, message.payload, now)
            case Operation.CONFIRM:
                self._prove(goal, now)
                self._requests.stop_offer(goal, now, answered=True, prompt=True)
                if goal.stage is ClientStage.OFFERED and goal.claim is None:
                    self._claim(goal, now)
            case Operation.ACCEPTED:
                self._runs(goal, now)
            case Operation.CANCEL:
                self._runs(goal, now)
                goal.cancel_stands = True
                self._cancel_answered(goal, True, "", now)
            case Operation.FEEDBACK:
                return self._receive_feedback(goal, stream, message.payload, now)
            case Operation.GOAL | Operation.FORMER:
                return "not_publisher"
        return None

    def stream_differs(self, server: int, stream_id: int, now: int) -> None:
        """Fail the goals of an action that its server defines differently."""
        for goal in list(self._goals.values()):
            if (goal.server, goal.key.stream_id) == (server, stream_id):
                self._mismatch(goal, now)

    def server_restarted(self, server: int, now: int) -> None:
        """Ask for the outcome of each goal that a restarted node had accepted."""
        for goal in self._goals.values():
            if goal.server == server and goal.stage is ClientStage.RUNS:
                self._claim(goal, now)

    def epoch_changed(self, now: int) -> None:
        """Send the goals again as goals of an earlier epoch: this node has begun a new one."""
        self._numbers.clear()
        for goal in self._goals.values():
            if goal.stage is ClientStage.ENDED:
                continue
            if goal.offer is not None:
                payload = goal.offer.record.payload
                self._outbox.stop(goal.offer, now)
                self._requests.offer(goal, payload, now)
            elif goal.stage is ClientStage.RUNS or goal.claim is not None:
                self._outbox.stop(goal.claim, now)
                self._claim(goal, now)
            if goal.cancel is not None:
                self._outbox.stop(goal.cancel, now)
                self._requests.cancel(goal, now)

    # Below the methods above

    def _arm(self, goal: ClientGoal) -> None:
        if goal.due_at is None:
            self._timers.cancel((Due.GOAL, goal.key))
        else:
            self._timers.at((Due.GOAL, goal.key), goal.due_at, partial(self._is_due, goal))

    def _is_due(self, goal: ClientGoal, now: int) -> None:
        """Ask for the outcome of a silent goal, or give it up."""
        if goal.deadline_at <= now:
            text = "no message about it came for too long"
            if goal.stage is ClientStage.OFFERED:
                text = "no answer before the deadline"
            self._fail(goal, GoalFailure.TIMED_OUT, text, now)
        else:
            self._claim(goal, now)

    def _claim(self, goal: ClientGoal, now: int) -> None:
        self._requests.claim(goal, now)
        self._arm(goal)

    def _numbers_for(self, stream: Stream, spec: ActionSpec, now: int) -> NumberWindow:
        """Return the numbers of an action, with the next one free.

        Raises:
            QueueFullError: As many goals as allowed are under way, or ended too recently.
        """
        taken = [key.number for key in self._goals if key.stream_id == stream.stream_id]
        numbers = self._numbers.get(stream.stream_id)
        if numbers is None:
            numbers = self._first_numbers(stream.stream_id, taken)
        if len(taken) < self._numbering.window:
            if numbers.may_begin(now, self.settling_ns):
                return numbers
            if numbers.is_stuck and self._epoch.renew(now):
                numbers = self._first_numbers(stream.stream_id, taken)
                if numbers.may_begin(now, self.settling_ns):
                    return numbers
        raise QueueFullError(
            f"stream {stream.stream_id}: {self._numbering.window} goals for node {spec.server} are "
            "under way, or have ended just now",
            hint="wait for results, or cancel goals",
        )

    def _first_numbers(self, stream_id: int, taken: list[int]) -> NumberWindow:
        numbers = NumberWindow(self._numbering, self._handshake.epoch, frozenset(taken))
        self._numbers[stream_id] = numbers
        return numbers

    def _stream(self, goal: ClientGoal) -> Stream:
        return self._table.by_id(goal.key.stream_id)

    def _patience_ns(self, goal: ClientGoal) -> int:
        spec = self._stream(goal).spec
        assert isinstance(spec, ActionSpec)
        return seconds_to_ns(spec.result_timeout_s)

    def _prove(self, goal: ClientGoal, now: int) -> None:
        """Note that the server has a goal."""
        if goal.numbers is not None:
            goal.numbers.proved(goal.index, now + self.settling_ns)

    def _runs(self, goal: ClientGoal, now: int) -> None:
        """Note that the server has accepted a goal."""
        self._prove(goal, now)
        self._requests.stop_offer(goal, now, answered=True)
        if goal.claim is not None:
            self._outbox.stop(goal.claim, now, answered=True)
            goal.claim = None
        patience_ns = self._patience_ns(goal)
        goal.claim_at, goal.deadline_at = now + patience_ns // 2, now + patience_ns
        self._arm(goal)
        if goal.stage is not ClientStage.RUNS:
            goal.stage = ClientStage.RUNS
            self._emit(GoalAnswered(goal=goal.key, accepted=True))

    def _receive_feedback(
        self, goal: ClientGoal, stream: Stream, payload: bytes, now: int
    ) -> str | None:
        try:
            value = stream.feedback_codec.decode(payload)
        except PayloadError:
            return "payload"
        self._runs(goal, now)
        count(self._stats.received, stream.stream_id)
        self._emit(FeedbackReceived(goal=goal.key, value=value))
        return None

    def _attempt_cancel(self, goal: ClientGoal, now: int) -> None:
        """Cancel a goal under an attempt number that no cancel of it has used in any boot epoch."""
        goal.attempt += 1
        attempt = goal.attempt

        def kept(at: int) -> None:
            is_open = goal.stage is not ClientStage.ENDED and goal.cancel_wanted
            if is_open and goal.attempt == attempt and goal.cancel is None:
                self._requests.cancel(goal, at)

        if attempt < goal.attempts_journalled:
            kept(now)
            return
        self._journal.keep(goal, kept, now)
        if self._journal.failure:
            # A vehicle that does not stop is worse than an application that gets a cancel twice.
            kept(now)

    def _cancel_answered(self, goal: ClientGoal, accepted: bool, text: str, now: int) -> None:
        if goal.cancel is not None:
            self._outbox.stop(goal.cancel, now, answered=True)
            goal.cancel = None
        if goal.cancel_wanted:
            goal.cancel_wanted = False
            self._emit(CancelAnswered(goal=goal.key, accepted=accepted, text=text))

    def _receive_refusal(self, goal: ClientGoal, payload: bytes, now: int) -> str | None:
        refusal = decode_refusal(payload)
        if refusal is None:
            return "payload"
        failure, text = refusal.failure, refusal.text
        if failure is GoalFailure.CANCEL_REFUSED:
            self._runs(goal, now)
            if not refusal.is_of(goal.attempt):
                return "old_cancel"
            self._cancel_answered(goal, False, text, now)
            return None
        may_have_run = goal.stage is ClientStage.RUNS or (
            goal.stage is ClientStage.FOUND and failure is GoalFailure.CANCELLED
        )
        if failure is GoalFailure.UNKNOWN or may_have_run:
            text = "the server does not know it any more"
            self._fail(goal, GoalFailure.UNKNOWN, text, now)
            return None
        self._prove(goal, now)
        event = GoalAnswered(goal=goal.key, accepted=False, failure=failure, text=text)
        self._end(goal, now, event, answered=True)
        return None

    def _receive_result(
        self, goal: ClientGoal, stream: Stream, payload: bytes, now: int
    ) -> str | None:
        self._prove(goal, now)
        decoded = decode_result(payload)
        if decoded is not None and decoded[0] is GoalStatus.UNKNOWN:
            text = "the server died while it ran, or has lost it"
            self._fail(goal, GoalFailure.UNKNOWN, text, now, confirms=True)
            return None
        value: Any = None
        try:
            if decoded is None:
                raise PayloadError("status")
            status, result = decoded
            value = None if result is None else stream.response_codec.decode(result)
        except PayloadError:
            text = "the result does not decode"
            self._fail(goal, GoalFailure.BAD_RESULT, text, now, confirms=True)
            return "payload"
        count(self._stats.received, stream.stream_id)
        ended = ResultReceived(goal=goal.key, status=status, value=value)
        if goal.stage is ClientStage.RUNS:
            self._end(goal, now, ended, answered=True, confirms=True)
        else:
            accepted = GoalAnswered(goal=goal.key, accepted=True)
            self._end(goal, now, accepted, ended, answered=True, confirms=True)
        return None

    def _mismatch(self, goal: ClientGoal, now: int) -> None:
        if goal.stage is not ClientStage.ENDED:
            text = f"node {goal.server} defines stream {goal.key.stream_id} in another way"
            self._fail(goal, GoalFailure.TABLE_MISMATCH, text, now)

    def _fail(
        self,
        goal: ClientGoal,
        failure: GoalFailure,
        text: str,
        now: int,
        *,
        confirms: bool = False,
    ) -> None:
        event = GoalFailed(goal=goal.key, failure=failure, text=text)
        self._end(goal, now, event, confirms=confirms)

    def _end(
        self,
        goal: ClientGoal,
        now: int,
        *events: ActionEvent,
        answered: bool = False,
        confirms: bool = False,
    ) -> None:
        """End a goal: emit its events, forget it, and only then let the server forget it.

        If this node dies meanwhile, it learns the outcome again after the restart; it is never
        lost.
        """
        goal.stage = ClientStage.ENDED
        self._arm(goal)
        for repetition in (goal.offer, goal.claim):
            self._outbox.stop(repetition, now, answered=answered)
        self._outbox.stop(goal.cancel, now)
        for event in events:
            self._emit(event)

        def forgotten(at: int) -> None:
            del self._goals[goal.key]
            if goal.numbers is not None:
                goal.numbers.ended(goal.index, goal.repetitions)
            if confirms:
                self._confirm(goal.key, self._stream(goal), goal.server, at)

        self._journal.forget(goal.key, forgotten, now)

    def _confirm(self, key: GoalKey, stream: Stream, server: int, now: int) -> None:
        """Let a server forget a result that this node has."""
        numbers = self._numbers.get(key.stream_id)
        if numbers is not None and key.epoch == self._handshake.epoch:
            numbers.rest(key.number, now + self.settling_ns)
        self._outbox.say(key, stream, server, Operation.CONFIRM, GoalLane.ANSWER, now)
