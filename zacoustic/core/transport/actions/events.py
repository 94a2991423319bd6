"""Events of actions for the application."""

from typing import Any

import msgspec

from zacoustic.core.wire.goals import GoalFailure, GoalKey, GoalStatus


class GoalReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A client sends a goal to this node: answer at once by `Actions.accept` or `.reject`."""

    goal: GoalKey
    """Names it."""
    value: Any
    """The goal."""
    deadline_at: int
    """Instant after which its client has given it up unless it was answered, ns."""


class CancelRequested(msgspec.Struct, frozen=True, kw_only=True):
    """The client of a goal that runs here wants it to end: answer by `Actions.answer_cancel`."""

    goal: GoalKey
    """Names it."""


class GoalRecovered(msgspec.Struct, frozen=True, kw_only=True):
    """A former life of this node sent a goal and did not learn its end; the goal goes on."""

    goal: GoalKey
    """Names it, as in the former life."""
    tag: bytes
    """What the application gave with it."""


class GoalAnswered(msgspec.Struct, frozen=True, kw_only=True):
    """The server has accepted or refused a goal of this node; a refusal is its end."""

    goal: GoalKey
    """Names it."""
    accepted: bool
    """It runs."""
    failure: GoalFailure | None = None
    """Why it was refused."""
    text: str = ""
    """One line for people."""


class FeedbackReceived(msgspec.Struct, frozen=True, kw_only=True):
    """Progress of a goal of this node."""

    goal: GoalKey
    """Names it."""
    value: Any
    """The feedback."""


class CancelAnswered(msgspec.Struct, frozen=True, kw_only=True):
    """The server will end a goal of this node, or will not; the result follows in either case."""

    goal: GoalKey
    """Names it."""
    accepted: bool
    """It will."""
    text: str = ""
    """Why not, one line."""


class ResultReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A goal of this node has ended."""

    goal: GoalKey
    """Names it."""
    status: GoalStatus
    """How."""
    value: Any
    """The result; None where the server gave none."""


class GoalFailed(msgspec.Struct, frozen=True, kw_only=True):
    """A goal of this node has no result and will get none."""

    goal: GoalKey
    """Names it."""
    failure: GoalFailure
    """Why."""
    text: str
    """One line for people."""


ActionEvent = (
    GoalReceived
    | CancelRequested
    | GoalRecovered
    | GoalAnswered
    | FeedbackReceived
    | CancelAnswered
    | ResultReceived
    | GoalFailed
)
"""Any of them."""
