"""Actions: clients that send goals, and servers that execute them with application functions.

The terms are those of ROS 2. The server accepts or rejects a goal. While the goal runs, its client
gets feedback and may cancel it. It ends with a status and a result.
"""

import asyncio
import inspect
import logging
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any, Generic, Protocol, TypeVar

import msgspec

from zacoustic.core.engine.events import GoalFailure, GoalStatus
from zacoustic.errors import DeliveryError, LocalError, ZacousticError
from zacoustic.zenoh.ends.goals import TakenGoal
from zacoustic.zenoh.node.api.service import Spawn
from zacoustic.zenoh.node.carrier import Carrier
from zacoustic.zenoh.node.goals import GoalEnd, SentGoal
from zacoustic.zenoh.node.routes import ActionRoute

_logger = logging.getLogger(__name__)

Goal = TypeVar("Goal")
Feedback = TypeVar("Feedback")
Result = TypeVar("Result")
GoalType = TypeVar("GoalType", covariant=True)
FeedbackType = TypeVar("FeedbackType", covariant=True)
ResultType = TypeVar("ResultType", covariant=True)


class ActionType(Protocol[GoalType, FeedbackType, ResultType]):
    """Names the three types of an action, as in ROS: a class with three classes inside.

    ``class Goto:``, and in it ``class Goal(msgspec.Struct)``, ``class Feedback(msgspec.Struct)``
    and ``class Result(msgspec.Struct)``.
    """

    # Methods, because a type checker sees a class inside a class as one.
    def Goal(self, *args: Any, **kwargs: Any) -> GoalType:  # noqa: ANN401, N802
        """Make a goal."""
        ...

    def Feedback(self, *args: Any, **kwargs: Any) -> FeedbackType:  # noqa: ANN401, N802
        """Make feedback."""
        ...

    def Result(self, *args: Any, **kwargs: Any) -> ResultType:  # noqa: ANN401, N802
        """Make a result."""
        ...


class GoalResult(msgspec.Struct, Generic[Result], frozen=True, kw_only=True):
    """How a goal ended."""

    status: GoalStatus
    """SUCCEEDED, CANCELED, ABORTED; or UNKNOWN: the server died while the goal ran."""
    result: Result | None
    """The result; None: the server gave none."""
    text: str = ""
    """One line of text, if the status does not say everything."""


FeedbackCallback = Callable[[Feedback], Awaitable[None] | None]
"""Receives feedback, on the loop; may be a coroutine function."""


class GoalHandle(Generic[Goal, Feedback, Result]):
    """A goal that was sent. Created by `ActionClient`.

    Args:
        route: The action.
        sent: The goal at the carrier.
    """

    def __init__(self, route: ActionRoute[Goal, Feedback, Result], sent: SentGoal) -> None:
        self.name: str = route.name
        """The action."""
        self._route = route
        self._sent = sent

    @property
    def accepted(self) -> bool:
        """Whether the server has accepted it; at first unknown after a restart of this node."""
        return self._sent.accepted

    @property
    def text(self) -> str:
        """Why the server rejected the goal, one line; empty: it did not."""
        return self._sent.text

    @property
    def tag(self) -> bytes:
        """The bytes that `ActionClient.send_goal` got with the goal."""
        return self._sent.tag

    async def cancel(self) -> bool:
        """Ask the server to cancel the goal, ahead of all other traffic; wait for the answer.

        Returns:
            True: the goal will be cancelled, or has been; the result follows.

        Raises:
            LocalError: The goal had ended before.
            LinkClosedError: The node was closed.
        """
        accepted, _ = await self._sent.cancel()
        return accepted

    async def result(self, *, timeout_s: float | None = None) -> GoalResult[Result]:
        """Wait for the end of the goal; may be called several times.

        Args:
            timeout_s: Time limit, s; None: until the goal ends or is given up.

        Raises:
            TimeoutError: The goal has not ended in time; it goes on.
            CallTimeoutError: No message about the goal came for the action's `result_timeout_s`.
            DeliveryError: The goal was rejected, or the two ends define its stream differently.
            LinkClosedError: The node was closed, or has failed.
        """
        async with asyncio.timeout(timeout_s):
            end = await self._sent.end()
        if end.error is not None:
            raise end.error
        if end.status is GoalStatus.UNKNOWN and not self.accepted and self.text:
            raise DeliveryError(f"{self.name}: the goal was rejected: {self.text}")
        return GoalResult(status=end.status, result=self._build(end), text=end.text)

    def _build(self, end: GoalEnd) -> Result | None:
        if end.value is None:
            return None
        try:
            return self._route.result.build(end.value)
        except (ValueError, TypeError) as error:  # from a check of the application's class
            raise DeliveryError(f"{self.name}: the result is refused: {error}") from error


