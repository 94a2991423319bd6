"""Goals at the engine: those of remote clients, and those for remote servers."""

from collections.abc import Callable

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import GoalFailure, GoalKey, GoalStatus
from zacoustic.core.streams.table import StreamTable
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
from zacoustic.errors import PayloadInvalidError, ZacousticError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.ends.enginecalls import add_server
from zacoustic.zenoh.ends.goals import Complain, GoalClient, GoalHandler, TakenGoal


class EngineGoals:
    """The goals of one node at its engine.

    Args:
        runner: Drives the engine.
        table: The streams.
        complain: Takes what cannot be passed on.
        recover: Takes a goal from before the restart, and returns its client; None: it has none.
    """

    def __init__(
        self,
        runner: LinkRunner,
        table: StreamTable,
        *,
        complain: Complain,
        recover: "Callable[[EngineGivenGoal], GoalClient | None]",
    ) -> None:
        self.runner = runner
        self.complain = complain
        self._table = table
        self._recover = recover
        self._given: dict[GoalKey, EngineGivenGoal] = {}
        self._taken: dict[GoalKey, EngineTakenGoal] = {}
        self._handlers: dict[int, GoalHandler] = {}

    def give(
        self,
        stream_id: int,
        value: object,
        client: GoalClient,
        *,
        timeout_s: float | None = None,
        tag: bytes = b"",
    ) -> "EngineGivenGoal":
        """Send a goal to its remote server.

        Args:
            stream_id: The action.
            value: The goal.
            client: Hears what becomes of it.
            timeout_s: Time limit for the answer, s; None: the action's own.
            tag: Bytes that a restarted node has with the goal.

        Raises:
            LocalError: It cannot be sent.
        """

        def send(engine: Engine, now: int) -> EngineGivenGoal:
            key = engine.actions.send_goal(stream_id, value, now, timeout_s=timeout_s, tag=tag)
            given = self._given[key] = EngineGivenGoal(self, self.name_of(key), key, tag)
            given.client = client
            return given  # before the events of the engine are polled

        return self.runner.apply(send)

    def serve(self, stream_id: int, handler: GoalHandler) -> Callable[[], None]:
        """Pass on the goals of an action; return the function that ends it.

        Raises:
            LocalError: This node already serves the action.
        """
        return add_server(self._handlers, self._table.by_id(stream_id), handler)

    def deliver(self, event: ActionEvent) -> None:
        """Take an event of the engine."""
        match event:
            case GoalReceived():
                self._take(event)
            case CancelRequested():
                taken = self._taken.get(event.goal)
                handler = self._handlers.get(event.goal.stream_id)
                if taken is not None and handler is not None:
                    handler.cancel(taken)
            case GoalRecovered():
                given = EngineGivenGoal(self, self.name_of(event.goal), event.goal, event.tag)
                given.client = self._recover(given)
                self._given[event.goal] = given
            case _:
                known = self._given.get(event.goal)
                if known is not None:
                    known.hear(event)

    def name_of(self, key: GoalKey) -> str:
        """Return the name of a goal's action."""
        return self._table.by_id(key.stream_id).name

    def forget(self, key: GoalKey) -> None:
        """Forget a goal that has ended."""
        self._given.pop(key, None)
        self._taken.pop(key, None)

    def _take(self, event: GoalReceived) -> None:
        taken = self._taken[event.goal] = EngineTakenGoal(self, event)
        handler = self._handlers.get(event.goal.stream_id)
        if handler is None:
            text = f"no program serves {self.name_of(event.goal)}"
            taken.reject(GoalFailure.NO_SERVER, text)
            return
        try:
            handler.take(taken)
        except ZacousticError as error:
            taken.reject(GoalFailure.BAD_GOAL, str(error))


class EngineGivenGoal:
    """A goal for a remote server."""

    def __init__(self, goals: EngineGoals, name: str, key: GoalKey, tag: bytes) -> None:
        self.name = name
        self.key = key
        self.tag = tag
        self.client: GoalClient | None = None
        self._goals = goals

    def cancel(self) -> bool:
        """Ask the server to end the goal; False: it has ended."""
        return bool(
            self._goals.runner.try_apply(
                lambda engine, now: engine.actions.cancel_goal(self.key, now)
            )
        )

    def hear(self, event: ActionEvent) -> None:
        """Take an event of the goal."""
        client = self.client
        is_over = isinstance(event, ResultReceived | GoalFailed)
        if is_over or (isinstance(event, GoalAnswered) and not event.accepted):
            self._goals.forget(self.key)
        if client is None:
            return
        match event:
            case GoalAnswered(accepted=True):
                if not client.accept():
                    self.cancel()
            case GoalAnswered():
                client.reject(event.failure or GoalFailure.REJECTED, event.text)
            case FeedbackReceived():
                try:
                    client.feed(event.value)
                except PayloadInvalidError as error:
                    self._goals.complain(self.name, "feedback", str(error))
            case CancelAnswered():
                client.answer_cancel(event.accepted, event.text)
            case ResultReceived():
                try:
                    client.finish(event.status, event.value)
                except PayloadInvalidError as error:
                    client.lose(GoalFailure.BAD_RESULT, str(error))
            case GoalFailed():
                client.lose(event.failure, event.text)
            case _:
                pass


class EngineTakenGoal(TakenGoal):
    """A goal of a remote client."""

    def __init__(self, goals: EngineGoals, event: GoalReceived) -> None:
        super().__init__(event.value, event.goal.client)
        self.deadline_at = event.deadline_at
        """Instant after which its client gives it up unless it is answered, ns."""
        self._key = event.goal
        self._goals = goals
        self._is_accepted = False

    def accept(self) -> bool:
        """Accept the goal."""
        self._is_accepted = True
        return self._apply(lambda engine, now: engine.actions.accept(self._key, now))

    def reject(self, failure: GoalFailure, text: str) -> bool:
        """Reject the goal."""
        self._goals.forget(self._key)
        return self._apply(
            lambda engine, now: engine.actions.reject(self._key, now, text=text, failure=failure)
        )

    def feed(self, value: object) -> bool:
        """Send feedback."""
        return self._apply(
            lambda engine, now: engine.actions.publish_feedback(self._key, value, now)
        )

    def answer_cancel(self, accepted: bool, text: str) -> bool:
        """Answer the request to cancel the goal."""
        return self._apply(
            lambda engine, now: engine.actions.answer_cancel(
                self._key, now, accepted=accepted, text=text
            )
        )

    def finish(self, status: GoalStatus, value: object, text: str = "") -> bool:
        """End the goal; if the result cannot be sent, the engine aborts it."""
        self._goals.forget(self._key)
        return self._apply(lambda engine, now: engine.actions.finish(self._key, status, value, now))

    def lose(self, failure: GoalFailure, text: str) -> bool:
        """Tell the client that the outcome is unknown, or that nobody serves the action."""
        if self._is_accepted:
            name = self._goals.name_of(self._key)
            self._goals.complain(name, "lost", f"{failure.name}: {text}")
            return self.finish(GoalStatus.UNKNOWN, None)
        is_absent = failure is GoalFailure.NO_SERVER
        return self.reject(failure if is_absent else GoalFailure.REJECTED, text)

    def _apply(self, command: Callable[[Engine, int], bool]) -> bool:
        return bool(self._goals.runner.try_apply(command))
