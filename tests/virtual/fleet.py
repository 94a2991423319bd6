"""A fleet whose tables differ, and random scenarios of it.

Each stream of a fleet exists in *variants*: another type under the same id, another name, other
bounds, another stamp, no such stream. A table takes one variant of each. The scenarios are those of
`zacoustic.testing.scenarios`: every value that is published carries a ticket, so one that was
decoded by another variant shows another ticket, another name, or another value.
"""

import itertools
import random
from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, Final

import msgspec

from zacoustic.channel.profiles import profile_named
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Stamp
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, StreamsDiffer
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.testing.scenarios.checker import Arrived, Checker
from zacoustic.testing.scenarios.invariants import OncePerCall
from zacoustic.testing.scenarios.randomscenario import Cast, Lane, RandomScenario, Shape, cast_of
from zacoustic.testing.scenarios.running import ScenarioRun, settling_ns
from zacoustic.testing.virtual import Modem

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


OPAQUE: Final = Shape(
    None,
    lambda ticket: ticket.to_bytes(2, "big"),
    lambda value: int.from_bytes(value, "big"),
    TICKETS,
)
FINE: Final = Shape(
    _FINE, lambda ticket: {"ticket": ticket}, lambda value: int(value["ticket"]), TICKETS
)
COARSE: Final = Shape(
    _COARSE,
    lambda ticket: {"ticket": 2 * ticket},
    lambda value: int(value["ticket"]) // 2,
    TICKETS,
)
BOUNDED: Final = Shape(
    _BOUNDED, lambda ticket: {"ticket": ticket}, lambda value: int(value["ticket"]), TICKETS
)
SIGNED: Final = Shape(
    _SIGNED, lambda ticket: {"number": -ticket}, lambda value: -int(value["number"]), TICKETS
)


def _topic(stream_id: int, name: str, shape: Shape, **settings: Any) -> Lane:
    type_name = shape.type_spec.name if shape.type_spec else None
    settings.setdefault("qos", Qos(depth=3))
    return Lane(TopicSpec(stream_id=stream_id, name=name, type_name=type_name, **settings), shape)


def _service(stream_id: int, name: str, request: Shape, response: Shape, server: int) -> Lane:
    spec = ServiceSpec(
        stream_id=stream_id,
        name=name,
        server=server,
        request_type=request.type_spec.name if request.type_spec else None,
        response_type=response.type_spec.name if response.type_spec else None,
        timeout_s=20,
        qos=Qos(priority=Priority.INTERACTIVE_HIGH),
    )
    return Lane(spec, request, response)


def _wildcard(*values: str) -> tuple[Wildcard, ...]:
    return (Wildcard(name="k", values=values),)


AGREED: Final = 5
"""The stream that every table has in the same way, and that carries bytes."""
CALLS: Final = 6
DENSE: Final = 7

VARIANTS: Final[dict[int, tuple[Lane | None, ...]]] = {
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
    DENSE: (
        _topic(DENSE, "speed", FINE, codec="dense"),
        _topic(DENSE, "speed", BOUNDED, codec="dense"),
        _topic(DENSE, "speed", FINE, codec="dense", qos=Qos(depth=3, stamp=Stamp.AGE)),
        _topic(DENSE, "speed", FINE),
        None,
    ),
    CALLS: (
        _service(CALLS, "arm", FINE, OPAQUE, 1),
        _service(CALLS, "arm", FINE, SIGNED, 1),
        _service(CALLS, "arm", COARSE, OPAQUE, 1),
        _service(CALLS, "disarm", FINE, OPAQUE, 1),
        _topic(CALLS, "arm", FINE),
        None,
    ),
}


def base_table(addresses: int) -> Cast:
    """Return the table of the first variants."""
    chosen = {stream_id: variants[0] for stream_id, variants in VARIANTS.items()}
    return _make(chosen, {address: f"n{address}" for address in range(1, addresses + 1)})


def random_table(rng: random.Random, addresses: int, *, change: float) -> Cast:
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


def _make(chosen: dict[int, Lane | None], nodes: dict[int, str]) -> Cast:
    lanes = {stream_id: lane for stream_id, lane in chosen.items() if lane}
    fine = next((lane.shape for lane in lanes.values() if _names(lane, "Fine")), None)
    for stream_id, lane in lanes.items():
        if fine is not None and _names(lane, "Fine"):
            # Two bounds under one type name cannot be in one table: the first one stays.
            lanes[stream_id] = msgspec.structs.replace(lane, shape=fine)
    return cast_of(lanes, nodes)


def _names(lane: Lane, type_name: str) -> bool:
    return lane.shape.type_spec is not None and lane.shape.type_spec.name == type_name


class Differences(Checker):
    """Remembers what was delivered, and which differences were reported."""

    def __init__(self) -> None:
        super().__init__()
        self.delivered: list[tuple[int, int, int, int]] = []
        """``(at, node, source, stream)`` of the samples that were right."""
        self.reported: set[tuple[int, int, int]] = set()
        """``(node, peer, stream)`` of the reported differences."""

    def received(self, arrived: Arrived) -> None:
        publication = arrived.publication
        lane = (arrived.node, publication.node, publication.stream.stream_id)
        self.delivered.append((arrived.at, *lane))

    def happened(self, node: int, event: Event, at: int) -> None:
        if isinstance(event, StreamsDiffer):
            self.reported.add((node, event.address, event.stream_id))


_LATELY_PAUSES: Final = 7
"""A stream is silent if nothing came in so many of its mean pauses: without carrier sense one
sample in six is lost to a collision, and of 2,000 scenarios one lost three in a row."""


