"""What the transports of one link are given: what there is once in a node, and once on each link.

What a node knows of another one holds on whatever link it was heard: its table, its life, that it
is there. So do silence, the journal and the boot epoch. What depends on airtimes is apart for each
link: queue, repetitions and their pauses, windows of numbers, runs of objects, counters.
"""

from collections.abc import Callable
from typing import Any

import msgspec

from zacoustic.core.base.generators import Generators
from zacoustic.core.base.journal import EPOCH_KEY, JournalPort
from zacoustic.core.base.signals import Signal
from zacoustic.core.base.stats import LinkStats
from zacoustic.core.base.timers import Timers
from zacoustic.core.peers.contact import Contact
from zacoustic.core.peers.doubt import Doubt
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.peers import Peers
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable


class BootEpoch:
    """The boot epoch of one node: no frame goes before it is written down.

    Args:
        handshake: Says it to others.
        journal: Keeps it.
    """

    def __init__(self, handshake: Handshake, journal: JournalPort) -> None:
        self._handshake = handshake
        self._journal = journal
        self._to_keep = 0
        self.began = Signal[int]()
        """``(now)``: a new one has begun."""
        self._is_calling: list[Callable[[], bool]] = []
        self._write()

    @property
    def may_speak(self) -> bool:
        """It is written down: no other life of the node will have it.

        Nor will one where the store cannot be written: it has drawn this one, and draws the next.
        """
        return not self._to_keep or bool(self._journal.failure)

    def outlast(self, is_calling: Callable[[], bool]) -> None:
        """Have somebody asked before it is renewed whether a call is under way."""
        self._is_calling.append(is_calling)

    def begin(self, now: int) -> None:
        """Begin a new one: what peers have confirmed is over."""
        self._handshake.table_changed(now)
        self._write()
        self.began(now)

    def renew(self, now: int) -> bool:
        """Begin a new one unless a call is under way, which would not survive it.

        Returns:
            Whether it has begun.
        """
        if any(is_calling() for is_calling in self._is_calling):
            return False
        self.begin(now)
        return True

    def _write(self) -> None:
        self._to_keep += 1
        self._journal.write(EPOCH_KEY, self._handshake.epoch.to_bytes(2, "big"), self._kept)

    def _kept(self, now: int) -> None:
        self._to_keep -= 1


class NodeParts(msgspec.Struct, frozen=True, kw_only=True):
    """What there is once in a node, on however many links it speaks."""

    address: int
    """Address of the node."""
    table: StreamTable
    """Its streams."""
    rules: TransmitRules
    """What the config says."""
    peers: Peers
    """The other nodes."""
    handshake: Handshake
    """What is agreed with them."""
    epoch: BootEpoch
    """Its boot epoch."""
    contact: Contact
    """Who is lost."""
    doubt: Doubt
    """Whether something of former lives is forgotten."""


class LinkParts(msgspec.Struct, frozen=True, kw_only=True):
    """What each link of a node has for itself."""

    name: str
    """Name of the link."""
    journal: JournalPort
    """Keeps what is to survive."""
    timers: Timers
    """Call the components when something is due."""
    stats: LinkStats
    """Counts."""
    generators: Generators
    """One for each component that draws."""
    emit: Callable[[Any], None]
    """Takes events."""
