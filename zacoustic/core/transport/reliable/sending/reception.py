"""What a publisher knows of one receiver of a key."""


class Reception:
    """What one receiver is known to have of a lane."""

    __slots__ = (
        "anew", "contradicted_at", "expected", "in_sync", "is_told", "late_ns", "lineage",
        "settled_at", "skips_to",
    )  # fmt: skip

    def __init__(self, expected: int) -> None:
        self.expected = expected
        """It has told that it has everything before this number."""
        self.in_sync = False
        """It knows the lineage, and nothing that it waits for is gone."""
        self.skips_to = 0
        """It is not to have the sample before this number, and others may still lack that: until
        it has told to await this number, it is addressed alone, with a floor of its own."""
        self.lineage: int | None = None
        """The lineage in which it was told last where the count stands; None: not in this life."""
        self.is_told = False
        """It has told in this life what it awaits."""
        self.contradicted_at: int | None = None
        """Instant at which it acknowledged what cannot be, and was asked a second time, ns."""
        self.anew = 0
        """How often its count was begun anew for that."""
        self.late_ns: int | None = None
        """How long the last round trip took at least, if the next ACK says the same again, ns."""
        self.settled_at: int | None = None
        """Instant from which it can be in sync: short ACKs from before have arrived by then, ns."""
