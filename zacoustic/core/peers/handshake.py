"""HELLO: before they decode anything, two nodes check that a stream id means the same to both.

The problem: an id is one byte, and its meaning is in the tables of both ends. A node may restart
with another table at any time, and any frame may be lost, including the first one after the
restart. A sample decoded by the wrong table is worse than a lost one.

The sender's side: each start of a node has a *boot epoch*. While any receiver of a frame has not
confirmed the current epoch, the frame begins with a HELLO (epoch and digest of the table, 8 bytes)
or with a TAG (the epoch alone, 3 bytes). Unicast frames carry the HELLO wherever it fits, broadcast
frames in one of eight. When all have confirmed, frames begin with nothing: in that state a sample
costs one byte.

The receiver's side has three rules:

1. A frame *without* HELLO or TAG is decoded only if the source's table is known to equal ours. A
   node confirms only a table that it knows to be equal, so a source that omits the TAG has our
   confirmation of its current boot epoch.
2. A frame *with* one is decoded only if it has the epoch of the HELLO that we heard last: all of it
   if the tables are equal, else those streams whose digests (TABLE rows) are known and equal.
3. Everything else is dropped as ``unconfirmed``, and the source is asked (ASK) for what is missing.
   A TAG of an epoch without a known HELLO erases what we knew of the source.

So a restarted node with a new table marks its frames with a new epoch until we know it (rule 2),
and a restarted receiver knows nothing and drops (rule 1), whichever frames are lost. Tables contain
the list of nodes, so "all have confirmed" means the same to both ends. Frames are also marked for a
node that is in no list, once it has introduced itself. If it stays silent, it is not protected from
the broadcasts of a new table and has to be restarted with that table.

Frames may also come twice, the second time within a *settling time* (`SETTLING_UNITS`). A duplicate
with an epoch does no harm. One without may be from an earlier boot epoch. So for a settling time
after a new epoch was heard, this node decodes no such frame and does not confirm the epoch: when
the source begins to omit its TAG, all frames of its earlier epochs have arrived, HELLOs included.

Nodes with different tables can never confirm each other: they introduce themselves unasked until
the pause between has grown to its maximum, and then only when asked. When what a node owes to a
peer goes is said in `zacoustic.core.peers.owing`.

A *provisional confirm* is a CONFIRM that does not wait for the settling time
(`zacoustic.core.peers.introducing`). It is true at that instant; only a late HELLO from an earlier
boot epoch of its receiver can undo it. The receiver knows how long it has been running. Once no
frame of an earlier epoch can be on its way, it treats the provisional confirm as a confirmation,
valid from when its sender decodes frames without a TAG, and answers with its own CONFIRM.
"""

import random
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.peers.agreementpolicy import CONFIRMING, AgreementPolicy
from zacoustic.core.peers.introducing import Introductions
from zacoustic.core.peers.owing import ASK_HELLO, Owing
from zacoustic.core.peers.peer import Peer, Row
from zacoustic.core.peers.peers import Peers
from zacoustic.core.peers.states import Agreement, Change, Life
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.wire.agreement import (
    ASSURED,
    PROVISIONAL,
    WIRE_VERSION,
    Ask,
    Confirm,
    Hello,
    TableRow,
)
from zacoustic.core.wire.frame import LAST_STREAM_ID

SETTLING_UNITS: Final = 4
"""A duplicate that a modem or the channel makes arrives within this many units. Modems need a few;
four is generous."""
LATEST_UNITS: Final = SETTLING_UNITS + 1
"""A frame arrives within a unit, so it and all its duplicates within this many units after its
transmission began. Whatever is done once is done once within this limit."""


def latest_ns(settling_ns: int) -> int:
    """Return the time in which a frame and all its duplicates arrive, by the settling time, ns."""
    return settling_ns * LATEST_UNITS // SETTLING_UNITS


def unit_ns(capabilities: LinkCapabilities) -> int:
    """Return the time in which the largest frame arrives, ns."""
    propagation_ns = seconds_to_ns(capabilities.propagation_s)
    return capabilities.airtime_ns(capabilities.mtu_bytes) + propagation_ns


class PeerSeen(msgspec.Struct, frozen=True, kw_only=True):
    """A node announced its epoch for the first time, or it restarted."""

    address: int
    """The node."""
    epoch: int
    """Its boot epoch."""
    same_table: bool
    """Its table has the same digest as ours."""
    wire_version: int
    """Its wire version; this node does not understand any other version than its own."""


