"""The goals of a node on a Zenoh session.

`zacoustic.zenoh.session.asking.goals` defines the messages.
"""

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import zenoh

from zacoustic.core.engine.events import CallFailure, GoalFailure, GoalStatus
from zacoustic.errors import LinkClosedError, PayloadInvalidError
from zacoustic.run.inbox import WakeUp
from zacoustic.zenoh.node.carrier import call_error
from zacoustic.zenoh.node.form import Form
from zacoustic.zenoh.node.goals import GoalEnd, GoalHandler, SentGoal, TakeFeedback
from zacoustic.zenoh.node.onzenoh.session import zenoh_errors
from zacoustic.zenoh.node.routes import ActionRoute
from zacoustic.zenoh.session.asking.goalrequest import FeedbackEar, LocalGoalRequest
from zacoustic.zenoh.session.asking.goals import (
    GOAL_ID_BYTES,
    ActionKey,
    ActionMessages,
    Ending,
    Verdict,
)
from zacoustic.zenoh.session.asking.goalserver import LocalGoalServer
from zacoustic.zenoh.session.asking.queries import HeldQuery, QueryHandler
from zacoustic.zenoh.session.marker import read_marker
from zacoustic.zenoh.session.session import ZenohSession

QUERIES_LIMIT: Final = 256
"""Most queries about the goals of one action that are held at once."""
_CLOSED_TEXT: Final = "the action server was closed"
# Zenoh's own time limit is above ours, because our error says more.
_BEHIND_S: Final = 1.0
# A restarted gateway is back after some seconds.
_PATIENCE_S: Final = 120.0

Route = ActionRoute[Any, Any, Any]
Keep = Callable[[Callable[[], None]], Callable[[], None]]
"""Remembers how to end a declaration; returns a function that ends it once."""