class ActionClient(Generic[Goal, Feedback, Result]):
    """Sends goals of one action. Created by `Node.create_action_client`.

    Args:
        route: Where goals go.
        carrier: Carries them.
        spawn: Starts callbacks that are coroutines.
    """

    def __init__(
        self, route: ActionRoute[Goal, Feedback, Result], carrier: Carrier, spawn: Spawn
    ) -> None:
        self.name: str = route.name
        """The action."""
        self._route = route
        self._carrier = carrier
        self._spawn = spawn
        self._is_closed = False

    async def send_goal(
        self,
        goal: Goal,
        *,
        feedback_callback: FeedbackCallback[Feedback] | None = None,
        timeout_s: float | None = None,
        tag: bytes = b"",
    ) -> GoalHandle[Goal, Feedback, Result]:
        """Send a goal and wait until the server has accepted or rejected it.

        Cancelling this call cancels the goal.

        Args:
            goal: A value of the client's type.
            feedback_callback: Receives feedback.
            timeout_s: Time limit for the answer, s, > 0, at most the action's own; None: that.
            tag: Any bytes, such as the number of a mission; after a restart, a node with a journal
                returns them with the goal (`recovered`).

        Returns:
            The goal; `GoalHandle.accepted` tells whether it runs.

        Raises:
            CallTimeoutError: No answer came in time; whether the goal runs is unknown.
            DeliveryError: The action has no server, or the two ends define its stream differently.
            PayloadInvalidError: The type does not allow the goal.
            PayloadTooLargeError: The goal fits no frame of this link.
            QueueFullError: Too many goals are under way.
            JournalUnavailableError: The journal cannot store the goal.
            LocalError: The client is closed, or this node is the server itself.
        """
        if self._is_closed:
            raise LocalError(f"the client of {self.name} is closed")
        if timeout_s is not None and not 0 < timeout_s < float("inf"):
            raise LocalError(f"timeout_s is {timeout_s}; allowed: above 0")
        feed = self._feeder(feedback_callback)
        sent = await self._carrier.sent_goals.send(self._route, goal, timeout_s, feed, tag)
        return GoalHandle(self._route, sent)

    def recovered(
        self, *, feedback_callback: FeedbackCallback[Feedback] | None = None
    ) -> list[GoalHandle[Goal, Feedback, Result]]:
        """Return the goals that this node sent before it restarted, each once.

        Only in direct mode with a journal; on Zenoh the gateway keeps them.
        """
        found = self._carrier.sent_goals.recovered(self.name, self._feeder(feedback_callback))
        return [GoalHandle(self._route, sent) for sent in found]

    def close(self) -> None:
        """Close the client; its goals go on. May be called again."""
        self._is_closed = True

    def _feeder(self, callback: FeedbackCallback[Feedback] | None) -> Callable[[object], None]:
        def feed(value: object) -> None:
            if callback is None:
                return
            try:
                taken = callback(self._route.feedback.build(value))
            except Exception as error:  # the application's
                _logger.warning("%s: the callback of feedback failed", self.name, exc_info=error)
                return
            if inspect.isawaitable(taken):
                self._spawn(self._attend(taken), f"feedback of {self.name}")

        return feed

    async def _attend(self, taken: Awaitable[None]) -> None:
        try:
            await taken
        except Exception as error:  # the application's
            _logger.warning("%s: the callback of feedback failed", self.name, exc_info=error)


