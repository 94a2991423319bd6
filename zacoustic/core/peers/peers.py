"""All other nodes: a `Peer` for each, and signals for everything else that is kept per node.

A `Peer` does not hold all knowledge of a node: transports keep their part in their own types.
Signals connect them. `forget` frees all of it, wherever it is, so a node that has left the fleet,
or an address that was heard by mistake, costs nothing any more.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

from zacoustic.core.base.signals import Signal
from zacoustic.core.peers.peer import Peer

Kept = TypeVar("Kept")


class Peers(dict[int, Peer]):
    """The other nodes by address; a missing one is created on access."""

    def __init__(self) -> None:
        super().__init__()
        self.restarted = Signal[int, int, int]()
        """``(address, epoch, now)``: a node began a new boot epoch."""
        self.proved = Signal[int, int, int]()
        """``(address, epoch, now)``: a node has shown that it has heard this one."""
        self.asked = Signal[int, int]()
        """``(address, now)``: a node asked for the HELLO of this one, or a row of its table."""
        self.differs = Signal[int, int, int]()
        """``(address, stream_id, now)``: a node defines a stream differently."""
        self.forgotten = Signal[int, int]()
        """``(address, now)``: free everything that belongs to a node."""

    def __missing__(self, address: int) -> Peer:
        peer = self[address] = Peer()
        return peer

    def forget(self, address: int, now: int) -> None:
        """Free everything that belongs to a node, as if it had never been heard."""
        self.forgotten(address, now)
        self.pop(address, None)


class PerPeer(dict[int, Kept], Generic[Kept]):
    """A value for each node: created on first use, freed when the node is forgotten.

    Args:
        peers: The nodes.
        make: Creates it for a node.
    """

    def __init__(self, peers: Peers, make: Callable[[], Kept]) -> None:
        super().__init__()
        self._make = make
        peers.forgotten.connect(self._forget)

    def __missing__(self, address: int) -> Kept:
        kept = self[address] = self._make()
        return kept

    def _forget(self, address: int, now: int) -> None:
        self.pop(address, None)
