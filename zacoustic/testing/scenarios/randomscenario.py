"""A random scenario: the channel, its faults, and a fleet with traffic."""

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec

from zacoustic.channel.scenario import Scenario
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.testing.virtualmodems import Modem

TICKETS: Final = 1 << 24
"""Tickets are below this, three bytes; a shape may allow fewer."""


class Shape(msgspec.Struct, frozen=True):
    """Turns a ticket into a value and back."""

    type_spec: TypeSpec | None
    """Type of the value; None: opaque bytes."""
    write: Callable[[int], Any]
    """Makes a value from a ticket, the same each time."""
    read: Callable[[Any], int]
    """Returns the ticket in a value; raises KeyError, TypeError or ValueError for a foreign one."""
    tickets: int = TICKETS
    """Number of tickets that it can carry."""


class Lane(msgspec.Struct, frozen=True):
    """A stream and the shape of its payloads."""

    spec: StreamSpec
    """The stream."""
    shape: Shape
    """Samples or requests."""
    response: Shape | None = None
    """Responses; None for a topic."""


class Cast(msgspec.Struct, frozen=True):
    """The table of a node, and the lanes of which it consists."""

    table: StreamTable
    """The table."""
    lanes: dict[int, Lane]
    """By stream id."""


class RandomScenario(msgspec.Struct, frozen=True, kw_only=True):
    """A random scenario, from which a run follows."""

    seed: int
    """Every draw follows from it."""
    scenario: Scenario
    """The channel and its faults."""
    casts: dict[int, Cast]
    """The table of each node."""
    pool: tuple[Cast, ...] = ()
    """Tables, one of which a node takes when it starts again; empty: it keeps its table."""
    modem: Modem = Modem()
    """Features of the modems."""
    busy_s: float
    """How long the nodes send every `pause_s`, and faults happen, s."""
    calm_s: float
    """How long the run goes on afterwards, s."""
    pause_s: float = 30.0
    """Longest time between two samples of a node on a stream, s."""
    beat_s: float | None = None
    """Time between two samples of a node on a stream, except for one in twenty, s; None: any time
    up to `pause_s`."""
    calm_pause_s: float | None = None
    """The same in the calm, s; None: no more samples."""

    @property
    def until_s(self) -> float:
        """Its end, s."""
        return self.busy_s + self.calm_s


def cast_of(lanes: Mapping[int, Lane], nodes: Mapping[int, str]) -> Cast:
    """Return the cast of these lanes.

    Raises:
        ConfigError: The lanes contradict each other.
    """
    types: dict[str, TypeSpec] = {}
    for lane in lanes.values():
        for shape in (lane.shape, lane.response):
            if shape is not None and shape.type_spec is not None:
                types[shape.type_spec.name] = shape.type_spec
    specs = [lane.spec for _, lane in sorted(lanes.items())]
    return Cast(StreamTable(specs, types=TypeTable(types.values()), nodes=nodes), dict(lanes))


def opaque(size_bytes: int) -> Shape:
    """Return opaque payloads of one size, ≥ 3 bytes, that follow from their tickets."""

    def write(ticket: int) -> bytes:
        filler = bytes((ticket * 31 + index * 17) & 0xFF for index in range(size_bytes - 3))
        return ticket.to_bytes(3, "big") + filler

    return Shape(None, write, lambda value: int.from_bytes(value[:3], "big"))


def typed(name: str, *, text: int = 0) -> Shape:
    """Return values of a type with the ticket, a depth that follows from it, maybe a text."""
    fields = [
        FieldSpec(name="ticket", type="uint32", range=(0, TICKETS)),
        FieldSpec(name="depth", type="float64", range=(0, 1000), step=0.5),
    ]
    if text:
        fields.append(FieldSpec(name="note", type="string", max_length=text))

    def write(ticket: int) -> dict[str, Any]:
        value: dict[str, Any] = {"ticket": ticket, "depth": ticket % 2000 / 2}
        if text:
            value["note"] = f"{ticket:x}"[:text]
        return value

    return Shape(TypeSpec(name=name, fields=tuple(fields)), write, lambda value: value["ticket"])
