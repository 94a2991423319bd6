"""What this node owes to its peers about agreement: confirmations, questions, answers and rows.

A statement rides on a frame that goes anyway. It gets a frame of its own only after a random pause,
and each repetition doubles the pause. Only received frames cause any of this, so an idle system
stays silent. This node sends a stranger no more bytes than the stranger has sent.

A CONFIRM without a frame to ride on goes right after the next frame of its peer, because the peer
then has no other frame on its way. At any other instant it may have one, which would be lost while
this node transmits. So a CONFIRM that no such frame triggers waits until the peer has been silent
for a long time.
"""

import random
from typing import Final

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.parts import Offer
from zacoustic.core.base.stats import Cause
from zacoustic.core.peers.agreementpolicy import AgreementPolicy
from zacoustic.core.peers.introducing import Introductions
from zacoustic.core.peers.peer import Peer
from zacoustic.core.peers.peers import Peers
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import (
    ABSENT_DIGEST,
    ASK_BYTES,
    ASSURED,
    CONFIRM_BYTES,
    HELLO_BYTES,
    ROW_BYTES,
    Ask,
    Confirm,
    TableRow,
)

ASK_HELLO: Final = 0
"""In place of a stream: the question is for the HELLO."""
PATIENCE_UNITS: Final = 16
"""A confirmation waits this long for the peer's next frame: with 64 bytes over 1000 m 24 s, longer
than the time between two reports of a vehicle."""


