"""How a frame begins, so that its receivers know which table it uses.

It begins with nothing where the policy of the fleet (`zacoustic.core.peers.agreementpolicy`) allows
that, mostly because all receivers have confirmed this node's boot epoch. Otherwise:

=========  ============================  ===========================================================
HELLO      epoch, digest; 8 bytes        for a receiver that may not know us, or asks for it
TAG and    epoch; the receiver's epoch;  for a node whose HELLO we have, with our digest: "we share
CONFIRM    7                             your table" also says what ours is
TAG        epoch; 3                      the receiver has heard the rest, or will in another frame
=========  ============================  ===========================================================

A node relies on a CONFIRM from then on, so a CONFIRM waits until no frame of an earlier epoch of
its receiver can arrive (`zacoustic.core.peers.handshake`). A *provisional confirm* does not wait:
it holds for the frame that contains it, and only a receiver that has been running for long may
treat it as a confirmation.
"""

from collections import Counter
from collections.abc import Iterable

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.stats import Cause
from zacoustic.core.peers.agreementpolicy import AgreementPolicy, Hearers, Opening
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


class Introductions:
    """Introduces one node to the receivers of its frames.

    Args:
        address: Address of the node.
        epoch: Its boot epoch, 0…65535.
        table: Its stream table.
        peers: What is known of the others.
        policy: Says when an introduction is needed.
    """

    def __init__(
        self,
        address: int,
        epoch: int,
        table: StreamTable,
        peers: Peers,
        policy: AgreementPolicy,
    ) -> None:
        self._address = address
        self._table = table
        self._peers = peers
        self._policy = policy
        self._since_hello = PerPeer(peers, Counter[str])
        """Marked frames since the last HELLO, including its frame, by destination and link."""
        self._hellos = PerPeer(peers, Counter[str])
        """Frames of this epoch with a HELLO, by destination and link."""
        self._newcomers: set[str] = set()
        """Links on which a node has restarted since the last HELLO to all."""
        self._announcing: set[str] = set()
        """Links on which the next HELLO to all is an announcement."""
        self.unit_ns = 0
        """The time in which the largest frame arrives, ns."""
        self.epoch = epoch
        self.digest = table.digest
        self.is_told = False
        """A HELLO of this epoch was sent: before that, nobody can know the epoch."""

    def table_changed(self) -> None:
        """Begin a new epoch, because peers have confirmed another table."""
        self.epoch = (self.epoch + 1) & 0xFFFF
        self.digest = self._table.digest
        self._since_hello.clear()
        self._hellos.clear()
        self.is_told = False

    def restarted(self, link: str) -> None:
        """Note that a node restarted: say HELLO in the next broadcast frame on that link."""
        self._newcomers.add(link)

    def announce(self, link: str) -> None:
        """Say HELLO in the next broadcast frame on that link, beside those that are due anyway.

        Perhaps nobody is there yet: then the first record needs one as well.
        """
        self._newcomers.add(link)
        self._announcing.add(link)

    def begin_frame(self, destination: int) -> None:
        """Begin to compose a frame; it contains nothing yet."""
        if destination != BROADCAST:
            self._peers[destination].is_being_confirmed = False

    def introduction(
        self, link: str, destination: int, room_bytes: int, now: int, *, urgent: bool = False
    ) -> bytes:
        """Return how a frame to `destination` begins.

        Args:
            link: Name of the link that it goes by.
            destination: Address, or `BROADCAST`.
            room_bytes: What the frame has left beside its first record; a HELLO that does not fit
                goes in a frame without it.
            now: The instant.
            urgent: The record must be in this frame: never displace it by a HELLO.
        """
        receivers = self._receivers(destination, now)
        opening = self._opening(link, destination, receivers)
        fits = room_bytes >= HELLO_BYTES
        if self._policy.is_sealed and (opening is Opening.BARE or (urgent and not fits)):
            self._since_hello[destination][link] += 1
            return b""
        if opening is Opening.BARE:
            return b""
        tag = Tag(self.epoch).encode()
        if opening is Opening.TAG or not (fits or (opening is Opening.HELLO and not urgent)):
            self._since_hello[destination][link] += 1
            return tag
        asked = self.introduces(link, destination)
        if destination == BROADCAST and link in self._announcing:
            self._announcing.discard(link)
        else:
            self._since_hello[destination][link] = 1
            self._hellos[destination][link] += 1
        if destination == BROADCAST:
            self._newcomers.discard(link)
        self.is_told = True
        if destination != BROADCAST and not asked and receivers[0].shares(self.digest):
            return tag + self._early_confirm(destination, receivers[0], now)
        self._introduced(link, destination, now)
        return Hello(WIRE_VERSION, self.epoch, self.digest).encode()

    def introduces(self, link: str, destination: int) -> bool:
        """Return whether a receiver of frames to `destination` waits for a HELLO in any case."""
        if destination == BROADCAST:
            return any(peer.owes_hello and peer.link == link for peer in self._peers.values())
        return self._peers[destination].owes_hello

    def is_due(self, link: str, destination: int) -> bool:
        """Return whether a sealed frame to `destination` has to state this node's table."""
        if not self._policy.is_sealed:
            return False
        receivers = [self._peers[destination]] if destination != BROADCAST else []
        return self._opening(link, destination, receivers) is Opening.HELLO

    def reaches_others(self, destination: int) -> bool:
        """Return whether a receiver of frames to `destination` is known to have another table.

        In a sealed frame receivers find out the table, but not where records end.
        """
        if not self._policy.is_sealed:
            return False
        if destination != BROADCAST:
            return self._peers[destination].differs_from(self.digest)
        return any(peer.differs_from(self.digest) for peer in self._peers.values())

    def is_unconfirmed(self, destination: int, now: int) -> bool:
        """Return whether a receiver of frames to `destination` may yet confirm our table."""
        if self._policy.is_sealed:
            return False
        receivers = self._receivers(destination, now)
        return not receivers or any(
            peer.agreement is Agreement.UNCONFIRMED and not peer.differs_from(self.digest)
            for peer in receivers
        )

    def concerns_others(self, destination: int) -> bool:
        """Return whether the fleet has nodes beside the receiver of a frame to one node."""
        return any(each not in (self._address, destination) for each in self._fleet)

    def is_only_other(self, address: int) -> bool:
        """Return whether a node and this one are all of a fleet that is listed."""
        return self._table.nodes.keys() == {self._address, address}

    # Below the methods above

    def _introduced(self, link: str, destination: int, now: int) -> None:
        """Note that the receivers that wait for a HELLO get one."""
        to_all = destination == BROADCAST
        for peer in self._peers.values() if to_all else (self._peers[destination],):
            if peer.owes_hello and (not to_all or peer.link == link):
                peer.owes_hello = False
                peer.answer_pause.use(now, self.unit_ns)

    def _opening(self, link: str, destination: int, receivers: list[Peer]) -> Opening:
        """Return how a frame begins; a HELLO that was asked for goes in any case."""
        is_for_newcomers = destination == BROADCAST and link in self._newcomers
        if is_for_newcomers or self.introduces(link, destination):
            return Opening.HELLO
        return self._policy.opening(
            to_all=destination == BROADCAST,
            hearers=self._hearers(destination, receivers),
            since_hello=self._since_hello[destination][link],
            hellos=self._hellos[destination][link],
        )

    def _hearers(self, destination: int, receivers: list[Peer]) -> Hearers:
        """Return what the receivers of a frame know of this node."""
        # Without a list nobody knows who hears a broadcast, even if some have confirmed.
        if not receivers or (destination == BROADCAST and not self._table.nodes):
            return Hearers.UNKNOWN
        if self._policy.is_sealed:
            shares = all(peer.shares(self.digest) for peer in receivers)
            return Hearers.AGREED if shares else Hearers.UNKNOWN
        silent = [peer for peer in receivers if not peer.confirmed_us]
        if not silent:
            return Hearers.AGREED
        is_told = all(
            peer.differs_from(self.digest) or peer.agreement is Agreement.PROVISIONAL
            for peer in silent
        )
        return Hearers.TOLD if is_told else Hearers.UNKNOWN

    def _early_confirm(self, address: int, peer: Peer, now: int) -> bytes:
        """Return a CONFIRM for a node whose table we know and share."""
        peer.is_being_confirmed = True
        named = PROVISIONAL
        if now >= peer.settled_at:
            named = ASSURED if peer.confirmed_us else address
            peer.said(Cause.CONFIRM, now, self.unit_ns)
        return Confirm(named, peer.present_epoch).encode()

    @property
    def _fleet(self) -> Iterable[int]:
        """Return the listed nodes; without a list all that have introduced themselves.

        With a list, a HELLO alone does not make a node count: anybody can send one.
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
