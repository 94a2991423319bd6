"""What a frame begins with, so that its hearers know by which table it is written.

It begins with nothing where all hearers have confirmed this life of the node; else:

=========  ============================  ===========================================================
HELLO      epoch, digest; 8 bytes        who hears it may never have heard of us, or asks for it
TAG and    epoch; the hearer's epoch; 7  a node whose HELLO we have, with our digest: that we know
CONFIRM                                  its table, and share it, says what ours is
TAG        epoch; 3                      the hearer has heard the rest, or will in another frame
=========  ============================  ===========================================================

A CONFIRM is what a node may rely on from then on, so it waits until nothing of a former life of the
hearer can arrive (`zacoustic.core.peers.handshake`). A *provisional
confirm* has not waited: it holds for the frame that it is in, and only a hearer that has been alive
for long may make more of it.
"""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.stats import Cause
from zacoustic.core.peers.peer import Peer
from zacoustic.core.peers.peers import Peers, PerPeer
from zacoustic.core.peers.states import Agreement
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import (
    ASSURED,
    HELLO_BYTES,
    PROVISIONAL,
    WIRE_VERSION,
    Confirm,
    Hello,
    Tag,
)

HELLO_EVERY: Final = 8
"""On broadcast one frame of this many carries a HELLO until all have confirmed: one byte a frame,
on average."""


class Introductions:
    """Introduces one node to the hearers of its frames.

    Args:
        address: Address of the node.
        epoch: Its boot epoch, 0…65535.
        table: Its stream table.
        peers: What is known of the others.
    """

    def __init__(self, address: int, epoch: int, table: StreamTable, peers: Peers) -> None:
        self._address = address
        self._table = table
        self._peers = peers
        self._since_hello = PerPeer(peers, Counter[str])
        """Frames since the last HELLO, by destination and link."""
        self.unit_ns = 0
        """The time in which the largest frame arrives, ns."""
        self.epoch = epoch
        self.digest = table.digest
        self.is_told = False
        """This life has said HELLO: before, nobody can know its epoch."""

    def table_changed(self) -> None:
        """Begin a new epoch, because the table is not what peers have confirmed."""
        self.epoch = (self.epoch + 1) & 0xFFFF
        self.digest = self._table.digest
        self._since_hello.clear()
        self.is_told = False

    def begin_frame(self, destination: int) -> None:
        """Nothing has been said in the frame that is composed now."""
        if destination != BROADCAST:
            self._peers[destination].is_being_confirmed = False

    def introduction(
        self, link: str, destination: int, room_bytes: int, now: int, *, urgent: bool = False
    ) -> bytes:
        """Return what a frame to `destination` begins with.

        Args:
            link: Name of the link that it goes by.
            destination: Address, or `BROADCAST`.
            room_bytes: What the frame has left beside its first record; a HELLO that does not fit
                is sent without it.
            now: The instant.
            urgent: The record must be in this frame: never displace it by a HELLO.
        """
        receivers = self._receivers(destination, now)
        silent = [peer for peer in receivers if not peer.confirmed_us]
        asked = self.introduces(link, destination)
        # Without a list nobody knows who hears a broadcast, whoever has confirmed.
        is_known = bool(receivers) and (destination != BROADCAST or bool(self._table.nodes))
        if is_known and not silent and not asked:
            return b""
        tag = Tag(self.epoch).encode()
        fits = room_bytes >= HELLO_BYTES
        if asked:
            wanted = fits or not urgent
        elif is_known and all(
            peer.differs_from(self.digest) or peer.agreement is Agreement.PROVISIONAL
            for peer in silent
        ):
            wanted = False
        else:
            turn = self._since_hello[destination][link] % HELLO_EVERY == 0
            wanted = (fits and (turn or destination != BROADCAST)) or (turn and not urgent)
        if not wanted:
            self._since_hello[destination][link] += 1
            return tag
        self._since_hello[destination][link] = 1
        self.is_told = True
        if destination != BROADCAST and not asked and receivers[0].shares(self.digest):
            return tag + self._early_confirm(destination, receivers[0], now)
        for peer in self._peers.values() if destination == BROADCAST else receivers:
            if peer.owes_hello and (destination != BROADCAST or peer.link == link):
                peer.owes_hello = False
                peer.answer_pause.use(now, self.unit_ns)
        return Hello(WIRE_VERSION, self.epoch, self.digest).encode()

    def introduces(self, link: str, destination: int) -> bool:
        """Tell whether a hearer of frames to `destination` waits for a HELLO, records or not."""
        if destination == BROADCAST:
            return any(peer.owes_hello and peer.link == link for peer in self._peers.values())
        return self._peers[destination].owes_hello

    def is_unconfirmed(self, destination: int, now: int) -> bool:
        """Tell whether somebody who hears frames to `destination` may yet confirm our table."""
        receivers = self._receivers(destination, now)
        return not receivers or any(
            peer.agreement is Agreement.UNCONFIRMED and not peer.differs_from(self.digest)
            for peer in receivers
        )

    def concerns_others(self, destination: int) -> bool:
        """Tell whether there are nodes of the fleet that a frame to one node is not for."""
        return any(each not in (self._address, destination) for each in self._fleet)

    # Below the methods above

    def _early_confirm(self, address: int, peer: Peer, now: int) -> bytes:
        """Say to a node that we know its table, and share it."""
        peer.is_being_confirmed = True
        named = PROVISIONAL
        if now >= peer.settled_at:
            named = ASSURED if peer.confirmed_us else address
            peer.said(Cause.CONFIRM, now, self.unit_ns)
        return Confirm(named, peer.present_epoch).encode()

    @property
    def _fleet(self) -> Iterable[int]:
        """The listed nodes; without a list all that have introduced themselves.

        Beside a list nobody is introduced to for having said a HELLO: anybody can.
        """
        heard = (each for each, peer in self._peers.items() if peer.epoch is not None)
        return self._table.nodes or heard

    def _receivers(self, destination: int, now: int) -> list[Peer]:
        if destination != BROADCAST:
            receivers = [self._peers[destination]]
        else:
            receivers = [self._peers[each] for each in self._fleet if each != self._address]
        for peer in receivers:
            peer.ripen(now)
        return receivers
