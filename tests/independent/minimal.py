"""A minimal node: best effort, reliable topics and calls, unsealed. From docs/wire.md alone.

It has no clock, no link and no thread: `handle` takes a frame that has arrived, `poll` gives the
next one to transmit (ask again until it gives None, when `next_due` says, and after `handle`,
`publish`, `call` and `respond`), and `events` lists what has come of them. Times are in seconds of
any clock. `handle_opened` and `poll_opened` do the same without the envelope, for links that carry
addresses.

It lacks what a node may lack: a journal, objects (which it refuses as too large), actions,
on-demand topics, dense blocks, medium access. Of what is only a SHOULD it has a simple form, first
of all of the pace of repetitions.
"""

import random
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum

from tests.independent import (
    access,
    agreement,
    calls,
    compose,
    dense,
    describe,
    envelope,
    frame,
    objects,
    record,
    reliable,
)
from tests.independent.agreement import Ask, Confirm, Hello, Row, Tag, Verdict
from tests.independent.cursor import Cursor
from tests.independent.envelope import BROADCAST, Capabilities, Opened
from tests.independent.errors import ReadError
from tests.independent.record import Acknowledgement, Call, Goal, Payload, Sample, Way
from tests.independent.reliable import Holding, Sync
from tests.independent.table import COMMANDS, EVERYWHERE, Service, Table, Topic

_WINDOW = 32
_CALL_WINDOW = 16
_NUMBERS = 64
_MODULUS = 1 << 24
_CONFIRM_PAUSES = (2, 256)
_ASK_PAUSES = (2, 64)
_CONFIRM_PATIENCE = 16
_HELLO_RHYTHM = 8
_GROWTH = (1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 9.0, 17.5)
_EPOCHS = 9
_CALLS_KEPT = 128
_IN_VAIN = 8
_COPIES_KNOWN = 8
_LINEAGES_KNOWN = 16
_TOO_LARGE = 2
_PATIENCE = 5

Handler = Callable[[Payload], Payload | None]
"""Serves a request; raises RuntimeError to fail with a text; None: `respond` follows."""


@dataclass(frozen=True)
class Link:
    """What a node must know of its link. `unit_s`: in which the largest frame of it arrives."""

    mtu: int
    unit_s: float
    linger_s: float = 0.0
    turn_s: float = 0.0
    """Between the answers of several receivers to a frame: the airtime of five bytes, and a gap."""
    capabilities: Capabilities = field(
        default_factory=lambda: Capabilities(checks=True, delimits=True)
    )

    @property
    def settling_s(self) -> float:
        return 4 * self.unit_s

    @property
    def room(self) -> int:
        """The bytes that an envelope leaves for records."""
        room = self.mtu
        while len(self.wrap(Opened(1, 2, b"\x01" * room))) > self.mtu:
            room -= 1
        return room

    def wrap(self, opened: Opened) -> bytes:
        return envelope.wrap(opened, self.capabilities)


# Events


@dataclass(frozen=True)
class Delivered:
    """A sample has come."""

    source: int
    sample: Sample


@dataclass(frozen=True)
class Ended:
    """A reliable sample has ended: all receivers have it, or a newer one has taken its place."""

    stream: int
    wildcards: tuple[str, ...]
    number: int
    delivered: bool


@dataclass(frozen=True)
class Answered:
    """A call has ended."""

    stream: int
    index: int
    result: Payload | calls.Failure


@dataclass(frozen=True)
class NotRead:
    """Something in a frame was not read, or not taken; `data`: that part of the frame."""

    source: int
    reason: str
    data: bytes


@dataclass(frozen=True)
class Requested:
    """A handler has left the answer for later: `Node.respond` with this."""

    client: int
    epoch: int
    stream: int
    number: int
    payload: Payload


Event = Delivered | Ended | Answered | NotRead | Requested


# What a node knows of another one


class Agreement(Enum):
    """Whether the peer has confirmed the present epoch of this node."""

    UNCONFIRMED = "unconfirmed"
    PROVISIONAL = "provisional"
    CONFIRMED = "confirmed"


@dataclass
class Debt:
    """Something owed to a peer: from `allowed_s` on it rides, at `due_s` it gets its own frame."""

    allowed_s: float
    due_s: float


@dataclass
class Peer:
    """Another node."""

    address: int
    known: agreement.Known
    state: Agreement = Agreement.UNCONFIRMED
    provisional_until_s: float = 0.0
    confirm: Debt | None = None
    hello: Debt | None = None
    asks: dict[int, Debt] = field(default_factory=dict)
    rows: dict[int, Debt] = field(default_factory=dict)
    rows_answered: set[int] = field(default_factory=set)
    asked: set[int] = field(default_factory=set)
    passing: dict[int, bytes] = field(default_factory=dict)
    """Rows of the present frame that were not asked for."""
    confirm_pause: int = _CONFIRM_PAUSES[0]
    ask_pause: int = _ASK_PAUSES[0]
    confirm_not_before_s: float = 0.0
    ask_not_before_s: float = 0.0
    epochs: deque[int] = field(default_factory=lambda: deque(maxlen=_EPOCHS))
    """The epochs in which it has confirmed the present epoch of this node, the last one last."""
    epoch_again: tuple[int, float] | None = None
    in_vain: int = 0
    """Frames to it since the last one of it."""
    refused: set[int] = field(default_factory=set)
    """Transfers of objects that this node has refused."""

    @property
    def differs(self) -> bool:
        return self.known.hello is not None and self.known.hello.digest != self.known.own

    def epoch(self) -> int | None:
        return None if self.known.hello is None else self.known.hello.epoch


# Reliable topics

Key = tuple[int, tuple[str, ...]]


@dataclass
class Repetition:
    """When something is due again."""

    due_s: float
    sent: int = 0

    def pause(self) -> float:
        return _GROWTH[min(self.sent, len(_GROWTH)) - 1] if self.sent else 0.0


