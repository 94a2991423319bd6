"""The pacers of all nodes: every mechanism that repeats something to a node asks its pacer.

While an answer from a node is awaited, nothing else is repeated to it. A silent node costs one
frame for each pause, whatever waits for it, and a day of silence a hundred at most
(`zacoustic.core.base.allowance`). As soon as it is heard, everything that waits for it is due.
"""

from collections import deque
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.signals import Signal
from zacoustic.core.peers.peers import Peers, PerPeer
from zacoustic.core.schedule.timing import LinkTimes, Pacer
from zacoustic.core.schedule.ways import Ways

_CROWD_ROUND_TRIPS: Final = 20
"""A node that was heard within this many round trips may be transmitting."""
_PRESENT_ROUND_TRIPS: Final = 4
"""A node that was heard within this many round trips is present."""


def _known(address: int, stream_id: int) -> None:
    """Do nothing: the next frame can be read."""


class Pacers(PerPeer[Pacer]):
    """A pacer for each node.

    Args:
        peers: The nodes.
        introduce: Makes the next frame to a node readable there: address, stream id.
    """

    def __init__(
        self,
        peers: Peers,
        introduce: Callable[[int, int], None] = _known,
    ) -> None:
        super().__init__(peers, Pacer)
        self.times: LinkTimes | None = None
        """The link's airtimes; None before it was up."""
        self.changed = Signal[[]]()
        """Emitted when something may go to a node sooner than its pacer said before."""
        self.released = Signal[int, int]()
        """``(address, now)``: everything that waits for a node is due."""
        self.hole_begins = Signal[int]()
        """``(now)``: the ends of other nodes' bulk service can be reached for a moment."""
        self.may_have_restarted = Signal[int]()
        """A node gets a try that is silent for so long that it may have restarted."""
        self._ways = PerPeer(peers, Ways)
        self._arrival = (0, 0, 0)
        self._introduce = introduce
        self._heard_at = PerPeer(peers, int)
        self.anybody_heard_at = -1
        """When any node was last heard, ns; -1 if never."""
        self._repeating: deque[Callable[[int], None]] = deque()
        self._repeated_at = -1

    @property
    def link_times(self) -> LinkTimes:
        """The `times` of a link that has been up, as after any transmission.

        Raises:
            RuntimeError: The link has not been up.
        """
        if self.times is None:
            raise RuntimeError("the link has not been up")
        return self.times

    def on_repeat(self, told: Callable[[int], None]) -> None:
        """Register a mechanism that repeats what is due, whichever mechanism was due first."""
        self._repeating.append(told)

    def repeat(self, now: int) -> None:
        """Repeat all that is due, as far as the frames of one turn have room.

        The mechanism that comes first in one turn comes last in the next one.
        """
        if now != self._repeated_at:
            self._repeated_at = now
            self._repeating.rotate()
        for repeat in tuple(self._repeating):
            repeat(now)

    def arrives(self, source: int, received_at: int, airtime_ns: int) -> None:
        """Note the frame that is about to be read: its end, and its duration, ns."""
        self._arrival = source, received_at, airtime_ns

    def answers(self, source: int, asked_at: int, linger_ns: int) -> None:
        """Learn how far a node is away from the frame that is being read: it answers at once.

        Args:
            source: The node.
            asked_at: End of the transmission that it answers, ns.
            linger_ns: How long it lets an answer linger, ns.
        """
        address, received_at, airtime_ns = self._arrival
        if address == source:
            round_trip_ns = received_at - airtime_ns - asked_at - linger_ns
            self._ways[source].answered(round_trip_ns // 2, received_at)

    def way(self, address: int, now: int) -> tuple[int, int] | None:
        """Return the propagation delay to a node as its answers show it, and its error, ns."""
        ways = self._ways.get(address)
        return None if ways is None else ways.way(now)

    def heard(self, source: int, now: int) -> None:
        """Record a frame from a node; if repetitions to it had become rare, make them due."""
        self._heard_at[source] = self.anybody_heard_at = now
        pacer, frames = self.get(source), 1 if self.times is None else self.times.frames_each
        if pacer is not None and pacer.heard(now, frames):
            self._release(source, now)

    def answered(self, source: int, now: int) -> None:
        """Record that a node has confirmed something that it lacked; if tries were rare, go on."""
        # With two nodes, silence means loss. With more, all may transmit at once: then one answer
        # does not mean that the channel is free.
        lately = now - self._round_trips_ns(_CROWD_ROUND_TRIPS)
        others = any(at > lately for each, at in self._heard_at.items() if each != source)
        if self[source].answered(in_crowd=others):
            self._release(source, now)

    def in_vain(self, address: int, at: int) -> None:
        """Record a frame, with nothing that is repeated, that a node did not answer.

        Args:
            address: The node.
            at: End of its transmission, ns.
        """
        pacer = self[address]
        pacer.allowance.sent(at, is_first=False)
        pacer.await_answer(at, at + pacer.allowance.pause_ns())
        self.changed()

    def quiet_until(self, address: int) -> int:
        """Return the instant until which an answer of a node is awaited, ns."""
        return self[address].quiet_until

    def await_nothing(self, address: int) -> None:
        """Stop awaiting an answer from a node."""
        pacer = self.get(address)  # a node that is being forgotten has none any more
        if pacer is not None:
            pacer.await_nothing()
        self.changed()

    def heard_at(self, address: int) -> int:
        """Return when a node was last heard, ns; -1 if never."""
        return self._heard_at.get(address, -1)

    def introduce(self, address: int, stream_id: int, *, anyway: bool = False) -> None:
        """Make the next frame to a silent node readable: it may have forgotten this one."""
        if anyway or self[address].may_have_restarted:
            self._introduce(address, stream_id)
        if self[address].may_have_restarted:
            self.may_have_restarted(address)

    def is_present(self, address: int, now: int) -> bool:
        """Return whether a node was heard just now."""
        lately = now - self._round_trips_ns(_PRESENT_ROUND_TRIPS)
        return address in self._heard_at and self._heard_at[address] > lately

    def begin_anew(self) -> None:
        """Forget how long nodes take to answer: frames go by another medium from now on."""
        self.clear()
        self._ways.clear()
        self.changed()

    def link_up(self, now: int) -> None:
        """Make everything due: the link is up."""
        for address in list(self):
            self._release(address, now)

    # Below the methods above

    def _release(self, address: int, now: int) -> None:
        self[address].release()
        self.changed()
        self.released(address, now)

    def _round_trips_ns(self, number: int) -> int:
        return number * self.times.first_round_trip_ns if self.times is not None else 0
