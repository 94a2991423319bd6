"""The contract of a `Carrier` for the goals of actions.

Values cross it as dicts and bytes, as in the codecs.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import msgspec

from zacoustic.core.engine.events import GoalFailure, GoalStatus
from zacoustic.errors import CallTimeoutError, DeliveryError, ZacousticError
from zacoustic.zenoh.node.routes import ActionRoute

TakeFeedback = Callable[[object], None]
"""Receives feedback, a dict or bytes."""


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


class SentGoal(Protocol):
    """A goal that the server has answered, or that this node sent before it restarted."""

    @property
    def accepted(self) -> bool:
        """Whether the goal runs or has run."""
        ...

    @property
    def text(self) -> str:
        """Why the goal was rejected, one line."""
        ...

    @property
    def tag(self) -> bytes:
        """The bytes given with the goal."""
        ...

    async def cancel(self) -> tuple[bool, str]:
        """Ask the server to cancel the goal; return whether it agrees, or why not.

        Raises:
            LocalError: The goal has ended.
        """
        ...

    async def end(self) -> GoalEnd:
        """Wait for the end of the goal; may be called several times, and cancelled."""
        ...


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
