"""The pacers of all nodes: every mechanism that repeats something to a node asks its pacer.

While an answer of a node is awaited, nothing else is repeated to it. A silent node costs one frame
for each pause, whatever waits for it. As soon as it is heard, everything that waits is due.
"""

from collections import deque
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.signals import Signal
from zacoustic.core.peers.peers import Peers, PerPeer
from zacoustic.core.schedule.timing import LinkTimes, Pacer

_CROWD_ROUND_TRIPS: Final = 20
"""A node that was heard within this many round trips may be transmitting."""
_PRESENT_ROUND_TRIPS: Final = 4
"""A node that was heard within this many round trips is present."""


class Pacers(PerPeer[Pacer]):
    """A pacer for each node.

    Args:
        peers: The nodes.
        introduce: Makes the next frame to a node readable there: address, stream id.
    """

    def __init__(
        self,
        peers: Peers,
        introduce: Callable[[int, int], None] = lambda address, stream_id: None,
    ) -> None:
        super().__init__(peers, Pacer)
        self.times: LinkTimes | None = None
        """The airtimes of the link; None before it was up."""
        self.changed = Signal[[]]()
        """Something may go to a node sooner than was told before."""
        self.released = Signal[int, int]()
        """``(address, now)``: what waits for a node is due."""
        self._introduce = introduce
        self._heard_at = PerPeer(peers, int)
        self._repeating: deque[Callable[[int], None]] = deque()
        self._repeated_at = -1

    @property
    def link_times(self) -> LinkTimes:
        """`times` of a link that has been up, as after any transmission.

        Raises:
            RuntimeError: It has not.
        """
        if self.times is None:
            raise RuntimeError("the link has not been up")
        return self.times

    def on_repeat(self, told: Callable[[int], None]) -> None:
        """Register a mechanism that repeats what is due, whichever of them was due first."""
        self._repeating.append(told)

    def repeat(self, now: int) -> None:
        """Repeat all that is due, as far as the frames of one turn have room.

        The mechanism that was asked first in one turn is asked last in the next one.
        """
        if now != self._repeated_at:
            self._repeated_at = now
            self._repeating.rotate()
        for repeat in tuple(self._repeating):
            repeat(now)

    def heard(self, source: int, now: int) -> None:
        """A frame of a node arrived: if repetitions to it had become rare, they are due."""
        self._heard_at[source] = now
        pacer = self.get(source)
        if pacer is not None and pacer.heard():
            self._release(source, now)

    def answered(self, source: int, now: int) -> None:
        """A node has confirmed something that it lacked."""
        # Where two speak, silence is loss. Where more do, it may be that all speak at once: then
        # one answer does not mean that the channel is free.
        lately = now - self._round_trips_ns(_CROWD_ROUND_TRIPS)
        others = any(at > lately for each, at in self._heard_at.items() if each != source)
        self[source].answered(in_crowd=others)

    def await_nothing(self, address: int) -> None:
        """Await no answer of a node any more."""
        self[address].quiet_until = 0
        self.changed()

    def heard_at(self, address: int) -> int:
        """Return when a node was heard last, ns; before all instants if it never was."""
        return self._heard_at.get(address, -1)

    def introduce(self, address: int, stream_id: int, *, anyway: bool = False) -> None:
        """Make the next frame to a node readable there: a silent one may have forgotten us."""
        if anyway or self[address].is_silent:
            self._introduce(address, stream_id)

    def is_present(self, address: int, now: int) -> bool:
        """Tell whether a node was heard just now."""
        lately = now - self._round_trips_ns(_PRESENT_ROUND_TRIPS)
        return address in self._heard_at and self._heard_at[address] > lately

    def link_up(self, now: int) -> None:
        """The link is up: everything is due."""
        for address in list(self):
            self._release(address, now)

    # Below the methods above

    def _release(self, address: int, now: int) -> None:
        self.await_nothing(address)
        self.released(address, now)

    def _round_trips_ns(self, number: int) -> int:
        return number * self.times.first_round_trip_ns if self.times is not None else 0
