"""The goals of a node on a link."""

import asyncio
from collections.abc import Callable
from typing import Any

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
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.goals import GoalEnd, GoalHandler, SentGoal, TakeFeedback, goal_error
from zacoustic.zenoh.node.onlink.calls import add_server
from zacoustic.zenoh.node.routes import ActionRoute


class LinkGoals:
    """The goals that this node has sent, and those that it executes.

    Args:
        runner: Drives the engine.
        table: The streams.
    """

    def __init__(self, runner: LinkRunner, table: StreamTable) -> None:
        self.runner = runner
        self._table = table
        self._sent: dict[GoalKey, LinkSentGoal] = {}
        self._handlers: dict[int, GoalHandler] = {}
        self._taken: dict[GoalKey, LinkTakenGoal] = {}

    async def send(
        self,
        route: ActionRoute[Any, Any, Any],
        value: object,
        timeout_s: float | None,
        feed: TakeFeedback,
        tag: bytes,
    ) -> "LinkSentGoal":
        """Send a goal and wait for the answer; cancelling this call cancels the goal."""
        stream_id = route.known_stream.stream_id

        def begin(engine: Engine, now: int) -> LinkSentGoal:
            key = engine.actions.send_goal(stream_id, value, now, timeout_s=timeout_s, tag=tag)
            sent = self._sent[key] = LinkSentGoal(self, route.name, key, feed, tag)
            return sent  # before the events of the engine are polled

        sent = self.runner.apply(begin)
        try:
            await asyncio.shield(sent.known)
        except asyncio.CancelledError:
            self.runner.try_apply(lambda engine, now: engine.actions.cancel_goal(sent.key, now))
            raise
        sent.raise_error()
        return sent

    def recovered(
        self, route: ActionRoute[Any, Any, Any], feed: TakeFeedback
    ) -> list["LinkSentGoal"]:
        """Return the goals sent before the restart that no caller has taken yet."""
        stream_id = route.known_stream.stream_id
        found = [
            sent
            for sent in self._sent.values()
            if sent.key.stream_id == stream_id and sent.feed is None
        ]
        for sent in found:
            sent.feed = feed
            self._forget_ended(sent)
        return found

    def serve(self, route: ActionRoute[Any, Any, Any], handler: GoalHandler) -> Callable[[], None]:
        """Pass on the goals of an action; return the function that ends it.

        Raises:
            LocalError: This node already serves the action.
        """
        return add_server(self._handlers, route, handler)

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
                name = self._table.by_id(event.goal.stream_id).name
                found = LinkSentGoal(self, name, event.goal, None, event.tag)
                self._sent[event.goal] = found
            case _:
                sent = self._sent.get(event.goal)
                if sent is not None:
                    sent.hear(event)
                    self._forget_ended(sent)

    def end_all(self, error: Exception) -> None:
        """Inform the waiting callers that no answer will come."""
        sent = list(self._sent.values())
        self._sent.clear()
        self._taken.clear()
        for each in sent:
            each.end_with(GoalEnd(error=error))

    def forget(self, key: GoalKey) -> None:
        """Forget a taken goal that has ended."""
        self._taken.pop(key, None)

    def _forget_ended(self, sent: "LinkSentGoal") -> None:
        """Forget an ended goal, unless it is from before the restart and nobody has asked for it.

        It may end before the application has created its client.
        """
        if sent.over.done() and sent.feed is not None:
            self._sent.pop(sent.key, None)

    def _take(self, event: GoalReceived) -> None:
        taken = self._taken[event.goal] = LinkTakenGoal(self, event)
        handler = self._handlers.get(event.goal.stream_id)
        if handler is None:
            name = self._table.by_id(event.goal.stream_id).name
            taken.reject(GoalFailure.NO_SERVER, f"no program serves {name}")
        else:
            handler.take(taken)


class LinkSentGoal(SentGoal):
    """A goal that this node has sent."""

    def __init__(
        self, goals: LinkGoals, name: str, key: GoalKey, feed: TakeFeedback | None, tag: bytes
    ) -> None:
        super().__init__(name, feed, tag)
        self.key = key
        self._goals = goals

    def hear(self, event: ActionEvent) -> None:
        """Take an event of the goal."""
        match event:
            case GoalAnswered(accepted=True):
                self.accept()
            case GoalAnswered():
                assert event.failure is not None
                self.reject(event.failure, event.text)
            case FeedbackReceived():
                if self.feed is not None:
                    self.feed(event.value)
            case CancelAnswered():
                self.answer_cancels(event.accepted, event.text)
            case ResultReceived():
                self.end_with(GoalEnd(status=event.status, value=event.value))
            case GoalFailed(failure=GoalFailure.UNKNOWN):
                self.end_with(GoalEnd(text=event.text))
            case GoalFailed():
                error = goal_error(self._name, event.failure, event.text)
                self.end_with(GoalEnd(text=event.text, error=error))
            case _:
                pass

    def _ask_cancel(self) -> bool:
        return self._goals.runner.apply(
            lambda engine, now: engine.actions.cancel_goal(self.key, now)
        )


class LinkTakenGoal:
    """A goal that arrived over the link; see `TakenGoal`."""

    def __init__(self, goals: LinkGoals, event: GoalReceived) -> None:
        self.value: Any = event.value
        self.client: int | None = event.goal.client
        self._key = event.goal
        self._goals = goals

    def accept(self) -> bool:
        """Accept the goal."""
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

    def finish(self, status: GoalStatus, value: object) -> bool:
        """End the goal."""
        self._goals.forget(self._key)
        return self._apply(lambda engine, now: engine.actions.finish(self._key, status, value, now))

    def answer_cancel(self, accepted: bool, text: str) -> bool:
        """Answer the request to cancel the goal."""
        return self._apply(
            lambda engine, now: engine.actions.answer_cancel(
                self._key, now, accepted=accepted, text=text
            )
        )

    def _apply(self, command: Callable[[Engine, int], bool]) -> bool:
        return bool(self._goals.runner.try_apply(command))