class ZenohGoals:
    """The goals that this node has sent, and those that it executes.

    Args:
        zenoh_session: Returns the session.
        keep: Remembers how to end a declaration.
    """

    def __init__(self, zenoh_session: Callable[[], ZenohSession], keep: Keep) -> None:
        self._zenoh_session = zenoh_session
        self._keep = keep
        self._sent: dict[bytes, ZenohSentGoal] = {}
        self._ears: set[str] = set()

    async def send(
        self,
        route: Route,
        value: object,
        timeout_s: float | None,
        feed: TakeFeedback,
        tag: bytes,
    ) -> SentGoal:
        """Send a goal and wait for the answer; cancelling this call cancels the goal."""
        messages = messages_of(route)
        limit_s = route.timeout_s if timeout_s is None else min(timeout_s, route.timeout_s)
        self._hear(route, messages)
        goal_id = os.urandom(GOAL_ID_BYTES)
        checked = _checked(route.goal, value)
        sent = ZenohSentGoal(self._zenoh_session(), route, messages, goal_id, feed, tag)
        self._sent[goal_id] = sent
        try:
            sent.goal_request.begin(checked, limit_s + _BEHIND_S)
            async with asyncio.timeout(limit_s):
                await asyncio.shield(sent.known)
        except (TimeoutError, asyncio.CancelledError) as error:
            sent.goal_request.cancel()
            self._sent.pop(goal_id, None)
            if isinstance(error, asyncio.CancelledError):
                raise
            text = f"no answer within {limit_s:g} s"
            raise call_error(route.name, CallFailure.TIMED_OUT, text) from None
        sent.over.add_done_callback(lambda _: self._sent.pop(goal_id, None))
        sent.raise_error()
        return sent

    def recovered(self, route: Route, feed: TakeFeedback) -> Sequence[SentGoal]:
        """Return nothing: the gateway keeps the goals."""
        return ()

    def serve(self, route: Route, handler: GoalHandler) -> Callable[[], None]:
        """Declare the queryable of an action."""
        zenoh_session = self._zenoh_session()
        server = _Server(route, handler, zenoh_session)
        with zenoh_errors(route.name):
            queryable = zenoh_session.session.declare_queryable(
                zenoh.KeyExpr(*messages_of(route).served()),
                zenoh_session.callback(server.bring),
                complete=True,
                allowed_origin=zenoh.Locality.REMOTE,
            )

        def end() -> None:
            queryable.undeclare()  # type: ignore[no-untyped-call]
            server.close()

        return self._keep(end)

    def close(self) -> None:
        """Inform the waiting callers that no answer will come."""
        sent = list(self._sent.values())
        self._sent.clear()
        for each in sent:
            each.goal_request.close()
            each.end_with(GoalEnd(error=LinkClosedError("the node was closed")))

    def _hear(self, route: Route, messages: ActionMessages) -> None:
        """Subscribe to the feedback of an action, once."""
        if route.name in self._ears:
            return
        zenoh_session = self._zenoh_session()
        ear = FeedbackEar(messages, self._take_feedback, hears_marked=True)
        with zenoh_errors(route.name):
            subscriber = zenoh_session.session.declare_subscriber(
                zenoh.KeyExpr(ActionKey.FEEDBACK.of(route.name)),
                zenoh_session.callback(ear.take),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        self._ears.add(route.name)
        self._keep(subscriber.undeclare)

    def _take_feedback(self, goal_id: bytes, value: object) -> None:
        sent = self._sent.get(goal_id)
        if sent is not None and sent.feed is not None and not sent.over.done():
            sent.feed(value)


class ZenohSentGoal(SentGoal):
    """A goal that this node has sent."""

    def __init__(
        self,
        zenoh_session: ZenohSession,
        route: Route,
        messages: ActionMessages,
        goal_id: bytes,
        feed: TakeFeedback,
        tag: bytes,
    ) -> None:
        super().__init__(route.name, feed, tag)
        self.goal_request = LocalGoalRequest(
            zenoh_session,
            messages,
            goal_id,
            self,
            priority=route.qos.priority,
            patience_s=min(route.result_timeout_s, _PATIENCE_S),
        )

    # For the goal request

    def answered(self, goal_id: bytes, verdict: Verdict) -> None:
        """Take the answer to the goal."""
        if verdict.accepted:
            self.accept()
        else:
            self.reject(verdict.failure or GoalFailure.REJECTED, verdict.text)

    def cancel_answered(self, goal_id: bytes, verdict: Verdict) -> None:
        """Take the answer to the request to cancel."""
        self.answer_cancels(verdict.accepted, verdict.text)

    def ended(self, goal_id: bytes, ending: Ending) -> None:
        """Take the end of the goal."""
        self.end_with(GoalEnd(status=ending.status, value=ending.result, text=ending.text))

    def lost(self, goal_id: bytes, failure: CallFailure, text: str) -> None:
        """End the goal, because nothing more will be known of it."""
        if self.accepted and failure in (CallFailure.BAD_REQUEST, CallFailure.UNKNOWN):
            self.end_with(GoalEnd(text=text))  # no gateway knows it any more
        else:
            self.end_with(GoalEnd(text=text, error=call_error(self._name, failure, text)))

    # Below the methods above

    def _ask_cancel(self) -> bool:
        if self.over.done():
            return False
        self.goal_request.cancel()
        return True


class _Server:
    """Receives the goals of one action; created on the loop."""

    def __init__(self, route: Route, handler: GoalHandler, zenoh_session: ZenohSession) -> None:
        self._route = route
        self._handler = handler
        self._goals: dict[bytes, _TakenGoal] = {}
        bell = WakeUp(asyncio.get_running_loop())
        self._queries = QueryHandler(
            zenoh_session.worker, bell.ring, limit=QUERIES_LIMIT, closed_text=_CLOSED_TEXT
        )
        bell.open(self._queries.serve)

        messages = messages_of(route)

        def put(which: ActionKey, payload: bytes) -> None:
            zenoh_session.put(
                messages.key(which),
                payload,
                encoding=messages.encoding,
                priority=route.qos.priority,
            )

        self.goal_server = LocalGoalServer(
            messages,
            self,
            put=put,
            keep_s=route.result_timeout_s,
            clock=time.monotonic_ns,
        )

    def bring(self, query: zenoh.Query) -> None:
        """Take a query; on Zenoh's thread."""
        self._queries.admit(self.goal_server.take, query)

    def close(self) -> None:
        """Refuse held queries, and later ones."""
        self._queries.close()

    def forget(self, goal_id: bytes) -> None:
        """Forget a goal that has ended."""
        self._goals.pop(goal_id, None)

    # For the goal server

    def begin(self, goal_id: bytes, value: object, held: HeldQuery) -> None:
        """Pass a goal to the application."""
        marker = read_marker(held.query.attachment)
        client = marker.acoustic if marker is not None else None
        goal = self._goals[goal_id] = _TakenGoal(self, self._route, goal_id, value, client)
        self._handler.take(goal)

    def cancel(self, goal_id: bytes) -> None:
        """Ask the application to cancel a goal."""
        goal = self._goals.get(goal_id)
        if goal is None or not goal.is_accepted:
            refused = Verdict(accepted=False, text="the goal does not run")
            self.goal_server.answer_cancel(goal_id, refused)
        else:
            self._handler.cancel(goal)


class _TakenGoal:
    """A goal that arrived over Zenoh; see `TakenGoal`."""

    def __init__(
        self, server: _Server, route: Route, goal_id: bytes, value: object, client: int | None
    ) -> None:
        self.value: Any = value
        self.client = client
        self.is_accepted = False
        self._server = server
        self._route = route
        self._goal_id = goal_id

    def accept(self) -> bool:
        self.is_accepted = True
        self._server.goal_server.answer(self._goal_id, Verdict(accepted=True))
        return True

    def reject(self, failure: GoalFailure, text: str) -> bool:
        self._server.forget(self._goal_id)
        refused = Verdict(accepted=False, failure=failure, text=text)
        self._server.goal_server.answer(self._goal_id, refused)
        return True

    def feed(self, value: object) -> bool:
        self._server.goal_server.feed(self._goal_id, _checked(self._route.feedback, value))
        return True

    def finish(self, status: GoalStatus, value: object) -> bool:
        self._server.forget(self._goal_id)
        goal_server = self._server.goal_server
        try:
            result = None if value is None else _checked(self._route.result, value)
            goal_server.end(self._goal_id, Ending(status=status, result=result))
        except PayloadInvalidError as error:
            goal_server.end(self._goal_id, Ending(status=GoalStatus.ABORTED, text=str(error)))
            raise
        return True

    def answer_cancel(self, accepted: bool, text: str) -> bool:
        self._server.goal_server.answer_cancel(self._goal_id, Verdict(accepted=accepted, text=text))
        return True


def messages_of(route: Route) -> ActionMessages:
    """Return the reader and writer of an action's messages."""
    return ActionMessages(
        route.name, route.goal.spec, route.feedback.spec, route.result.spec, route.encoding
    )


def _checked(form: Form[Any], value: object) -> object:
    """Return a value in the form of a message: a dict, or bytes.

    Raises:
        PayloadInvalidError: The type does not allow the value, or it is opaque and not bytes.
    """
    if form.spec is not None:
        return form.spec.validate(value)
    if not isinstance(value, bytes | bytearray | memoryview):
        raise PayloadInvalidError(f"{type(value).__name__} in an opaque action; allowed: bytes")
    return bytes(value)
