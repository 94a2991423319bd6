"""One goal that this node serves, and its state."""

import enum

from zacoustic.core.transport.exchanges.repeating import Repetition
from zacoustic.core.wire.goals import GoalKey


class ServedStage(enum.Enum):
    """State of a goal at its server."""

    TAKEN = "taken"
    """It is being journalled; the application does not know of it."""
    OFFERED = "offered"
    """The application has not answered."""
    RUNS = "runs"
    """The application has accepted it."""
    REFUSED = "refused"
    """It does not run; `answer` has the reason."""
    ENDED = "ended"
    """It has run; `answer` is its result."""


class CancelStage(enum.Enum):
    """State of the client's request to end a goal that runs, or may still run."""

    NONE = "none"
    """There is no request."""
    WANTED = "wanted"
    """The client has asked; the application does not know yet."""
    ASKED = "asked"
    """The application knows and has not answered."""
    ACCEPTED = "accepted"
    """The application will end the goal."""
    REFUSED = "refused"
    """The application refuses."""


class ServedGoal:
    """A goal that this node has received.

    Args:
        key: Identifies the goal.
        stage: Its state.
        deadline_at: Instant after which its client no longer waits for an answer, ns.
        forget_at: Instant at which it is forgotten, ns; None: it runs.
    """

    __slots__ = (
        "answer", "cancel", "cancel_attempt", "cancel_text", "claimed_in", "deadline_at",
        "forget_at", "is_confirmed", "is_journalled", "key", "repetition", "stage",
    )  # fmt: skip

    def __init__(
        self, key: GoalKey, stage: ServedStage, deadline_at: int, forget_at: int | None
    ) -> None:
        self.key = key
        self.stage = stage
        self.deadline_at = deadline_at
        self.forget_at = forget_at
        self.answer = b""
        """Payload of REFUSED or RESULT."""
        self.is_journalled = False
        """The answer is journalled and may be sent."""
        self.is_confirmed = False
        """Whether the client has the result."""
        self.claimed_in: int | None = None
        """The later epoch in which the client has asked about the goal, or None."""
        self.repetition: Repetition | None = None
        """The transmission of the RESULT."""
        self.cancel = CancelStage.NONE
        self.cancel_attempt = 0
        """The client's attempt that `cancel` refers to."""
        self.cancel_text = ""
        """The reason why the application refuses."""
