"""The tables of the vectors: for programs as `StreamTable`, for everybody else as `tables.json`.

`python -m tests.golden.tables` writes the file anew. A table that has changed has other digests, so
a changed table is a changed vector.
"""

import json
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.core.base.qos import Durability, Forward, Qos, Reliability, Stamp
from zacoustic.core.streams.carry import CARRY_STREAM_ID, Carry
from zacoustic.core.streams.commands import COMMANDS_STREAM_ID
from zacoustic.core.streams.keydelivery import KEYS_STREAM_ID
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.routing import ROUTING_STREAM_ID
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.status import STATUS_STREAM_ID
from zacoustic.core.streams.table import EVERY_NODE, Stream, StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

TABLES_FILE: Final = Path(__file__).parent / "tables.json"
BUILT_IN: Final = (ROUTING_STREAM_ID, KEYS_STREAM_ID, STATUS_STREAM_ID, COMMANDS_STREAM_ID)

NAV = TypeSpec(
    name="Nav",
    fields=(
        FieldSpec(name="lat", type="float64", range=(-90, 90), step=1e-6),
        FieldSpec(name="depth", type="float32", range=(0, 1000), step=0.1),
        FieldSpec(name="heading", type="float32", range=(0, 360), step=0.1, wraps=True),
        FieldSpec(name="mode", type="enum", values=("idle", "survey", "abort")),
    ),
)
NAV_VALUE: Final = {"lat": 45.4, "depth": 12.3, "heading": 271.5, "mode": "survey"}
"""A value of that type."""


def table() -> StreamTable:
    """Return the table of all vectors: node 1 is ``shore``, node 2 is ``auv1``."""
    aged = Qos(stamp=Stamp.AGE)
    return StreamTable(
        [
            TopicSpec(stream_id=10, name="auv1/nav", type_name="Nav"),
            TopicSpec(stream_id=11, name="auv1/raw"),
            TopicSpec(stream_id=12, name="auv1/old", qos=aged),
            TopicSpec(
                stream_id=13,
                name="fleet/{node}/{sensor}",
                wildcards=(Wildcard(name="sensor", values=("ctd", "adcp", "sonar")),),
            ),
            ServiceSpec(stream_id=20, name="auv1/arm", server=2, timeout_s=30),
            TopicSpec(stream_id=21, name="auv1/other"),
        ],
        types=TypeTable([NAV]),
        nodes={1: "shore", 2: "auv1"},
    )


def reliable_table() -> StreamTable:
    """Return the table of `table` with a reliable topic for each of the two."""
    known = table()
    reliable = Qos(reliability=Reliability.RELIABLE, depth=8)
    specs = [stream.spec for stream in known]
    specs += [
        TopicSpec(stream_id=30, name="auv1/orders", subscribers=(2,), qos=reliable),
        TopicSpec(
            stream_id=31,
            name="fleet/{node}/log/{sensor}",
            wildcards=(Wildcard(name="sensor", values=("ctd", "adcp", "sonar")),),
            qos=reliable,
        ),
    ]
    return StreamTable(specs, types=known.types, nodes=known.nodes)


def action_table() -> StreamTable:
    """Return the table of the vectors of actions."""
    known = table()
    specs = [
        *(stream.spec for stream in known),
        ActionSpec(stream_id=40, name="auv1/goto", goal_type="Nav", server=2),
    ]
    return StreamTable(specs, types=known.types, nodes=known.nodes)


def demand_table() -> StreamTable:
    """Return the table of the vectors of on-demand topics."""
    known = table()
    qos = Qos(forward=Forward.ON_DEMAND)
    specs = [stream.spec for stream in known]
    specs.append(TopicSpec(stream_id=50, name="auv1/sonar", publishers=(2,), qos=qos))
    return StreamTable(specs, types=known.types, nodes=known.nodes)


def dense_table() -> StreamTable:
    """Return the table of the vectors of dense topics: stream 10 is one, and 50, of its age."""
    known = table()
    specs: list[StreamSpec] = [stream.spec for stream in known if stream.stream_id != 10]
    aged = Qos(stamp=Stamp.AGE)
    specs += [
        TopicSpec(stream_id=10, name="auv1/nav", type_name="Nav", codec="dense", qos=Qos(depth=4)),
        TopicSpec(stream_id=50, name="auv1/way", type_name="Nav", codec="dense", qos=aged),
    ]
    return StreamTable(specs, types=known.types, nodes=known.nodes)


def bytes_table() -> StreamTable:
    """Return the table of the vectors of packed bytes: streams 51, and 52, which is dense."""
    specs: list[StreamSpec] = [
        *(stream.spec for stream in table()),
        TopicSpec(stream_id=51, name="auv1/log", encoding="text/plain", codec="packed"),
        TopicSpec(stream_id=52, name="auv1/talk", encoding="text/plain", codec="dense"),
    ]
    return StreamTable(specs, types=table().types, nodes=table().nodes)


