"""Section 3: a frame, in two passes. Written from docs/wire.md alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from tests.independent import access, agreement, arithmetic, dense, objects, record, relay, reliable
from tests.independent import subscriptions as subscribe
from tests.independent.agreement import Hello, Tag, Verdict
from tests.independent.cursor import Cursor
from tests.independent.errors import EndedError, ReadError
from tests.independent.record import Call, Goal, Way

PADDING, LEN = 0x00, 0xB2
FIRST_EXTENSION = 0xC0
PRIVATE_EXTENSION = 0xE0
_PREFIXES = (record.DELETE, record.ENCODING, reliable.SYNC, reliable.ACK)


@dataclass(frozen=True)
class Extension:
    """An extension: of a later version of the page, or private."""

    code: int
    body: bytes

    @property
    def private(self) -> bool:
        return self.code >= PRIVATE_EXTENSION


@dataclass(frozen=True)
class Unread:
    """Bytes that were not read, and why."""

    data: bytes
    reason: str


@dataclass(frozen=True)
class RecordBytes:
    """A record that is not yet read."""

    data: bytes


Control = access.Clock | access.Turn | objects.Feedback | subscribe.Subscribe | dense.BlockAck
Item = (
    Control
    | objects.Fragment
    | Extension
    | dense.Block
    | relay.Relayed
    | relay.HopAcknowledgement
    | relay.Flooded
    | relay.Probe
    | record.Record
    | Unread
)
Piece = agreement.Control | Item | RecordBytes


@dataclass(frozen=True)
class Placed:
    """A control or record, and its bytes in the frame, LEN included."""

    data: bytes
    item: agreement.Control | Item


Introduction = Hello | Tag


class Judge(Protocol):
    """Knows what may be decoded of a source."""

    def learn(self, controls: Sequence[agreement.Control]) -> None:
        """Take the controls of agreement of a frame: the first pass."""

    def verdict(self, introduction: Introduction | None, stream: int) -> Verdict:
        """Return whether a record of a stream may be decoded."""


class Trusting:
    """Decodes everything, as if both tables were known to be equal."""

    def learn(self, controls: Sequence[agreement.Control]) -> None:
        """Learn nothing."""

    def verdict(self, introduction: Introduction | None, stream: int) -> Verdict:
        """Return that it may be decoded."""
        return Verdict.DECODE


@dataclass(frozen=True)
class Frame:
    """What a frame holds: all in its order, without padding."""

    introduction: Introduction | None
    placed: tuple[Placed, ...]
    padding: int

    @property
    def agreement(self) -> tuple[agreement.Control, ...]:
        """The controls of agreement, which are taken first."""
        return tuple(one.item for one in self.placed if isinstance(one.item, agreement.Control))

    @property
    def items(self) -> tuple[Item, ...]:
        """Everything else."""
        return tuple(one.item for one in self.placed if not isinstance(one.item, agreement.Control))


def read(
    records: bytes,
    way: Way,
    judge: Judge | None = None,
    *,
    life: int | None = None,
    weak: bool = False,
) -> Frame:
    """Read the records of a frame. What cannot be read is among the items as `Unread`.

    `life`: of the sender of a sealed frame, which is read as if it began with a TAG of its life.
    `weak`: it is sealed, and not strong.
    """
    judge = Trusting() if judge is None else judge
    splitter = _Splitter(records, way, judge, life)
    pieces = splitter.split()
    judge.learn([piece for _, piece in pieces if isinstance(piece, agreement.Control)])
    placed: list[Placed] = []
    for data, piece in pieces:
        if isinstance(piece, RecordBytes):
            item = _decoded(piece.data, way, judge, splitter.introduction)
            if weak and isinstance(item, Call | Goal):
                item = Unread(piece.data, "weak")
            placed.append(Placed(data, item))
        else:
            placed.append(Placed(data, piece))
    return Frame(splitter.introduction, tuple(placed), splitter.padding)


def _decoded(data: bytes, way: Way, judge: Judge, introduction: Introduction | None) -> Item:
    try:
        cursor = Cursor(data)
        if not record.is_acknowledgement(data):
            verdict = judge.verdict(introduction, record.stream_of(data))
            if verdict != Verdict.DECODE:
                return Unread(data, verdict.value)
        one = record.read(cursor, way)
        cursor.end()
    except ReadError as error:
        return Unread(data, str(error))
    return one


class _Splitter:
    """Cuts a frame into its pieces."""

    def __init__(self, records: bytes, way: Way, judge: Judge, life: int | None) -> None:
        self._cursor = Cursor(records)
        self._way = way
        self._judge = judge
        self._behind_record = False
        self._pieces: list[tuple[bytes, Piece]] = []
        self._start = 0
        self._sealed = life is not None
        self.introduction: Introduction | None = None if life is None else Tag(life)
        self.padding = 0

    def split(self) -> list[tuple[bytes, Piece]]:
        cursor = self._cursor
        if cursor.peek() == relay.RELAY:
            return [(cursor.data, self._relayed())]
        while cursor.left:
            self._start = cursor.position
            try:
                self._piece()
            except ReadError as error:
                rest = cursor.data[self._start :]
                self._pieces.append((rest, Unread(rest, str(error))))
                break
        return self._pieces

    def _relayed(self) -> Item:
        data = self._cursor.data
        if not self._way.routes:
            return Unread(data, "no such route")
        return _attempt(lambda: relay.read(data), data)

    def _add(self, piece: Piece) -> None:
        data = self._cursor.data[self._start : self._cursor.position]
        self._pieces.append((data, piece))

    def _piece(self) -> None:
        cursor = self._cursor
        code = cursor.data[cursor.position]
        if code == PADDING:
            cursor.take(1)
            self.padding += 1
        elif code == LEN:
            cursor.take(1)
            self._delimited(cursor.take(cursor.number(1)))
        elif code >= arithmetic.FIRST:
            self._add(dense.Block(cursor.rest()))
        elif code in agreement.CODES:
            self._agreement(code)
        elif code in (access.CLOCK, access.TURN, objects.FEEDBACK, subscribe.SUBSCRIBE):
            cursor.take(1)
            control = self._control(code)
            if isinstance(control, subscribe.Subscribe) and self._way.broadcast:
                self._add(Unread(control.write(), "in unicast frames only"))
            else:
                self._add(control)
        elif code == objects.FRAGMENT:
            cursor.take(1)
            self._add(objects.read_fragment(cursor))
        elif code == reliable.ACK and self._is_dense_ack():
            cursor.take(1)
            node = cursor.number(1) if self._way.broadcast else None
            self._add(dense.BlockAck(node, dense.read_mark(cursor)))
        elif code <= record.LAST_STREAM or code in _PREFIXES:
            self._record()
        else:
            raise ReadError("reserved")

    def _agreement(self, code: int) -> None:
        cursor = self._cursor
        if code in (agreement.HELLO, agreement.TAG) and self._behind_record:
            raise ReadError("an introduction behind a record")
        cursor.take(1)
        control = agreement.read(code, cursor)
        if isinstance(control, Hello) and control.version != agreement.VERSION:
            raise ReadError("another version")
        self._add(control)
        if isinstance(control, Hello | Tag):
            self.introduction = control

    def _control(self, code: int) -> Control:
        if code == objects.FEEDBACK:
            return objects.read_feedback(self._cursor)
        if code == subscribe.SUBSCRIBE:
            return subscribe.read(self._cursor)
        return access.read(code, self._cursor)

    def _is_dense_ack(self) -> bool:
        place = self._cursor.position + (2 if self._way.broadcast else 1)
        return self._cursor.data[place : place + 1] >= bytes((arithmetic.FIRST,))

    def _delimited(self, data: bytes) -> None:
        """Take what stands behind LEN; nothing is skipped."""
        if not data:
            return
        first = data[0]
        if first >= FIRST_EXTENSION:
            self._add(Extension(first, data[1:]))
        elif first == objects.FRAGMENT:
            self._add(_attempt(lambda: objects.read_fragment(Cursor(data, 1)), data))
        elif PADDING < first <= record.LAST_STREAM or first in _PREFIXES:
            self._behind_record = True
            self._add(RecordBytes(data))
        else:
            self._add(Unread(data, "reserved"))

    def _measures(self) -> bool:
        """Tell whether a record behind an introduction ends where it shows its end."""
        data = self._cursor.data[self._cursor.position :]
        if not self._sealed:
            return False
        if record.is_acknowledgement(data):
            return True
        verdict = self._judge.verdict(self.introduction, record.stream_of(data))
        return verdict == Verdict.DECODE

    def _record(self) -> None:
        """Take a record without LEN."""
        cursor = self._cursor
        self._behind_record = True
        if self.introduction is not None and not self._measures():
            self._add(RecordBytes(cursor.rest()))
            return
        start = cursor.position
        ahead = Cursor(cursor.data, start)
        try:
            record.read(ahead, self._way)
        except EndedError as error:
            refused = cursor.take(ahead.position - start)
            self._add(Unread(refused, str(error)))
            return
        self._add(RecordBytes(cursor.take(ahead.position - start)))


def _attempt(reading: Callable[[], Item], data: bytes) -> Item:
    try:
        return reading()
    except ReadError as error:
        return Unread(data, str(error))