class StreamsDiffer(msgspec.Struct, frozen=True, kw_only=True):
    """A node defines a stream differently: the stream stops between the two, others continue."""

    address: int
    """The node."""
    stream_id: int
    """The stream that differs, or that one of the two lacks."""


class Handshake:
    """Introduces this node to its peers, and decides which of their records may be decoded.

    Args:
        address: Address of this node.
        epoch: Its boot epoch, 0…65535.
        table: Its stream table.
        peers: The other nodes.
        rng: Draws the pauses before frames of its own.
        policy: Policy of the agreement on tables.
    """

    def __init__(
        self,
        address: int,
        epoch: int,
        table: StreamTable,
        peers: Peers,
        rng: random.Random,
        policy: AgreementPolicy = CONFIRMING,
    ) -> None:
        self._address = address
        self._table = table
        self._peers = peers
        self._policy = policy
        self.is_sealed = policy.is_sealed
        """The seal identifies the boot epoch and the table of a frame."""
        self.introductions = Introductions(address, epoch, table, peers, self._policy)
        self._units_ns: dict[str, int] = {}
        """Of each link that was up."""
        self.owing = Owing(table, peers, self.introductions, rng, policy)
        """What this node owes to others."""
        self.owing.unit_ns = seconds_to_ns(1)
        self.settling_ns = SETTLING_UNITS * self.owing.unit_ns
        """Time within which a duplicate of a frame can still arrive, ns."""
        self._began_at: int | None = None
        self.news: list[PeerSeen | StreamsDiffer] = []
        """Events for the engine to pass on."""

    @property
    def epoch(self) -> int:
        """The current boot epoch of this node."""
        return self.introductions.epoch

    @property
    def digest(self) -> bytes:
        """Digest of the table of this epoch."""
        return self.introductions.digest

    def begin(self, now: int) -> None:
        """Note the first instant of the boot epoch; later calls have no effect."""
        if self._began_at is None:
            self._began_at = now

    def use_link(self, link: str, capabilities: LinkCapabilities, now: int) -> None:
        """Scale the pauses to a link: a unit is the time in which the largest frame arrives.

        Knowledge of a node holds on all links, so the unit is that of the slowest one.
        """
        self._units_ns[link] = unit_ns(capabilities)
        longest_ns = max(self._units_ns.values())
        if len(self._units_ns) > 1 and longest_ns > self.owing.unit_ns and not self.is_sealed:
            for peer in self._peers.values():  # that link may bring frames of an earlier epoch
                peer.settled_at = max(peer.settled_at, now + SETTLING_UNITS * longest_ns)
        self.owing.unit_ns = longest_ns
        self.introductions.unit_ns = self.owing.unit_ns
        self.settling_ns = SETTLING_UNITS * self.owing.unit_ns

    def table_changed(self, now: int) -> None:
        """Begin a new epoch, because peers have confirmed another table."""
        self._began_at = now
        self.introductions.table_changed()
        for peer in self._peers.values():
            peer.doubt(Change.TABLE_CHANGED)

    # What this node says

    def introduce(self, link: str, address: int, stream_id: int) -> None:
        """Make a record in the next frame to a node readable, whatever the node has forgotten."""
        peer = self._peers[address]
        peer.link = link
        peer.owes_hello = not self.is_sealed
        if peer.digest != self.digest and (peer.digest or not self.is_sealed):
            peer.owed_rows[stream_id] = None

    def answers_within(self, address: int, duration_ns: int) -> None:
        """Wait this long for answers of a node before repeating anything to it.

        Args:
            address: The node.
            duration_ns: How long its answers take behind a device that decides when it transmits.
        """
        self._peers[address].answers_within_ns = duration_ns

    # What this node hears

    def begin_frame(self, source: int, size_bytes: int, now: int, *, unicast: bool) -> None:
        """Begin to read a frame of this many bytes, envelope included; its items follow."""
        peer = self._peers[source]
        if not self._table.lists(source):
            peer.credit_bytes = (peer.credit_bytes or 0) + size_bytes
        peer.heard_alone = unicast
        peer.confirms_now = False
        peer.rows_now.clear()
        peer.ripen(now)

    def authentic(self, source: int, life: int, digest: bytes, now: int) -> None:
        """Note that a sealed frame was opened.

        Args:
            source: Its sender.
            life: Its sender's life.
            digest: Of its sender's table; empty: the frame does not contain it.
            now: The instant.
        """
        peer = self._peers[source]
        is_new_life = peer.epoch != life
        if is_new_life:
            peer.begin_life(Change.NEW_LIFE)
            peer.epoch, peer.digest, peer.settled_at = life, b"", now
        if digest and digest != peer.digest:
            if peer.digest:
                peer.doubt(Change.TABLE_CHANGED)
            peer.digest = digest
            same = digest == self.digest
            self.news.append(
                PeerSeen(address=source, epoch=life, same_table=same, wire_version=WIRE_VERSION)
            )
            if not same and not peer.answer_pause.is_longest:
                self.owing.introduction(peer, now)
        if is_new_life:
            self._peers.restarted(source, life, now)

    def heard_hello(self, source: int, hello: Hello, now: int, *, unicast: bool = False) -> None:
        """Remember a HELLO, and answer it if it is new."""
        peer = self._peers[source]
        peer.is_assured &= not unicast
        # A digest of another wire version means nothing to us.
        digest = hello.digest if hello.version == WIRE_VERSION else b""
        peer.missed_epoch = None
        peer.questions.pop(ASK_HELLO, None)
        if not peer.is_owed:
            peer.speak_at = None
        is_new_epoch = peer.epoch != hello.epoch
        if (peer.epoch, peer.digest) != (hello.epoch, digest):
            self._note_restart(peer)
            peer.begin_life(Change.NEW_LIFE)
            peer.epoch, peer.digest = hello.epoch, digest
            peer.settled_at = now + self.settling_ns
            same = digest == self.digest
            self.news.append(
                PeerSeen(
                    address=source,
                    epoch=hello.epoch,
                    same_table=same,
                    wire_version=hello.version,
                )
            )
            if self._policy.answers(unicast=unicast):
                self._answer_introduction(peer, now)
        if is_new_epoch:
            self._peers.restarted(source, hello.epoch, now)

    def heard_tag(self, source: int, epoch: int, now: int, *, unicast: bool = False) -> None:
        """Note a TAG: its sender does not know that we know it."""
        peer = self._peers[source]
        peer.is_assured &= not unicast
        if peer.epoch == epoch:
            return
        peer.marked = peer.marked + 1 if peer.missed_epoch == epoch else 1
        peer.missed_epoch = epoch
        is_asked = ASK_HELLO in peer.questions
        self._note_restart(peer)
        # Our knowledge of it may be of an earlier epoch: better to have none.
        peer.begin_life(Change.STRAY_TAG)
        peer.epoch, peer.digest = None, b""
        if is_asked or self._policy.asks(peer.marked, unicast=unicast):
            self.owing.question(peer, ASK_HELLO, now)

    def heard_too_short(self, source: int, now: int) -> None:
        """Introduce this node to the source, whose record relies on an agreement that is gone."""
        if not self.is_sealed:
            self.owing.introduction(self._peers[source], now)

    def heard_too_long(self, source: int, now: int) -> None:
        """Confirm the source again, whose record does not rely on our agreement.

        It has heard us, and each of its records is longer until we do; so our confirms of before,
        which were in vain, do not delay this one. But where it hears us no more, such records
        would each get an answer: they end the delay ever less often.
        """
        peer = self._peers[source]
        if peer.confirmed_us:
            if now >= peer.named_pause.not_before:
                peer.named_pause.use(now, self.owing.unit_ns)
                peer.answer_pause.reset()
            self._answer_introduction(peer, now)

    def ask(self, address: int, now: int) -> None:
        """Ask a node for its HELLO: what is known of it does not hold."""
        self.owing.question(self._peers[address], ASK_HELLO, now)

    def is_present(self, epoch: int | None) -> bool:
        """Return whether an epoch that a frame repeats is the current one of this node.

        The sender of such a frame has heard this node since its start: the frame is not from an
        earlier epoch, and its sender does not guess. For a sealed frame the seal already shows it.
        """
        return self.is_sealed or (epoch == self.epoch and self.introductions.is_told)

    def heard_epoch(self, address: int) -> int | None:
        """Return the epoch of a node, to prove that this node heard it; None: no proof needed."""
        return None if self.is_sealed else self._peers[address].epoch

    def heard_introduced(self, source: int, epoch: int, now: int, *, unicast: bool) -> None:
        """Note records behind a HELLO or TAG: the source still waits for an answer to it."""
        peer = self._peers[source]
        if peer.epoch == epoch and self._policy.answers(unicast=unicast):
            self._answer_introduction(peer, now)

    def confirms_us(self, confirm: Confirm, *, unicast: bool) -> bool:
        """Return whether the sender of a CONFIRM knows our current epoch."""
        return self._is_present(confirm) and self._is_about_us(confirm, unicast=unicast)

    def heard_introduction(self, source: int) -> None:
        """Note a unicast frame that confirms us and introduces its source: it waits for an answer.

        The source has heard us, so the way back is open, and each of its frames begins so until we
        answer. On broadcast there is no haste: others may stay silent for ever.
        """
        self._peers[source].answer_pause.reset()

    def heard_confirm(
        self, source: int, confirm: Confirm, now: int, *, unicast: bool = False
    ) -> None:
        """Note that a peer knows our table and has the same."""
        if not self._is_about_us(confirm, unicast=unicast):
            return
        peer = self._peers[source]
        if not self._is_present(confirm):
            # It takes us for an earlier epoch, perhaps because of a late duplicate of its HELLO.
            peer.take(Change.DOUBT)
            self.owing.introduction(peer, now)
            return
        peer.confirms_now = unicast
        if confirm.address == PROVISIONAL:
            self._heard_provisional_confirm(peer, now)
            return
        peer.take(Change.CONFIRM)
        if unicast and confirm.address == ASSURED:
            if now >= peer.settled_at:
                peer.is_assured, peer.owes_confirm = True, False
        elif unicast and peer.shares(self.digest):
            # It has not heard our own CONFIRM; let that ride, since the peer may have no data.
            self.owing.confirm(peer)

    def ask_for_proof(self, address: int, now: int) -> None:
        """Introduce this node again: the CONFIRM shows which boot epoch of a peer is present."""
        peer = self._peers[address]
        peer.take(Change.DOUBT)
        peer.heard_alone = True  # what goes to all, nobody may answer
        self.owing.introduction(peer, now)

    def heard_ask(self, source: int, ask: Ask, now: int) -> bool:
        """Note that a peer wants our HELLO or a table row; True if it asked this node."""
        if ask.address != self._address:
            self._heard_question(ask, now)
            return False
        peer = self._peers[source]
        peer.take(Change.DOUBT)
        if ask.stream_id == ASK_HELLO:
            self.owing.hello(peer)
        else:
            self.owing.row(peer, ask.stream_id)
        # The peer has already waited before it asked; a second pause would grow with every loss.
        self.owing.speak_soon(peer, now)
        return True

    def heard_row(self, source: int, row: TableRow, now: int, *, unicast: bool = False) -> None:
        """Take a row of a peer's table."""
        peer = self._peers[source]
        if not 1 <= row.stream_id <= LAST_STREAM_ID:
            return
        if peer.epoch != row.epoch:
            self.owing.question(peer, ASK_HELLO, now)
            return
        if peer.shares(self.digest):
            return  # equal tables have equal rows, whatever the frame says
        known = peer.rows.get(row.stream_id)
        is_answer = self.is_sealed or row.stream_id in peer.asked_rows
        differs = row.digest != self.owing.digest_of(row.stream_id)
        if known is not None and known.is_sure and not is_answer:
            if known.digest != row.digest:
                self.owing.question(peer, row.stream_id, now)
            return
        peer.rows[row.stream_id] = Row(row.digest, is_answer)
        peer.rows_now.add(row.stream_id)
        peer.asked_rows.discard(row.stream_id)
        peer.questions.pop(row.stream_id, None)
        peer.ask_pause.reset()
        if not differs:
            return
        if is_answer:
            self._tell_difference(source, peer, row.stream_id)
        else:
            self.owing.question(peer, row.stream_id, now)
        answers = known is None and self._policy.answers(unicast=unicast)
        if answers and self.owing.row(peer, row.stream_id):
            self.owing.speak_soon(peer, max(now, peer.answer_pause.not_before))

    def verdict(self, source: int, epoch: int | None, stream_id: int, now: int) -> str | None:
        """Decide whether a record may be decoded.

        Args:
            source: Who sent the frame.
            epoch: From the frame's HELLO or TAG; None for a frame without.
            stream_id: The record's stream.
            now: The instant.

        Returns:
            None: it may; else the reason for the statistics, ``unconfirmed`` or ``differs``.
        """
        peer = self._peers[source]
        peer.ripen(now)
        if peer.shares(self.digest):
            if epoch == peer.epoch:
                return None
            if epoch is None and peer.life(now) is Life.SETTLED:
                peer.is_assured = True
                return None
        elif peer.epoch is not None and epoch == peer.epoch:
            row = peer.rows.get(stream_id)
            if row is not None and (row.is_sure or stream_id in peer.rows_now):
                return None if row.digest == self.owing.digest_of(stream_id) else "differs"
            self.owing.question(peer, stream_id, now)
            return "unconfirmed"
        # Without HELLO or TAG the source takes us for confirmed, because of an earlier epoch of
        # ours or of a late CONFIRM: the question corrects it.
        if epoch is None or ASK_HELLO in peer.questions:
            self.owing.question(peer, ASK_HELLO, now)
        return "unconfirmed"

    def may_measure(self, source: int, stream: Stream) -> bool:
        """Return whether a sealed record ends where this node's table says, as far as known."""
        peer = self._peers.get(source)
        row = None if peer is None else peer.rows.get(stream.stream_id)
        return (
            peer is None
            or peer.shares(self.digest)
            or stream.is_built_in
            or (row is not None and row.digest == stream.digest)
        )

    def misses_reference(self, source: int, now: int) -> None:
        """Tell a node that this one lacks a dense reference which the node assumes it has.

        Without a seal the message would only be understood when both know each other.
        """
        if self.is_sealed:
            self.owing.question(self._peers[source], ASK_HELLO, now)

    def differs(self, address: int, stream_id: int) -> bool:
        """Return whether a node is known to define a stream differently."""
        peer = self._peers.get(address)
        row = peer.rows.get(stream_id) if peer else None
        return row is not None and row.is_sure and row.digest != self.owing.digest_of(stream_id)

    def verdict_dense(self, source: int, epoch: int | None, now: int) -> str | None:
        """Decide whether a dense block may be decoded: that needs the whole table.

        Args and returns as `verdict`.
        """
        peer = self._peers[source]
        if peer.differs_from(self.digest) and epoch == peer.epoch:
            return "differs"
        return self.verdict(source, epoch, ASK_HELLO, now)

    def knows_difference(self, address: int) -> bool:
        """Return whether a node is known to have another table."""
        peer = self._peers.get(address)
        return peer is not None and peer.differs_from(self.digest)

    def peer(self, address: int) -> Peer:
        """Return the knowledge of a node and what is owed to it."""
        return self._peers[address]

    def peers(self) -> dict[int, Peer]:
        """Return the knowledge of each node heard so far, by address."""
        return dict(self._peers)

    # Below the methods above

    def _note_restart(self, peer: Peer) -> None:
        """Note that a known node restarted and knows nothing of this one."""
        if peer.epoch is not None and self._policy.speaks_to_all:
            self.introductions.restarted(peer.link)

    def _heard_question(self, ask: Ask, now: int) -> None:
        """Note a question to another node: if its answer goes to all, this node need not ask."""
        peer = self._peers.get(ask.address)
        if self._policy.speaks_to_all and peer is not None and ask.stream_id in peer.questions:
            del peer.questions[ask.stream_id]
            peer.ask_pause.use(now, self.owing.unit_ns)
            if ask.stream_id != ASK_HELLO:
                peer.asked_rows.add(ask.stream_id)  # that answer serves this node as well

    def _is_present(self, confirm: Confirm) -> bool:
        """Return whether a CONFIRM is of this start; an earlier one may have had the same epoch."""
        return confirm.epoch == self.epoch and self.introductions.is_told

    def _is_about_us(self, confirm: Confirm, *, unicast: bool) -> bool:
        return confirm.address == self._address or (
            unicast and confirm.address in (ASSURED, PROVISIONAL)
        )

    def _heard_provisional_confirm(self, peer: Peer, now: int) -> None:
        """Take a provisional confirm: it holds if this node has run long enough by then."""
        is_old = self._began_at is not None and now >= self._began_at + 2 * self.settling_ns
        if is_old and peer.agreement is Agreement.UNCONFIRMED:
            peer.take(Change.EARLY_CONFIRM)
            peer.holds_at = now + self.settling_ns
            if peer.shares(self.digest):
                # It introduces itself in every frame until it gets the answer.
                self.owing.confirm(peer)
                self.owing.speak_soon(peer, max(peer.holds_at, peer.confirm_at))

    def _answer_introduction(self, peer: Peer, now: int) -> None:
        if peer.digest == self.digest:
            if not self.owing.confirm(peer):
                return
            earliest = now if peer.confirm_at <= now else peer.confirm_at + self.owing.patience_ns
            self.owing.speak_soon(peer, earliest)
        elif not peer.answer_pause.is_longest:
            # It will never confirm us, so nothing shows that it has heard; a few times are enough.
            self.owing.introduction(peer, now)

    def _tell_difference(self, source: int, peer: Peer, stream_id: int) -> None:
        if stream_id not in peer.told_differing:
            peer.told_differing.add(stream_id)
            self.news.append(StreamsDiffer(address=source, stream_id=stream_id))
