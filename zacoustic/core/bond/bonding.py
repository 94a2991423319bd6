"""A node's part in one bond: which links a frame goes by, and who has answered.

The streams of a bond have one set of transports, so their calls, counts and objects do not know by
which link a frame goes. Each frame takes, for each of its receivers, the first link that reaches
that receiver, and so a switch loses and doubles nothing:

- On links that cost nothing, each receiver answers each frame. A frame without an answer goes again
  by the next link, as it is.
- While a link is in doubt (`zacoustic.core.bond.reach`), frames go by it and by the next one.
  Urgent frames do so unless it has just been answered.
- A receiver takes each frame once: its number and its bytes identify it for a minute.

`zacoustic.core.bond.policy` chooses the links.

While something waits for nodes that a better link does not reach, that link is tried every few
seconds. An idle node transmits nothing.

An answer is sealed like any frame of the bond. Numbers, and questions without a frame, are not: who
forges them makes nodes answer on links that cost nothing, and use two links in place of one.
"""

import random
import zlib
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.base.stats import Entries, LinkStats
from zacoustic.core.base.timers import Due
from zacoustic.core.bond.outbox import BondFrame, Outbox
from zacoustic.core.bond.policy import LinkPolicy
from zacoustic.core.bond.reach import PeerReach, Reach
from zacoustic.core.bond.spec import Bond, BondLink
from zacoustic.core.peers.handshake import unit_ns
from zacoustic.core.peers.peers import PerPeer
from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.hopage import UNBOUNDED, hop_age, travelled
from zacoustic.core.wire.bond import (
    ANSWER_CODE,
    MOST_ANSWERS,
    Bonded,
    decode,
    decode_answers,
    encode_answers,
)
from zacoustic.core.wire.frame import PADDING
from zacoustic.core.wire.relay import HEADER_BYTES

_ANSWER_NS: Final = NS_PER_S // 10
"""Time in which a receiver decides and begins to answer, beside airtimes and propagation."""
_SEEN_NS: Final = 60 * NS_PER_S
"""How long frames are remembered, ns."""
_MOST_OWED: Final = 4 * MOST_ANSWERS
"""The most answers that wait for one node."""

Deliver = Callable[[ReceivedFrame, int, Callable[[int], None]], None]
"""``(frame, now, opened_at)``: takes a frame of the bond; `opened_at` is called with the instant
once a sealed one has been opened."""
Report = Callable[[TransmitReport, int], None]
"""Takes the end of a transmission on the bond."""


class PeerReachable(msgspec.Struct, frozen=True, kw_only=True):
    """A link of a bond reaches a node, does not, or is in doubt."""

    address: int
    """The node."""
    link: str
    """Name of the link."""
    bond: str
    """Name of the bond."""
    reach: Reach
    """Whether it reaches the node."""
    changed_at: int
    """Instant of the change, ns."""


class BondStatus(msgspec.Struct, frozen=True, kw_only=True):
    """What a bond does at present."""

    name: str = ""
    """Name of the bond."""
    links: tuple[str, ...] = ()
    """Its links at this node, the best one first."""
    in_use: str | None = None
    """The link whose airtimes hold: the best one that reaches all; None: none is up."""
    reach: dict[int, dict[str, Reach]] = {}
    """By address and link, whether it reaches the node."""
    again: int = 0
    """Frames that went again by the next link for lack of an answer."""


class _Awaited(msgspec.Struct):
    """A frame whose answers are awaited."""

    frame: Transmission
    entries: Entries
    is_urgent: bool
    expires_at: int | None
    by_link: dict[str, set[int]]
    """Who has not answered, by the link."""
    due_at: dict[str, int]
    """When they should have, by the link; only once it has left, ns."""
    given: dict[str, None]
    """The links by which it went."""
    made_at: int
    """Instant at which it was made, ns."""


class _Seen(msgspec.Struct):
    """A frame of another node that has come."""

    at: int
    is_read: bool = False
    """Whether it is authentic."""
    links: dict[str, bool] = {}
    """By which links it came, and whether its receivers answer there."""


