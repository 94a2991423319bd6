"""What the components of one engine share; each is made with it and takes what it needs."""

import random
from collections.abc import Callable, Mapping
from typing import Any

from zacoustic.core.base.generators import Generators
from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.base.timers import Timers
from zacoustic.core.peers.doubt import Doubt
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.peers import Peers
from zacoustic.core.peers.reception import Reception
from zacoustic.core.peers.statements import Statements
from zacoustic.core.schedule.hearing import hear_medium
from zacoustic.core.schedule.queue import TransmitQueue
from zacoustic.core.streams.table import StreamTable


class Context:
    """The node, and what is there once.

    Args:
        address: Address of the node, 1…254.
        table: Its streams.
        epoch: Its boot epoch, 0…65535.
        rng: Source of all randomness; one number is drawn from it.
        stored: What the journal has kept from earlier lives.
        emit: Takes events.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        epoch: int,
        rng: random.Random,
        stored: Mapping[str, bytes],
        emit: Callable[[Any], None],
    ) -> None:
        self.address = address
        self.table = table
        self.stored = stored
        self.emit = emit
        """Takes an event for the application."""
        self.generators = Generators(rng)
        """Random numbers, of each component its own."""
        self.journal = JournalPort()
        """Keeps what is to survive."""
        self.timers = Timers()
        """Call back when something is due."""
        self.stats = EngineStats()
        self.peers = Peers()
        """The other nodes, and signals of what becomes of them."""
        self.doubt = Doubt(address, table, stored, self.journal, emit)
        """Whether something of former lives is forgotten."""
        self.handshake = Handshake(
            address, epoch, table, self.peers, self.generators.of("handshake")
        )
        """What is agreed with the others."""
        self.reception = Reception()
        """Gives out what arrives to those that have registered."""
        self.queue = TransmitQueue()
        """Records that wait for a frame."""
        Statements(self.handshake, self.peers, self.reception)
        hear_medium(self.reception)
        self.peers.forgotten.connect(self.queue.peer_forgotten)
