"""Sections 3 to 5, 11 and 12: records and frames, from what they mean to bytes.

Written from docs/wire.md alone.
"""

from collections.abc import Iterable, Sequence

from tests.independent import agreement, calls, cborpos, encodings, frame, goals, packed, record
from tests.independent.errors import ReadError
from tests.independent.record import Acknowledgement, Call, Goal, Payload, Record, Sample
from tests.independent.reliable import ACK, RHYTHM
from tests.independent.table import Action, Service, Table, Topic


def write(one: Record, table: Table) -> bytes:
    """Return a record without LEN."""
    stream = table.stream(one.stream)
    if isinstance(one, Sample) and isinstance(stream, Topic):
        return _sample(one, stream, table)
    if isinstance(one, Acknowledgement) and isinstance(stream, Topic):
        return _acknowledgement(one, stream)
    if isinstance(one, Call) and isinstance(stream, Service):
        return _call(one, stream, table)
    if isinstance(one, Goal) and isinstance(stream, Action):
        return _goal(one, stream, table)
    raise ReadError("a record of another kind of stream")


def shows_end(one: Record, table: Table) -> bool:
    """Tell whether a record shows its end in a frame without HELLO and TAG."""
    stream = table.stream(one.stream)
    if isinstance(one, Sample) and isinstance(stream, Topic):
        return one.payload is None or isinstance(one.payload, dict)
    if isinstance(one, Acknowledgement):
        return True
    return one.payload is None or isinstance(one.payload, dict)


def frame_of(
    controls: Sequence[agreement.Control], records: Iterable[Record], table: Table
) -> bytes:
    """Return a frame of controls, and of records with LEN where they need it."""
    introduced = any(isinstance(one, agreement.Hello | agreement.Tag) for one in controls)
    out = b"".join(one.write() for one in controls)
    several = list(records)
    for place, one in enumerate(several):
        data = write(one, table)
        last = place == len(several) - 1
        if not last and (introduced or not shows_end(one, table)):
            data = delimited(data)
        out += data
    return out


def delimited(data: bytes) -> bytes:
    """Put LEN before a record, a FRAGMENT or an extension."""
    if len(data) > 255:
        raise ReadError("LEN delimits at most 255 bytes")
    return bytes((frame.LEN, len(data))) + data


def _sample(one: Sample, topic: Topic, table: Table) -> bytes:
    out = one.sync.write() if one.sync is not None else b""
    if one.payload is None:
        out += bytes((record.DELETE,))
    if one.encoding is not None:
        out += bytes((record.ENCODING,)) + encodings.write(one.encoding)
    out += bytes((topic.id,)) + _wildcards(one.wildcards, topic)
    if one.number is not None:
        out += bytes((one.number & 127 | RHYTHM * one.in_rhythm,))
    if one.payload is None:
        return out
    if topic.aged:
        out += bytes((record.write_age(one.age_s or 0.0),))
    return out + payload_bytes(one.payload, topic.type, topic.codec, table)


def _wildcards(values: Sequence[str], topic: Topic) -> bytes:
    pairs = zip(topic.wildcards, values, strict=True)
    return bytes(wildcard.values.index(value) for wildcard, value in pairs)


def _acknowledgement(one: Acknowledgement, topic: Topic) -> bytes:
    out = one.sync.write() if one.sync is not None else b""
    out += bytes((ACK,)) if one.node is None else bytes((ACK, one.node))
    return out + bytes((topic.id,)) + _wildcards(one.wildcards, topic) + one.holding.write()


def payload_bytes(payload: Payload, name: str | None, codec: str, table: Table) -> bytes:
    """Return a payload of a type; bytes stand for themselves, but packed ones without a type."""
    if isinstance(payload, bytes):
        plain = name is not None or codec == "cbor"
        return payload if plain else packed.write_bytes(payload)
    if name is None:
        raise ReadError("a stream without a type")
    written = cborpos.write if codec == "cbor" else packed.write
    return written(table.all_types, name, payload)


def _call(one: Call, service: Service, table: Table) -> bytes:
    server = b"" if one.server is None else bytes((one.server,))
    out = bytes((service.id,)) + server + one.head.write()
    if one.payload is None:
        return out
    if isinstance(one.payload, calls.Failure):
        return out + one.payload.write()
    if service.aged:
        out += bytes((record.write_age(one.age_s or 0.0),))
    name = service.response if one.head.from_server else service.request
    return out + payload_bytes(one.payload, name, service.codec, table)


def _goal(one: Goal, action: Action, table: Table) -> bytes:
    out = bytes((action.id,)) + one.head.write()
    if one.attempt is not None:
        out += bytes((one.attempt,))
    if one.head.operation == "RESULT":
        out += bytes((one.status or 0,))
    if one.payload is None:
        return out
    if isinstance(one.payload, goals.Refusal):
        return out + one.payload.write()
    names = {"GOAL": action.goal, "FEEDBACK": action.feedback}
    name = names.get(one.head.operation, action.result)
    return out + payload_bytes(one.payload, name, action.codec, table)
