"""Sections 3 to 5, 11 and 12: one record, from its prefixes to its end.

Written from docs/wire.md alone.
"""

import math
from dataclasses import dataclass
from typing import Any

from tests.independent import calls, cborpos, encodings, goals, packed, reliable
from tests.independent.cursor import Cursor
from tests.independent.envelope import BROADCAST
from tests.independent.errors import EndedError, ReadError
from tests.independent.table import KEYS, Action, Service, Table, Topic

DELETE, ENCODING = 0xB3, 0xB4
LAST_STREAM = 0xAF
Payload = dict[str, Any] | bytes
_KEYS_REQUEST = 41


@dataclass(frozen=True)
class Way:
    """Between whom a frame goes, and the table by which its records are read.

    `routes`: whether the link has routes or bonds.
    """

    table: Table
    source: int
    destination: int
    routes: bool = True

    @property
    def broadcast(self) -> bool:
        return self.destination == BROADCAST


@dataclass(frozen=True)
class Sample:
    """A sample of a topic. `age_s`: None without a stamp; infinite: more than an hour."""

    stream: int
    wildcards: tuple[str, ...]
    payload: Payload | None
    encoding: str | None = None
    number: int | None = None
    in_rhythm: bool = False
    age_s: float | None = None
    sync: reliable.Sync | None = None

    @property
    def deletes(self) -> bool:
        return self.payload is None


@dataclass(frozen=True)
class Acknowledgement:
    """An ACK of a reliable topic. `node`: None in a unicast frame."""

    node: int | None
    stream: int
    wildcards: tuple[str, ...]
    holding: reliable.Holding
    sync: reliable.Sync | None = None


@dataclass(frozen=True)
class Call:
    """A record of a service. `server`: of the streams that every node serves."""

    stream: int
    head: calls.Head
    payload: Payload | calls.Failure | None
    server: int | None = None
    age_s: float | None = None


@dataclass(frozen=True)
class Goal:
    """A record of an action."""

    stream: int
    head: goals.Head
    payload: Payload | goals.Refusal | None = None
    status: int | None = None
    attempt: int | None = None


Record = Sample | Acknowledgement | Call | Goal


@dataclass(frozen=True)
class _Before:
    """What stands before a content. `node`: of an ACK; None: for the destination of its frame."""

    stream: int
    sync: reliable.Sync | None
    node: int | None
    encoding: str | None
    deletes: bool
    acknowledges: bool


def is_acknowledgement(data: bytes) -> bool:
    """Tell whether a record is an ACK."""
    try:
        return _prefixes(Cursor(data)).acknowledges
    except ReadError:
        return False


def stream_of(data: bytes) -> int:
    """Return the stream of a record, without reading its content."""
    return _prefixes(Cursor(data)).stream


def read(cursor: Cursor, way: Way) -> Record:
    """Take a record. If its payload shows no end, it takes all that is there."""
    before = _prefixes(cursor, way)
    stream = way.table.stream(before.stream)
    if isinstance(stream, Topic):
        if before.acknowledges:
            return _acknowledgement(cursor, stream, before)
        return _sample(cursor, way.table, stream, before)
    if before != _Before(before.stream, None, None, None, False, False):
        raise ReadError("only records of topics have prefixes")
    one = _call(cursor, way, stream) if isinstance(stream, Service) else _goal(cursor, way, stream)
    if one.head.from_server and way.broadcast:
        raise EndedError("a server's records go to one client")
    return one


def _prefixes(cursor: Cursor, way: Way | None = None) -> _Before:
    """Take what stands before a content, in any order; of each prefix the last one counts."""
    sync = node = encoding = None
    deletes = acknowledges = False
    while True:
        code = cursor.number(1)
        if code == reliable.SYNC:
            sync = reliable.read_sync(cursor)
        elif code == reliable.ACK:
            acknowledges = True
            node = cursor.number(1) if way is not None and way.broadcast else None
        elif code == DELETE:
            deletes = True
        elif code == ENCODING:
            encoding = encodings.read(cursor)
        elif 1 <= code <= LAST_STREAM:
            return _Before(code, sync, node, encoding, deletes, acknowledges)
        else:
            raise ReadError("no stream")