class ServerGoalHandle(Generic[Goal, Feedback, Result]):
    """A goal that runs here. Created by `ActionServer`.

    Args:
        route: The action.
        taken: The goal at the carrier.
        request: Its value.
    """

    def __init__(
        self, route: ActionRoute[Goal, Feedback, Result], taken: TakenGoal, request: Goal
    ) -> None:
        self.name: str = route.name
        """The action."""
        self.request = request
        """The value of the goal."""
        self.client: int | None = taken.client
        """Acoustic address of the client; None: on this Zenoh network."""
        self.status: GoalStatus | None = None
        """The status that `succeed`, `abort` or `canceled` has set; None: none yet."""
        self._route = route
        self._taken = taken
        self._cancelled = asyncio.Event()
        self._is_over = False

    @property
    def is_active(self) -> bool:
        """Whether the goal still runs."""
        return not self._is_over

    @property
    def is_cancel_requested(self) -> bool:
        """Whether the client has asked to cancel the goal, and the server agreed."""
        return self._cancelled.is_set()

    async def cancel_requested(self) -> None:
        """Wait for an accepted request to cancel the goal."""
        await self._cancelled.wait()

    async def wait_cancel(self, *, timeout_s: float) -> bool:
        """Wait as `cancel_requested`, in place of a sleep; return whether the request came."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._cancelled.wait()
        except TimeoutError:
            return False
        return True

    def publish_feedback(self, feedback: Feedback) -> bool:
        """Send feedback, of which only the newest waits. False: the goal has ended.

        Raises:
            PayloadInvalidError: The type does not allow the feedback.
            PayloadTooLargeError: The feedback fits no frame of this link.
        """
        return not self._is_over and self._taken.feed(feedback)

    def succeed(self, result: Result | None = None) -> None:
        """Set SUCCEEDED; a result ends the goal at once, otherwise the callback's return does."""
        self._say(GoalStatus.SUCCEEDED, result)

    def abort(self, result: Result | None = None) -> None:
        """Set ABORTED: the server gave the goal up."""
        self._say(GoalStatus.ABORTED, result)

    def canceled(self, result: Result | None = None) -> None:
        """Set CANCELED: the server gave the goal up at the client's request."""
        self._say(GoalStatus.CANCELED, result)

    def wish_to_cancel(self) -> None:
        """Tell the callback of the accepted request to cancel."""
        self._cancelled.set()

    def finish(self, status: GoalStatus, result: object) -> None:
        """End the goal; later calls do nothing."""
        if self._is_over:
            return
        self._is_over = True
        try:
            if not self._taken.finish(status, result):
                _logger.warning("%s: nobody waits for the goal any more", self.name)
        except ZacousticError as error:
            _logger.warning("%s: the result cannot be sent: %s", self.name, error)
            self._taken.finish(GoalStatus.ABORTED, None, str(error))

    def _say(self, status: GoalStatus, result: Result | None) -> None:
        if self.status is not None:
            raise LocalError(f"{self.name}: the goal is {self.status.name} already")
        self.status = status
        if result is not None:
            self.finish(status, result)


Execute = Callable[[ServerGoalHandle[Goal, Feedback, Result]], Awaitable[Result | None]]
"""Executes a goal: a coroutine function. It calls `succeed`, `abort` or `canceled`, and either
returns the result or passes it there."""
Decide = Callable[[Goal], bool | Awaitable[bool]]
"""Decides whether to accept a goal; promptly, because the client waits."""
DecideCancel = Callable[[ServerGoalHandle[Goal, Feedback, Result]], bool | Awaitable[bool]]
"""Decides whether to accept a request to cancel."""


