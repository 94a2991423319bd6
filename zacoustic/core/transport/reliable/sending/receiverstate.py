"""A publisher's state for one receiver of a key."""

from zacoustic.core.base.allowance import Allowance


class ReceiverState:
    """What one receiver is known to have of a lane."""

    __slots__ = (
        "allowance", "anew", "contradicted_at", "expected", "has_forgotten", "in_sync", "is_told",
        "lineage", "settled_at", "skips_to",
    )  # fmt: skip

    def __init__(self, expected: int) -> None:
        self.expected = expected
        """The receiver has reported that it has everything before this number."""
        self.in_sync = False
        """Whether the receiver knows the lineage and awaits nothing that is over."""
        self.has_forgotten = False
        """Whether it may lack what it has acknowledged: it has begun an epoch, or has asked."""
        self.skips_to = 0
        """The number after a sample that this receiver does not get but others may still lack.
        Until the receiver reports that it awaits this number, it is addressed alone, with a floor
        of its own."""
        self.lineage: int | None = None
        """The lineage last sent to the receiver or named by its SYNC since the restart; None: none
        yet."""
        self.is_told = False
        """Whether the receiver has reported since the restart which number it awaits."""
        self.contradicted_at: int | None = None
        """Instant of its first impossible acknowledgement, after which it was asked again, ns."""
        self.allowance = Allowance()
        """How many frames may still go in vain, while the receiver acknowledges none of the key."""
        self.anew = 0
        """How often the count was begun anew for this receiver."""
        self.settled_at: int | None = None
        """Instant from which it can be in sync, since all earlier short ACKs have arrived by then,
        ns."""
