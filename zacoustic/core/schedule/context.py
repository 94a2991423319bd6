"""What components share: what there is once in a node, and once on each of its links.

What a node knows of another one holds on whatever link it was heard: its table, its life, that it
is there. So do silence, the journal and the boot epoch. What depends on airtimes is apart for each
link: queue, repetitions and their pauses, windows of numbers, runs of objects, counters.
"""

import random
from collections.abc import Callable, Mapping
from typing import Any

from zacoustic.core.base.generators import Generators
from zacoustic.core.base.journal import BOOT_KEY, LIFE_KEY, JournalPort, stored_apart
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.base.timers import Timers
from zacoustic.core.peers.bootepoch import BootEpoch
from zacoustic.core.peers.doubt import Doubt
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.peers import Peers
from zacoustic.core.peers.reception import Reception
from zacoustic.core.peers.statements import Statements
from zacoustic.core.schedule.hearing import hear_medium
from zacoustic.core.schedule.queue import TransmitQueue
from zacoustic.core.streams.table import StreamTable

Emit = Callable[[Any], None]
"""Takes an event for the application."""


class NodeContext:
    """What there is once in a node, on however many links it speaks.

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
        emit: Emit,
    ) -> None:
        self.address = address
        self.table = table
        self.stored = stored
        self.emit = emit
        self.generators = Generators(rng)
        self.journal = JournalPort()
        self.timers = Timers()
        self.stats = EngineStats()
        self.peers = Peers()
        self.doubt = Doubt(address, table, stored, self.journal, emit)
        self.handshake = Handshake(
            address, epoch, table, self.peers, self.generators.of("handshake")
        )
        self.epoch = BootEpoch(self.handshake, self.journal)


class Context:
    """What the components of a node on one link are made with; each takes what it needs.

    Args:
        node: What there is once.
        link: Name of the link.
        emit: Takes the events of this link.
        is_first: It is the first link: what it keeps and draws has no name of its own.
    """

    def __init__(self, node: NodeContext, link: str, emit: Emit, *, is_first: bool) -> None:
        self.link = link
        """Name of the link."""
        self.address = node.address
        """Address of the node."""
        self.table = node.table
        """Its streams."""
        self.emit = emit
        """Takes an event for the application."""
        self.peers = node.peers
        """The other nodes, and signals of what becomes of them."""
        self.handshake = node.handshake
        """What is agreed with them."""
        self.epoch = node.epoch
        """Boot epoch of the node."""
        self.doubt = node.doubt
        """Whether something of former lives is forgotten."""
        self.stats = node.stats.on(link)
        """Counts."""
        self.journal = node.journal if is_first else node.journal.apart(link)
        """Keeps what is to survive."""
        self.timers = node.timers if is_first else node.timers.apart(link)
        """Call back when something is due."""
        self.generators = node.generators if is_first else node.generators.apart(link)
        """Random numbers, of each component its own."""
        common = {key: node.stored[key] for key in (LIFE_KEY, BOOT_KEY) if key in node.stored}
        self.stored = stored_apart(node.stored, None if is_first else link) | common
        """What the journal has kept from earlier lives."""
        self.reception = Reception()
        """Gives out what arrives to those that have registered."""
        self.queue = TransmitQueue()
        """Records that wait for a frame."""
        Statements(self.handshake, self.peers, self.reception)
        hear_medium(self.reception)
        self.peers.forgotten.connect(self.queue.peer_forgotten)