class ActionServer(Generic[Goal, Feedback, Result]):
    """Serves one action. Created by `Node.create_action_server`.

    Each goal runs in a separate task. An exception of `execute` is logged and aborts the goal.

    Args:
        route: The action.
        execute: Executes a goal.
        goal_callback: Accepts or rejects a goal; None: accepts all.
        cancel_callback: Accepts or rejects a request to cancel; None: accepts all.
        carrier: Carries them.
        spawn: Starts the tasks.
    """

    def __init__(
        self,
        route: ActionRoute[Goal, Feedback, Result],
        execute: Execute[Goal, Feedback, Result],
        carrier: Carrier,
        spawn: Spawn,
        *,
        goal_callback: Decide[Goal] | None = None,
        cancel_callback: DecideCancel[Goal, Feedback, Result] | None = None,
    ) -> None:
        self.name: str = route.name
        """The action."""
        self._route = route
        self._execute = execute
        self._goal_callback = goal_callback
        self._cancel_callback = cancel_callback
        self._spawn = spawn
        self._tasks: set[asyncio.Task[None]] = set()
        self._running: dict[TakenGoal, ServerGoalHandle[Goal, Feedback, Result]] = {}
        self._stop = carrier.serve_goals(route, self)

    def close(self) -> None:
        """Stop serving and abort the goals that run. May be called again."""
        for handle in self._running.values():
            handle.finish(GoalStatus.ABORTED, None)
        self._stop()
        for task in tuple(self._tasks):
            task.cancel()

    # For the carrier

    def take(self, goal: TakenGoal) -> None:
        """Take an arrived goal."""
        self._begin(self._decide(goal), f"goal of {self.name}")

    def cancel(self, goal: TakenGoal) -> None:
        """Take an accepted request to cancel a goal."""
        self._begin(self._decide_cancel(goal), f"cancel of {self.name}")

    # Below the methods above

    def _begin(self, coroutine: Coroutine[Any, Any, None], name: str) -> None:
        task = self._spawn(coroutine, name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _decide(self, taken: TakenGoal) -> None:
        try:
            request = self._route.goal.build(taken.value)
        except (ValueError, TypeError) as error:  # from a check of the application's class
            taken.reject(GoalFailure.BAD_GOAL, str(error))
            return
        accepts, text = True, ""
        if self._goal_callback is not None:
            try:
                decided = self._goal_callback(request)
                accepts = bool(await decided if inspect.isawaitable(decided) else decided)
            except Exception as error:  # the application's
                _logger.warning("%s: the callback of goals failed", self.name, exc_info=error)
                accepts, text = False, " ".join(str(error).split()) or type(error).__name__
        if not accepts:
            taken.reject(GoalFailure.REJECTED, text)
            return
        handle = ServerGoalHandle(self._route, taken, request)
        self._running[taken] = handle
        if taken.accept():
            await self._run(handle)
        else:
            _logger.warning("%s: a goal was accepted after its client's deadline", self.name)
        self._running.pop(taken, None)

    async def _run(self, handle: ServerGoalHandle[Goal, Feedback, Result]) -> None:
        try:
            result = await self._execute(handle)
        except asyncio.CancelledError:
            handle.finish(GoalStatus.ABORTED, None)
            raise
        except Exception as error:  # the application's
            _logger.warning("%s: the goal failed", self.name, exc_info=error)
            handle.finish(GoalStatus.ABORTED, None)
            return
        if handle.status is None:
            _logger.warning("%s: the callback set no status: the goal is aborted", self.name)
        handle.finish(handle.status or GoalStatus.ABORTED, result)

    async def _decide_cancel(self, taken: TakenGoal) -> None:
        handle = self._running.get(taken)
        if handle is None:
            taken.answer_cancel(False, "the goal does not run")
            return
        accepts, text = True, ""
        if self._cancel_callback is not None:
            try:
                decided = self._cancel_callback(handle)
                accepts = bool(await decided if inspect.isawaitable(decided) else decided)
            except Exception as error:  # the application's
                _logger.warning("%s: the callback of cancels failed", self.name, exc_info=error)
                accepts, text = False, " ".join(str(error).split()) or type(error).__name__
        taken.answer_cancel(accepts, text)
        if accepts:
            handle.wish_to_cancel()
