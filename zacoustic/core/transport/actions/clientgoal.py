"""One goal that this node has sent, and its state."""

import enum

from zacoustic.core.transport.exchanges.numbers import NumberWindow
from zacoustic.core.transport.exchanges.repeating import Repetition
from zacoustic.core.wire.goals import GoalKey


class ClientStage(enum.Enum):
    """State of a goal at its client."""

    OFFERED = "offered"
    """The server has not answered."""
    FOUND = "found"
    """It was sent before a restart; its outcome is asked for."""
    RUNS = "runs"
    """The server has accepted it."""
    ENDED = "ended"
    """Its end is being journalled."""


class ClientGoal:
    """A goal that this node has sent.

    Args:
        key: Identifies the goal.
        server: Address of its server.
        stage: Its state.
        deadline_at: Instant at which it is given up, ns, unless a record about it comes.
        tag: The application's tag.
    """

    __slots__ = (
        "attempt", "attempts_journalled", "cancel", "cancel_stands", "cancel_wanted", "claim",
        "claim_at",
        "deadline_at", "index", "key", "numbers", "offer", "repetitions", "server", "stage", "tag",
    )  # fmt: skip

    def __init__(
        self, key: GoalKey, server: int, stage: ClientStage, deadline_at: int, tag: bytes
    ) -> None:
        self.key = key
        self.server = server
        self.stage = stage
        self.deadline_at = deadline_at
        self.tag = tag
        self.claim_at: int | None = None
        """Instant at which to ask for its outcome, ns; None: the question is under way or not
        needed."""
        self.numbers: NumberWindow | None = None
        """Source of its number; None: sent in an earlier boot epoch."""
        self.index = 0
        """How many goals began before it in `numbers`."""
        self.offer: Repetition | None = None
        """The transmission of the GOAL."""
        self.claim: Repetition | None = None
        """The transmission of the CLAIM."""
        self.cancel: Repetition | None = None
        """The transmission of the CANCEL."""
        self.cancel_wanted = False
        """Whether the application waits for an answer to its cancel."""
        self.cancel_stands = False
        """Whether the server has agreed to end the goal."""
        self.attempt = -1
        """The last attempt to cancel it, counted from 0; -1: none."""
        self.attempts_journalled = 0
        """How many attempts the journal covers."""
        self.repetitions: list[Repetition] = []
        """All repetitions for it, including ended ones."""

    @property
    def due_at(self) -> int | None:
        """Instant of the next step, ns."""
        if self.stage is ClientStage.ENDED:
            return None
        return self.deadline_at if self.claim_at is None else min(self.claim_at, self.deadline_at)

    @property
    def is_unsent(self) -> bool:
        """Whether it was never transmitted, so that the server cannot have it."""
        is_new = self.stage is ClientStage.OFFERED
        return is_new and all(each.tries == 0 for each in self.repetitions)
