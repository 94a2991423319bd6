"""One node of a `VirtualNetwork`: its present engine, and what survives it."""

import random

from zacoustic.channel.profiles import ModemProfile
from zacoustic.core.base.linktypes import Transmission
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.engine.engine import Engine
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LocalError
from zacoustic.testing.virtualclock import NodeClock
from zacoustic.testing.virtualjournal import VirtualJournal


class NodeDownError(LocalError):
    """The node has crashed and has not started again."""


class VirtualNode:
    """A computer, its disk, its clocks and its modem.

    Args:
        address: Address.
        table: Streams of its engines.
        profile: What modem it has.
        journal: What survives a crash.
        clock: Its clocks.
        rng: Decides what a crash leaves of a commit.
    """

    __slots__ = (
        "address", "armed_at", "carriers", "clock", "engine", "exchange", "is_up", "journal",
        "lives", "past", "profile", "rng", "table", "transmits_until",
    )  # fmt: skip

    def __init__(
        self,
        address: int,
        *,
        table: StreamTable,
        profile: ModemProfile,
        journal: VirtualJournal,
        clock: NodeClock,
        rng: random.Random,
    ) -> None:
        self.address = address
        self.table = table
        self.profile = profile
        self.journal = journal
        self.clock = clock
        self.rng = rng
        self.engine: Engine | None = None
        """None while the node is down."""
        self.lives = 0
        """How often it has been started."""
        self.past: list[EngineStats] = []
        """The counters of former boot epochs."""
        self.armed_at: int | None = None
        """For when the engine's timer is set, on the node's own clock, ns."""
        self.is_up = True
        """The modem is plugged in."""
        self.transmits_until = 0
        self.exchange: tuple[Transmission, int] | None = None
        """Transmission whose acknowledgement the modem waits for, and when it began, ns."""
        self.carriers = 0
        """How many others are heard now."""

    @property
    def running(self) -> Engine:
        """The engine.

        Raises:
            NodeDownError: The node is down.
        """
        if self.engine is None:
            raise NodeDownError(f"node {self.address} is down; it has not started again")
        return self.engine
