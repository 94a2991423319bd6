"""Two nodes with one address: found where they hear each other, and where others hear both.

A node that hears a frame of its own address which it has not transmitted has a twin. Others see the
boot epoch of one node go back and forth: a restart leads to a new epoch, and never back to one that
was over. A frame may be late, so an epoch must return twice.

Twins look like an old copy of a journal: receivers know samples of the other one. So while a twin
is known, nobody's word makes this node doubt its journal.
"""

from collections import deque
from collections.abc import Callable
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.peers.doubt import Doubt

_SENT_KEPT: Final = 64
_EPOCHS_KEPT: Final = 4
_RETURNS: Final = 2
"""Returns to an earlier epoch, or foreign frames of the own address, that show it."""
_TELL_EVERY_NS: Final = seconds_to_ns(600.0)


class AddressShared(msgspec.Struct, frozen=True, kw_only=True):
    """Two nodes have one address, so each is taken for the other: samples mix and get lost."""

    address: int
    """The address: another node's, or this node's own."""


class Twins:
    """Which addresses two nodes have.

    Args:
        address: Address of this node.
        doubt: Believes nobody about its journal while this node has a twin.
        emit: Takes `AddressShared`, of each address at most every ten minutes.
    """

    def __init__(self, address: int, doubt: Doubt, emit: Callable[[Any], None]) -> None:
        self._address = address
        self._doubt = doubt
        self._emit = emit
        self._sent: deque[bytes] = deque(maxlen=_SENT_KEPT)
        self._epochs: dict[int, deque[int]] = {}
        self._signs: dict[int, int] = {}
        self._told_at: dict[int, int] = {}

    @property
    def shared(self) -> frozenset[int]:
        """The addresses that two nodes have."""
        return frozenset(self._told_at)

    def sent(self, frame: bytes) -> None:
        """Note a frame of this node: it may come back as an echo."""
        self._sent.append(frame)

    def heard_own(self, frame: bytes, now: int) -> None:
        """Take a frame of this node's own address."""
        if frame not in self._sent:
            self._sign(self._address, now)

    def heard_epoch(self, address: int, epoch: int, now: int) -> None:
        """Take the boot epoch of another node, other than its last one."""
        known = self._epochs.setdefault(address, deque(maxlen=_EPOCHS_KEPT))
        if epoch in known:
            self._sign(address, now)
            known.remove(epoch)
        known.append(epoch)

    def _sign(self, address: int, now: int) -> None:
        self._signs[address] = self._signs.get(address, 0) + 1
        told_at = self._told_at.get(address)
        if self._signs[address] < _RETURNS:
            return
        if told_at is None or now - told_at >= _TELL_EVERY_NS:
            self._told_at[address] = now
            if address == self._address:
                self._doubt.explain()
            self._emit(AddressShared(address=address))