class Trial:
    """One random scenario of a fleet: faults for a while, then calm.

    Args:
        seed: Everything follows from it.
        nodes: How many, 2…4.
        mtu_bytes: Room for records in a frame, bytes.
        modem: What the modems lack.
        repeat: Share of the frames that arrive again, up to the settling time later.
        fault_s: How long there are losses, repetitions, restarts and outages.
        calm_s: How long there are none afterwards.
        change: How much tables differ.
        corrupt: Share of the frames that arrive damaged, to the end; for modems that do not check.
        most_restarts: Restarts of each node at most.
        agreement: What of `AgreementMethod` nodes have, by address; a node without has the default.
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
        agreement: Mapping[int, AgreementMethod] = MappingProxyType({}),
    ) -> None:
        rng = random.Random(seed)
        self.end_s = fault_s + calm_s
        self._pause_s = 60.0 * nodes
        pool = (base_table(nodes), *(random_table(rng, nodes, change=change) for _ in range(2)))
        modem = modem or Modem()
        overhead = 2 * (not modem.addressed) + 4 * (not modem.checked) + 3 * (not modem.framed)
        modem = msgspec.structs.replace(modem, mtu_bytes=min(64, mtu_bytes + overhead))
        drawn = RandomScenario(
            seed=seed,
            scenario=_weather(
                rng,
                seed,
                nodes,
                fault_s,
                modem=modem,
                repeat=repeat,
                corrupt=corrupt,
                most_restarts=most_restarts,
            ),
            casts={address: rng.choice(pool) for address in range(1, nodes + 1)},
            pool=pool,
            modem=modem,
            busy_s=fault_s,
            calm_s=calm_s,
            calm_pause_s=self._pause_s,
        )
        self._differences = Differences()
        self._scenario_run = ScenarioRun(
            drawn,
            [self._differences, OncePerCall()],
            digest=True,
            build=partial(_engine, agreement),
        )
        self.network = self._scenario_run.network

    def run(self) -> None:
        """Run the scenario."""
        self._scenario_run.run()

    @property
    def wrong(self) -> list[str]:
        """What was misread, or ran twice."""
        return self._scenario_run.violations()

    @property
    def delivered(self) -> list[tuple[int, int, int, int]]:
        """``(at, node, source, stream)`` of the samples that were right."""
        return self._differences.delivered

    def agree(self, one: int, other: int, stream_id: int) -> bool:
        """Tell whether two nodes define a stream in the same way."""
        casts = self._scenario_run.casts
        first, second = (casts[address].table.get(stream_id) for address in (one, other))
        return first is not None and second is not None and first.digest == second.digest

    def missing(self) -> list[str]:
        """Return what is wrong at the end: what agrees and is silent, what differs and is not."""
        lately = self.delivered_after(self.end_s - _LATELY_PAUSES * self._pause_s)
        violations: list[str] = []
        casts = self._scenario_run.casts
        for node, source in itertools.permutations(casts, 2):
            for stream_id, lane in casts[source].lanes.items():
                spec = lane.spec
                if not isinstance(spec, TopicSpec) or not self._reaches(spec, source, node):
                    continue
                here = casts[node].table.get(stream_id)
                way = (node, source, stream_id)
                if self.agree(node, source, stream_id):
                    listens = here is not None and here.may_subscribe(node)
                    if listens and way not in lately:
                        violations.append(f"agreed stream is silent: {way}")
                elif way in lately:
                    violations.append(f"differing stream is delivered: {way}")
                elif way not in self._differences.reported:
                    violations.append(f"difference is not reported: {way}")
        return violations

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
            for at, node, source, stream_id in self.delivered
            if at >= after
        }


def _engine(
    agreement: Mapping[int, AgreementMethod],
    *,
    address: int,
    rules: TransmitRules,
    **others: Any,
) -> Engine:
    """Make the engine of a node that agrees in its own way."""
    method = agreement.get(address, rules.agreement)
    rules = msgspec.structs.replace(rules, agreement=method)
    return Engine(address=address, rules=rules, **others)


def _weather(
    rng: random.Random,
    seed: int,
    nodes: int,
    fault_s: float,
    *,
    modem: Modem,
    repeat: float,
    corrupt: float,
    most_restarts: int,
) -> Scenario:
    """Draw what goes wrong."""
    positions = [0.0] + [rng.uniform(100, 900) for _ in range(nodes - 1)]
    calm = line(*positions, seed=seed, channel="none")
    capabilities = modem.capabilities(profile_named(calm.profile), calm.farthest_s)
    addresses = range(1, nodes + 1)
    loss = [
        {
            "from": source,
            "to": target,
            "loss": {"frame": rng.choice([0.0, 0.1, 0.3, 0.6]), "until_s": fault_s},
        }
        for source, target in itertools.permutations(addresses, 2)
    ]
    restarts = {
        address: [rng.uniform(0, fault_s) for _ in range(rng.randint(0, most_restarts))]
        for address in addresses
    }
    unplugged = []
    for address in addresses:
        if rng.random() < 0.3:
            begin_s = rng.uniform(0, fault_s - 1)
            end_s = min(fault_s, begin_s + rng.uniform(1, 40))
            unplugged.append({"node": address, "from_s": begin_s, "to_s": end_s})
    faults = {
        "corrupt": corrupt,
        "duplicate": repeat,
        "duplicate_after_s": [0, settling_s(capabilities)],
        "until_s": None if corrupt else fault_s,
        "unplugged": unplugged,
        "crashes": [
            {"node": address, "at_s": instants, "restart_after_s": 0}
            for address, instants in restarts.items()
            if instants
        ],
    }
    return line(*positions, seed=seed, channel="none", links=loss, faults=faults)


def settling_s(capabilities: LinkCapabilities | None) -> float:
    """Return the time within which a link may repeat a frame, s: four of its longest frames."""
    assert capabilities is not None
    return settling_ns(capabilities) / NS_PER_S
