"""One goal that this node has sent, and its state."""

import enum

from zacoustic.core.transport.actions.numbers import GoalNumbers
from zacoustic.core.transport.repeating import Repetition
from zacoustic.core.wire.goals import GoalKey


class ClientStage(enum.Enum):
    """State of a goal at its client."""

    OFFERED = "offered"
    """The server has not answered."""
    FOUND = "found"
    """A former life sent it; its outcome is asked."""
    RUNS = "runs"
    """The server has accepted it."""
    ENDED = "ended"
    """Its end is being journalled."""


class ClientGoal:
    """A goal that this node has sent.

    Args:
        key: Names it.
        server: Address of its server.
        stage: How far it is.
        deadline_at: Instant at which it is given up, ns, unless something is heard of it.
        tag: What the application gave with it.
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
        """Instant at which its outcome is asked, ns; None: the question is under way, or not
        needed."""
        self.numbers: GoalNumbers | None = None
        """Source of its number; None for a goal of a former life."""
        self.index = 0
        """How many goals had begun there before it."""
        self.offer: Repetition | None = None
        """The GOAL."""
        self.claim: Repetition | None = None
        """The CLAIM."""
        self.cancel: Repetition | None = None
        """The CANCEL."""
        self.cancel_wanted = False
        """The application waits for an answer to its cancel."""
        self.cancel_stands = False
        """The server has agreed to end the goal."""
        self.attempt = -1
        """The last attempt to cancel it, counted from 0; -1: there was none."""
        self.attempts_journalled = 0
        """How many attempts the journal allows."""
        self.repetitions: list[Repetition] = []
        """All repetitions for it, ended ones included."""

    @property
    def due_at(self) -> int | None:
        """Instant of the next step, ns."""
        if self.stage is ClientStage.ENDED:
            return None
        return self.deadline_at if self.claim_at is None else min(self.claim_at, self.deadline_at)

    @property
    def is_unsent(self) -> bool:
        """The server cannot have it: it was never transmitted."""
        is_new = self.stage is ClientStage.OFFERED
        return is_new and all(each.tries == 0 for each in self.repetitions)
