"""Which lives of other nodes are over, so that a call recorded in one of them runs no more.

A server names a call by the boot epoch of its client, and forgets it when nobody repeats it any
more. Whoever plays back the frames of a former life of the client later, its HELLO before them,
would have the call executed once more. So a node keeps the last boot epochs of each other one, in
its journal if it has one. An epoch counts when its node has shown by a CONFIRM that it
has heard this node in its present life: a forged HELLO makes no life of another node a former one.
"""

from collections.abc import Mapping
from typing import Final

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.peers.peers import Peers
from zacoustic.core.streams.table import StreamTable

_JOURNAL: Final = "lives"
_LIVES: Final = 9
"""So many are kept of a node, the present one included."""
_EPOCH_BYTES: Final = 2


class Lives:
    """The boot epochs of the nodes for which one node may do something.

    Args:
        table: Its streams.
        stored: What the journal has kept.
        journal: Keeps the rest.
        peers: The other nodes.
    """

    def __init__(
        self,
        table: StreamTable,
        stored: Mapping[str, bytes],
        journal: JournalPort,
        peers: Peers,
    ) -> None:
        self._journal = journal
        self._table = table
        self._of: dict[int, tuple[int, ...]] = {}
        for name, value in stored.items():
            head, _, node = name.partition("/")
            if head == _JOURNAL:
                steps = range(0, len(value), _EPOCH_BYTES)
                epochs = (value[step : step + _EPOCH_BYTES] for step in steps)
                self._of[int(node)] = tuple(int.from_bytes(each, "big") for each in epochs)
        peers.forgotten.connect(self._forget)

    def proved(self, address: int, epoch: int) -> None:
        """A node has shown that it has heard this one, in a life of this boot epoch."""
        known = self._of.get(address, ())
        if not self._table.lists(address) or epoch in known:
            return
        known = self._of[address] = (epoch, *known)[:_LIVES]
        value = b"".join(each.to_bytes(_EPOCH_BYTES, "big") for each in known)
        self._journal.write(f"{_JOURNAL}/{address}", value)

    def is_over(self, address: int, epoch: int) -> bool:
        """Tell whether a life of a node is known to be over."""
        return epoch in self._of.get(address, ())[1:]

    # Below the methods above

    def _forget(self, address: int, now: int) -> None:
        if self._of.pop(address, None) is not None:
            self._journal.write(f"{_JOURNAL}/{address}", None)