def carried_table() -> StreamTable:
    """Return the table of the vectors of carried topics: node 3 takes them from 2 to 1."""
    known = table()
    reliable = Qos(reliability=Reliability.RELIABLE, depth=8)
    specs: list[StreamSpec] = [
        *(stream.spec for stream in known),
        TopicSpec(
            stream_id=60, name="auv1/track", type_name="Nav", publishers=(2,), subscribers=(1,),
            qos=reliable, journal=True, carry=Carry(by=(3,)),
        ),
        TopicSpec(
            stream_id=61, name="deep/{sensor}", publishers=(2,), subscribers=(1,),
            wildcards=(Wildcard(name="sensor", values=("ctd", "adcp", "sonar")),),
            qos=reliable, journal=True, carry=Carry(by=(3,)),
        ),
    ]  # fmt: skip
    return StreamTable(specs, types=known.types, nodes={**known.nodes, 3: "glider"})


def other_table() -> StreamTable:
    """Return a table that differs from `table` in one stream: 21 has a type."""
    known = table()
    specs: list[StreamSpec] = [stream.spec for stream in known if stream.stream_id != 21]
    specs.append(TopicSpec(stream_id=21, name="auv1/other", type_name="Nav"))
    return StreamTable(specs, types=known.types, nodes=known.nodes)


def kinds_table() -> StreamTable:
    """Return a table with every kind of stream and of field that a description may have."""
    point = TypeSpec(
        name="Point",
        fields=(
            FieldSpec(name="x", type="float32"),
            FieldSpec(name="y", type="float64", range=(-5e6, 5e6), step=0.001),
        ),
    )
    every = TypeSpec(
        name="Every",
        fields=(
            FieldSpec(name="flag", type="bool", default=False),
            FieldSpec(name="count", type="uint16", range=(0, 60_000), step=10, unit="m"),
            FieldSpec(name="angle", type="float32", range=(-180, 180), step=1e-05, wraps=True),
            FieldSpec(name="level", type="int8", range=(0, 10), outside="escape"),
            FieldSpec(name="edge", type="int8", range=(0, 10), outside="clamp"),
            FieldSpec(name="large", type="float64", range=(0, 1e22)),
            FieldSpec(name="mode", type="enum", values=("aus", "grün", 'a "b"')),
            FieldSpec(name="text", type="string", max_length=20),
            FieldSpec(name="data", type="bytes", optional=True),
            FieldSpec(name="at", type="Point"),
            FieldSpec(name="way", type="Point", max_length=8),
            FieldSpec(name="pair", type="int64", length=2),
            FieldSpec(name="names", type="string", max_length=3, optional=True),
        ),
    )
    specs: list[StreamSpec] = [
        TopicSpec(stream_id=1, name="öl/stand", type_name="Every", encoding="application/json"),
        TopicSpec(
            stream_id=2, name="{node}/log", codec="packed", publishers=(3, 1), subscribers=(2,)
        ),
        TopicSpec(
            stream_id=3,
            name="{node}/{side}/valve/{part}",
            type_name="Point",
            wildcards=(
                Wildcard(name="side", values=("left", "right")),
                Wildcard(name="part", values=("a", "ä")),
            ),
            qos=Qos(
                reliability=Reliability.RELIABLE,
                depth=300,
                stamp=Stamp.AGE,
                forward=Forward.ON_DEMAND,
            ),
        ),
        TopicSpec(stream_id=4, name="nav", type_name="Point", codec="dense"),
        ServiceSpec(stream_id=5, name="get", server=3, response_type="Point", timeout_s=0.25),
        ServiceSpec(stream_id=6, name="set", server=3, request_type="Every", timeout_s=60.0),
        ActionSpec(
            stream_id=7,
            name="go",
            server=3,
            goal_type="Point",
            feedback_type="Every",
            result_type="Point",
            timeout_s=90.5,
            result_timeout_s=1e6,
            codec="packed",
        ),
    ]
    nodes = {3: "auv2", 1: "shore", 2: "bücher"}
    return StreamTable(specs, types=TypeTable([point, every]), nodes=nodes)


def latched_table() -> StreamTable:
    """Return a table of topics that tell apart the publishers of a node."""
    qos = Qos(
        reliability=Reliability.RELIABLE, durability=Durability.TRANSIENT_LOCAL, stamp=Stamp.AGE
    )
    specs = [
        TopicSpec(stream_id=10, name="tf_static", local_publishers=3, qos=qos),
        TopicSpec(
            stream_id=11,
            name="{node}/valve/{side}",
            wildcards=(Wildcard(name="side", values=("left", "right")),),
            local_publishers=2,
            qos=Qos(durability=Durability.TRANSIENT_LOCAL),
        ),
    ]
    return StreamTable(specs, nodes={1: "shore", 2: "auv1"})


