"""The events of actions."""

from typing import Any

import msgspec

from zacoustic.core.wire.goals import GoalFailure, GoalKey, GoalStatus


class GoalReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A client sends a goal to this node; answer at once with `Actions.accept` or `.reject`."""

    goal: GoalKey
    """The goal's key."""
    value: Any
    """The goal."""
    deadline_at: int
    """Instant after which its client gives up an unanswered goal, ns."""


class CancelRequested(msgspec.Struct, frozen=True, kw_only=True):
    """A client wants a goal to end that runs here; answer with `Actions.answer_cancel`."""

    goal: GoalKey
    """The goal's key."""


class GoalRecovered(msgspec.Struct, frozen=True, kw_only=True):
    """A goal from before a restart whose outcome this node does not know; it continues."""

    goal: GoalKey
    """The goal's key, as before the restart."""
    tag: bytes
    """The application's tag."""


class GoalAnswered(msgspec.Struct, frozen=True, kw_only=True):
    """The server has accepted or rejected a goal of this node; a rejection ends it."""

    goal: GoalKey
    """The goal's key."""
    accepted: bool
    """Whether it runs."""
    failure: GoalFailure | None = None
    """The reason for the rejection."""
    text: str = ""
    """One line for people."""


class FeedbackReceived(msgspec.Struct, frozen=True, kw_only=True):
    """Feedback on a goal of this node."""

    goal: GoalKey
    """The goal's key."""
    value: Any
    """The feedback."""


class CancelAnswered(msgspec.Struct, frozen=True, kw_only=True):
    """The server agrees to end a goal of this node, or refuses; its result follows either way."""

    goal: GoalKey
    """The goal's key."""
    accepted: bool
    """Whether the server agrees."""
    text: str = ""
    """The reason for the refusal, one line."""


class ResultReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A goal of this node has ended."""

    goal: GoalKey
    """The goal's key."""
    status: GoalStatus
    """How it ended."""
    value: Any
    """The result; None: the server gave none."""


class GoalFailed(msgspec.Struct, frozen=True, kw_only=True):
    """A goal of this node has no result and will not get one."""

    goal: GoalKey
    """The goal's key."""
    failure: GoalFailure
    """The reason."""
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
"""Any event of actions."""
