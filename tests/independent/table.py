"""What both ends know of the streams. Written from docs/wire.md alone.

The page says what a table holds, not how it is written: these classes are this reader's own.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from tests.independent.errors import ReadError

INTEGERS = {
    f"{sign}int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
"""Least and greatest value of each type of integer."""


@dataclass(frozen=True)
class Field:
    """One field of a type."""

    name: str
    type: str
    range: tuple[float, float] | None = None
    step: float | None = None
    wraps: bool = False
    escapes: bool = False
    values: tuple[str, ...] = ()
    length: int | None = None
    max_length: int | None = None
    optional: bool = False
    min_length: int = 0
    nan: bool = False
    is_finite: bool = False
    """It stands behind the bit, or in the column, that says that there is a value."""

    @property
    def is_array(self) -> bool:
        """Tell whether it is one; a string with a `max_length` is a string of bounded length."""
        if self.type in ("string", "bytes"):
            return self.length is not None
        return self.length is not None or self.max_length is not None


Types = Mapping[str, tuple[Field, ...]]
"""The fields of each type by its name."""


@dataclass(frozen=True)
class Wildcard:
    """A wildcard of a name, with its list of values."""

    name: str
    values: tuple[str, ...]


@dataclass(frozen=True)
class Topic:
    """A stream of samples."""

    id: int
    name: str
    type: str | None = None
    codec: str = "cbor"
    wildcards: tuple[Wildcard, ...] = ()
    reliable: bool = False
    depth: int = 1
    aged: bool = False
    publishers: tuple[int, ...] = ()
    subscribers: tuple[int, ...] = ()
    on_demand: bool = False
    encoding: str | None = None
    custodians: tuple[int, ...] = ()


@dataclass(frozen=True)
class Service:
    """A stream of calls. `server`: None for the streams that every node serves."""

    id: int
    name: str
    server: int | None
    request: str | None = None
    response: str | None = None
    timeout_s: float = 30.0
    aged: bool = False
    codec: str = "cbor"
    encoding: str | None = None


@dataclass(frozen=True)
class Action:
    """A stream of goals."""

    id: int
    name: str
    server: int
    goal: str | None = None
    result: str | None = None
    feedback: str | None = None
    timeout_s: float = 60.0
    result_timeout_s: float = 3600.0
    codec: str = "cbor"
    encoding: str | None = None


Stream = Topic | Service | Action

PRIORITIES = (
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
)

_YEAR_S = 31_622_400
_STATE = (
    Field("on", "bool", optional=True),
    Field("min_interval_s", "float64", range=(0, 86400), step=0.01, optional=True),
    Field("priority", "enum", values=PRIORITIES, optional=True),
)

SYSTEM_TYPES: Types = {
    "command": (
        Field("serial", "uint16"),
        Field("order", "enum", values=("ask", "silence", "resume", "tune", "reset")),
        Field("for_s", "float64", range=(0, _YEAR_S), step=0.1, optional=True),
        Field("stream", "uint8", optional=True),
        *_STATE,
        Field("heard", "uint16", optional=True),
    ),
    "command answer": (
        Field("silent", "bool"),
        Field("ordered", "bool"),
        Field("left_s", "float64", range=(0, _YEAR_S), step=0.1, optional=True),
        *_STATE,
    ),
    "status": (
        Field("journal", "enum", values=("none", "kept", "doubted", "failing")),
        Field("starts", "uint16"),
        Field("utc_s", "uint32", optional=True),
        Field("clock_error_s", "float64", range=(0, 3600), step=0.01, optional=True),
        Field("range_m", "uint16", optional=True),
        Field("schedule", "uint16"),
    ),
}
"""Section 5, Remote commands and Status."""

COMMANDS = Service(0xAF, "orders", None, "command", "command answer", 600, aged=True)
STATUS = Service(0xAE, "status", None, None, "status", 60, aged=True)
KEYS = Service(0xAD, "keys", None, None, None, 600)
ROUTING = Service(0xAC, "routing", None, None, None, 600)
CARRIED = Topic(
    0xAB, "{node}/carried/{to}", None, "cbor", (Wildcard("to", tuple(map(str, range(255)))),),
    reliable=True, depth=4096,
)  # fmt: skip
"""The stream of section 18, of tables with a carried topic and a list of nodes."""
EVERYWHERE = (ROUTING, KEYS, STATUS, COMMANDS)
"""The streams that every table has, unless it gives their ids to others."""


@dataclass(frozen=True)
class Table:
    """The streams, the types and the nodes of a fleet."""

    streams: Mapping[int, Stream]
    types: Types = field(default_factory=dict)
    nodes: Mapping[int, str] = field(default_factory=dict)

    def stream(self, stream_id: int) -> Stream:
        known = self.streams.get(stream_id)
        if known is not None:
            return known
        for system in EVERYWHERE:
            if system.id == stream_id:
                return system
        if stream_id == CARRIED.id and self.carries:
            return CARRIED
        raise ReadError(f"no stream {stream_id:#04x}")

    @property
    def carries(self) -> bool:
        """Tell whether a topic is carried."""
        return any(isinstance(one, Topic) and one.custodians for one in self.streams.values())

    def fields(self, type_name: str) -> tuple[Field, ...]:
        found = self.types.get(type_name, SYSTEM_TYPES.get(type_name))
        if found is None:
            raise ReadError(f"no type {type_name}")
        return found

    @property
    def all_types(self) -> Types:
        return {**SYSTEM_TYPES, **self.types}


def field_of(plain: Mapping[str, Any]) -> Field:
    """Read a field as the vectors spell it."""
    bounds = plain.get("range")
    return Field(
        name=plain["name"],
        type=plain["type"],
        range=None if bounds is None else (bounds[0], bounds[1]),
        step=plain.get("step"),
        wraps=plain.get("wraps", False),
        escapes=plain.get("outside") == "escape",
        values=tuple(plain.get("values", ())),
        length=plain.get("length"),
        max_length=plain.get("max_length"),
        optional=plain.get("optional", False),
        min_length=plain.get("min_length") or 0,
        nan=plain.get("nan", False),
    )


def types_of(plain: list[Mapping[str, Any]]) -> Types:
    """Read types as the vectors spell them."""
    return {one["name"]: tuple(field_of(each) for each in one["fields"]) for one in plain}


def stream_of(plain: Mapping[str, Any]) -> Stream:
    """Read a stream as `tables.json` spells it."""
    number, name, codec = plain["id"], plain["name"], plain["codec"]
    aged, encoding = plain["stamp"] == "age", plain["encoding"]
    if plain["kind"] == "topic":
        return Topic(
            number,
            name,
            plain["type"],
            codec,
            tuple(Wildcard(one["name"], tuple(one["values"])) for one in plain["wildcards"]),
            plain["reliability"] == "reliable",
            plain["depth"],
            aged,
            tuple(plain["publishers"] or ()),
            tuple(plain["subscribers"] or ()),
            plain["forward"] == "on_demand",
            encoding,
            tuple(plain.get("custodians", ())),
        )
    server, timeout_s = plain["server"], plain["timeout_s"]
    if plain["kind"] == "service":
        every = server == "every node"
        types = plain["request"], plain["response"]
        return Service(
            number, name, None if every else server, *types, timeout_s, aged, codec, encoding
        )
    kinds = plain["goal"], plain["result"], plain["feedback"]
    return Action(
        number, name, server, *kinds, timeout_s, plain["result_timeout_s"], codec, encoding
    )


def table_of(plain: Mapping[str, Any]) -> Table:
    """Read a table as `tables.json` spells it."""
    streams = [stream_of(one) for one in plain["streams"]]
    nodes = {int(address): name for address, name in plain["nodes"].items()}
    return Table({one.id: one for one in streams}, types_of(plain["types"]), nodes)