@dataclass
class Receiver:
    """What a publisher knows of a receiver of a key."""

    awaited: int = 0
    held: set[int] = field(default_factory=set)
    in_sync: bool = False
    first_sync_s: float | None = None

    def lacks(self, number: int) -> bool:
        return number >= self.awaited and number not in self.held

    def lose(self) -> None:
        """It is not in sync any more, and may have lost what it held."""
        self.held.clear()
        self.in_sync = False
        self.first_sync_s = None


@dataclass
class Pending:
    """A sample that has not ended."""

    sample: Sample
    again: Repetition


@dataclass
class Publication:
    """One key of a reliable topic at its publisher."""

    topic: Topic
    wildcards: tuple[str, ...]
    receivers: dict[int, Receiver]
    next_number: int = 0
    pending: dict[int, Pending] = field(default_factory=dict)
    waiting: deque[Sample] = field(default_factory=deque)

    @property
    def floor(self) -> int:
        """The oldest number that may still come."""
        return min(self.pending, default=self.next_number)

    def lacking(self, number: int) -> list[int]:
        """Return who is to get a number: of what it holds, only the next that is not over."""
        return [
            node
            for node, one in self.receivers.items()
            if one.lacks(number) or number == self._next_for(one)
        ]

    def _next_for(self, one: Receiver) -> int | None:
        return min((number for number in self.pending if number >= one.awaited), default=None)

    def is_acknowledged(self, number: int) -> bool:
        """Tell whether a number has ended: one that is only held may be lost by a restart."""
        return all(one.awaited > number for one in self.receivers.values())

    def wanted(self) -> list[tuple[int, Pending]]:
        """Return the samples that somebody is to get."""
        return [(number, one) for number, one in self.pending.items() if self.lacking(number)]

    def needs_sync(self, number: int) -> bool:
        return any(
            not self.receivers[node].in_sync or number >= self.receivers[node].awaited + _WINDOW
            for node in self.lacking(number)
        )


@dataclass
class Reception:
    """One key of a reliable topic at a receiver."""

    lineage: int | None = None
    awaited: int = 0
    held: dict[int, Sample] = field(default_factory=dict)
    ended: deque[int] = field(default_factory=lambda: deque(maxlen=_LINEAGES_KNOWN))
    with_sync: bool = True
    ack: Debt | None = None
    asks_lineage: bool = False


# Calls


@dataclass
class Request:
    """A call at its client."""

    stream: int
    index: int
    number: int
    server: int
    payload: Payload
    deadline_s: float
    again: Repetition
    confirmed: bool = False
    last_sent_s: float | None = None


@dataclass
class Client:
    """The calls of this node to one service."""

    begun: int = 0
    closed: int = 0
    """So many calls, from the first one, are closed."""
    spent: int = 0
    """So many are closed, and no answer to them can come any more."""
    closings: deque[tuple[float, int]] = field(default_factory=deque)
    """When `spent` is what."""
    active: dict[int, Request] = field(default_factory=dict)
    """By index."""
    spare_s: dict[int, float] = field(default_factory=dict)
    """When the number of an ended call, by its index, may be used by the one 16 later."""
    waiting: deque[Request] = field(default_factory=deque)


@dataclass
class Served:
    """A call at its server."""

    client: int
    epoch: int
    service: Service
    number: int
    taken_s: float
    named: bool
    answer: Payload | calls.Failure | None
    again: Repetition
    done: bool = False