class _Sent:
    """A frame on its way by several links; its end is that of the first one that sent it."""

    def __init__(self, frame: Transmission, links: int, report: Report) -> None:
        self._transmission_id = frame.transmission_id
        self._left = links
        self._report: Report | None = report

    def ended(self, report: TransmitReport, now: int) -> None:
        """Take the end on one link."""
        self._left -= 1
        is_sent = _has_left(report)
        tell = self._report
        if tell is None or not (is_sent or self._left == 0):
            return
        self._report = None
        outcome = TransmitOutcome.SENT if is_sent else report.outcome
        tell(
            msgspec.structs.replace(report, transmission_id=self._transmission_id, outcome=outcome),
            now,
        )


class Bonding:
    """One bond of one node.

    Args:
        bond: The bond.
        links: How it treats each of its links at this node, in its order.
        hearers: The nodes that its frames concern, heard or not.
        context: The node on the bond, as on a link.
        stats: The counters of each of its links.
        rng: Draws the first number.
    """

    def __init__(
        self,
        bond: Bond,
        links: dict[str, BondLink],
        hearers: Sequence[int],
        context: Context,
        stats: Mapping[str, LinkStats],
        rng: random.Random,
    ) -> None:
        self.bond = bond
        """The bond."""
        self._rules = dict(links)
        self._hearers = tuple(hearers)
        self._context = context
        self.outboxes = {link: Outbox(stats[link]) for link in links}
        """What waits for each of its links."""
        self._reach = {
            link: PerPeer(
                context.peers, partial(PeerReach, rules, is_last=link == next(reversed(links)))
            )
            for link, rules in links.items()
        }
        self._policy = LinkPolicy(self._rules, self._reach, self.outboxes)
        self._numbers, self._most_seen = context.sizes.hops, context.sizes.seen_hops
        self._next_seq = rng.randrange(self._numbers)
        self._awaited: dict[int, _Awaited] = {}
        self._owed: PerPeer[list[tuple[int, int]]] = PerPeer(context.peers, list)
        self._came_by: PerPeer[str] = PerPeer(context.peers, str)
        """By which link the last frame of a node came."""
        self._heard: PerPeer[bool] = PerPeer(context.peers, bool)
        """The nodes of which a frame was read."""
        self._seen: OrderedDict[tuple[int, int, int], _Seen] = OrderedDict()
        self._again = 0
        self._deliver: Deliver | None = None
        self._report: Report | None = None
        self._is_waiting: Callable[[], bool] = lambda: False
        context.reception.on_extension(ANSWER_CODE, self._answered)
        context.reception.read.connect(self._read)

    def begin(self, deliver: Deliver, report: Report, is_waiting: Callable[[], bool]) -> None:
        """Take who takes frames and reports, and who tells whether anything waits."""
        self._deliver, self._report, self._is_waiting = deliver, report, is_waiting

    # Getters

    @property
    def capabilities(self) -> LinkCapabilities | None:
        """What the bond can do as a link at present; None: none of its links is up."""
        return self._policy.capabilities(self._concerned)

    @property
    def is_costly(self) -> bool:
        """Whether every link that is up costs money."""
        return not self._policy.free_of_money

    @property
    def slowest_unit_ns(self) -> int:
        """The time in which the largest frame arrives by the slowest link, ns."""
        return self._policy.slowest_unit_ns

    @property
    def status(self) -> BondStatus:
        """What the bond does at present."""
        return BondStatus(
            name=self.bond.name,
            links=tuple(self._rules),
            in_use=self._policy.in_use(self._concerned),
            reach={
                peer: {link: self._reach[link][peer].state for link in self._rules}
                for peer in self._concerned
            },
            again=self._again,
        )

    def extra_bytes(self, now: int) -> int:
        """Return by how many bytes a frame that goes now may be larger than `capabilities` say."""
        return self._policy.extra_bytes(self._concerned, now)

    # Inputs

    def handle_state(
        self,
        link: str,
        state: LinkState,
        capabilities: LinkCapabilities | None,
        room_bytes: int,
        now: int,
    ) -> None:
        """Take the state of one of its links.

        Args:
            link: Its name.
            state: Its state.
            capabilities: What it can do; None: unknown yet.
            room_bytes: Content of one of its frames without envelope, bytes.
            now: The instant, ns.
        """
        if state is LinkState.UP and capabilities is not None:
            self._policy.link_up(link, capabilities, room_bytes)
            self._rearm(now)
            return
        if not self._policy.link_down(link):
            return
        for peer in list(self._reach[link]):
            self._change(link, peer, now, PeerReach.lost)
        for awaited in list(self._awaited.values()):
            if link in awaited.by_link:
                awaited.due_at[link] = now
        self.outboxes[link].clear(now)
        self._review(now)

    def submit(
        self,
        frame: Transmission,
        entries: Entries,
        now: int,
        *,
        is_urgent: bool = False,
        is_granted: bool = False,
        expires_at: int | None = None,
        is_heartbeat: bool = False,
    ) -> None:
        """Take a frame of this node.

        Args:
            frame: The frame.
            entries: What it is to enter into the ledger.
            now: The instant, ns.
            is_urgent: Whether it goes before all others.
            is_granted: Whether it may go although the node is silent.
            expires_at: Instant after which it, or a part of it, is worthless, ns; None: it never
                is.
            is_heartbeat: Whether it has nothing but the sign that this node is there: it costs no
                money, and shows whether other links reach anybody again.
        """
        policy = self._policy
        among = policy.free_of_money if is_heartbeat else policy.up
        by_link: dict[str, set[int]] = {}
        for peer in self._hearers_of(frame):
            for link in policy.ways_to(peer, frame, now, expires_at, among, is_urgent=is_urgent):
                by_link.setdefault(link, set()).add(peer)
        if not by_link and (last := policy.last_of(among)) is not None:
            by_link[last] = set()
        assert self._report is not None
        sent = _Sent(frame, max(1, len(by_link)), self._report)
        if not by_link:
            sent.ended(_aborted(now), now)
            return
        seq = self._take_number()
        wanted = {link: peers for link, peers in by_link.items() if self._rules[link].answers}
        awaited = None
        if wanted:
            given = dict.fromkeys(by_link)
            awaited = _Awaited(frame, entries, is_urgent, expires_at, wanted, {}, given, now)
            self._awaited[seq] = awaited
        for link in by_link:
            self._give(
                link,
                seq,
                frame,
                entries,
                now,
                sent,
                awaited,
                is_urgent=is_urgent,
                is_granted=is_granted,
            )
        for link in self._to_try(now):
            self._probe(link, now)
        self._rearm(now)

    def handle(
        self, link: str, source: int, content: bytes, frame: ReceivedFrame, now: int
    ) -> str | None:
        """Take the content of a frame on one of its links; return why it is dropped, or None."""
        bonded = decode(content)
        if bonded is None:
            return "relay_format"
        nodes = self._context.table.nodes
        if nodes and source not in nodes:
            return "relay_route"
        if not bonded.content:
            if self._context.is_sealed:  # a question has a seal as well
                return "unsealed"
            self._heard_by(link, source, bonded.seq, now, wants_answer=True)
            self._rearm(now)
            return None
        seen, is_known = self._note(source, bonded, now)
        # Who has copied it may bring it by another link: it is answered once by each.
        is_again = link in seen.links
        seen.links[link] = seen.links.get(link, False) or bonded.wants_answer
        if not self._context.is_sealed or (seen.is_read and not is_again):
            self._heard_by(link, source, bonded.seq, now, wants_answer=bonded.wants_answer)
        if not is_known and self._deliver is not None:
            self._came_by[source] = link
            inside = msgspec.structs.replace(
                frame,
                frame_bytes=bonded.content,
                source=source,
                travel=travelled(frame, bonded.age) or UNBOUNDED,
            )
            self._deliver(inside, now, partial(self._opened, source, bonded.seq, seen))
        self._rearm(now)
        return "relay_again" if is_known else None

    # Below the methods above

    def _opened(self, source: int, seq: int, seen: _Seen, now: int) -> None:
        """Take that a sealed frame is authentic, by whichever links it has come until now."""
        if not self._context.is_sealed:
            return
        seen.is_read = True
        for link, wants_answer in seen.links.items():
            self._heard_by(link, source, seq, now, wants_answer=wants_answer)
        self._rearm(now)

    def _heard_by(self, link: str, source: int, seq: int, now: int, *, wants_answer: bool) -> None:
        """Take that a node is heard on a link whose receivers answer; answer it."""
        if self._rules[link].answers:
            self._change(link, source, now, PeerReach.heard)  # a hope, which an answer confirms
            if wants_answer:
                self._owe(link, source, seq, now)

    def _read(self, source: int, now: int) -> None:
        """Take that a frame of a node was authentic, where that alone shows that a link works."""
        self._heard[source] = True
        link = self._came_by.get(source)
        if link is not None and not self._rules[link].answers:
            self._change(link, source, now, PeerReach.heard)

    def _hearers_of(self, frame: Transmission) -> tuple[int, ...]:
        return self._concerned if frame.destination == BROADCAST else (frame.destination,)

    @property
    def _concerned(self) -> tuple[int, ...]:
        """The nodes that frames for all are for: those of the table, and whoever was heard."""
        return tuple(sorted({*self._hearers, *self._heard}))

    def _take_number(self) -> int:
        seq, self._next_seq = self._next_seq, (self._next_seq + 1) % self._numbers
        self._awaited.pop(seq, None)
        return seq

    def _give(
        self,
        link: str,
        seq: int,
        frame: Transmission,
        entries: Entries,
        now: int,
        sent: _Sent | None,
        awaited: _Awaited | None,
        *,
        is_urgent: bool,
        is_granted: bool = False,
        made_at: int | None = None,
    ) -> None:
        """Let a frame go by one link; it was made just now unless `made_at` says when."""
        wants_answer = awaited is not None and link in awaited.by_link
        bonded = Bonded(self.bond.number, seq, frame.frame_bytes, wants_answer)
        since = now if made_at is None else made_at

        def make(room_bytes: int, now: int) -> bytes:
            return msgspec.structs.replace(bonded, age=hop_age(since, now)).encode()

        for peer in self._hearers_of(frame):
            self._change(link, peer, now, PeerReach.transmitted)

        def ended(report: TransmitReport, now: int) -> None:
            if awaited is not None and wants_answer:
                if _has_left(report):
                    awaited.due_at[link] = now + self._answer_ns(link)
                else:  # that says nothing about who hears the link
                    self._pass_on(link, seq, awaited, now)
                self._rearm(now)
            if sent is not None:
                sent.ended(report, now)

        waiting = BondFrame(
            frame.destination,
            make,
            now,
            is_urgent=is_urgent,
            ended=ended,
            entries=entries,
            is_granted=is_granted,
        )
        self.outboxes[link].put(waiting, now)

    def _answer_ns(self, link: str) -> int:
        """Return how long the answer to a frame that has left takes, ns."""
        capabilities = self._policy.up.get(link)
        if capabilities is None:
            return 0
        return 2 * unit_ns(capabilities) + _ANSWER_NS

    def _owe(self, link: str, source: int, seq: int, now: int) -> None:
        """Answer a frame; further ones may be answered by the same frame."""
        owed = self._owed[source]
        index = self.bond.links.index(link)
        is_due = not any(each == index for each, _ in owed)
        if len(owed) < _MOST_OWED:
            owed.append((index, seq))
        if is_due:
            make = partial(self._make_answer, source, index)
            self.outboxes[link].put(BondFrame(source, make, now, is_urgent=True), now)

    def _make_answer(self, source: int, index: int, room_bytes: int, now: int) -> bytes | None:
        """Make the frame that answers those of a node that have come by one link."""
        owed = self._owed[source]
        answered = [each for each in owed if each[0] == index]
        self._owed[source] = [each for each in owed if each[0] != index]
        for _, seq in answered[MOST_ANSWERS:]:  # in a frame of their own
            self._owe(self.bond.links[index], source, seq, now)
        context, introduction = self._context, b""
        said = encode_answers(answered[:MOST_ANSWERS])
        closing = context.seal.settle(source, None, None, now)
        whole_bytes = room_bytes - HEADER_BYTES
        room_bytes = whole_bytes - closing.overhead_bytes - len(said)
        if room_bytes < 0 or not answered:
            return None
        if not context.is_sealed:
            introductions = context.handshake.introductions
            introductions.begin_frame(source)
            introduction = introductions.introduction(context.link, source, room_bytes, now)
        closed = context.seal.close(
            introduction + said,
            source,
            closing,
            now,
            needs_no_table=True,
            padded_to=whole_bytes,
        )
        return Bonded(self.bond.number, self._take_number(), closed).encode()

    def _answered(self, heard: Heard, body: bytes) -> str | None:
        """Take the answers in a frame of the bond."""
        answers = decode_answers(body)
        if answers is None:
            return "relay_format"
        for index, seq in answers:
            link = self.bond.links[index] if index < len(self.bond.links) else ""
            if link not in self._rules or not self._rules[link].answers:
                continue
            self._change(link, heard.source, heard.now, PeerReach.answered)
            awaited = self._awaited.get(seq)
            if awaited is not None and link in awaited.by_link:
                awaited.by_link[link].discard(heard.source)
                self._close(seq, awaited)
        self._rearm(heard.now)
        return None

    def _close(self, seq: int, awaited: _Awaited) -> None:
        """Forget a frame that nobody has left to answer."""
        for link in [link for link, peers in awaited.by_link.items() if not peers]:
            del awaited.by_link[link]
        if not awaited.by_link:
            del self._awaited[seq]

    def _review(self, now: int) -> None:
        """Do what is due: answers that did not come, links in doubt, tries."""
        for seq, awaited in list(self._awaited.items()):
            for link in [each for each, at in awaited.due_at.items() if at <= now]:
                self._overdue(link, seq, awaited, now)
        for link, known in self._reach.items():
            for peer in list(known):
                self._change(link, peer, now, PeerReach.review)
        for link in self._tried:
            in_doubt = [
                peer for peer in self._in_doubt(link) if self._reach[link][peer].asks_at <= now
            ]
            for peer in in_doubt:
                self._reach[link][peer].asked(now)
                self._ask(link, peer, now)
        if self._is_waiting():
            for link in self._to_try(now):
                self._probe(link, now)
        self._rearm(now)

    def _overdue(self, link: str, seq: int, awaited: _Awaited, now: int) -> None:
        """Take that answers to a frame on a link did not come in time."""
        for peer in awaited.by_link.get(link, ()):
            self._change(link, peer, now, PeerReach.overdue)
        self._pass_on(link, seq, awaited, now)

    def _pass_on(self, link: str, seq: int, awaited: _Awaited, now: int) -> None:
        """Let a frame go by the next link to those who have not answered on one."""
        awaited.due_at.pop(link, None)
        silent = awaited.by_link.pop(link, set())
        if not awaited.by_link and self._awaited.get(seq) is awaited:
            del self._awaited[seq]
        further: dict[str, None] = {}
        for peer in silent:
            ways = self._policy.ways_to(peer, awaited.frame, now, awaited.expires_at)
            further |= dict.fromkeys(each for each in ways if each != link)
        if not further and silent and (last := self._policy.last_of(self._policy.up)) is not None:
            further[last] = None
        for other in further:
            if other not in awaited.given:
                awaited.given[other] = None
                self._again += 1
                self._give(
                    other,
                    seq,
                    awaited.frame,
                    awaited.entries,
                    now,
                    None,
                    None,
                    is_urgent=awaited.is_urgent,
                    made_at=awaited.made_at,
                )

    def _to_try(self, now: int) -> list[str]:
        """Return the links that answer, are out of use for a node, and may be tried now."""
        return [
            link
            for link in self._tried
            if any(self._reach[link][peer].may_try(now) for peer in self._worse_off(link))
        ]

    @property
    def _tried(self) -> list[str]:
        return [
            each for each, rules in self._rules.items() if rules.answers and each in self._policy.up
        ]

    def _worse_off(self, link: str) -> list[int]:
        """Return the nodes that only a worse link reaches."""
        links = list(self._rules)
        place = links.index(link)
        return [
            peer
            for peer in self._concerned
            if (used := self._policy.used_to(peer)) is None
            or links.index(used) > place
            or used == link
        ]

    def _probe(self, link: str, now: int) -> None:
        """Ask on a link who hears this node."""
        peers = [each for each in self._worse_off(link) if self._reach[link][each].may_try(now)]
        for peer in peers:
            self._reach[link][peer].tried(now)
        self._ask(link, peers[0] if len(peers) == 1 else BROADCAST, now)

    def _ask(self, link: str, destination: int, now: int) -> None:
        make = partial(self._make_question, destination, self._take_number())
        self.outboxes[link].put(BondFrame(destination, make, now), now)

    def _make_question(self, destination: int, seq: int, room_bytes: int, now: int) -> bytes:
        """Make a frame that only wants an answer; a sealed one holds padding."""
        context, inside = self._context, b""
        if context.is_sealed:
            closing = context.seal.settle(destination, None, None, now)
            inside = context.seal.close(
                PADDING, destination, closing, now, needs_no_table=True,
                padded_to=room_bytes - HEADER_BYTES,
            )  # fmt: skip
        return Bonded(self.bond.number, seq, inside, True).encode()

    def _in_doubt(self, link: str) -> list[int]:
        known = self._reach[link]
        return [peer for peer, reach in known.items() if reach.state is Reach.DOUBT]

    def _rearm(self, now: int) -> None:
        """Set the timer to what is due next."""
        instants = [at for awaited in self._awaited.values() for at in awaited.due_at.values()]
        for link, known in self._reach.items():
            for peer in self._in_doubt(link):
                instants.append(known[peer].doubt_ends_at)
                if link in self._policy.up:
                    instants.append(known[peer].asks_at)
        if self._is_waiting():
            for link in self._tried:
                for peer in self._worse_off(link):
                    reach = self._reach[link][peer]
                    if reach.state is Reach.DOWN:
                        instants.append(reach.next_try_at)
        key = (Due.BOND, self.bond.number)
        if instants:
            self._context.timers.at(key, max(now, min(instants)), self._review)
        else:
            self._context.timers.cancel(key)

    def _change(
        self, link: str, peer: int, now: int, what: Callable[[PeerReach, int], None]
    ) -> None:
        """Tell what is known of a node on a link, and emit what has changed by it."""
        reach = self._reach[link][peer]
        before = reach.state
        what(reach, now)
        if reach.state is not before:
            self._context.node.emit(
                PeerReachable(
                    address=peer,
                    link=link,
                    bond=self.bond.name,
                    reach=reach.state,
                    changed_at=now,
                )
            )

    def _note(self, source: int, bonded: Bonded, now: int) -> tuple[_Seen, bool]:
        """Remember a frame; return what is known of it, and whether it has been here before."""
        key = source, bonded.seq, zlib.crc32(bonded.content)
        seen = self._seen.get(key)
        if seen is not None and now - seen.at <= _SEEN_NS:
            return seen, True
        seen = self._seen[key] = _Seen(now)
        self._seen.move_to_end(key)
        if len(self._seen) > self._most_seen:
            self._seen.popitem(last=False)
        return seen, False


def _has_left(report: TransmitReport) -> bool:
    """Return whether a frame has begun to leave a link, as far as that is known."""
    return report.outcome not in (TransmitOutcome.ABORTED, TransmitOutcome.REJECTED)


def _aborted(now: int) -> TransmitReport:
    return TransmitReport(
        transmission_id=0,
        outcome=TransmitOutcome.ABORTED,
        started_at=now,
        finished_at=now,
        detail="no link of the bond is up",
    )
