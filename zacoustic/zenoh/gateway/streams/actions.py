"""Actions: local goals for remote servers, and received goals.

A local goal arrives in a `LocalGoalServer`, which represents the remote server. Its local id, 16
bytes, does not cross: on the channel a goal has a number. The engine keeps the id as its tag, so a
restarted gateway still knows it.

A received goal becomes a `LocalGoalRequest`: sent to the local program that serves the action, and
followed to its end. If the program ends without a result, the outcome is unknown, and the client
is informed.
"""

import random
from collections.abc import Callable
from typing import Final

import zenoh

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailure, GoalFailure, GoalKey, GoalStatus
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.actions.events import (
    ActionEvent,
    CancelAnswered,
    CancelRequested,
    FeedbackReceived,
    GoalAnswered,
    GoalFailed,
    GoalReceived,
    GoalRecovered,
    ResultReceived,
)
from zacoustic.errors import LocalError, PayloadInvalidError, ZacousticError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.dialect.dialects import Dialects
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.session.asking.goalrequest import FeedbackEar, LocalGoalRequest
from zacoustic.zenoh.session.asking.goals import GOAL_ID_BYTES, ActionForm, Ending, Verdict
from zacoustic.zenoh.session.asking.goalserver import LocalGoalServer, Put
from zacoustic.zenoh.session.asking.queries import HeldQuery
from zacoustic.zenoh.session.marker import Marker
from zacoustic.zenoh.session.session import ZenohSession

PROGRAM_PATIENCE_S: Final = 10.0
"""How long a program that executes a goal, or the router, may be away, s."""
# Zenoh refuses a limit of 0.
_LEAST_LIMIT_S: Final = 0.001

_AS_CALL: Final = {
    GoalFailure.TIMED_OUT: CallFailure.TIMED_OUT,
    GoalFailure.TABLE_MISMATCH: CallFailure.TABLE_MISMATCH,
    GoalFailure.BAD_RESULT: CallFailure.BAD_RESPONSE,
}


