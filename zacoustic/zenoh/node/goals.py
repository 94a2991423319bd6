"""The contract of a `Carrier` for the goals of actions.

Values cross it as dicts and bytes, as in the codecs.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

import msgspec

from zacoustic.core.engine.events import GoalFailure, GoalStatus
from zacoustic.errors import CallTimeoutError, DeliveryError, LocalError, ZacousticError
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


class SentGoal(ABC):
    """A goal that the server has answered, or that this node sent before it restarted.

    Args:
        name: Name of the action.
        feed: Takes the feedback; None: nobody does yet.
        tag: The bytes given with the goal.
    """

    def __init__(self, name: str, feed: TakeFeedback | None, tag: bytes) -> None:
        loop = asyncio.get_running_loop()
        self.accepted = False
        """Whether the goal runs or has run."""
        self.text = ""
        """Why the goal was rejected, one line."""
        self.tag = tag
        self.feed = feed
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
        """
        answer: asyncio.Future[tuple[bool, str]] = asyncio.get_running_loop().create_future()
        self._cancels.append(answer)
        if not self._ask_cancel():
            raise LocalError(f"{self._name}: the goal has ended")
        return await answer

    async def end(self) -> GoalEnd:
        """Wait for the end of the goal; may be called several times, and cancelled."""
        return await asyncio.shield(self.over)

    def raise_error(self) -> None:
        """Raise the error that has ended the goal, if one has."""
        if self.over.done() and (error := self.over.result().error) is not None:
            raise error

    # For the carrier

    def accept(self) -> None:
        """Note that the server has accepted the goal."""
        self.accepted = True
        if not self.known.done():
            self.known.set_result(None)

    def reject(self, failure: GoalFailure, text: str) -> None:
        """Note that the goal was not accepted."""
        self.text = text or failure.name.lower()
        error = None if failure in _REFUSALS else goal_error(self._name, failure, text)
        self.end_with(GoalEnd(text=self.text, error=error))

    def answer_cancels(self, accepted: bool, text: str) -> None:
        """Note the answer to the request to cancel."""
        waiting, self._cancels = self._cancels, []
        for answer in waiting:
            if not answer.done():
                answer.set_result((accepted, text))

    def end_with(self, end: GoalEnd) -> None:
        """End the goal."""
        if not self.over.done():
            self.over.set_result(end)
        if not self.known.done():
            self.known.set_result(None)
        is_over = end.status is GoalStatus.CANCELED
        self.answer_cancels(is_over, "" if is_over else "the goal has ended")

    @abstractmethod
    def _ask_cancel(self) -> bool:
        """Send the request to cancel; False: the goal has ended."""


class TakenGoal(Protocol):
    """A goal that was sent to this node."""

    value: Any
    """The goal, a dict or bytes."""
    client: int | None
    """Acoustic address of the client; None: the client is local."""

    def accept(self) -> bool:
        """Accept the goal; False: its client has given up, and the goal must not begin."""
        ...

    def reject(self, failure: GoalFailure, text: str) -> bool:
        """Reject the goal."""
        ...

    def feed(self, value: object) -> bool:
        """Send feedback; False: the goal does not run.

        Raises:
            LocalError: The feedback cannot be sent.
        """
        ...

    def finish(self, status: GoalStatus, value: object) -> bool:
        """End the goal; False: it does not run.

        Raises:
            LocalError: The result cannot be sent; the goal is aborted without one.
        """
        ...

    def answer_cancel(self, accepted: bool, text: str) -> bool:
        """Answer the request to cancel the goal."""
        ...


class GoalHandler(Protocol):
    """The server of an action."""

    def take(self, goal: TakenGoal) -> None:
        """Take a goal that has arrived."""
        ...

    def cancel(self, goal: TakenGoal) -> None:
        """Take a request to cancel an accepted goal."""
        ...


class GoalCarrier(Protocol):
    """Carries goals: the part of a `Carrier` for actions."""

    async def send(
        self,
        route: ActionRoute[Any, Any, Any],
        value: object,
        timeout_s: float | None,
        feed: TakeFeedback,
        tag: bytes,
    ) -> SentGoal:
        """Send a goal and wait for the answer; cancelling this call cancels the goal.

        Raises:
            LocalError: The goal cannot be sent.
            DeliveryError: Nobody has answered; see `goal_error`.
        """
        ...

    def recovered(
        self, route: ActionRoute[Any, Any, Any], feed: TakeFeedback
    ) -> Sequence[SentGoal]:
        """Return the goals sent before the restart of this node, each once."""
        ...

    def serve(self, route: ActionRoute[Any, Any, Any], handler: GoalHandler) -> Callable[[], None]:
        """Pass on the goals of an action; return the function that ends it.

        Raises:
            LocalError: This node already serves the action.
        """
        ...


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
