"""What carries goals: the part of the contract of a `Carrier` that is about actions.

Values cross it as codecs have them, dicts and bytes.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import msgspec

from zacoustic.core.engine.events import GoalFailure, GoalStatus
from zacoustic.errors import CallTimeoutError, DeliveryError, ZacousticError
from zacoustic.zenoh.node.routes import ActionRoute

TakeFeedback = Callable[[object], None]
"""Takes each feedback, a dict or bytes."""


class GoalEnd(msgspec.Struct, frozen=True, kw_only=True):
    """How a goal ended for its client."""

    status: GoalStatus = GoalStatus.UNKNOWN
    """How, where there is no error."""
    value: Any = None
    """The result, a dict or bytes; None: there is none."""
    text: str = ""
    """One line for people."""
    error: Exception | None = None
    """Why that is not known here."""


class SentGoal(Protocol):
    """A goal that the server has answered, or that a former boot epoch has sent."""

    @property
    def accepted(self) -> bool:
        """It runs, or has run."""
        ...

    @property
    def text(self) -> str:
        """Why it was rejected, one line."""
        ...

    @property
    def tag(self) -> bytes:
        """What was given with it."""
        ...

    async def cancel(self) -> tuple[bool, str]:
        """Ask the server to end it; returns whether it will, or why not.

        Raises:
            LocalError: It has ended.
        """
        ...

    async def end(self) -> GoalEnd:
        """Wait for its end; may be called several times, and cancelled."""
        ...


class TakenGoal(Protocol):
    """A goal that was sent to this node."""

    value: Any
    """The goal, a dict or bytes."""
    client: int | None
    """Acoustic address of the client; None: it is local."""

    def accept(self) -> bool:
        """Accept it; False: its client has given up, and it must not begin."""
        ...

    def reject(self, failure: GoalFailure, text: str) -> bool:
        """Refuse it."""
        ...

    def feed(self, value: object) -> bool:
        """Send feedback; False: it does not run.

        Raises:
            LocalError: It cannot be sent.
        """
        ...

    def finish(self, status: GoalStatus, value: object) -> bool:
        """End it; False: it does not run.

        Raises:
            LocalError: The result cannot be sent; it is aborted without one.
        """
        ...

    def answer_cancel(self, accepted: bool, text: str) -> bool:
        """Answer the wish to cancel it."""
        ...


class GoalHandler(Protocol):
    """Who serves an action."""

    def take(self, goal: TakenGoal) -> None:
        """A goal arrived."""
        ...

    def cancel(self, goal: TakenGoal) -> None:
        """An accepted goal was cancelled."""
        ...


class GoalCarrier(Protocol):
    """Carries goals: the part of a `Carrier` that is about actions."""

    async def send(
        self,
        route: ActionRoute[Any, Any, Any],
        value: object,
        timeout_s: float | None,
        feed: TakeFeedback,
        tag: bytes,
    ) -> SentGoal:
        """Send a goal, and wait until it is answered; cancelling this cancels the goal.

        Raises:
            LocalError: The goal cannot be sent.
            DeliveryError: Nobody has answered it; see `goal_error`.
        """
        ...

    def recovered(
        self, route: ActionRoute[Any, Any, Any], feed: TakeFeedback
    ) -> Sequence[SentGoal]:
        """Return the goals that a former boot epoch has sent, each once."""
        ...

    def serve(self, route: ActionRoute[Any, Any, Any], handler: GoalHandler) -> Callable[[], None]:
        """Hand over the goals of an action; returns what ends it.

        Raises:
            LocalError: It is served already.
        """
        ...


def goal_error(name: str, failure: GoalFailure, text: str) -> ZacousticError:
    """Make the exception of a goal without an answer, or with an unknown end."""
    kind = CallTimeoutError if failure is GoalFailure.TIMED_OUT else DeliveryError
    return kind(
        f"{name}: {text or failure.name.lower().replace('_', ' ')}", hint=_HINTS.get(failure, "")
    )


_HINTS = {
    GoalFailure.NO_SERVER: "start the program that serves it",
    GoalFailure.TABLE_MISMATCH: "compare both configs: zacoustic check FILE",
    GoalFailure.TIMED_OUT: "whether the goal runs is unknown",
}