TABLES: Final[dict[str, StreamTable]] = {
    "base": table(),
    "reliable": reliable_table(),
    "action": action_table(),
    "on_demand": demand_table(),
    "dense": dense_table(),
    "bytes": bytes_table(),
    "carried": carried_table(),
    "other": other_table(),
    "kinds": kinds_table(),
    "latched": latched_table(),
    "unlisted": StreamTable([TopicSpec(stream_id=10, name="raw")]),
}
"""Each table by the name by which vectors refer to it."""


def as_json() -> dict[str, Any]:
    """Return the content of the file."""
    known = table()
    return {
        "about": "Tables of the vectors. docs/wire.md, section 14, says what each key means.",
        "tables": {name: as_plain(each) for name, each in TABLES.items()},
        "built_in": [
            _stream(TABLES["carried"].by_id(CARRY_STREAM_ID)),
            *(_stream(known.by_id(stream_id)) for stream_id in BUILT_IN),
        ],
        "built_in_types": [
            fields_of(each) for stream_id in BUILT_IN for each in _types(known.by_id(stream_id))
        ],
    }


def as_plain(each: StreamTable) -> dict[str, Any]:
    """Return a table as the file has it."""
    nodes = sorted(each.nodes.items())
    return {
        "nodes": {str(address): name for address, name in nodes},
        "types": [fields_of(each.types[known.name]) for known in each.types],
        "streams": [_stream(stream) for stream in each],
        "nodes_description": msgspec.json.encode(nodes).decode(),
        "digest": each.digest.hex(),
    }


def _stream(stream: Stream) -> dict[str, Any]:
    spec = stream.spec
    found: dict[str, Any] = {"id": stream.stream_id, "name": stream.name}
    match spec:
        case TopicSpec():
            found |= {
                "kind": "topic",
                "type": spec.type_name,
                "publishers": spec.publishers,
                "subscribers": spec.subscribers,
                "wildcards": [
                    {"name": each.name, "values": each.values} for each in stream.keys.wildcards
                ],
                "reliability": spec.qos.reliability.value,
                "depth": spec.qos.depth,
                "forward": spec.qos.forward.value,
            }
            if spec.carry is not None:
                found["custodians"] = spec.carry.by
        case ServiceSpec():
            found |= {
                "kind": "service",
                "request": spec.request_type,
                "response": spec.response_type,
                "server": spec.server if spec.server != EVERY_NODE else "every node",
                "timeout_s": spec.timeout_s,
            }
        case ActionSpec():
            found |= {
                "kind": "action",
                "goal": spec.goal_type,
                "feedback": spec.feedback_type,
                "result": spec.result_type,
                "server": spec.server,
                "timeout_s": spec.timeout_s,
                "result_timeout_s": spec.result_timeout_s,
            }
    found |= {"codec": spec.codec, "encoding": stream.encoding, "stamp": spec.qos.stamp.value}
    found["description"] = msgspec.json.encode(stream._description()).decode()
    found["digest"] = stream.digest.hex()
    return found


def _types(stream: Stream) -> list[TypeSpec]:
    return [each for each in (stream.type, stream.response_type) if each is not None]


def fields_of(each: TypeSpec) -> dict[str, Any]:
    """Return a type with what is stated of its fields, and its description."""
    plain = FieldSpec(name="plain", type="bool")
    fields = []
    for field in each.fields:
        stated = msgspec.to_builtins(field)
        default = msgspec.to_builtins(plain)
        fields.append(
            {
                key: value
                for key, value in stated.items()
                if key in ("name", "type") or value != default[key]
            }
        )
    return {"name": each.name, "fields": fields, "description": each.canonical().decode()}


def text() -> str:
    """Return the file, one stream or field a line."""
    return lines(as_json()) + "\n"


def lines(value: object, indent: str = "") -> str:
    """Return JSON with a line for each innermost list or object."""
    flat = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(flat) <= 100 or not isinstance(value, dict | list):
        return flat
    inner = indent + " "
    if isinstance(value, dict):
        parts = [
            f"{inner}{json.dumps(key, ensure_ascii=False)}: {lines(each, inner)}"
            for key, each in value.items()
        ]
        return "{\n" + ",\n".join(parts) + f"\n{indent}}}"
    return "[\n" + ",\n".join(inner + lines(each, inner) for each in value) + f"\n{indent}]"


if __name__ == "__main__":
    TABLES_FILE.write_text(text(), encoding="utf-8")
