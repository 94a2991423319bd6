"""The goals that a program has sent, at the End of its node."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

import msgspec

from zacoustic.core.engine.events import GoalFailure, GoalStatus
from zacoustic.errors import (
    CallTimeoutError,
    DeliveryError,
    LinkClosedError,
    LocalError,
    ZacousticError,
)
from zacoustic.zenoh.ends.goals import GivenGoal, GoalClient
from zacoustic.zenoh.node.routes import ActionRoute

TakeFeedback = Callable[[object], None]
"""Receives feedback, a dict or bytes."""
_REFUSALS: Final = (GoalFailure.REJECTED, GoalFailure.CANCELLED)
"""Failures that an application sees in `accepted`; all others are errors."""


class GoalEnd(msgspec.Struct, frozen=True, kw_only=True):
    """The end of a goal for its client."""

    status: GoalStatus = GoalStatus.UNKNOWN
    """The status, if there is no error."""
    value: Any = None
    """The result, a dict or bytes; None: no result."""
    text: str = ""
    """One line of text."""
    error: Exception | None = None
    """Why the end is unknown here."""


class SentGoal(GoalClient):
    """A goal that a program has sent, or that this node sent before it restarted.

    Args:
        name: Name of the action.
        take_feedback: Takes the feedback; None: nobody does yet.
        tag: The bytes given with the goal.
    """

    def __init__(self, name: str, take_feedback: TakeFeedback | None, tag: bytes) -> None:
        loop = asyncio.get_running_loop()
        self.accepted = False
        """Whether the goal runs or has run."""
        self.text = ""
        """Why the goal was rejected, one line."""
        self.tag = tag
        self.take_feedback = take_feedback
        self.given: GivenGoal | None = None
        """The goal at its End."""
        self.known: asyncio.Future[None] = loop.create_future()
        """Done when the goal is answered."""
        self.over: asyncio.Future[GoalEnd] = loop.create_future()
        """Done when the goal has ended."""
        self._name = name
        self._cancels: list[asyncio.Future[tuple[bool, str]]] = []

    async def cancel(self) -> tuple[bool, str]:
        """Ask the server to cancel the goal; return whether it agrees, or why not.

        Raises:
            LocalError: The goal has ended.
            LinkClosedError: The node was closed, or has failed.
        """
        answer: asyncio.Future[tuple[bool, str]] = asyncio.get_running_loop().create_future()
        self._cancels.append(answer)
        if self.over.done() or self.given is None or not self.given.cancel():
            self.raise_error(LinkClosedError)
            raise LocalError(f"{self._name}: the goal has ended")
        return await answer

    async def end(self) -> GoalEnd:
        """Wait for the end of the goal; may be called several times, and cancelled."""
        return await asyncio.shield(self.over)

    def raise_error(self, kind: type[Exception] = Exception) -> None:
        """Raise the error that has ended the goal, if one of this kind has."""
        error = self.over.result().error if self.over.done() else None
        if isinstance(error, kind):
            raise error

    # From the End

    def accept(self) -> bool:
        """The goal runs."""
        self.accepted = True
        if not self.known.done():
            self.known.set_result(None)
        return True

    def reject(self, failure: GoalFailure, text: str) -> bool:
        """The goal does not run."""
        self.text = text or failure.name.lower()
        error = None if failure in _REFUSALS else goal_error(self._name, failure, text)
        return self.end_with(GoalEnd(text=self.text, error=error))

    def feed(self, value: object) -> bool:
        """Pass feedback to the application."""
        if self.take_feedback is not None and not self.over.done():
            self.take_feedback(value)
        return True

    def answer_cancel(self, accepted: bool, text: str) -> bool:
        """Note the answer to the request to cancel."""
        waiting, self._cancels = self._cancels, []
        for answer in waiting:
            if not answer.done():
                answer.set_result((accepted, text))
        return True

    def finish(self, status: GoalStatus, value: object, text: str = "") -> bool:
        """The goal has ended."""
        return self.end_with(GoalEnd(status=status, value=value, text=text))

    def lose(self, failure: GoalFailure, text: str) -> bool:
        """Nothing more will be known of the goal."""
        is_unknown = failure is GoalFailure.UNKNOWN
        error = None if is_unknown else goal_error(self._name, failure, text)
        return self.end_with(GoalEnd(text=text, error=error))

    def end_with(self, end: GoalEnd) -> bool:
        """End the goal."""
        if not self.over.done():
            self.over.set_result(end)
        if not self.known.done():
            self.known.set_result(None)
        is_canceled = end.status is GoalStatus.CANCELED
        return self.answer_cancel(is_canceled, "" if is_canceled else "the goal has ended")


class Give(Protocol):
    """Gives a goal to the End of a node."""

    def __call__(
        self,
        route: ActionRoute[Any, Any, Any],
        value: object,
        client: GoalClient,
        *,
        timeout_s: float | None,
        tag: bytes,
    ) -> GivenGoal:
        """Give a goal.

        Raises:
            LocalError: The goal cannot be sent.
        """
        ...


class SentGoals:
    """The goals that the programs of one node have sent; for the loop.

    Args:
        give: Gives them to the End of the node.
    """

    def __init__(self, give: Give) -> None:
        self._give = give
        self._sent: set[SentGoal] = set()
        self._recovered: list[tuple[str, SentGoal]] = []

    async def send(
        self,
        route: ActionRoute[Any, Any, Any],
        value: object,
        timeout_s: float | None,
        take_feedback: TakeFeedback,
        tag: bytes,
    ) -> SentGoal:
        """Send a goal and wait for the answer; cancelling this call cancels the goal.

        Raises:
            LocalError: The goal cannot be sent.
            DeliveryError: Nobody has answered; see `goal_error`.
        """
        sent = SentGoal(route.name, take_feedback, tag)
        sent.given = self._give(route, value, sent, timeout_s=timeout_s, tag=tag)
        self._watch(sent)
        try:
            await asyncio.shield(sent.known)
        except asyncio.CancelledError:
            sent.given.cancel()
            raise
        sent.raise_error()
        return sent

    def recover(self, given: GivenGoal, name: str, tag: bytes) -> SentGoal:
        """Take a goal from before the restart, for the program that asks for it."""
        sent = SentGoal(name, None, tag)
        sent.given = given
        self._recovered.append((name, sent))
        self._watch(sent)
        return sent

    def recovered(self, name: str, take_feedback: TakeFeedback) -> Sequence[SentGoal]:
        """Return the goals that were sent before the restart, each once."""
        found = [sent for each, sent in self._recovered if each == name]
        self._recovered = [each for each in self._recovered if each[0] != name]
        for sent in found:
            sent.take_feedback = take_feedback
        return found

    def end_all(self, error: Exception) -> None:
        """Inform the waiting callers that no answer will come."""
        for sent in tuple(self._sent):
            sent.end_with(GoalEnd(error=error))

    def _watch(self, sent: SentGoal) -> None:
        self._sent.add(sent)
        sent.over.add_done_callback(lambda _: self._sent.discard(sent))


def goal_error(name: str, failure: GoalFailure, text: str) -> ZacousticError:
    """Return the exception for a goal without an answer, or with an unknown end."""
    kind = CallTimeoutError if failure is GoalFailure.TIMED_OUT else DeliveryError
    return kind(
        f"{name}: {text or failure.name.lower().replace('_', ' ')}", hint=_HINTS.get(failure, "")
    )


_HINTS = {
    GoalFailure.NO_SERVER: "start the program that serves it",
    GoalFailure.TABLE_MISMATCH: "compare both configs: zacoustic config check FILE",
    GoalFailure.TIMED_OUT: "whether the goal runs is unknown",
}
