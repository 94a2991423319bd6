"""What actions tell the application: events, and the words in them."""

import enum
from typing import Any

import msgspec


class GoalKey(msgspec.Struct, frozen=True):
    """Names a goal, at both ends and over restarts."""

    client: int
    """Address of the node that sent it."""
    epoch: int
    """Boot epoch in which it did."""
    stream_id: int
    """The action's stream."""
    number: int
    """0…31."""


class GoalStatus(enum.IntEnum):
    """How a goal ended; the numbers are those of ROS 2, and on the wire."""

    UNKNOWN = 0
    """Its server died while it ran, or lost it: what became of it is not known. No result."""
    SUCCEEDED = 4
    """It was reached."""
    CANCELED = 5
    """It was given up because its client wanted so."""
    ABORTED = 6
    """It was given up for another reason."""


class GoalFailure(enum.IntEnum):
    """Why a goal was refused, or has no result; the numbers are on the wire."""

    REJECTED = 1
    """The server's application does not want it; the text is its own."""
    NO_SERVER = 2
    """The server's node has nobody who serves."""
    BAD_GOAL = 3
    """The goal could not be decoded by the server's node."""
    TABLE_MISMATCH = 4
    """The two nodes hold different definitions of this stream."""
    BAD_RESULT = 5
    """The result could not be decoded here."""
    TIMED_OUT = 6
    """Not answered in time, or nothing was heard of it for too long: it may run, or have run."""
    CANCELLED = 7
    """Cancelled before it was accepted: it does not run."""
    UNKNOWN = 8
    """The server died while it ran, or does not know it any more: what became of it is unknown."""
    CANCEL_REFUSED = 9
    """Only in an answer to a cancel: the goal goes on."""


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
    """A former life of this node has sent a goal whose end it did not learn; it goes on."""

    goal: GoalKey
    """Names it, as in the former life."""
    tag: bytes
    """What the application gave with it."""


class GoalAnswered(msgspec.Struct, frozen=True, kw_only=True):
    """The server has accepted or refused a goal of this node; refused, that is its end."""

    goal: GoalKey
    """Names it."""
    accepted: bool
    """It runs."""
    failure: GoalFailure | None = None
    """Why it was refused."""
    text: str = ""
    """One line for people."""


class FeedbackReceived(msgspec.Struct, frozen=True, kw_only=True):
    """The server tells how far a goal of this node is."""

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
    """A goal of this node has no result, and none will come."""

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