class Owing:
    """Statements that wait for a frame, or for one of their own.

    Args:
        table: The streams of this node.
        peers: The other nodes; each `Peer` has what it is owed.
        introductions: Know the boot epoch of this node.
        rng: Draws the pauses before frames of their own.
        policy: Policy of the agreement on tables.
    """

    def __init__(
        self,
        table: StreamTable,
        peers: Peers,
        introductions: Introductions,
        rng: random.Random,
        policy: AgreementPolicy,
    ) -> None:
        self._table = table
        self._peers = peers
        self._introductions = introductions
        self._rng = rng
        self._policy = policy
        self.unit_ns = 0
        """Time in which the largest frame of the slowest link arrives, ns."""

    @property
    def patience_ns(self) -> int:
        """How long a confirmation waits for the next frame of a peer, ns."""
        return PATIENCE_UNITS * self.unit_ns

    def on(self, link: str) -> "OwedOnLink":
        """Return the frames that a link needs for owed statements alone."""
        return OwedOnLink(link, self._peers)

    # In frames that go

    def take(
        self, link: str, destination: int, room_bytes: int, now: int
    ) -> list[tuple[Cause, bytes]]:
        """Take what is owed to the receivers of a frame and fits in it, except a HELLO."""
        taken: list[tuple[Cause, bytes]] = []
        hearers = [destination]
        if destination == BROADCAST:
            hearers = sorted(each for each, peer in self._peers.items() if peer.link == link)
        for address in hearers:
            peer = self._peers.get(address)
            if peer is not None and peer.is_owed:
                peer.ripen(now)
                unicast = destination != BROADCAST
                for cause, control in self._controls(address, peer, now, unicast=unicast):
                    if len(control) > room_bytes:
                        break
                    room_bytes -= len(control)
                    taken.append((cause, control))
                    peer.is_being_confirmed |= unicast and cause is Cause.CONFIRM
                    peer.said(cause, now, self.unit_ns)
                if not peer.is_owed:
                    peer.speak_at = None
        return taken

    def spoken(self, link: str, destination: int, now: int) -> None:
        """Note that a frame went to a peer, or to all; what did not fit goes in a later one."""
        if destination != BROADCAST:
            peer = self._peers.get(destination)
            if peer is not None:
                self._spoken(peer, now)
        elif self._policy.speaks_to_all:
            for peer in self._peers.values():
                if peer.link == link and peer.speak_at is not None and peer.speak_at <= now:
                    self._spoken(peer, now)

    # Debts

    def confirm(self, peer: Peer) -> bool:
        """Owe a CONFIRM; return False if the peer has no credit for it."""
        peer.owes_confirm = peer.owes_confirm or peer.spend(CONFIRM_BYTES)
        return peer.owes_confirm

    def hello(self, peer: Peer) -> bool:
        """Owe a HELLO; return False if the peer has no credit for it."""
        peer.owes_hello = peer.owes_hello or peer.spend(HELLO_BYTES)
        return peer.owes_hello

    def row(self, peer: Peer, stream_id: int) -> bool:
        """Owe a row of this node's table; return False if the peer has no credit for it."""
        if stream_id not in peer.owed_rows and not peer.spend(ROW_BYTES):
            return False
        peer.owed_rows[stream_id] = None
        return True

    def question(self, peer: Peer, stream_id: int, now: int) -> None:
        """Ask a peer for a row of its table, or with `ASK_HELLO` for its HELLO."""
        if stream_id not in peer.questions and not peer.spend(ASK_BYTES):
            return
        peer.questions[stream_id] = None
        self.speak_soon(peer, max(now, peer.ask_pause.not_before))

    def introduction(self, peer: Peer, now: int) -> None:
        """Owe a HELLO, soon."""
        if self.hello(peer):
            self.speak_soon(peer, max(now, peer.answer_pause.not_before))

    def speak_soon(self, peer: Peer, earliest: int) -> None:
        """Give what is owed a frame of its own, unless another frame goes before."""
        to_all = self._policy.speaks_to_all and not peer.heard_alone
        shortest_ns, longest_ns = self.unit_ns // 2, 2 * self.unit_ns
        if to_all:
            longest_ns = self._policy.longest_pause_units(len(self._table.nodes)) * self.unit_ns
            shortest_ns = longest_ns // 2
        at = earliest + self._rng.randrange(shortest_ns, longest_ns + 1)
        if peer.speak_at is None or at < peer.speak_at:
            peer.speak_at, peer.speaks_to_all = at, to_all

    def digest_of(self, stream_id: int) -> bytes:
        """Return the digest of a row of this node's table."""
        stream = self._table.get(stream_id)
        return stream.digest if stream else ABSENT_DIGEST

    # Below the methods above

    def _spoken(self, peer: Peer, now: int) -> None:
        if not peer.is_owed:
            peer.speak_at = None
        elif peer.sayable_at <= now:
            peer.speak_at = now
        elif peer.speak_at is None or peer.speak_at <= now:
            # That instant was for something that was sent since.
            confirm_at = peer.confirm_at + self.patience_ns
            peer.speak_at = peer.ask_pause.not_before if peer.questions else confirm_at

    def _controls(
        self, address: int, peer: Peer, now: int, *, unicast: bool
    ) -> list[tuple[Cause, bytes]]:
        controls: list[tuple[Cause, bytes]] = []
        if peer.owes_confirm and peer.epoch is not None and peer.confirm_at <= now:
            named = ASSURED if unicast and peer.confirmed_us else address
            controls.append((Cause.CONFIRM, Confirm(named, peer.epoch).encode()))
        if peer.ask_pause.not_before <= now:
            controls += [
                (Cause.ASK, Ask(address, stream_id).encode()) for stream_id in peer.questions
            ]
        for stream_id in peer.owed_rows:
            row = TableRow(self._introductions.epoch, stream_id, self.digest_of(stream_id))
            controls.append((Cause.TABLE, row.encode()))
        return controls


class OwedOnLink:
    """Statements owed on one link that have found no other frame, as a source of frames.

    Args:
        link: Name of the link.
        peers: The other nodes.
    """

    def __init__(self, link: str, peers: Peers) -> None:
        self._link = link
        self._peers = peers

    def due_at(self, now: int) -> int | None:
        """Return when a frame that carries only owed statements may go, ns, or None."""
        earliest: int | None = None
        for peer in self._peers.values():
            at = peer.speak_at
            if at is None or peer.link != self._link or not peer.is_owed:
                continue
            if earliest is None or at < earliest:
                earliest = at
        return earliest

    def offer(self, now: int) -> Offer | None:
        """Offer what found no other frame in time: it goes before other waiting data."""
        if (at := self.due_at(now)) is None or at > now:
            return None
        address = min(
            address
            for address, peer in self._peers.items()
            if peer.speak_at == at and peer.link == self._link and peer.is_owed
        )
        destination = BROADCAST if self._peers[address].speaks_to_all else address
        return Offer(destination=destination, owed_first=True, rides=True, is_reply=True)
