"""Sections 3 to 5, 11 and 12: one record, from its prefixes to its end.

Written from docs/wire.md alone.
"""

import math
from dataclasses import dataclass
from typing import Any

from tests.independent import calls, cborpos, encodings, goals, packed, reliable
from tests.independent.cursor import Cursor
from tests.independent.envelope import BROADCAST
from tests.independent.errors import ReadError
from tests.independent.table import KEYS, Action, Service, Table, Topic

DELETE, ENCODING = 0xB3, 0xB4
LAST_STREAM = 0xAF
Payload = dict[str, Any] | bytes
_KEYS_REQUEST = 41


@dataclass(frozen=True)
class Way:
    """Between whom a frame goes, and the table by which its records are read."""

    table: Table
    source: int
    destination: int

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


def is_acknowledgement(data: bytes) -> bool:
    """Tell whether a record is an ACK."""
    place = 6 if data[:1] == bytes((reliable.SYNC,)) else 0
    return data[place : place + 1] == bytes((reliable.ACK,))


def stream_of(data: bytes) -> int:
    """Return the stream of a record, without reading its content."""
    return _prefixes(Cursor(data))[-1]


def read(cursor: Cursor, way: Way) -> Record:
    """Take a record. If its payload shows no end, it takes all that is there."""
    sync, node, deletes, encoding, stream_id = _prefixes(cursor, way)
    stream = way.table.stream(stream_id)
    if node is not None:
        return _acknowledgement(cursor, stream, sync, node or None)
    if isinstance(stream, Topic):
        return _sample(cursor, way.table, stream, sync, encoding, deletes=deletes)
    if sync is not None or deletes or encoding is not None:
        raise ReadError("only samples have prefixes")
    if isinstance(stream, Service):
        return _call(cursor, way, stream)
    return _goal(cursor, way, stream)


def _prefixes(
    cursor: Cursor, way: Way | None = None
) -> tuple[reliable.Sync | None, int | None, bool, str | None, int]:
    """Take what stands before a content: SYNC, ACK (0: to the destination), DELETE, ENCODING."""
    sync = node = encoding = None
    deletes = False
    code = cursor.number(1)
    if code == reliable.SYNC:
        sync = reliable.read_sync(cursor)
        code = cursor.number(1)
    if code == reliable.ACK:
        node = cursor.number(1) if way is not None and way.broadcast else 0
        code = cursor.number(1)
    else:
        if code == DELETE:
            deletes = True
            code = cursor.number(1)
        if code == ENCODING:
            encoding = encodings.read(cursor)
            code = cursor.number(1)
    if not 1 <= code <= LAST_STREAM:
        raise ReadError("no stream")
    return sync, node, deletes, encoding, code


def _wildcards(cursor: Cursor, stream: Topic) -> tuple[str, ...]:
    values = []
    for wildcard in stream.wildcards:
        place = cursor.number(1)
        if place >= len(wildcard.values):
            raise ReadError(f"no such {wildcard.name}")
        values.append(wildcard.values[place])
    return tuple(values)


def _acknowledgement(
    cursor: Cursor, stream: object, sync: reliable.Sync | None, node: int | None
) -> Acknowledgement:
    if not isinstance(stream, Topic) or not stream.reliable:
        raise ReadError("no reliable topic")
    wildcards = _wildcards(cursor, stream)
    holding = reliable.read_holding(cursor)
    if sync is not None and sync.number & 127 != holding.awaited:
        raise ReadError("SYNC and ACK await different numbers")
    return Acknowledgement(node, stream.id, wildcards, holding, sync)


def _sample(
    cursor: Cursor,
    table: Table,
    topic: Topic,
    sync: reliable.Sync | None,
    encoding: str | None,
    *,
    deletes: bool,
) -> Sample:
    wildcards = _wildcards(cursor, topic)
    number = None
    in_rhythm = False
    if topic.reliable:
        byte = cursor.number(1)
        number, in_rhythm = byte & 127, bool(byte & reliable.RHYTHM)
    age_s = read_age(cursor) if topic.aged and not deletes else None
    payload = None
    if not deletes:
        payload = _topic_payload(cursor, table, topic, encoding)
    return Sample(topic.id, wildcards, payload, encoding, number, in_rhythm, age_s, sync)


def _topic_payload(cursor: Cursor, table: Table, topic: Topic, encoding: str | None) -> Payload:
    if topic.type is None:
        raw = cursor.rest()
        return raw if topic.codec == "cbor" else packed.read_bytes(raw)
    if encoding is not None:
        return cursor.rest()  # A guess: a payload in another encoding is not of the type.
    if topic.codec == "cbor":
        return cborpos.read(table.all_types, topic.type, cursor)
    return packed.read(table.all_types, topic.type, cursor)


def _payload(cursor: Cursor, table: Table, name: str | None) -> Payload:
    if name is None:
        return cursor.rest()
    return cborpos.read(table.all_types, name, cursor)


def _from_server(way: Way, server: int) -> bool:
    if way.source == server:
        return True
    if way.destination == server:
        return False
    raise ReadError("neither from the server nor to it")


def _call(cursor: Cursor, way: Way, service: Service) -> Call:
    server = cursor.number(1) if service.server is None else None
    from_server = _from_server(way, service.server or server or 0)
    if from_server and way.broadcast:
        raise ReadError("an answer goes to its client")
    head = calls.read_head(cursor, from_server=from_server)
    if head.kind == calls.CONFIRM:
        return Call(service.id, head, None, server)
    if head.kind == calls.ERROR:
        return Call(service.id, head, calls.read_failure(cursor), server)
    age_s = read_age(cursor) if service.aged else None
    name = service.response if from_server else service.request
    payload = _payload(cursor, way.table, name)
    if service is KEYS and not from_server and len(payload) != _KEYS_REQUEST:
        raise ReadError("a request of keys has 41 bytes")
    return Call(service.id, head, payload, server, age_s)


def _goal(cursor: Cursor, way: Way, action: Action) -> Goal:
    from_server = _from_server(way, action.server)
    if from_server and way.broadcast:
        raise ReadError("a goal's records go to its client")
    head = goals.read_head(cursor, from_server=from_server)
    name = head.operation
    if name == "GOAL":
        return Goal(action.id, head, _payload(cursor, way.table, action.goal))
    if name == "SUCCEEDED":
        return Goal(action.id, head, _payload(cursor, way.table, action.result), status=4)
    if name == "FEEDBACK":
        return Goal(action.id, head, _payload(cursor, way.table, action.feedback))
    if name == "REFUSED":
        return Goal(action.id, head, goals.read_refusal(cursor))
    if name == "CANCEL AGAIN":
        return Goal(action.id, head, attempt=cursor.number(1))
    if name == "RESULT":
        status = goals.read_status(cursor)
        if not goals.has_result(status):
            return Goal(action.id, head, status=status)
        return Goal(action.id, head, _payload(cursor, way.table, action.result), status=status)
    return Goal(action.id, head)


def read_age(cursor: Cursor) -> float:
    """Take an age, s; infinite: more than an hour."""
    code = cursor.number(1)
    if code <= 100:
        return code / 10
    if code == 255:
        return float("inf")
    return float(10 * 360 ** ((code - 100) / 154))


def write_age(age_s: float) -> int:
    """Return the code of an age: the nearest one."""
    if age_s <= 10:
        return max(0, round(age_s * 10))
    if age_s > 3600:
        return 255
    return 100 + round(154 * math.log(age_s / 10, 360))