def _values(stream: Topic, places: bytes) -> tuple[str, ...]:
    """Return the wildcard values of a content that has been taken."""
    for wildcard, place in zip(stream.wildcards, places, strict=True):
        if place >= len(wildcard.values):
            raise EndedError(f"no such {wildcard.name}")
    wildcards = zip(stream.wildcards, places, strict=True)
    return tuple(wildcard.values[place] for wildcard, place in wildcards)


def _acknowledgement(cursor: Cursor, stream: Topic, before: _Before) -> Acknowledgement:
    places = cursor.take(len(stream.wildcards))
    holding = reliable.read_holding(cursor)
    if not stream.reliable:
        raise EndedError("no reliable topic")
    return Acknowledgement(before.node, stream.id, _values(stream, places), holding, before.sync)


def _sample(cursor: Cursor, table: Table, topic: Topic, before: _Before) -> Sample:
    places = cursor.take(len(topic.wildcards))
    number = None
    in_rhythm = False
    if topic.reliable:
        byte = cursor.number(1)
        number, in_rhythm = byte & 127, bool(byte & reliable.RHYTHM)
    age_s = payload = None
    if not before.deletes:
        age_s = read_age(cursor) if topic.aged else None
        payload = _payload(cursor, table, topic.type, topic.codec)
    return Sample(
        topic.id,
        _values(topic, places),
        payload,
        before.encoding,
        number,
        in_rhythm,
        age_s,
        before.sync,
    )


def _payload(cursor: Cursor, table: Table, name: str | None, codec: str = "cbor") -> Payload:
    """Take a payload. One that is not allowed has an end, if that can be told."""
    if name is None:
        raw = cursor.rest()
        return raw if codec == "cbor" else packed.read_bytes(raw)
    read, skip = (cborpos.read, cborpos.skip) if codec == "cbor" else (packed.read, packed.skip)
    ahead = Cursor(cursor.data, cursor.position)
    try:
        return read(table.all_types, name, cursor)
    except ReadError as error:
        skip(table.all_types, name, ahead)
        cursor.position = ahead.position
        raise EndedError(str(error)) from error


def _call(cursor: Cursor, way: Way, service: Service) -> Call:
    server = cursor.number(1) if service.server is None else None
    from_server = way.source == (service.server or server)
    head = calls.read_head(cursor, from_server=from_server)
    if head.kind == calls.CONFIRM:
        return Call(service.id, head, None, server)
    if head.kind == calls.ERROR:
        return Call(service.id, head, calls.read_failure(cursor), server)
    age_s = read_age(cursor) if service.aged else None
    name = service.response if from_server else service.request
    payload = _payload(cursor, way.table, name, service.codec)
    if service is KEYS and not from_server and len(payload) != _KEYS_REQUEST:
        raise ReadError("a request of keys has 41 bytes")
    return Call(service.id, head, payload, server, age_s)


def _goal(cursor: Cursor, way: Way, action: Action) -> Goal:
    from_server = way.source == action.server
    head = goals.read_head(cursor, from_server=from_server)
    name = head.operation
    if name == "GOAL":
        return Goal(action.id, head, _payload(cursor, way.table, action.goal, action.codec))
    if name == "SUCCEEDED":
        return Goal(
            action.id, head, _payload(cursor, way.table, action.result, action.codec), status=4
        )
    if name == "FEEDBACK":
        return Goal(action.id, head, _payload(cursor, way.table, action.feedback, action.codec))
    if name == "REFUSED":
        return Goal(action.id, head, goals.read_refusal(cursor))
    if name == "CANCEL AGAIN":
        return Goal(action.id, head, attempt=cursor.number(1))
    if name == "RESULT":
        status = cursor.number(1)
        if not goals.has_result(status):
            return Goal(action.id, head, status=status)
        return Goal(
            action.id, head, _payload(cursor, way.table, action.result, action.codec), status=status
        )
    return Goal(action.id, head)


def read_age(cursor: Cursor) -> float:
    """Take an age, s; infinite: more than thirty days; not a number: unknown."""
    code = cursor.number(1)
    if code <= 100:
        return code / 10
    if code == 255:
        return float("nan")
    if code == 254:
        return float("inf")
    return round(float(10 * 259_200 ** ((code - 100) / 153)), 3)


def write_age(age_s: float) -> int:
    """Return the code of an age: the nearest one."""
    if math.isnan(age_s):
        return 255
    if age_s <= 10:
        return max(0, round(age_s * 10))
    if age_s > 30 * 86_400:
        return 254
    return 100 + round(153 * math.log(age_s / 10, 259_200))
