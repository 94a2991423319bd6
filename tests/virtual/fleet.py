"""A fleet whose tables differ, with an oracle that knows what every sample was.

Each stream of a fleet exists in *variants*: another type under the same id, another name, other
bounds, another stamp, no such stream. A table takes one variant of each. Every value that is
published carries a *ticket*, a number under which `Oracle` remembers who published what, by which
name and type; a value that was decoded by another variant shows another ticket, another name, or
another value.
"""

import itertools
import random
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec

from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.engine import Engine
from zacoustic.core.events import (
    CallFailed,
    CallFailure,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
    StreamsDiffer,
)
from zacoustic.core.keys import Instance, Wildcard
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.qos import Priority, Qos, Stamp
from zacoustic.core.streams import ServiceSpec, StreamSpec, StreamTable, TopicSpec
from zacoustic.core.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

TICKETS: Final = 30_000


def line(*positions_m: float, **settings: Any) -> Scenario:
    """Return a scenario with nodes 1, 2, … on a line to the east, at these positions, m."""
    nodes = [
        {"address": index + 1, "position": [position, 0, 10]}
        for index, position in enumerate(positions_m)
    ]
    return scenario_from_mapping({"nodes": nodes, **settings}, source="test")


_FINE: Final = TypeSpec(
    name="Fine", fields=(FieldSpec(name="ticket", type="uint16", range=(0, 60_000)),)
)
_COARSE: Final = TypeSpec(
    name="Coarse", fields=(FieldSpec(name="ticket", type="uint32", range=(0, 120_000), step=2),)
)
_BOUNDED: Final = TypeSpec(
    name="Fine", fields=(FieldSpec(name="ticket", type="uint16", range=(0, 40_000)),)
)
_SIGNED: Final = TypeSpec(name="Signed", fields=(FieldSpec(name="number", type="int32"),))


class Shape(msgspec.Struct, frozen=True):
    """How a ticket becomes a value and how it is read back."""

    type_spec: TypeSpec | None
    write: Callable[[int], Any]
    read: Callable[[Any], int]


OPAQUE: Final = Shape(
    None, lambda ticket: ticket.to_bytes(2, "big"), lambda value: int.from_bytes(value, "big")
)
FINE: Final = Shape(_FINE, lambda ticket: {"ticket": ticket}, lambda value: int(value["ticket"]))
COARSE: Final = Shape(
    _COARSE, lambda ticket: {"ticket": 2 * ticket}, lambda value: int(value["ticket"]) // 2
)
BOUNDED: Final = Shape(
    _BOUNDED, lambda ticket: {"ticket": ticket}, lambda value: int(value["ticket"])
)
SIGNED: Final = Shape(
    _SIGNED, lambda ticket: {"number": -ticket}, lambda value: -int(value["number"])
)


class Variant(msgspec.Struct, frozen=True):
    """One way to define a stream."""

    spec: StreamSpec
    shape: Shape
    response: Shape = OPAQUE


def _topic(stream_id: int, name: str, shape: Shape, **settings: Any) -> Variant:
    type_name = shape.type_spec.name if shape.type_spec else None
    settings.setdefault("qos", Qos(depth=3))
    return Variant(
        TopicSpec(stream_id=stream_id, name=name, type_name=type_name, **settings), shape
    )


def _service(stream_id: int, name: str, request: Shape, response: Shape, server: int) -> Variant:
    spec = ServiceSpec(
        stream_id=stream_id,
        name=name,
        server=server,
        request_type=request.type_spec.name if request.type_spec else None,
        response_type=response.type_spec.name if response.type_spec else None,
        timeout_s=20,
        qos=Qos(priority=Priority.INTERACTIVE_HIGH),
    )
    return Variant(spec, request, response)


def _wildcard(*values: str) -> tuple[Wildcard, ...]:
    return (Wildcard(name="k", values=values),)


AGREED: Final = 5
"""The stream that every table has in the same way, and that carries bytes."""
CALLS: Final = 6