class Node:
    """A node of the fleet."""

    def __init__(
        self,
        address: int,
        table: Table,
        epoch: int,
        link: Link,
        chance: random.Random,
        now: float,
    ) -> None:
        self.address = address
        self.table = table
        self.digest = describe.table_digest(table)
        self.epoch = epoch
        self.link = link
        self.handlers: dict[int, Handler] = {}
        self.events: list[Event] = []
        self.taken: list[frame.Placed] = []
        """What of the last frame was neither unreadable nor refused."""
        self._rows = describe.rows(table)
        self._chance = chance
        self._began_s = now
        self._sent_hello = False
        self._broadcasts = 0
        self._asked_broadcast = False
        self._peers: dict[int, Peer] = {}
        self._samples: deque[Sample] = deque()
        self._publications: dict[Key, Publication] = {}
        self._receptions: dict[tuple[int, Key], Reception] = {}
        self._copies: dict[tuple[int, Key], deque[Sync]] = {}
        self._clients: dict[int, Client] = {}
        self._served: dict[tuple[int, int, int, int], Served] = {}
        self._confirms: list[tuple[int, Call]] = []
        self._feedback: list[tuple[int, objects.Feedback]] = []
        for node in table.nodes:
            if node != address:
                self._peer(node)

    # What the application does

    def publish(
        self, stream: int, payload: Payload | None, now: float, wildcards: tuple[str, ...] = ()
    ) -> None:
        """Publish a sample, or delete its key (None)."""
        topic = self.table.stream(stream)
        if not isinstance(topic, Topic):
            raise ReadError("no topic")
        sample = Sample(stream, wildcards, payload, age_s=0.0 if topic.aged else None)
        size = len(self._written(sample)) + 2
        if size > self.link.room - (16 if topic.reliable else 8):
            raise ReadError("this node has no objects")
        if not topic.reliable:
            self._samples.append(sample)
            return
        publication = self._publications.get((stream, wildcards))
        if publication is None:
            nodes = topic.subscribers or tuple(self.table.nodes)
            receivers = {node: Receiver() for node in nodes if node != self.address}
            publication = Publication(topic, wildcards, receivers)
            self._publications[stream, wildcards] = publication
        publication.waiting.append(sample)
        self._admit(publication, now)

    def call(self, stream: int, payload: Payload, now: float, server: int | None = None) -> int:
        """Call a service, and return the index of the call."""
        service = self.table.stream(stream)
        if not isinstance(service, Service):
            raise ReadError("no service")
        node = service.server if service.server is not None else server
        if node is None:
            raise ReadError("no server")
        head = calls.Head(calls.REQUEST, 0, from_server=False)
        every = None if service.server is not None else node
        if len(self._written(Call(stream, head, payload, every, 0.0))) > self.link.room - 8:
            raise ReadError("a request that fits no frame with HELLO")
        client = self._clients.setdefault(stream, Client())
        index = client.begun + len(client.waiting)
        number = (calls.first_number(self.epoch) + index) % _NUMBERS
        deadline = now + service.timeout_s
        request = Request(stream, index, number, node, payload, deadline, Repetition(now))
        client.waiting.append(request)
        self._begin_calls(client, now)
        return index

    def respond(self, request: Requested, answer: Payload | calls.Failure, now: float) -> None:
        """Give the answer that a handler has left for later."""
        name = (request.client, request.epoch, request.stream, request.number)
        served = self._served.get(name)
        if served is not None and served.answer is None:
            served.answer = answer
            served.again = Repetition(now)

    # Frames that arrive

    def handle(self, data: bytes, now: float, addresses: tuple[int, int] | None = None) -> None:
        """Take a frame from the link. `addresses`: destination and source, if the link has them."""
        try:
            if len(data) > max(self.link.mtu, 4096) + 2:  # the two zero bytes of a byte stream
                raise ReadError("longer than 4096 bytes and than the MTU")
            opened = envelope.unwrap(data, self.link.capabilities, addresses=addresses)
            if not envelope.is_for(opened, self.address):
                raise ReadError("for another node, or of this one")
        except ReadError as error:
            self.events.append(NotRead(0, str(error), data))
            return
        self.handle_opened(opened, now)

    def handle_opened(self, opened: Opened, now: float) -> None:
        """Take a frame without its envelope."""
        if not envelope.is_for(opened, self.address):
            return
        self._tick(now)
        peer = self._peer(opened.source)
        peer.in_vain = 0
        way = Way(self.table, opened.source, opened.destination, routes=False)
        judge = _Judge(self, peer, way, now)
        whole = frame.read(opened.records, way, judge)
        self._note_frame(peer, now)
        if _has_records(whole) and peer.known.hello is not None:
            epoch = None if whole.introduction is None else whole.introduction.epoch
            if epoch == peer.known.hello.epoch:
                self._answer_introduction(peer, now)
        self.taken.clear()
        for placed in whole.placed:
            refused = None
            if not isinstance(placed.item, agreement.Control):
                refused = self._item(placed.item, peer, way, whole.introduction, now)
            if refused is None:
                self.taken.append(placed)
            else:
                self.events.append(NotRead(peer.address, refused, placed.data))

    def _item(
        self,
        item: frame.Item,
        peer: Peer,
        way: Way,
        introduction: frame.Introduction | None,
        now: float,
    ) -> str | None:
        """Take an item of a frame, or return why it is not taken."""
        listed = not self.table.nodes or peer.address in self.table.nodes
        if isinstance(item, Sample):
            return self._sample(item, peer, way, now, listed=listed)
        if isinstance(item, Acknowledgement):
            if item.node not in (None, self.address):
                return None
            return self._acknowledged(item, peer, now)
        if isinstance(item, access.Clock | access.Turn | dense.BlockAck):
            return None
        if isinstance(item, frame.Unread):
            self._unread(item, peer, introduction, now)
            if listed and not way.broadcast:
                self._refuse_request(item, peer, introduction, now)
            return item.reason
        if not listed:
            return "of a node that is not listed"
        if isinstance(item, Call):
            if item.server not in (None, peer.address, self.address):
                return "another server"
            if item.head.from_server:
                return self._answer(item, peer, now)
            return self._request(item, peer, introduction, now)
        if isinstance(item, objects.Fragment):
            return self._refuse_object(item, peer)
        return "nothing that this node takes"

    def _sample(
        self, item: Sample, peer: Peer, way: Way, now: float, *, listed: bool
    ) -> str | None:
        topic = self.table.stream(item.stream)
        if not isinstance(topic, Topic) or not self._subscribes(topic, peer.address):
            return "no publisher or no subscriber"
        if not topic.reliable:
            if not self._is_first_copy(item, peer.address):
                return "a copy"
            self.events.append(Delivered(peer.address, item))
            return None
        if not listed:
            return "of a node that is not listed"
        return self._reliable(item, topic, peer, way, now)

    def _refuse_request(
        self,
        item: frame.Unread,
        peer: Peer,
        introduction: frame.Introduction | None,
        now: float,
    ) -> None:
        """Answer a request that does not decode, though its stream is equal."""
        refused = item.reason in (Verdict.UNCONFIRMED.value, Verdict.DIFFERS.value)
        if refused or peer.known.hello is None:
            return
        try:
            cursor = Cursor(item.data)
            stream = record.stream_of(item.data)
            service = self.table.stream(stream)
            cursor.take(1)
            head = calls.read_head(cursor, from_server=False)
        except ReadError:
            return
        if not isinstance(service, Service) or service.server != self.address:
            return
        if head.kind == calls.REQUEST:
            self._request(Call(stream, head, calls.Failure(3, "")), peer, introduction, now)

    def _unread(
        self,
        item: frame.Unread,
        peer: Peer,
        introduction: frame.Introduction | None,
        now: float,
    ) -> None:
        refused = item.reason in (Verdict.UNCONFIRMED.value, Verdict.DIFFERS.value)
        if refused and (introduction is None or peer.known.hello is None):
            self._owe_ask(peer, 0, now)
        elif item.reason == Verdict.DIFFERS.value:
            try:
                stream = record.stream_of(item.data)
            except ReadError:
                return
            if stream not in peer.known.rows:
                self._owe_ask(peer, stream, now)

    def _refuse_object(self, fragment: objects.Fragment, peer: Peer) -> str | None:
        """Refuse an object of a subscribed topic, so that its publisher goes on without it."""
        if fragment.index == objects.NO_FRAGMENT:
            return None
        if fragment.index == 0:
            peer.refused.discard(fragment.number)
            try:
                topic = self.table.stream(objects.read_manifest(fragment.data).stream)
            except ReadError as error:
                return str(error)
            if isinstance(topic, Topic) and self._subscribes(topic, peer.address):
                peer.refused.add(fragment.number)
        if fragment.number in peer.refused and fragment.hint == 0:
            feedback = objects.Feedback(fragment.number, objects.REFUSED, reason=_TOO_LARGE)
            if (peer.address, feedback) not in self._feedback:
                self._feedback.append((peer.address, feedback))
        return "an object"

    def _subscribes(self, topic: Topic, source: int) -> bool:
        if topic.publishers and source not in topic.publishers:
            return False
        return not topic.subscribers or self.address in topic.subscribers

    def _is_first_copy(self, sample: Sample, source: int) -> bool:
        """Tell whether a best-effort sample is no copy: one behind SYNC is sent more than once."""
        if sample.sync is None:
            return True
        key = (source, (sample.stream, sample.wildcards))
        heard = self._copies.setdefault(key, deque(maxlen=_COPIES_KNOWN))
        if sample.sync in heard:
            return False
        heard.append(sample.sync)
        return True

    # Agreement

    def _peer(self, address: int) -> Peer:
        peer = self._peers.get(address)
        if peer is None:
            known = agreement.Known(self.digest, self._rows, self.link.settling_s)
            peer = self._peers[address] = Peer(address, known)
        return peer

    def learn(
        self, peer: Peer, controls: Sequence[agreement.Control], way: Way, now: float
    ) -> None:
        """Take the controls of agreement of a frame."""
        peer.passing.clear()
        confirms = [one for one in controls if isinstance(one, Confirm) and self._is_mine(one, way)]
        for control in controls:
            if isinstance(control, Hello | Tag):
                self._introduced(peer, control, confirms, way, now)
        for control in controls:
            if isinstance(control, Confirm):
                if control in confirms:
                    self._confirmed(peer, control, way, now)
            elif isinstance(control, Ask):
                if control.node == self.address:
                    self._asked(peer, control, way, now)
            elif isinstance(control, Row):
                self._row(peer, control, now)

    def _is_mine(self, confirm: Confirm, way: Way) -> bool:
        special = (agreement.DESTINATION, agreement.PROVISIONAL)
        return confirm.node == self.address or (not way.broadcast and confirm.node in special)

    def _introduced(
        self,
        peer: Peer,
        control: Hello | Tag,
        confirms: Sequence[Confirm],
        way: Way,
        now: float,
    ) -> None:
        if isinstance(control, Hello) and control.version != agreement.VERSION:
            return
        before = peer.known.hello
        provisional = self._sent_hello and any(one.epoch == self.epoch for one in confirms)
        if isinstance(control, Tag) and provisional:
            peer.known.provisional(control, now)
            peer.confirm_pause = _CONFIRM_PAUSES[0]
        else:
            peer.known.take(control, now)
        after = peer.known.hello
        if after != before:
            self._unconfirm(peer)
            peer.asks.pop(0, None)
            if after is None or before is None or after.epoch != before.epoch:
                peer.rows_answered.clear()
                peer.asked.clear()
                peer.confirm_pause = _CONFIRM_PAUSES[0]
                peer.ask_pause = _ASK_PAUSES[0]
                peer.confirm_not_before_s = peer.ask_not_before_s = now
        if after is None:
            self._owe_ask(peer, 0, now)
        elif after != before:
            self._answer_introduction(peer, now)

    def _answer_introduction(self, peer: Peer, now: float) -> None:
        if peer.differs:
            self._owe_hello(peer, now, requested=False)
        else:
            self._owe_confirm(peer, now)

    def _unconfirm(self, peer: Peer) -> None:
        peer.state = Agreement.UNCONFIRMED
        for publication in self._publications.values():
            receiver = publication.receivers.get(peer.address)
            if receiver is not None:
                receiver.lose()

    def _confirmed(self, peer: Peer, confirm: Confirm, way: Way, now: float) -> None:
        if confirm.epoch != self.epoch:
            peer.state = Agreement.UNCONFIRMED
            if confirm.node == self.address:
                self._owe_hello(peer, now, requested=True)
            return
        if not self._sent_hello:
            return
        if confirm.node == agreement.PROVISIONAL:
            old = now >= self._began_s + 2 * self.link.settling_s
            if old and peer.state == Agreement.UNCONFIRMED:
                peer.state = Agreement.PROVISIONAL
                peer.provisional_until_s = now + self.link.settling_s
                if peer.confirm is not None:
                    peer.confirm.due_s = min(peer.confirm.due_s, peer.confirm.allowed_s)
            return
        peer.state = Agreement.CONFIRMED
        peer.hello = None
        if not way.broadcast and confirm.node == self.address and not peer.differs:
            self._owe_confirm(peer, now, again=True)
        epoch = peer.epoch()
        if epoch is None:
            return
        if epoch not in peer.epochs:
            peer.epochs.append(epoch)
        elif epoch != peer.epochs[-1] and peer.epoch_again is None:
            peer.epoch_again = (epoch, now + self.link.settling_s)

    def _asked(self, peer: Peer, ask: Ask, way: Way, now: float) -> None:
        self._unconfirm(peer)
        if ask.stream:
            peer.rows[ask.stream] = Debt(now, now + self._pause())
            return
        self._owe_hello(peer, now, requested=True)
        if way.broadcast:
            self._asked_broadcast = True

    def _row(self, peer: Peer, row: Row, now: float) -> None:
        """Take a row. One that was not asked for holds for its own frame."""
        if not peer.differs or row.epoch != peer.epoch():
            return
        own = self._rows.get(row.stream, bytes(4))
        if row.stream in peer.asked:
            peer.asked.discard(row.stream)
            peer.asks.pop(row.stream, None)
            peer.known.take(row, now)
            if row.digest != own:
                self._fail_calls(peer, row.stream)
        else:
            peer.passing[row.stream] = row.digest
            if row.digest != peer.known.rows.get(row.stream, own):
                self._owe_ask(peer, row.stream, now)
        if row.digest != own and row.stream not in peer.rows_answered:
            peer.rows_answered.add(row.stream)
            peer.rows[row.stream] = Debt(now, now + self._pause())

    def _pause(self) -> float:
        return self._chance.uniform(0.5, 2) * self.link.unit_s

    def _owe_confirm(self, peer: Peer, now: float, *, again: bool = False) -> None:
        if peer.confirm is not None:
            return
        allowed = peer.known.since_s + self.link.settling_s
        if not again:
            allowed = max(allowed, peer.confirm_not_before_s)
        patience = 0.0 if allowed <= now else _CONFIRM_PATIENCE * self.link.unit_s
        peer.confirm = Debt(allowed, max(allowed, now) + patience + self._pause())

    def _owe_hello(self, peer: Peer, now: float, *, requested: bool) -> None:
        if not requested and peer.confirm_pause == _CONFIRM_PAUSES[1]:
            return
        allowed = now if requested else max(now, peer.confirm_not_before_s)
        if requested or peer.hello is None:
            peer.hello = Debt(allowed, allowed + self._pause())

    def _owe_ask(self, peer: Peer, stream: int, now: float) -> None:
        if stream not in peer.asks:
            allowed = max(now, peer.ask_not_before_s)
            peer.asks[stream] = Debt(allowed, allowed + self._pause())

    def _note_frame(self, peer: Peer, now: float) -> None:
        """Count the pause of a CONFIRM from the first frame that comes when it is allowed."""
        if peer.confirm is not None and now >= peer.confirm.allowed_s:
            peer.confirm.due_s = min(peer.confirm.due_s, now + self._pause())

    # Reliable topics: the receiver

    def _reliable(
        self, sample: Sample, topic: Topic, peer: Peer, way: Way, now: float
    ) -> str | None:
        key = (peer.address, (sample.stream, sample.wildcards))
        reception = self._receptions.setdefault(key, Reception())
        sync = sample.sync
        reception.with_sync = sync is not None or reception.lineage is None
        reception.asks_lineage = False
        known_before = False
        if sync is not None and sync.lineage != reception.lineage:
            if sync.lineage in reception.ended or self._is_former(reception, sync.lineage):
                self._owe_ack(reception, topic, way, now, again=True)
                return "a former lineage"
            if reception.lineage is not None:
                self._deliver_all(reception, peer.address)
                reception.ended.append(reception.lineage)
            reception.lineage, reception.awaited = sync.lineage, sync.number
            reception.held.clear()
        if reception.lineage is None:
            reception.asks_lineage = True
            self._owe_ack(reception, topic, way, now, again=True)
            return "the lineage is not known"
        if sync is not None:
            ahead = (sync.number - reception.awaited) % _MODULUS
            if ahead < _MODULUS // 2:
                self._pass_over(reception, reception.awaited + ahead, peer.address)
        number = reliable.whole_number(sample.number or 0, reception.awaited)
        if number >= reception.awaited:
            known_before = number in reception.held
            reception.held[number] = sample
            self._pass_over(reception, number - topic.depth + 1, peer.address)
            while reception.awaited in reception.held:
                self._pass_over(reception, reception.awaited + 1, peer.address)
        else:
            known_before = True
        self._owe_ack(reception, topic, way, now, again=known_before or sync is not None)
        return "repeated" if known_before else None

    @staticmethod
    def _is_former(reception: Reception, lineage: int) -> bool:
        present = reception.lineage
        return present is not None and 1 <= (present - lineage) % (1 << 16) <= _LINEAGES_KNOWN

    def _pass_over(self, reception: Reception, number: int, source: int) -> None:
        """Deliver what is held below a number, and await that one."""
        for one in sorted(held for held in reception.held if held < number):
            self.events.append(Delivered(source, reception.held.pop(one)))
        reception.awaited = max(reception.awaited, number)

    def _deliver_all(self, reception: Reception, source: int) -> None:
        """End a lineage: what it held behind a gap is delivered, in order."""
        for one in sorted(reception.held):
            self.events.append(Delivered(source, reception.held[one]))

    def _owe_ack(
        self, reception: Reception, topic: Topic, way: Way, now: float, *, again: bool
    ) -> None:
        wait = self.link.linger_s
        if way.broadcast:
            nodes = sorted(topic.subscribers or self.table.nodes)
            several = [node for node in nodes if node != way.source]
            if self.address in several:
                wait += several.index(self.address) * self.link.turn_s
            if again:
                wait += self._chance.uniform(0, 2 * len(several) * self.link.turn_s)
        elif again:
            wait += self._chance.uniform(0, self.link.turn_s)
        reception.ack = Debt(now, now + wait)

    # Reliable topics: the publisher

    def _admit(self, publication: Publication, now: float) -> None:
        """Give numbers to what waits, as far as the window goes."""
        while publication.waiting and publication.next_number < publication.floor + _WINDOW:
            number = publication.next_number
            publication.next_number += 1
            sample = publication.waiting.popleft()
            publication.pending[number] = Pending(sample, Repetition(now))
            for old in [
                one for one in publication.pending if one <= number - publication.topic.depth
            ]:
                self._end(publication, old, delivered=False)

    def _end(self, publication: Publication, number: int, *, delivered: bool) -> None:
        del publication.pending[number]
        stream = publication.topic.id
        self.events.append(Ended(stream, publication.wildcards, number, delivered))

    def _acknowledged(self, ack: Acknowledgement, peer: Peer, now: float) -> str | None:
        publication = self._publications.get((ack.stream, ack.wildcards))
        if publication is None or peer.address not in publication.receivers:
            return "nothing was published"
        receiver = publication.receivers[peer.address]
        if not ack.holding.knows_lineage:
            receiver.lose()
            for pending in publication.pending.values():
                pending.again.due_s = now
            return None
        if ack.sync is not None:
            if ack.sync.lineage != self.epoch or ack.sync.number > publication.next_number:
                return "another lineage"
            awaited = ack.sync.number
            self._count_sync(receiver, now)
        elif receiver.in_sync:
            awaited = reliable.whole_awaited(ack.holding.awaited, receiver.awaited)
        else:
            return "not in sync"
        if not 0 <= awaited <= publication.next_number:
            return "not published"
        receiver.awaited = max(receiver.awaited, awaited)
        receiver.held = {one for one in ack.holding.numbers(awaited) if one >= receiver.awaited}
        for number in [one for one in publication.pending if publication.is_acknowledged(one)]:
            self._end(publication, number, delivered=True)
        self._admit(publication, now)
        return None

    def _count_sync(self, receiver: Receiver, now: float) -> None:
        """Count acknowledgements with SYNC: two, a settling time apart, bring it in sync."""
        if receiver.first_sync_s is None:
            receiver.first_sync_s = now
        elif now >= receiver.first_sync_s + self.link.settling_s:
            receiver.in_sync = True

    # Calls: the client

    def _begin_calls(self, client: Client, now: float) -> None:
        while client.waiting:
            request = client.waiting[0]
            before = request.index - _CALL_WINDOW
            if before in client.active or client.spare_s.get(before, now) > now:
                return
            while client.closings and now >= client.closings[0][0]:
                client.spent = client.closings.popleft()[1]
            if request.index >= client.spent + _NUMBERS:
                return
            client.spare_s.pop(before, None)
            client.waiting.popleft()
            client.begun += 1
            client.active[request.index] = request

    def _answer(self, item: Call, peer: Peer, now: float) -> str | None:
        client = self._clients.get(item.stream)
        if client is None:
            return "nothing was called"
        request = next(
            (one for one in client.active.values() if one.number == item.head.number), None
        )
        if item.head.epoch is not None:
            takes = item.head.epoch == self.epoch & 63
        else:
            takes = peer.state == Agreement.CONFIRMED
        if not takes:
            if request is not None and item.head.kind != calls.CONFIRM:
                request.again.due_s = now
                request.confirmed = False
            return "not known to be of this epoch"
        if item.head.kind != calls.CONFIRM:
            head = calls.Head(calls.CONFIRM, item.head.number, from_server=False)
            confirm = (peer.address, Call(item.stream, head, None, item.server))
            if confirm not in self._confirms:
                self._confirms.append(confirm)
        if request is None or request.server != peer.address or request.last_sent_s is None:
            return "no such call"
        if request.index - 48 <= client.closed <= request.index - _CALL_WINDOW:
            client.closed = request.index - _CALL_WINDOW + 1
            client.closings.append((now + 6 * self.link.unit_s, client.closed))
        if item.head.kind == calls.CONFIRM:
            request.confirmed = True
            return None
        if item.payload is not None:
            self._finish(client, request, item.payload)
        self._begin_calls(client, now)
        return None

    def _fail_calls(self, peer: Peer, stream: int) -> None:
        """End the calls of a stream that the server defines differently."""
        client = self._clients.get(stream, Client())
        for request in [*client.active.values()]:
            if request.server == peer.address:
                self._finish(client, request, calls.Failure(4, ""))

    def _finish(self, client: Client, request: Request, result: Payload | calls.Failure) -> None:
        client.active.pop(request.index, None)
        if request.last_sent_s is not None:
            client.spare_s[request.index] = request.last_sent_s + 6 * self.link.unit_s
        self.events.append(Answered(request.stream, request.index, result))

    # Calls: the server

    def _request(
        self, item: Call, peer: Peer, introduction: frame.Introduction | None, now: float
    ) -> str | None:
        service = self.table.stream(item.stream)
        epoch = peer.epoch()
        if not isinstance(service, Service) or epoch is None:
            return "no client is known"
        if service.server not in (None, self.address):
            return "another server"
        name = (peer.address, epoch, item.stream, item.head.number)
        served = self._served.get(name)
        if item.head.kind == calls.CONFIRM:
            if served is not None:
                served.done = True
            return None
        if served is not None:
            served.named = introduction is not None
            served.done = False
            served.again.due_s = now
            if served.answer is None:
                self._confirm_request(served)
            return "repeated"
        if epoch in peer.epochs and epoch != peer.epochs[-1]:
            return "a former epoch"
        ours = [one for one in self._served if one[:3] == name[:3]]
        for one in ours:
            if 16 <= (item.head.number - one[3]) % _NUMBERS <= 48:
                del self._served[one]
        if len(ours) >= _CALLS_KEPT:
            return "too many calls"
        answer = self._execute(item)
        served = self._served[name] = Served(
            peer.address,
            epoch,
            service,
            item.head.number,
            now,
            introduction is not None,
            answer,
            Repetition(now),
        )
        if answer is None:
            self._confirm_request(served)
            if item.payload is not None and not isinstance(item.payload, calls.Failure):
                self.events.append(Requested(*name, item.payload))
        return None

    def _confirm_request(self, served: Served) -> None:
        epoch = served.epoch & 63 if served.named else None
        head = calls.Head(calls.CONFIRM, served.number, True, epoch)
        server = self.address if served.service.server is None else None
        confirm = (served.client, Call(served.service.id, head, None, server))
        if confirm not in self._confirms:
            self._confirms.append(confirm)

    def _execute(self, item: Call) -> Payload | calls.Failure | None:
        if isinstance(item.payload, calls.Failure):
            return item.payload
        handler = self.handlers.get(item.stream)
        if handler is None and self.table.stream(item.stream) is COMMANDS:
            return calls.Failure(1, "no commands")
        if handler is None or item.payload is None:
            return calls.Failure(2, "")
        try:
            return handler(item.payload)
        except RuntimeError as error:
            text = str(error).encode()[: calls.TEXT_LIMIT].decode(errors="ignore")
            return calls.Failure(1, text)

    # Time

    def _tick(self, now: float) -> None:
        for peer in self._peers.values():
            if peer.state == Agreement.PROVISIONAL and now >= peer.provisional_until_s:
                peer.state = Agreement.CONFIRMED
            if peer.epoch_again is not None and now >= peer.epoch_again[1]:
                epoch = peer.epoch_again[0]
                peer.epoch_again = None
                if epoch in peer.epochs:
                    peer.epochs.remove(epoch)
                    peer.epochs.append(epoch)
        for client in self._clients.values():
            for request in [*client.active.values()]:
                if now >= request.deadline_s:
                    self._finish(client, request, calls.Failure(6, ""))
            while client.waiting and now >= client.waiting[0].deadline_s:
                request = client.waiting.popleft()
                client.begun += 1
                self._finish(client, request, calls.Failure(6, ""))
            self._begin_calls(client, now)
        for name, served in [*self._served.items()]:
            kept = 2 * served.service.timeout_s + 10 * self.link.unit_s
            if now >= served.taken_s + kept:
                del self._served[name]

    def next_due(self) -> float | None:
        """Return when `poll` may next have a frame, or None if only a frame changes that."""
        times = [due for _, due, _ in self._reasons()]
        times += [one.deadline_s for client in self._clients.values() for one in client.waiting]
        times += [
            one.deadline_s for client in self._clients.values() for one in client.active.values()
        ]
        times += [
            peer.provisional_until_s
            for peer in self._peers.values()
            if peer.state == Agreement.PROVISIONAL
        ]
        return min(times, default=None)

    def _reasons(self) -> Iterator[tuple[int, float, int]]:
        """Return what needs a frame: its destination, when it is due, and its rank."""
        for node, _ in (*self._confirms, *self._feedback):
            yield node, 0.0, 0
        for request in self._requests():
            yield request.server, request.again.due_s, 1
        for served in self._answers():
            yield served.client, served.again.due_s, 1
        for publication in self._publications.values():
            for number, pending in publication.wanted():
                yield self._destination(publication, number), pending.again.due_s, 2
        if self._samples:
            yield BROADCAST, 0.0, 3
        for (source, _), reception in self._receptions.items():
            if reception.ack is not None:
                yield source, reception.ack.due_s, 4
        for peer in self._peers.values():
            for debt in (peer.confirm, peer.hello, *peer.asks.values(), *peer.rows.values()):
                if debt is not None:
                    yield peer.address, debt.due_s, 5

    def _requests(self) -> Iterator[Request]:
        for client in self._clients.values():
            for request in client.active.values():
                if not request.confirmed:
                    yield request

    def _answers(self) -> Iterator[Served]:
        for served in self._served.values():
            if served.answer is None or served.done:
                continue
            if served.again.due_s < served.taken_s + served.service.timeout_s:
                yield served

    def _destination(self, publication: Publication, number: int) -> int:
        lacking = publication.lacking(number)
        return lacking[0] if len(lacking) == 1 else BROADCAST

    # Frames to transmit

    def poll(self, now: float) -> bytes | None:
        """Return the next frame, with its envelope, or None."""
        opened = self.poll_opened(now)
        return None if opened is None else self.link.wrap(opened)

    def poll_opened(self, now: float) -> Opened | None:
        """Return the next frame without its envelope, or None."""
        self._tick(now)
        due = [(rank, when, node) for node, when, rank in self._reasons() if when <= now]
        if not due:
            return None
        destination = min(due)[2]
        records = self._compose(destination, now)
        return Opened(self.address, destination, records) if records else None

    def _compose(self, destination: int, now: float) -> bytes:
        if destination != BROADCAST:
            self._peers[destination].in_vain += 1
        controls = self._introduction(destination, now)
        filling = _Filling(controls, self.link.room)
        for peer in self._peers.values():
            if destination in (peer.address, BROADCAST):
                self._ride(peer, destination, filling, now)
        if destination == BROADCAST:
            self._fill_broadcast(filling, now)
        else:
            self._fill_unicast(destination, filling, now)
        return filling.done()

    def _introduction(self, destination: int, now: float) -> list[agreement.Control]:
        hello = Hello(agreement.VERSION, self.epoch, self.digest)
        if destination == BROADCAST:
            return self._broadcast_introduction(hello)
        peer = self._peers[destination]
        wanted = peer.hello is not None and peer.hello.allowed_s <= now
        wanted = wanted or peer.in_vain > _PATIENCE
        built_in = self._built_in(destination, now)
        if built_in:
            self._sent_hello = True
            equal = peer.known.hello is not None and not peer.differs
            rows = [] if equal else [Row(self.epoch, one, self._rows[one]) for one in built_in]
            return [hello, *rows]
        if peer.state == Agreement.CONFIRMED and not wanted:
            return []
        if peer.state == Agreement.PROVISIONAL and not wanted:
            return [Tag(self.epoch)]
        if peer.differs and not wanted:
            return [Tag(self.epoch)]
        if peer.hello is not None:
            peer.hello = None
            self._lengthen(peer, now)
        self._sent_hello = True
        return [hello]

    def _built_in(self, node: int, now: float) -> list[int]:
        """Return the streams of every table of which a request or an answer is due."""
        due = [
            one.stream for one in self._requests() if one.server == node and one.again.due_s <= now
        ]
        due += [
            one.service.id
            for one in self._answers()
            if one.client == node and one.again.due_s <= now
        ]
        return sorted({one for one in due if self.table.stream(one) in EVERYWHERE})

    def _broadcast_introduction(self, hello: Hello) -> list[agreement.Control]:
        others = [node for node in self.table.nodes if node != self.address]
        confirmed = all(self._peers[node].state == Agreement.CONFIRMED for node in others)
        if others and confirmed and not self._asked_broadcast:
            return []
        turn = self._broadcasts % _HELLO_RHYTHM == 0
        self._broadcasts += 1
        if turn or self._asked_broadcast:
            self._asked_broadcast = False
            self._sent_hello = True
            return [hello]
        return [Tag(self.epoch)]

    def _lengthen(self, peer: Peer, now: float) -> None:
        peer.confirm_not_before_s = now + peer.confirm_pause * self.link.unit_s
        peer.confirm_pause = min(2 * peer.confirm_pause, _CONFIRM_PAUSES[1])

    def _ride(self, peer: Peer, destination: int, filling: "_Filling", now: float) -> None:
        """Put what is owed to a peer into a frame, as far as it fits."""
        epoch = peer.epoch()
        if peer.confirm is not None and now >= peer.confirm.allowed_s:
            if epoch is None or peer.differs:
                peer.confirm = None
            else:
                assured = destination != BROADCAST and peer.state == Agreement.CONFIRMED
                node = agreement.DESTINATION if assured else peer.address
                if filling.control(Confirm(node, epoch)):
                    peer.confirm = None
                    self._lengthen(peer, now)
        for stream, debt in [*peer.asks.items()]:
            if now >= debt.allowed_s and filling.control(Ask(peer.address, stream)):
                del peer.asks[stream]
                peer.asked.add(stream)
                peer.ask_not_before_s = now + peer.ask_pause * self.link.unit_s
                peer.ask_pause = min(2 * peer.ask_pause, _ASK_PAUSES[1])
        for stream in [*peer.rows]:
            own = self._rows.get(stream, bytes(4))
            if filling.control(Row(self.epoch, stream, own)):
                del peer.rows[stream]

    def _fill_broadcast(self, filling: "_Filling", now: float) -> None:
        for publication in self._publications.values():
            for number, pending in publication.wanted():
                everyone = self._destination(publication, number) == BROADCAST
                if everyone and pending.again.due_s <= now:
                    self._put_sample(publication, number, pending, filling, now)
        while self._samples and filling.record(self._samples[0], self.table):
            self._samples.popleft()

    def _fill_unicast(self, destination: int, filling: "_Filling", now: float) -> None:
        for report in [one for one in self._feedback if one[0] == destination]:
            if filling.control(report[1]):
                self._feedback.remove(report)
        for entry in [one for one in self._confirms if one[0] == destination]:
            if filling.record(entry[1], self.table):
                self._confirms.remove(entry)
        for (source, key), reception in self._receptions.items():
            if source == destination and reception.ack is not None:
                ack = self._ack(key, reception)
                if filling.record(ack, self.table):
                    reception.ack = None
        for request in self._requests():
            if request.server == destination and request.again.due_s <= now:
                service = self.table.stream(request.stream)
                everywhere = isinstance(service, Service) and service.server is None
                head = calls.Head(calls.REQUEST, request.number, from_server=False)
                server = request.server if everywhere else None
                call = Call(request.stream, head, request.payload, server, 0.0)
                if filling.record(call, self.table):
                    request.last_sent_s = now
                    self._repeat(request.again, now)
        for served in self._answers():
            if (
                served.client == destination
                and served.again.due_s <= now
                and served.answer is not None
            ):
                is_failure = isinstance(served.answer, calls.Failure)
                kind = calls.ERROR if is_failure else calls.RESPONSE
                epoch = served.epoch & 63 if served.named else None
                head = calls.Head(kind, served.number, True, epoch)
                server = self.address if served.service.server is None else None
                if filling.record(Call(served.service.id, head, served.answer, server), self.table):
                    self._repeat(served.again, now)
        for publication in self._publications.values():
            for number, pending in publication.wanted():
                alone = self._destination(publication, number) == destination
                if alone and pending.again.due_s <= now:
                    self._put_sample(publication, number, pending, filling, now)

    def _put_sample(
        self,
        publication: Publication,
        number: int,
        pending: Pending,
        filling: "_Filling",
        now: float,
    ) -> None:
        sync = None
        if publication.needs_sync(number) or pending.again.sent >= _IN_VAIN:
            sync = Sync(self.epoch, publication.floor % _MODULUS)
        old = pending.sample
        sample = Sample(
            old.stream, old.wildcards, old.payload, number=number & 127, age_s=old.age_s, sync=sync
        )
        if filling.record(sample, self.table):
            self._repeat(pending.again, now)

    def _ack(self, key: Key, reception: Reception) -> Acknowledgement:
        stream, wildcards = key
        if reception.asks_lineage or reception.lineage is None:
            return Acknowledgement(None, stream, wildcards, Holding(0, (), knows_lineage=False))
        beyond = tuple(
            number - reception.awaited for number in sorted(reception.held) if number > 0
        )
        beyond = tuple(one for one in beyond if 1 <= one <= 35)
        holding = Holding(reception.awaited & 127, beyond)
        sync = None
        if reception.with_sync:
            sync = Sync(reception.lineage, reception.awaited % _MODULUS)
        return Acknowledgement(None, stream, wildcards, holding, sync)

    def _repeat(self, again: Repetition, now: float) -> None:
        again.sent += 1
        round_trip = 4 * self.link.unit_s + self.link.linger_s
        again.due_s = now + again.pause() * round_trip * self._chance.uniform(1, 1.5)

    def _written(self, one: record.Record) -> bytes:
        return compose.write(one, self.table)


