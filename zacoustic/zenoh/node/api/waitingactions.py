"""Blocking actions, for the blocking `Node`: each wraps an asyncio one on its loop."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from zacoustic.zenoh.node.api import action
from zacoustic.zenoh.node.api.action import FeedbackCallback, GoalResult
from zacoustic.zenoh.node.api.loopthread import LoopThread, OnLoop

Goal = TypeVar("Goal")
Feedback = TypeVar("Feedback")
Result = TypeVar("Result")


class GoalHandle(OnLoop[action.GoalHandle[Goal, Feedback, Result]]):
    """A goal that was sent; see `zacoustic.GoalHandle`."""

    @property
    def name(self) -> str:
        """The action."""
        return self._endpoint.name

    @property
    def accepted(self) -> bool:
        """Whether the server has accepted the goal."""
        return self._endpoint.accepted

    @property
    def text(self) -> str:
        """Why the server rejected the goal, one line; empty: it did not."""
        return self._endpoint.text

    @property
    def tag(self) -> bytes:
        """The bytes that `ActionClient.send_goal` got with the goal."""
        return self._endpoint.tag

    def cancel(self) -> bool:
        """Ask the server to cancel the goal, and wait for the answer."""
        return self._thread.wait(self._endpoint.cancel)

    def result(self, *, timeout_s: float | None = None) -> GoalResult[Result]:
        """Wait for the end of the goal; raises the errors of `zacoustic.GoalHandle.result`."""
        return self._thread.wait(lambda: self._endpoint.result(timeout_s=timeout_s))


class ActionClient(OnLoop[action.ActionClient[Goal, Feedback, Result]]):
    """Sends goals of one action; see `zacoustic.ActionClient`."""

    @property
    def name(self) -> str:
        """The action."""
        return self._endpoint.name

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
            lambda: self._endpoint.send_goal(
                goal, feedback_callback=feedback_callback, timeout_s=timeout_s, tag=tag
            )
        )
        return GoalHandle(sent, self._thread)

    def recovered(
        self, *, feedback_callback: FeedbackCallback[Feedback] | None = None
    ) -> list[GoalHandle[Goal, Feedback, Result]]:
        """Return the goals that this node sent before it restarted, each once."""
        found = self._thread.apply(
            lambda: self._endpoint.recovered(feedback_callback=feedback_callback)
        )
        return [GoalHandle(handle, self._thread) for handle in found]

    def close(self) -> None:
        """Close the client; its goals go on."""
        self._thread.apply(self._endpoint.close)


class ServerGoalHandle(OnLoop[action.ServerGoalHandle[Goal, Feedback, Result]]):
    """A goal that runs here, for the thread that executes it; see `zacoustic.ServerGoalHandle`."""

    @property
    def name(self) -> str:
        """The action."""
        return self._endpoint.name

    @property
    def request(self) -> Goal:
        """The goal."""
        return self._endpoint.request

    @property
    def client(self) -> int | None:
        """Acoustic address of the client; None: on this Zenoh network."""
        return self._endpoint.client

    @property
    def is_active(self) -> bool:
        """Whether the goal still runs."""
        return self._endpoint.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """Whether the client has asked to cancel the goal, and the server agreed."""
        return self._endpoint.is_cancel_requested

    def wait_cancel(self, *, timeout_s: float) -> bool:
        """Wait for an accepted request to cancel, in place of a sleep; return whether it came."""
        try:
            self._thread.wait(self._endpoint.cancel_requested, timeout_s=timeout_s)
        except TimeoutError:
            return False
        return True

    def publish_feedback(self, feedback: Feedback) -> bool:
        """Send feedback, of which only the newest waits. False: the goal has ended."""
        return self._thread.apply(lambda: self._endpoint.publish_feedback(feedback))

    def succeed(self, result: Result | None = None) -> None:
        """Set SUCCEEDED."""
        self._thread.apply(lambda: self._endpoint.succeed(result))

    def abort(self, result: Result | None = None) -> None:
        """Set ABORTED: the server gave the goal up."""
        self._thread.apply(lambda: self._endpoint.abort(result))

    def canceled(self, result: Result | None = None) -> None:
        """Set CANCELED: the server gave the goal up at the client's request."""
        self._thread.apply(lambda: self._endpoint.canceled(result))


Execute = Callable[[ServerGoalHandle[Goal, Feedback, Result]], Result | None]
"""Executes a goal, in a separate thread; may block as long as it likes."""


class ActionServer(OnLoop[action.ActionServer[Goal, Feedback, Result]]):
    """Serves one action; see `zacoustic.ActionServer`."""

    @property
    def name(self) -> str:
        """The action."""
        return self._endpoint.name

    def close(self) -> None:
        """Stop serving and abort the goals that run; their threads go on."""
        self._thread.apply(self._endpoint.close)


def in_thread(
    execute: Execute[Goal, Feedback, Result], thread: LoopThread
) -> action.Execute[Goal, Feedback, Result]:
    """Make a coroutine function from a blocking one; each goal gets a thread."""

    async def pursue(
        handle: action.ServerGoalHandle[Goal, Feedback, Result],
    ) -> Result | None:
        return await asyncio.to_thread(execute, ServerGoalHandle(handle, thread))

    return pursue
