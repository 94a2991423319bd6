"""Section 8: descriptions of types and streams, and digests. Written from docs/wire.md alone."""

import hashlib
import json
from typing import Any

from tests.independent.table import (
    CARRIED,
    EVERYWHERE,
    INTEGERS,
    Action,
    Field,
    Service,
    Stream,
    Table,
    Topic,
    Types,
)

_NODE = "{node}"


def _digest(*parts: bytes) -> bytes:
    return hashlib.sha256(b"".join(parts)).digest()[:4]


def _text(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)


def type_text(types: Types, name: str) -> str:
    """Return the description of a type, behind those that it uses."""
    found: list[str] = []
    _place(types, name, found)
    return f"[{','.join(found)}]"


def _place(types: Types, name: str, found: list[str]) -> int:
    """Return the position of a type in the list, to which it is added if it is not there."""
    fields = types[name]
    used = [one.type for one in fields if one.type in types]
    places = {one: _place(types, one, found) for one in dict.fromkeys(used)}
    listed = [_field(one, places) for one in fields]
    text = json.dumps(listed, separators=(",", ":"), ensure_ascii=True)
    if text not in found:
        found.append(text)
    return found.index(text)


def _field(field: Field, places: dict[str, int]) -> list[Any]:
    bounds = None if field.range is None else [_number(field, one) for one in field.range]
    step = None if field.step is None else _number(field, field.step)
    listed: list[Any] = [field.name, places.get(field.type, field.type), bounds, step, field.wraps]
    listed += [list(field.values), field.length, field.max_length, field.optional]
    listed += ["escape"] if field.escapes else []
    listed += ["nan"] if field.nan else []
    return [*listed, f"min_length {field.min_length}"] if field.min_length else listed


def _number(field: Field, value: float) -> float:
    return int(value) if field.type in INTEGERS else float(value)


def _whole(value: float) -> float:
    return int(value) if value == int(value) else value


def stream_text(stream: Stream, table: Table) -> str:
    """Return the description of a stream."""
    if isinstance(stream, Topic):
        return _text(
            ["topic", *_common(stream, table, stream.type, stream.type), *_topic(stream, table)]
        )
    if isinstance(stream, Service):
        front = _common(stream, table, stream.request, stream.response)
        return _text(["service", *front, stream.server or 0, _whole(stream.timeout_s)])
    front = _common(stream, table, stream.goal, stream.result)
    feedback = None if stream.feedback is None else type_text(table.all_types, stream.feedback)
    times = [_whole(stream.timeout_s), _whole(stream.result_timeout_s)]
    return _text(["action", *front, feedback, stream.server, *times])


def _common(stream: Stream, table: Table, *names: str | None) -> list[Any]:
    types = [None if one is None else type_text(table.all_types, one) for one in names]
    every = [*names, stream.feedback] if isinstance(stream, Action) else names
    typed = any(one is not None for one in every)
    encoding = stream.encoding or ("application/cbor" if typed else "zenoh/bytes")
    codec = {"cbor": [], "packed": ["codec packed"], "dense": ["codec dense 3"]}[stream.codec]
    return [stream.id, stream.name, types, encoding, *codec]


def _topic(topic: Topic, table: Table) -> list[Any]:
    ends = [sorted(one) or None for one in (topic.publishers, topic.subscribers)]
    wildcards = [[one.name, *one.values] for one in topic.wildcards]
    nodes = _nodes(table) if _NODE in topic.name else []
    found = [ends, wildcards, nodes, "age" if topic.aged else "none"]
    if topic.reliable:
        found += ["reliable", topic.depth]
    return [*found, "on_demand"] if topic.on_demand else found


def _nodes(table: Table) -> list[list[Any]]:
    return [[node, table.nodes[node]] for node in sorted(table.nodes)]


def nodes_text(table: Table) -> str:
    """Return the list of nodes that begins the text of a table."""
    return _text(_nodes(table))


def stream_digest(stream: Stream, table: Table) -> bytes:
    """Return the digest of a stream."""
    return _digest(stream_text(stream, table).encode())


def rows(table: Table) -> dict[int, bytes]:
    """Return the digests of all streams of a table, and of those that every table has."""
    built_in = (CARRIED, *EVERYWHERE) if table.carries else EVERYWHERE
    every = {one.id: one for one in built_in} | dict(table.streams)
    return {number: stream_digest(one, table) for number, one in every.items()}


def table_digest(table: Table) -> bytes:
    """Return the digest of a table without a model."""
    digests = [stream_digest(table.streams[number], table) for number in sorted(table.streams)]
    return _digest(nodes_text(table).encode(), *digests)
