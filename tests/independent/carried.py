"""Section 18: messages of carried topics. Written from docs/wire.md alone."""

from dataclasses import dataclass

from tests.independent import cborpos, encodings, packed
from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError
from tests.independent.table import Table, Topic

ENVELOPE, RECEIPT, REFUSAL, DIRECT = 0, 1, 2, 3
_DELETES, _ENCODED, _FINAL, _COUNT = 0x20, 0x10, 0x20, 0x0F
_UNKNOWN = 255


@dataclass(frozen=True)
class Message:
    """A message. `floor`: None if unknown; `life_min` and `more`: of an envelope."""

    kind: int
    origin: int
    destination: int
    stream: int
    lineage: int
    number: int
    wildcards: tuple[str, ...] = ()
    digest: bytes = b""
    floor: int | None = None
    life_min: int | None = None
    more: int | None = None
    deletes: bool = False
    encoding: str | None = None
    payload: bytes = b""
    final: bool = False


def read(data: bytes, source: int, destination: int, table: Table) -> Message:
    """Read a whole message that went from `source` to `destination`."""
    cursor = Cursor(data)
    flags = cursor.number(1)
    kind = flags >> 6
    if kind in (RECEIPT, REFUSAL):
        return _answer(cursor, kind, flags & 63, table)
    life = more = None
    if kind == ENVELOPE:
        source, destination = cursor.number(1), cursor.number(1)
        life, more = minutes(cursor.number(1)), flags & _COUNT
    elif flags & _COUNT:
        raise ReadError("a reserved bit")
    topic = _topic(cursor.number(1), table)
    digest = cursor.take(2)
    lineage, number, behind = cursor.number(2), cursor.number(3), cursor.number(1)
    if behind != _UNKNOWN and behind > number:
        raise ReadError("a floor below zero")
    wildcards = _wildcards(cursor, topic)
    encoding = encodings.read(cursor) if flags & _ENCODED else None
    payload = cursor.rest()
    if flags & _DELETES and payload:
        raise ReadError("a deleted key has no payload")
    return Message(
        kind, source, destination, topic.id, lineage, number, wildcards, digest,
        None if behind == _UNKNOWN else number - behind, life, more,
        bool(flags & _DELETES), encoding, payload,
    )  # fmt: skip


def _answer(cursor: Cursor, kind: int, flags: int, table: Table) -> Message:
    if flags & ~(_FINAL if kind == REFUSAL else 0):
        raise ReadError("a reserved bit")
    origin, destination = cursor.number(1), cursor.number(1)
    topic = _topic(cursor.number(1), table)
    lineage, number = cursor.number(2), cursor.number(3)
    wildcards = _wildcards(cursor, topic)
    if cursor.rest():
        raise ReadError("bytes behind its end")
    return Message(
        kind, origin, destination, topic.id, lineage, number, wildcards, final=bool(flags)
    )


def _topic(stream_id: int, table: Table) -> Topic:
    topic = table.stream(stream_id)
    if not isinstance(topic, Topic) or not topic.custodians:
        raise ReadError("no carried topic")
    return topic


def _wildcards(cursor: Cursor, topic: Topic) -> tuple[str, ...]:
    values = []
    for wildcard in topic.wildcards:
        place = cursor.number(1)
        if place >= len(wildcard.values):
            raise ReadError(f"no such {wildcard.name}")
        values.append(wildcard.values[place])
    return tuple(values)


def write(one: Message, table: Table) -> bytes:
    """Return the bytes of a message."""
    topic = _topic(one.stream, table)
    pairs = zip(topic.wildcards, one.wildcards, strict=True)
    wildcards = bytes(wildcard.values.index(value) for wildcard, value in pairs)
    ends = bytes((one.origin, one.destination))
    place = one.lineage.to_bytes(2, "big") + one.number.to_bytes(3, "big")
    if one.kind in (RECEIPT, REFUSAL):
        head = bytes((one.kind << 6 | _FINAL * one.final,))
        return head + ends + bytes((one.stream,)) + place + wildcards
    flags = one.kind << 6 | _DELETES * one.deletes | _ENCODED * (one.encoding is not None)
    head = bytes((flags | (one.more or 0),))
    if one.kind == ENVELOPE:
        head += ends + bytes((code(one.life_min or 0),))
    behind = _UNKNOWN if one.floor is None else one.number - one.floor
    head += bytes((one.stream,)) + one.digest + place + bytes((behind,)) + wildcards
    if one.encoding is not None:
        head += encodings.write(one.encoding)
    return head + one.payload


def minutes(life: int) -> int:
    """Return the minutes of a life: the high bits are an exponent, the low ones a mantissa."""
    return (life & 15) << (life >> 4)


def code(life_min: int) -> int:
    """Return the life of minutes, rounded down."""
    exponent = 0
    while life_min >> exponent > 15:
        exponent += 1
    return exponent << 4 | life_min >> exponent


def value(one: Message, table: Table) -> dict[str, object] | bytes:
    """Return what the payload of an envelope means."""
    topic = _topic(one.stream, table)
    if topic.type is None:
        return one.payload if topic.codec == "cbor" else packed.read_bytes(one.payload)
    read_payload = cborpos.read if topic.codec == "cbor" else packed.read
    return read_payload(table.all_types, topic.type, Cursor(one.payload))
