"""Custody of one frame of a route: a node keeps it until a node further along the path has it."""

import enum
from collections.abc import Callable

from zacoustic.core.base.stats import Entries
from zacoustic.core.wire.relay import Number, Relayed


class Stage(enum.Enum):
    """What a frame in custody waits for."""

    WAITING = enum.auto()
    """To be transmitted."""
    ON_AIR = enum.auto()
    """The end of its transmission."""
    AWAITING = enum.auto()
    """A sign of a node further along."""


class Custody:
    """One frame of a route at a node that has to get it to the next one.

    Args:
        relayed: The frame.
        queued_at: Instant since which this node has it, ns.
        expires_at: Instant after which it is dropped, ns.
        ended: Called with the instant when it is over; None: it comes from another node.
        entries: What a frame of this node is to enter into the ledger.
        made_at: Instant at which it was made, ns; None: unknown.
    """

    __slots__ = (
        "ended", "entries", "expires_at", "made_at", "queued_at", "relayed", "stage", "tries",
    )  # fmt: skip

    def __init__(
        self,
        relayed: Relayed,
        queued_at: int,
        expires_at: int,
        ended: Callable[[int], None] | None = None,
        entries: Entries | None = None,
        made_at: int | None = None,
    ) -> None:
        self.made_at = made_at
        self.relayed = relayed
        self.queued_at = queued_at
        self.expires_at = expires_at
        self.ended = ended
        self.entries = entries
        self.stage = Stage.WAITING
        self.tries = 0

    @property
    def number(self) -> Number:
        """Which frame of which route it is."""
        return self.relayed.number

    @property
    def is_urgent(self) -> bool:
        """Whether it goes before all others."""
        return self.relayed.is_urgent

    @property
    def is_own(self) -> bool:
        """Whether the route begins at this node."""
        return self.ended is not None
