"""One goal that this node serves, and its state."""

import enum

from zacoustic.core.transport.exchanges.taken import TakenExchange
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


class ServedGoal(TakenExchange[GoalKey]):
    """A goal that this node has received."""

    __slots__ = (
        "answer",
        "cancel",
        "cancel_attempt",
        "cancel_text",
        "claimed_in",
        "is_confirmed",
        "stage",
    )

    def __init__(self, key: GoalKey) -> None:
        super().__init__(key)
        self.stage = ServedStage.TAKEN
        self.answer = b""
        """Payload of REFUSED or RESULT."""
        self.is_confirmed = False
        """Whether the client has the result."""
        self.claimed_in: int | None = None
        """The later epoch in which the client has asked about the goal, or None."""
        self.cancel = CancelStage.NONE
        self.cancel_attempt = 0
        """The client's attempt that `cancel` refers to."""
        self.cancel_text = ""
        """The reason why the application refuses."""
