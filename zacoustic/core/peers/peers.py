"""All other nodes: a `Peer` for each; and who keeps something of one is told what becomes of it.

What a node knows of another one is not all in its `Peer`: transports keep what they need in their
own types. Two signals hold that together. `restarted` is sent when a node tells that it has begun a
new life. `forget` frees everything that is kept of a node, wherever it is kept: a node that has
left the fleet, or an address that was only ever heard by mistake, costs nothing then.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

from zacoustic.core.peers.peer import Peer

Kept = TypeVar("Kept")

Restarted = Callable[[int, int, int], None]
"""``(address, epoch, now)``: a node has begun a life with this boot epoch."""
Forgotten = Callable[[int, int], None]
"""``(address, now)``: nothing is to be kept of a node."""


class Peers(dict[int, Peer]):
    """The other nodes, by address; of one that is not in it nothing is known yet."""

    def __init__(self) -> None:
        super().__init__()
        self._restarted: list[Restarted] = []
        self._forgotten: list[Forgotten] = []

    def __missing__(self, address: int) -> Peer:
        peer = self[address] = Peer()
        return peer

    def on_restart(self, told: Restarted) -> None:
        """Tell somebody of each new life, after those that have asked before."""
        self._restarted.append(told)

    def on_forget(self, told: Forgotten) -> None:
        """Have somebody free what it keeps of a node, after those that have asked before."""
        self._forgotten.append(told)

    def restarted(self, address: int, epoch: int, now: int) -> None:
        """A node has begun a new life."""
        for told in self._restarted:
            told(address, epoch, now)

    def forget(self, address: int, now: int) -> None:
        """Free all that is kept of a node; it is as if it had never been heard."""
        for told in self._forgotten:
            told(address, now)
        self.pop(address, None)


class PerPeer(dict[int, Kept], Generic[Kept]):
    """Something for each node, made when it is asked for and freed when the node is forgotten.

    Args:
        peers: The nodes.
        make: Makes it for one.
    """

    def __init__(self, peers: Peers, make: Callable[[], Kept]) -> None:
        super().__init__()
        self._make = make
        peers.on_forget(self._forget)

    def __missing__(self, address: int) -> Kept:
        kept = self[address] = self._make()
        return kept

    def _forget(self, address: int, now: int) -> None:
        self.pop(address, None)