class Actions:
    """The actions of one gateway; for the loop, except for `ear`.

    Args:
        address: Address of this node.
        table: All streams.
        zenoh_session: The session of the goals.
        input_errors: Takes the errors of local programs.
        dialects: The local forms of actions.
        runner: Drives the engine.
        clock: Source of instants.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        zenoh_session: ZenohSession,
        input_errors: InputErrors,
        dialects: Dialects,
        *,
        runner: LinkRunner,
        clock: Clock,
    ) -> None:
        self._table = table
        self.forms = {
            stream.stream_id: dialects.action(stream)
            for stream in table
            if isinstance(stream.spec, ActionSpec)
        }
        """The local form of each action, by stream id."""
        self._proxies: dict[int, _Proxy] = {}
        self._attendants: dict[int, _Attendant] = {}
        for stream in table:
            if not isinstance(stream.spec, ActionSpec):
                continue
            if stream.spec.server == address:
                form = self.forms[stream.stream_id]
                attendant = _Attendant(
                    stream, form, zenoh_session, input_errors, runner=runner, clock=clock
                )
                self._attendants[stream.stream_id] = attendant
            else:
                form = self.forms[stream.stream_id]
                put = dialects.put_about_goals(stream, form)
                self._proxies[stream.stream_id] = _Proxy(
                    stream, form, put, input_errors, runner=runner, clock=clock
                )

    def ask(self, stream_id: int, held: HeldQuery) -> None:
        """Take a query about goals for a remote server."""
        self._proxies[stream_id].goal_server.take(held)

    def ear(self, stream_id: int) -> Callable[[zenoh.Sample], None]:
        """Return a function that takes the local program's feedback, on Zenoh's thread."""
        return self._attendants[stream_id].ear.take

    def deliver(self, event: ActionEvent) -> None:
        """Take an event of the engine."""
        stream_id = event.goal.stream_id
        if isinstance(event, GoalReceived | CancelRequested):
            self._attendants[stream_id].deliver(event)
        else:
            self._proxies[stream_id].deliver(event)

    def close(self) -> None:
        """Stop asking the local network."""
        for attendant in self._attendants.values():
            attendant.close()


class _Proxy:
    """Represents the remote server of one action locally; see `Pursuer`."""

    def __init__(
        self,
        stream: Stream,
        form: ActionForm,
        put: Put,
        input_errors: InputErrors,
        *,
        runner: LinkRunner,
        clock: Clock,
    ) -> None:
        self._stream = stream
        self._input_errors = input_errors
        self._runner = runner
        self._ids: dict[GoalKey, bytes] = {}
        self._keys: dict[bytes, GoalKey] = {}
        assert isinstance(stream.spec, ActionSpec)
        self._form = form
        self.goal_server = LocalGoalServer(
            form,
            self,
            put=put,
            keep_s=stream.spec.result_timeout_s,
            clock=clock,
            mark=Marker(acoustic=stream.spec.server).encode(),
        )

    # For the goal server

    def begin(self, goal_id: bytes, value: object, held: HeldQuery) -> None:
        """Send a goal to a remote server."""
        attachment = held.query.attachment
        if attachment is not None and self._form.is_marked(attachment.to_bytes()):
            raise LocalError("the goal came off the channel, it does not go back")

        def send(engine: Engine, now: int) -> None:
            key = engine.actions.send_goal(self._stream.stream_id, value, now, tag=goal_id)
            self._learn(key, goal_id)  # before the events of the engine are polled

        try:
            self._runner.apply(send)
        except LocalError as error:
            self._input_errors.add(self._stream.name, "goal", str(error))
            raise

    def cancel(self, goal_id: bytes) -> None:
        """Cancel a remote goal."""
        key = self._keys.get(goal_id)
        if key is not None:
            self._runner.try_apply(lambda engine, now: engine.actions.cancel_goal(key, now))

    # From the channel

    def deliver(self, event: ActionEvent) -> None:
        """Take an event about a local goal."""
        if isinstance(event, GoalRecovered):
            if len(event.tag) == GOAL_ID_BYTES:
                self._learn(event.goal, event.tag)
                self.goal_server.adopt(event.tag)
            return
        goal_id = self._ids.get(event.goal)
        if goal_id is None:
            return
        match event:
            case GoalAnswered():
                verdict = Verdict(accepted=event.accepted, failure=event.failure, text=event.text)
                self.goal_server.answer(goal_id, verdict)
                if not event.accepted:
                    self._forget(event.goal)
            case FeedbackReceived():
                try:
                    self.goal_server.feed(goal_id, event.value)
                except PayloadInvalidError as error:
                    self._input_errors.add(self._stream.name, "feedback", str(error))
            case CancelAnswered():
                verdict = Verdict(accepted=event.accepted, text=event.text)
                self.goal_server.answer_cancel(goal_id, verdict)
            case ResultReceived():
                self._forget(event.goal)
                try:
                    self.goal_server.end(goal_id, Ending(status=event.status, result=event.value))
                except PayloadInvalidError as error:
                    self.goal_server.fail(goal_id, CallFailure.BAD_RESPONSE, str(error))
            case GoalFailed():
                self._forget(event.goal)
                if event.failure is GoalFailure.UNKNOWN:
                    self.goal_server.end(
                        goal_id, Ending(status=GoalStatus.UNKNOWN, text=event.text)
                    )
                else:
                    failure = _AS_CALL.get(event.failure, CallFailure.NO_SERVER)
                    self.goal_server.fail(goal_id, failure, event.text)
            case _:
                pass

    def _learn(self, key: GoalKey, goal_id: bytes) -> None:
        self._ids[key] = goal_id
        self._keys[goal_id] = key

    def _forget(self, key: GoalKey) -> None:
        self._keys.pop(self._ids.pop(key), None)


class _Attendant:
    """Takes the received goals of one action to the local program; see `GoalSender`."""

    def __init__(
        self,
        stream: Stream,
        form: ActionForm,
        zenoh_session: ZenohSession,
        input_errors: InputErrors,
        *,
        runner: LinkRunner,
        clock: Clock,
    ) -> None:
        self._stream = stream
        self._form = form
        self._zenoh_session = zenoh_session
        self._input_errors = input_errors
        self._runner = runner
        self._clock = clock
        # Random, so that no two gateways and no two boot epochs give two goals the same id.
        self._rng = random.SystemRandom()
        self._keys: dict[bytes, GoalKey] = {}
        self._ids: dict[GoalKey, bytes] = {}
        self._goal_requests: dict[bytes, LocalGoalRequest] = {}
        self._accepted: set[bytes] = set()
        self.ear = FeedbackEar(form, self._feed, hears_marked=False)

    def deliver(self, event: GoalReceived | CancelRequested) -> None:
        """Take an event about a received goal."""
        if isinstance(event, CancelRequested):
            goal_request = self._goal_requests.get(self._ids.get(event.goal, b""))
            if goal_request is not None:
                goal_request.cancel()
            return
        goal_id = self._rng.randbytes(GOAL_ID_BYTES)
        self._keys[goal_id], self._ids[event.goal] = event.goal, goal_id
        goal_request = self._goal_requests[goal_id] = LocalGoalRequest(
            self._zenoh_session,
            self._form,
            goal_id,
            self,
            priority=self._stream.qos.priority,
            patience_s=PROGRAM_PATIENCE_S,
            mark=Marker(acoustic=event.goal.client).encode(),
        )
        left_s = ns_to_seconds(event.deadline_at - self._clock())
        goal_request.begin(event.value, max(left_s, _LEAST_LIMIT_S))

    def close(self) -> None:
        """Stop asking the local network."""
        for goal_request in self._goal_requests.values():
            goal_request.close()

    # From the program

    def answered(self, goal_id: bytes, verdict: Verdict) -> None:
        """The program has accepted or rejected a goal."""
        key = self._keys.get(goal_id)
        if key is None:
            return
        if not verdict.accepted:
            self._reject(goal_id, verdict.failure or GoalFailure.REJECTED, verdict.text)
            return
        self._accepted.add(goal_id)
        if not self._runner.try_apply(lambda engine, now: engine.actions.accept(key, now)):
            # Its client has meanwhile given it up: it must not run.
            self._goal_requests[goal_id].cancel()

    def cancel_answered(self, goal_id: bytes, verdict: Verdict) -> None:
        """The program will end a goal, or will not."""
        key = self._keys.get(goal_id)
        if key is not None:
            self._runner.try_apply(
                lambda engine, now: engine.actions.answer_cancel(
                    key, now, accepted=verdict.accepted, text=verdict.text
                ),
            )

    def ended(self, goal_id: bytes, ending: Ending) -> None:
        """A goal has ended."""
        self._finish(goal_id, ending.status, ending.result)

    def lost(self, goal_id: bytes, failure: CallFailure, text: str) -> None:
        """The program does not answer any more."""
        if goal_id in self._accepted:
            self._input_errors.add(self._stream.name, "lost", f"{failure.name}: {text}")
            self._finish(goal_id, GoalStatus.UNKNOWN, None)
        else:
            said = GoalFailure.NO_SERVER if failure is CallFailure.NO_SERVER else None
            self._reject(goal_id, said or GoalFailure.REJECTED, text)

    # Below the methods above

    def _feed(self, goal_id: bytes, value: object) -> None:
        key = self._keys.get(goal_id)
        if key is None:
            return
        try:
            self._runner.try_apply(
                lambda engine, now: engine.actions.publish_feedback(key, value, now),
            )
        except ZacousticError as error:
            self._input_errors.add(self._stream.name, "feedback", str(error))

    def _reject(self, goal_id: bytes, failure: GoalFailure, text: str) -> None:
        key = self._forget(goal_id)
        if key is not None:
            self._runner.try_apply(
                lambda engine, now: engine.actions.reject(key, now, text=text, failure=failure),
            )

    def _finish(self, goal_id: bytes, status: GoalStatus, result: object) -> None:
        key = self._forget(goal_id)
        if key is None:
            return
        try:
            self._runner.try_apply(
                lambda engine, now: engine.actions.finish(key, status, result, now),
            )
        except ZacousticError as error:  # the engine has aborted the goal
            self._input_errors.add(self._stream.name, "result", str(error))

    def _forget(self, goal_id: bytes) -> GoalKey | None:
        goal_request = self._goal_requests.pop(goal_id, None)
        if goal_request is not None:
            goal_request.close()
        self._accepted.discard(goal_id)
        key = self._keys.pop(goal_id, None)
        if key is not None:
            self._ids.pop(key, None)
        return key
