"""One node of a `VirtualNetwork`: its present engine, and the parts that outlive it."""

import random

from zacoustic.channel.agenda import Entry
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.engine.engine import Engine
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LocalError
from zacoustic.testing.virtualclock import NodeClock
from zacoustic.testing.virtualjournal import VirtualJournal


class NodeDownError(LocalError):
    """The node has crashed and has not started again."""


class VirtualNode:
    """A computer, its disk and its clocks.

    Args:
        address: Address.
        table: Streams of its engines.
        journal: Survives a crash.
        clock: Its clocks.
        rng: Decides what a crash leaves of a commit.
    """

    __slots__ = (
        "address", "armed", "armed_at", "clock", "engine", "journal", "lives", "past", "rng",
        "table",
    )  # fmt: skip

    def __init__(
        self,
        address: int,
        *,
        table: StreamTable,
        journal: VirtualJournal,
        clock: NodeClock,
        rng: random.Random,
    ) -> None:
        self.address = address
        self.table = table
        self.journal = journal
        self.clock = clock
        self.rng = rng
        self.engine: Engine | None = None
        """The engine; None while the node is down."""
        self.lives = 0
        """How often the node has started."""
        self.past: list[EngineStats] = []
        """The counters of former boot epochs."""
        self.armed_at: int | None = None
        """Instant to which the engine's timer is set, on the node's own clock, ns."""
        self.armed: Entry | None = None
        """That timer."""

    @property
    def running(self) -> Engine:
        """The engine.

        Raises:
            NodeDownError: The node is down.
        """
        if self.engine is None:
            raise NodeDownError(f"node {self.address} is down; it has not started again")
        return self.engine