VARIANTS: Final[dict[int, tuple[Variant | None, ...]]] = {
    1: (
        _topic(1, "depth", FINE),
        _topic(1, "depth", COARSE),
        _topic(1, "depth", BOUNDED),
        _topic(1, "depth", SIGNED),
        _topic(1, "depth", OPAQUE),
        _topic(1, "height", FINE),
        _topic(1, "depth", FINE, qos=Qos(depth=3, stamp=Stamp.AGE)),
        None,
    ),
    2: (
        _topic(2, "valve/{k}/state", FINE, wildcards=_wildcard("a", "b")),
        _topic(2, "valve/{k}/state", FINE, wildcards=_wildcard("b", "a")),
        _topic(2, "valve/state", FINE),
        _topic(2, "valve/{k}/state", OPAQUE, wildcards=_wildcard("a", "b")),
        None,
    ),
    3: (
        _topic(3, "fleet/status", OPAQUE),
        _topic(3, "status", OPAQUE),
        _topic(3, "status", SIGNED),
        _topic(3, "fleet/status", OPAQUE, publishers=(1, 2)),
    ),
    4: (
        _topic(4, "left", OPAQUE, qos=Qos(depth=3, stamp=Stamp.AGE)),
        _topic(4, "right", OPAQUE, qos=Qos(depth=3, stamp=Stamp.AGE)),
        _topic(4, "left", OPAQUE),
        _topic(4, "left", OPAQUE, subscribers=(1,), qos=Qos(depth=3, stamp=Stamp.AGE)),
        None,
    ),
    AGREED: (_topic(AGREED, "agreed", OPAQUE),),
    CALLS: (
        _service(CALLS, "arm", FINE, OPAQUE, 1),
        _service(CALLS, "arm", FINE, SIGNED, 1),
        _service(CALLS, "arm", COARSE, OPAQUE, 1),
        _service(CALLS, "disarm", FINE, OPAQUE, 1),
        _topic(CALLS, "arm", FINE),
        None,
    ),
}


class Choice(msgspec.Struct, frozen=True):
    """A table, and which variants it was made of."""

    table: StreamTable
    variants: dict[int, Variant]


def base_table(addresses: int) -> Choice:
    """Return the table of the first variants."""
    chosen = {stream_id: variants[0] for stream_id, variants in VARIANTS.items()}
    return _make(chosen, {address: f"n{address}" for address in range(1, addresses + 1)})


def random_table(rng: random.Random, addresses: int, *, change: float) -> Choice:
    """Draw a table: each stream is that of `base_table`, or with probability `change` another."""
    chosen = {
        stream_id: rng.choice(variants) if rng.random() < change else variants[0]
        for stream_id, variants in VARIANTS.items()
    }
    nodes = {address: f"n{address}" for address in range(1, addresses + 1)}
    if rng.random() < change:
        # A list that leaves out a node that is there breaks its promise; all others are fair.
        nodes = rng.choice([{}, nodes | {99: "absent"}, nodes | {1: "renamed"}])
    return _make(chosen, nodes)


def _make(chosen: dict[int, Variant | None], nodes: dict[int, str]) -> Choice:
    variants = {stream_id: variant for stream_id, variant in chosen.items() if variant}
    types: dict[str, TypeSpec] = {}
    specs: list[StreamSpec] = []
    for stream_id, variant in sorted(variants.items()):
        for shape in (variant.shape, variant.response):
            if shape.type_spec is None:
                continue
            other = types.setdefault(shape.type_spec.name, shape.type_spec)
            if other is not shape.type_spec:
                # Two bounds under one type name cannot be in one table: the first one stays.
                renamed = FINE if other is _FINE else BOUNDED
                variant = msgspec.structs.replace(variant, shape=renamed)
        variants[stream_id] = variant
        specs.append(variant.spec)
    return Choice(StreamTable(specs, types=TypeTable(types.values()), nodes=nodes), variants)


