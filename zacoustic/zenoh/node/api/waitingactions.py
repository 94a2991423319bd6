"""Blocking actions, for the blocking `Node`: each wraps an asyncio one on its loop."""

import asyncio
from collections.abc import Callable
from typing import Generic, TypeVar

from zacoustic.zenoh.node.api import action
from zacoustic.zenoh.node.api.action import FeedbackCallback, GoalResult
from zacoustic.zenoh.node.api.loopthread import LoopThread

Goal = TypeVar("Goal")
Feedback = TypeVar("Feedback")
Result = TypeVar("Result")


class GoalHandle(Generic[Goal, Feedback, Result]):
    """A goal that was sent; see `zacoustic.GoalHandle`."""

    def __init__(
        self, handle: action.GoalHandle[Goal, Feedback, Result], thread: LoopThread
    ) -> None:
        self.name = handle.name
        """The action."""
        self._handle = handle
        self._thread = thread

    @property
    def accepted(self) -> bool:
        """Whether the server has accepted the goal."""
        return self._handle.accepted

    @property
    def text(self) -> str:
        """Why the server rejected the goal, one line; empty: it did not."""
        return self._handle.text

    @property
    def tag(self) -> bytes:
        """The bytes that `ActionClient.send_goal` got with the goal."""
        return self._handle.tag

    def cancel(self) -> bool:
        """Ask the server to cancel the goal, and wait for the answer."""
        return self._thread.wait(self._handle.cancel())

    def result(self, *, timeout_s: float | None = None) -> GoalResult[Result]:
        """Wait for the end of the goal; raises the errors of `zacoustic.GoalHandle.result`."""
        return self._thread.wait(self._handle.result(timeout_s=timeout_s))


class ActionClient(Generic[Goal, Feedback, Result]):
    """Sends goals of one action; see `zacoustic.ActionClient`."""

    def __init__(
        self, client: action.ActionClient[Goal, Feedback, Result], thread: LoopThread
    ) -> None:
        self.name = client.name
        """The action."""
        self._client = client
        self._thread = thread

    def send_goal(
        self,
        goal: Goal,
        *,
        feedback_callback: FeedbackCallback[Feedback] | None = None,
        timeout_s: float | None = None,
        tag: bytes = b"",
    ) -> GoalHandle[Goal, Feedback, Result]:
        """Send a goal and wait for the answer; the callback runs in the loop's thread."""
        sent = self._thread.wait(
            self._client.send_goal(
                goal, feedback_callback=feedback_callback, timeout_s=timeout_s, tag=tag
            )
        )
        return GoalHandle(sent, self._thread)

    def recovered(
        self, *, feedback_callback: FeedbackCallback[Feedback] | None = None
    ) -> list[GoalHandle[Goal, Feedback, Result]]:
        """Return the goals that this node sent before it restarted, each once."""
        found = self._thread.apply(
            lambda: self._client.recovered(feedback_callback=feedback_callback)
        )
        return [GoalHandle(handle, self._thread) for handle in found]

    def close(self) -> None:
        """Close the client; its goals go on."""
        self._thread.apply(self._client.close)


class ServerGoalHandle(Generic[Goal, Feedback, Result]):
    """A goal that runs here, for the thread that executes it; see `zacoustic.ServerGoalHandle`."""

    def __init__(
        self, handle: action.ServerGoalHandle[Goal, Feedback, Result], thread: LoopThread
    ) -> None:
        self.name = handle.name
        """The action."""
        self.request = handle.request
        """The goal."""
        self.client = handle.client
        """Acoustic address of the client; None: on this Zenoh network."""
        self._handle = handle
        self._thread = thread

    @property
    def is_active(self) -> bool:
        """Whether the goal still runs."""
        return self._handle.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """Whether the client has asked to cancel the goal, and the server agreed."""
        return self._handle.is_cancel_requested

    def wait_cancel(self, *, timeout_s: float) -> bool:
        """Wait for an accepted request to cancel, in place of a sleep; return whether it came."""

        async def wait() -> bool:
            try:
                async with asyncio.timeout(timeout_s):
                    await self._handle.cancel_requested()
            except TimeoutError:
                return False
            return True

        return self._thread.wait(wait())

    def publish_feedback(self, feedback: Feedback) -> bool:
        """Send feedback, of which only the newest waits. False: the goal has ended."""
        return self._thread.apply(lambda: self._handle.publish_feedback(feedback))

    def succeed(self, result: Result | None = None) -> None:
        """Set SUCCEEDED."""
        self._thread.apply(lambda: self._handle.succeed(result))

    def abort(self, result: Result | None = None) -> None:
        """Set ABORTED: the server gave the goal up."""
        self._thread.apply(lambda: self._handle.abort(result))

    def canceled(self, result: Result | None = None) -> None:
        """Set CANCELED: the server gave the goal up at the client's request."""
        self._thread.apply(lambda: self._handle.canceled(result))


Execute = Callable[[ServerGoalHandle[Goal, Feedback, Result]], Result | None]
"""Executes a goal, in a separate thread; may block as long as it likes."""


class ActionServer(Generic[Goal, Feedback, Result]):
    """Serves one action; see `zacoustic.ActionServer`."""

    def __init__(
        self, served: action.ActionServer[Goal, Feedback, Result], thread: LoopThread
    ) -> None:
        self.name = served.name
        """The action."""
        self._served = served
        self._thread = thread

    def close(self) -> None:
        """Stop serving and abort the goals that run; their threads go on."""
        self._thread.apply(self._served.close)


def in_thread(
    execute: Execute[Goal, Feedback, Result], thread: LoopThread
) -> action.Execute[Goal, Feedback, Result]:
    """Make a coroutine function from a blocking one; each goal gets a thread."""

    async def pursue(
        handle: action.ServerGoalHandle[Goal, Feedback, Result],
    ) -> Result | None:
        return await asyncio.to_thread(execute, ServerGoalHandle(handle, thread))

    return pursue
