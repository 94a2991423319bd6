"""Which boot epochs of other nodes are over, so that a recorded call of one is not executed again.

A server identifies a call by the boot epoch of its client, and forgets it when nobody repeats it
any more. An attacker could play back frames from an earlier epoch of the client, HELLO first, and
the server would execute the call once more. So a node keeps the last boot epochs of each other
node, in its journal if it has one. An epoch counts when a frame with it shows by a CONFIRM that its
sender has heard this node since this node's start: a forged HELLO does not end an epoch.

An attacker that listens can forge that CONFIRM or play it back. So an epoch that seemed to be over
becomes valid when it is shown again, but only after a settling time: a frame is no proof of
itself.
"""

from collections.abc import Mapping
from typing import Final

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.peers.peers import Peers
from zacoustic.core.streams.table import StreamTable

_JOURNAL: Final = "lives"
_LIVES: Final = 9
"""Epochs kept of a node, including the current one."""
_EPOCH_BYTES: Final = 2


class Lives:
    """The boot epochs of nodes for which this node may execute something.

    Args:
        table: Its streams.
        stored: What the journal had at the start.
        journal: Stores changes.
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
        """Boot epochs by node, latest first."""
        self._again: dict[int, tuple[int, int]] = {}
        """``(epoch, instant)``: an epoch that is valid again from then on, by node."""
        for name, value in stored.items():
            head, _, node = name.partition("/")
            if head == _JOURNAL:
                steps = range(0, len(value), _EPOCH_BYTES)
                epochs = (value[step : step + _EPOCH_BYTES] for step in steps)
                self._of[int(node)] = tuple(int.from_bytes(each, "big") for each in epochs)
        peers.forgotten.connect(self._forget)

    def proved(self, address: int, epoch: int, settled_at: int) -> None:
        """Note a frame that shows that its sender has heard this node.

        Args:
            address: Its sender.
            epoch: Its boot epoch.
            settled_at: When all frames sent earlier have arrived, ns.
        """
        if not self._table.lists(address):
            return
        if not self._is_former(address, epoch):
            self._begin(address, epoch)
        elif self._again.get(address, (None, 0))[0] != epoch:
            self._again[address] = epoch, settled_at

    def is_over(self, address: int, epoch: int, now: int) -> bool:
        """Return whether a boot epoch of a node is known to be over."""
        again, at = self._again.get(address, (None, 0))
        if again == epoch and now >= at:
            self._begin(address, epoch)
        return self._is_former(address, epoch)

    # Below the methods above

    def _is_former(self, address: int, epoch: int) -> bool:
        return epoch in self._of.get(address, ())[1:]

    def _begin(self, address: int, epoch: int) -> None:
        self._again.pop(address, None)
        known = self._of.get(address, ())
        if known[:1] == (epoch,):
            return
        known = self._of[address] = (epoch, *(each for each in known if each != epoch))[:_LIVES]
        value = b"".join(each.to_bytes(_EPOCH_BYTES, "big") for each in known)
        self._journal.write(f"{_JOURNAL}/{address}", value)

    def _forget(self, address: int, now: int) -> None:
        self._again.pop(address, None)
        if self._of.pop(address, None) is not None:
            self._journal.write(f"{_JOURNAL}/{address}", None)