class Published(msgspec.Struct, frozen=True):
    """What the oracle remembers of a sample, a request or a response."""

    source: int
    key: str
    stream_digest: bytes
    value: Any
    at: int


class Oracle:
    """Knows every ticket, and complains about what nobody published so."""

    def __init__(self) -> None:
        self.wrong: list[str] = []
        self.delivered: list[tuple[int, int, int, int]] = []
        """``(at, node, source, stream)`` of the samples that were right."""
        self.answered = 0
        self.executed: set[tuple[int, int]] = set()
        self.differing: set[tuple[int, int, int]] = set()
        """``(node, peer, stream)`` of the reported differences."""
        self._tickets: dict[int, Published] = {}
        self._next = 1

    def ticket(self, published: Callable[[int], Published]) -> int:
        """Remember something under a new ticket."""
        ticket = self._next
        self._next = self._next % TICKETS + 1
        self._tickets[ticket] = published(ticket)
        return ticket

    def published(self, ticket: int) -> Published | None:
        """Return what has that ticket, or None."""
        return self._tickets.get(ticket)

    def judge(self, node: int, choice: Choice, event: SampleReceived, now: int) -> None:
        """Check a sample that arrived."""
        variant = choice.variants[event.stream_id]
        stream = choice.table.by_id(event.stream_id)
        key = stream.keys.key(event.source, event.instance)
        try:
            known = self.published(variant.shape.read(event.value))
        except (KeyError, TypeError, ValueError) as error:
            known = None
            self.wrong.append(f"{error!r}")
        if (
            known is None
            or (known.source, known.key, known.value) != (event.source, key, event.value)
            or known.stream_digest != stream.digest
        ):
            self.wrong.append(f"{now / NS_PER_S:.3f} s: node {node} got {key} {event}: {known}")
        else:
            self.delivered.append((now, node, event.source, event.stream_id))


