"""Actions whose calls wait, for the blocking `Node`: each stands for one on its loop."""

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
        """The server has accepted it."""
        return self._handle.accepted

    @property
    def text(self) -> str:
        """Why it was rejected, one line; empty: it was not."""
        return self._handle.text

    @property
    def tag(self) -> bytes:
        """What was given with it."""
        return self._handle.tag

    def cancel(self) -> bool:
        """Ask the server to end it, and wait for the answer."""
        return self._thread.wait(self._handle.cancel())

    def result(self, *, timeout_s: float | None = None) -> GoalResult[Result]:
        """Wait for its end; raises what `zacoustic.GoalHandle.result` does."""
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
        """Send a goal and wait for its answer; the callback runs in the thread of the loop."""
        sent = self._thread.wait(
            self._client.send_goal(
                goal, feedback_callback=feedback_callback, timeout_s=timeout_s, tag=tag
            )
        )
        return GoalHandle(sent, self._thread)

    def recovered(
        self, *, feedback_callback: FeedbackCallback[Feedback] | None = None
    ) -> list[GoalHandle[Goal, Feedback, Result]]:
        """Return the goals that a former boot epoch of this node has sent, each once."""
        found = self._thread.apply(
            lambda: self._client.recovered(feedback_callback=feedback_callback)
        )
        return [GoalHandle(handle, self._thread) for handle in found]

    def close(self) -> None:
        """Withdraw the client; goals go on."""
        self._thread.apply(self._client.close)


class ServerGoalHandle(Generic[Goal, Feedback, Result]):
    """A goal that runs here; see `zacoustic.ServerGoalHandle`. For the thread that pursues it."""

    def __init__(
        self, handle: action.ServerGoalHandle[Goal, Feedback, Result], thread: LoopThread
    ) -> None:
        self.name = handle.name
        """The action."""
        self.request = handle.request
        """The goal."""
        self.client = handle.client
        """Acoustic address of its client; None: on this Zenoh network."""
        self._handle = handle
        self._thread = thread

    @property
    def is_active(self) -> bool:
        """It runs."""
        return self._handle.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """Its client wants it to end, and that was accepted."""
        return self._handle.is_cancel_requested

    def wait_cancel(self, *, timeout_s: float) -> bool:
        """Wait until its client wants it to end; return whether it does. Instead of a sleep."""

        async def wait() -> bool:
            try:
                async with asyncio.timeout(timeout_s):
                    await self._handle.cancel_requested()
            except TimeoutError:
                return False
            return True

        return self._thread.wait(wait())

    def publish_feedback(self, feedback: Feedback) -> bool:
        """Tell how far it is; of what waits only the newest is sent. False: it is over."""
        return self._thread.apply(lambda: self._handle.publish_feedback(feedback))

    def succeed(self, result: Result | None = None) -> None:
        """Say that it was reached."""
        self._thread.apply(lambda: self._handle.succeed(result))

    def abort(self, result: Result | None = None) -> None:
        """Say that it was given up."""
        self._thread.apply(lambda: self._handle.abort(result))

    def canceled(self, result: Result | None = None) -> None:
        """Say that it was given up because its client wanted so."""
        self._thread.apply(lambda: self._handle.canceled(result))


Execute = Callable[[ServerGoalHandle[Goal, Feedback, Result]], Result | None]
"""Pursues a goal, in its own thread; may wait as long as it likes."""


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
        """Serve no more; goals that run are aborted, though their threads go on."""
        self._thread.apply(self._served.close)


def in_thread(
    execute: Execute[Goal, Feedback, Result], thread: LoopThread
) -> action.Execute[Goal, Feedback, Result]:
    """Make a coroutine function of one that waits: each goal gets a thread."""

    async def pursue(
        handle: action.ServerGoalHandle[Goal, Feedback, Result],
    ) -> Result | None:
        return await asyncio.to_thread(execute, ServerGoalHandle(handle, thread))

    return pursue