def _has_records(whole: frame.Frame) -> bool:
    records = (Sample, Acknowledgement, Call, Goal, frame.Unread)
    return any(isinstance(one, records) for one in whole.items)


class _Judge:
    """What a node may decode of a frame."""

    def __init__(self, node: Node, peer: Peer, way: Way, now: float) -> None:
        self._node = node
        self._peer = peer
        self._way = way
        self._now = now

    def learn(self, controls: Sequence[agreement.Control]) -> None:
        """Take the controls of agreement of the frame."""
        self._node.learn(self._peer, controls, self._way, self._now)

    def verdict(self, introduction: frame.Introduction | None, stream: int) -> Verdict:
        """Return whether a record may be decoded."""
        peer = self._peer
        verdict = peer.known.verdict(introduction, stream, self._now)
        if verdict != Verdict.DIFFERS or introduction is None or stream not in peer.passing:
            return verdict
        own = peer.known.own_rows.get(stream)
        return Verdict.DECODE if peer.passing[stream] == own else Verdict.DIFFERS


class _Filling:
    """A frame that is being filled."""

    def __init__(self, controls: Sequence[agreement.Control], room: int) -> None:
        self._introduced = any(isinstance(one, Hello | Tag) for one in controls)
        self._front = b"".join(one.write() for one in controls)
        self._room = room
        self._records: list[tuple[bytes, bool]] = []

    def _assembled(self) -> bytes:
        out = self._front
        for place, (data, ends) in enumerate(self._records):
            last = place == len(self._records) - 1
            bare = last or (ends and not self._introduced)
            out += data if bare else compose.delimited(data)
        return out

    def control(self, control: agreement.Control | objects.Feedback) -> bool:
        """Put a control in, if it fits."""
        if len(self._assembled()) + len(control.write()) > self._room:
            return False
        self._front += control.write()
        return True

    def record(self, one: record.Record, table: Table) -> bool:
        """Put a record in, if it fits."""
        self._records.append((compose.write(one, table), compose.shows_end(one, table)))
        if len(self._assembled()) > self._room:
            self._records.pop()
            return False
        return True

    def done(self) -> bytes:
        return self._assembled()