class Trial:
    """One random story of a fleet: faults for a while, then calm.

    Args:
        seed: Everything follows from it.
        nodes: How many, 2…4.
        mtu_bytes: Room for records in a frame, bytes.
        modem: What the modems lack.
        repeat: Share of the frames that arrive again, up to the settling time later.
        fault_s: How long there are losses, repetitions, restarts and outages.
        calm_s: How long there are none afterwards.
        change: How much tables differ.
        corrupt: Share of the frames that arrive damaged; for modems that do not check.
        most_restarts: Restarts of each node at most.
    """

    def __init__(
        self,
        seed: int,
        *,
        nodes: int = 2,
        mtu_bytes: int = 64,
        modem: Modem | None = None,
        repeat: float = 0.0,
        fault_s: float = 120.0,
        calm_s: float = 1500.0,
        change: float = 0.4,
        corrupt: float = 0.0,
        most_restarts: int = 3,
    ) -> None:
        self.rng = rng = random.Random(seed)
        self.fault_s = fault_s
        self.calm_s = calm_s
        self.nodes = nodes
        self.change = change
        self.oracle = Oracle()
        self._repeat = repeat
        self._most_restarts = most_restarts
        self._calls: dict[tuple[int, int], tuple[int, Choice]] = {}
        self._pool = [base_table(nodes)] + [
            random_table(rng, nodes, change=change) for _ in range(2)
        ]
        self.choices = {address: rng.choice(self._pool) for address in range(1, nodes + 1)}
        positions = [0.0] + [rng.uniform(100, 900) for _ in range(nodes - 1)]
        self._loss = {
            (source, node): rng.choice([0.0, 0.1, 0.3, 0.6])
            for source in range(1, nodes + 1)
            for node in range(1, nodes + 1)
        }
        modem = modem or Modem()
        overhead = 2 * (not modem.addressed) + 4 * (not modem.checked) + 3 * (not modem.framed)
        self.network = VirtualNetwork(
            line(*positions, seed=seed, channel="none", faults={"corrupt": corrupt}),
            {address: choice.table for address, choice in self.choices.items()},
            modem=msgspec.structs.replace(modem, mtu_bytes=min(64, mtu_bytes + overhead)),
            deliver=self._deliver,
            disturb=self._disturb,
        )
        self._settling_s = settling_s(self.network.engine(1).capabilities)

    def run(self) -> None:
        """Tell the story."""
        network, rng = self.network, self.rng
        for address in self.choices:
            for stream_id in VARIANTS:
                self._go_on(address, stream_id, 0.0)
            for _ in range(rng.randint(0, self._most_restarts)):
                network.at(rng.uniform(0, self.fault_s), partial(self._restart, address))
            if rng.random() < 0.3:
                begin_s = rng.uniform(0, self.fault_s)
                network.at(begin_s, partial(network.set_link, address, up=False))
                network.at(
                    min(self.fault_s, begin_s + rng.uniform(1, 40)),
                    partial(network.set_link, address, up=True),
                )
        network.run(until_s=self.fault_s + self.calm_s)

    def agree(self, one: int, other: int, stream_id: int) -> bool:
        """Tell whether two nodes define a stream in the same way."""
        tables = [self.choices[address].table.get(stream_id) for address in (one, other)]
        first, second = tables
        return first is not None and second is not None and first.digest == second.digest

    def missing(self) -> list[str]:
        """Return what is wrong at the end: what agrees and is silent, what differs and is not."""
        lately = self.delivered_after(self.fault_s + self.calm_s - 700)
        complaints: list[str] = []
        for node, source in itertools.permutations(self.choices, 2):
            for stream_id, variant in self.choices[source].variants.items():
                spec = variant.spec
                if isinstance(spec, ServiceSpec) or not self._reaches(spec, source, node):
                    continue
                here = self.choices[node].table.get(stream_id)
                lane = (node, source, stream_id)
                if self.agree(node, source, stream_id):
                    listens = here is not None and here.may_subscribe(node)
                    if listens and lane not in lately:
                        complaints.append(f"agreed stream is silent: {lane}")
                elif lane in lately:
                    complaints.append(f"differing stream is delivered: {lane}")
                elif lane not in self.oracle.differing:
                    complaints.append(f"difference is not reported: {lane}")
        return complaints

    @staticmethod
    def _reaches(spec: TopicSpec, source: int, node: int) -> bool:
        """Tell whether samples of `source` are sent where `node` can hear them."""
        if spec.publishers is not None and source not in spec.publishers:
            return False
        others = [address for address in spec.subscribers or () if address != source]
        return len(others) != 1 or node in others

    def delivered_after(self, instant_s: float) -> set[tuple[int, int, int]]:
        """Return ``(node, source, stream)`` of what was delivered after an instant."""
        after = seconds_to_ns(instant_s)
        return {
            (node, source, stream_id)
            for at, node, source, stream_id in self.oracle.delivered
            if at >= after
        }

    def _restart(self, address: int) -> None:
        self.choices[address] = self.rng.choice(self._pool)
        self._calls = {key: call for key, call in self._calls.items() if key[0] != address}
        self.network.restart(address, self.choices[address].table)

    def _disturb(self, source: int, node: int, now: int) -> list[float]:
        if now >= seconds_to_ns(self.fault_s):
            return [0.0]
        delays_s = [] if self.rng.random() < self._loss[source, node] else [0.0]
        if self.rng.random() < self._repeat:
            delays_s.append(self.rng.uniform(0, self._settling_s))
        return delays_s

    def _go_on(self, address: int, stream_id: int, now_s: float) -> None:
        """Act on a stream at a random instant, and again, less often when calm."""
        longest_s = 30.0 if now_s < self.fault_s else 60.0 * self.nodes

        def act() -> None:
            self._act(address, stream_id)
            self._go_on(address, stream_id, self.network.now / NS_PER_S)

        self.network.at(now_s + self.rng.uniform(1, longest_s), act)

    def _act(self, address: int, stream_id: int) -> None:
        """Publish or call, if the node's table has the stream for it."""
        choice = self.choices[address]
        variant = choice.variants.get(stream_id)
        if variant is None:
            return
        stream = choice.table.by_id(stream_id)
        if isinstance(variant.spec, ServiceSpec):
            if variant.spec.server != address:
                self._call(address, stream_id, choice, variant)
            return
        if not stream.may_publish(address):
            return
        instance: Instance = tuple(
            self.rng.randrange(len(wildcard.values)) for wildcard in stream.keys.wildcards
        )
        key = stream.keys.key(address, instance)
        ticket = self.oracle.ticket(
            lambda number: Published(
                address, key, stream.digest, variant.shape.write(number), self.network.now
            )
        )
        self.network.publish(address, stream_id, variant.shape.write(ticket), instance=instance)

    def _call(self, address: int, stream_id: int, choice: Choice, variant: Variant) -> None:
        stream = choice.table.by_id(stream_id)
        ticket = self.oracle.ticket(
            lambda number: Published(
                address, stream.name, stream.digest, variant.shape.write(number), self.network.now
            )
        )
        value = variant.shape.write(ticket)
        call_id = self.network.apply(
            address, lambda engine, now: engine.call(stream_id, value, now)
        )
        self._calls[address, call_id] = (ticket, choice)

    def _deliver(self, node: int, event: Event) -> None:
        choice = self.choices[node]
        if isinstance(event, SampleReceived):
            self.oracle.judge(node, choice, event, self.network.now)
        elif isinstance(event, StreamsDiffer):
            self.oracle.differing.add((node, event.address, event.stream_id))
        elif isinstance(event, RequestReceived):
            self._serve(node, choice, event)
        elif isinstance(event, ResponseReceived):
            ticket, asked_by = self._calls.pop((node, event.call_id))
            shape = asked_by.variants[event.stream_id].response
            if shape.read(event.value) != ticket:
                self.oracle.wrong.append(f"call {event.call_id} of ticket {ticket}: {event}")
            self.oracle.answered += 1
        elif isinstance(event, CallFailed):
            if event.failure in (CallFailure.BAD_REQUEST, CallFailure.BAD_RESPONSE):
                self.oracle.wrong.append(f"a call was misunderstood: {event}")
            self._calls.pop((node, event.call_id), None)

    def _serve(self, node: int, choice: Choice, event: RequestReceived) -> None:
        """Answer with the ticket of the request, a little later."""
        variant = choice.variants[event.call.stream_id]
        stream = choice.table.by_id(event.call.stream_id)
        ticket = variant.shape.read(event.value)
        known = self.oracle.published(ticket)
        found = (event.call.client, stream.name, stream.digest, event.value)
        if known is None or found != (
            known.source,
            known.key,
            known.stream_digest,
            known.value,
        ):
            self.oracle.wrong.append(f"request {event}: {known}")
        life = (ticket, self.network.engine(node).epoch)
        if life in self.oracle.executed:
            self.oracle.wrong.append(f"a second time: {event}")
        self.oracle.executed.add(life)
        epoch = self.network.engine(node).epoch

        def answer() -> None:
            if self.network.engine(node).epoch == epoch:
                value = variant.response.write(ticket)

                def reply(engine: Engine, now: int) -> bool:
                    return engine.reply(event.call, value, now)

                self.network.apply(node, reply)

        after_s = self.rng.uniform(0, 10)
        self.network.at(self.network.now / NS_PER_S + after_s, answer)


def settling_s(capabilities: LinkCapabilities | None) -> float:
    """Return the time within which a link may repeat a frame, s: four of its longest frames."""
    assert capabilities is not None
    airtime_s = capabilities.airtime_ns(capabilities.mtu_bytes) / NS_PER_S
    return 4 * (airtime_s + capabilities.propagation_s)
