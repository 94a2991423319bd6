"""One goal that this node serves, and its state."""

import enum

from zacoustic.core.transport.repeating import Repetition
from zacoustic.core.wire.goals import GoalKey


class ServedStage(enum.Enum):
    """State of a goal at its server."""

    TAKEN = "taken"
    """It is being journalled; the application does not know it."""
    OFFERED = "offered"
    """The application has not answered."""
    RUNS = "runs"
    """The application has accepted it."""
    REFUSED = "refused"
    """It does not run; `answer` says why."""
    ENDED = "ended"
    """It has run; `answer` is its result."""


class CancelStage(enum.Enum):
    """The client's wish to end a goal that runs, or may still run."""

    NONE = "none"
    """Nothing."""
    WANTED = "wanted"
    """The client wants its end; the application does not know it yet."""
    ASKED = "asked"
    """The application has not answered."""
    ACCEPTED = "accepted"
    """The application will end it."""
    REFUSED = "refused"
    """The application will not."""


class ServedGoal:
    """A goal that this node was sent.

    Args:
        key: Names it.
        stage: How far it is.
        deadline_at: Instant after which its client does not wait for an answer any more, ns.
        forget_at:Instant from which it may be forgotten, ns; None: it runs.
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
        """The client has the result."""
        self.claimed_in: int | None = None
        """Later epoch of the client in which it has asked for the goal, or None."""
        self.repetition: Repetition | None = None
        """The RESULT on its way."""
        self.cancel = CancelStage.NONE
        self.cancel_attempt = 0
        """Which attempt of the client to cancel it `cancel` is about."""
        self.cancel_text = ""
        """Why not."""
