"""`zacoustic sim`: a scenario with its traffic, in virtual time, and what came of it.

The nodes run the real engines with the stream table of the scenario's `config`. Each publication of
the scenario's `traffic` is remembered by its payload; a sample that arrives belongs to the newest
publication of the same payload before it, which is exact as long as a payload is not published
again while its predecessor is under way.
"""

import random
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.channel.traffic import TrafficSpec
from zacoustic.config import read_config
from zacoustic.core.clock import NS_PER_S, ns_to_seconds
from zacoustic.core.events import (
    CallFailed,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.stats import NO_STREAM
from zacoustic.core.streams import ServiceSpec, Stream, StreamTable, TopicSpec
from zacoustic.core.trace import TraceRecord
from zacoustic.errors import ConfigError, LocalError
from zacoustic.json5 import read_json5
from zacoustic.testing.virtual import VirtualNetwork

DEFAULT_UNTIL_S: Final = 3600.0
"""How long a scenario runs unless told otherwise, s of virtual time."""

_FIRST_OPAQUE_ID: Final = 1


class StreamResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one stream."""

    stream_id: int
    """The stream."""
    name: str
    """Its name."""
    published: int
    """Samples or calls that the traffic made."""
    delivered: int
    """Samples that arrived, at all subscribers together; calls that were answered."""
    failed: int
    """Calls that ended without an answer."""
    refused: int
    """Samples or calls that the engine did not take."""
    mean_s: float | None
    """Mean time from publication to arrival, or from call to answer, s."""
    p95_s: float | None
    """95th percentile of the same, s."""
    transmitted_bytes: int
    """Bytes given to the links for it."""
    airtime_share: float
    """Its share of the bytes of all streams, 0…1."""


class SimulationResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a scenario."""

    seed: int
    """The seed."""
    until_s: float
    """Length of the run, s of virtual time."""
    frames: int
    """Frames transmitted."""
    transmitted_bytes: int
    """Bytes given to the links."""
    airtime_s: float
    """Airtime of all frames, s."""
    losses: dict[str, int]
    """Arrivals that were lost, by outcome."""
    dropped: dict[str, int]
    """What engines dropped, by reason."""
    streams: tuple[StreamResult, ...]
    """By stream."""
    digest: str
    """SHA-256 of the trace: equal for equal runs."""


def simulate(
    path: str | Path,
    *,
    seed: int | None = None,
    until_s: float = DEFAULT_UNTIL_S,
    trace: Callable[[TraceRecord], None] | None = None,
) -> SimulationResult:
    """Run a scenario file.

    Args:
        path: The file, JSON5.
        seed: Replaces that of the file.
        until_s: How long, s of virtual time, > 0.
        trace: Takes each trace record.

    Raises:
        ConfigError: The scenario, its config or its traffic is wrong.
    """
    scenario = scenario_from_mapping(read_json5(path), source=str(path))
    if seed is not None:
        scenario = msgspec.structs.replace(scenario, seed=seed)
    if not scenario.traffic:
        raise ConfigError(
            f"{path}: traffic is empty; allowed: at least one entry",
            hint='add traffic: [ { node: 1, topic: "a/b", every_s: 10, size_bytes: 30 } ]',
        )
    run = _Run(scenario, _tables(scenario, Path(path)), source=str(path), trace=trace)
    run.network.run(until_s=until_s)
    return run.result(until_s)


class _Run:
    """One run of a scenario."""

    def __init__(
        self,
        scenario: Scenario,
        tables: dict[int, StreamTable],
        *,
        source: str,
        trace: Callable[[TraceRecord], None] | None,
    ) -> None:
        self.network = VirtualNetwork(scenario, tables, deliver=self._deliver, trace=trace)
        self._table = next(iter(tables.values()))
        self._rng = random.Random(scenario.seed)
        self._published: dict[tuple[int, int, bytes], int] = {}
        self._called: dict[tuple[int, int], int] = {}
        self._answers: dict[int, object] = {}
        self._tallies: dict[int, _Tally] = {}
        self._seed = scenario.seed
        for index, traffic in enumerate(scenario.traffic):
            self._begin(traffic, f"{source}: traffic[{index}]")

    def _begin(self, traffic: TrafficSpec, where: str) -> None:
        if traffic.node not in self.network.addresses:
            known = ", ".join(str(address) for address in self.network.addresses)
            raise ConfigError(f"{where}.node: {traffic.node}; allowed: {known}")
        found = self._table.find(traffic.topic or traffic.service or "", traffic.node)
        wanted = TopicSpec if traffic.topic else ServiceSpec
        if found is None or not isinstance(found[0].spec, wanted):
            key = "topic" if traffic.topic else "service"
            known = ", ".join(s.name for s in self._table if isinstance(s.spec, wanted)) or "none"
            raise ConfigError(
                f'{where}.{key}: "{traffic.topic or traffic.service}"; allowed: {known}'
            )
        stream, instance = found
        self._answers.setdefault(stream.stream_id, traffic.answer)

        def act() -> None:
            value = traffic.value
            if traffic.size_bytes is not None:
                value = self._rng.randbytes(traffic.size_bytes)
            if traffic.topic:
                self._publish(traffic.node, stream, instance, value)
            else:
                self._call(traffic.node, stream, value)

        def step() -> None:
            delay_s = self._rng.random() * traffic.jitter_s
            self.network.at(ns_to_seconds(self.network.now) + delay_s, act)

        self.network.every(traffic.every_s, step, first_s=traffic.first_s)

    def _publish(self, node: int, stream: Stream, instance: tuple[int, ...], value: object) -> None:
        tally = self._tally(stream)
        tally.published += 1
        try:
            self.network.publish(node, stream.stream_id, value, instance=instance)
        except LocalError:
            tally.refused += 1
            return
        self._published[(stream.stream_id, node, stream.codec.encode(value))] = self.network.now

    def _call(self, node: int, stream: Stream, value: object) -> None:
        tally = self._tally(stream)
        tally.published += 1
        try:
            call_id = self.network.apply(
                node, lambda engine, now: engine.call(stream.stream_id, value, now)
            )
        except LocalError:
            tally.refused += 1
            return
        self._called[(node, call_id)] = self.network.now

    def _deliver(self, address: int, event: Event) -> None:
        if isinstance(event, SampleReceived):
            stream = self._table.by_id(event.stream_id)
            key = (event.stream_id, event.source, stream.codec.encode(event.value))
            self._tally(stream).took_ns.append(self._since(self._published.get(key)))
        elif isinstance(event, RequestReceived):
            answer = self._answers.get(event.call.stream_id)
            self.network.apply(
                address,
                lambda engine, at: engine.reply(event.call, b"" if answer is None else answer, at),
            )
        elif isinstance(event, ResponseReceived | CallFailed):
            began_at = self._called.pop((address, event.call_id), None)
            tally = self._tally(self._table.by_id(event.stream_id))
            if isinstance(event, CallFailed):
                tally.failed += 1
            elif began_at is not None:
                tally.took_ns.append(self._since(began_at))

    def _since(self, began_at: int | None) -> int:
        now = self.network.now
        return 0 if began_at is None else now - began_at

    def _tally(self, stream: Stream) -> "_Tally":
        return self._tallies.setdefault(stream.stream_id, _Tally())

    def result(self, until_s: float) -> SimulationResult:
        """Sum up."""
        engines = [self.network.engine(address) for address in self.network.addresses]
        by_stream: dict[int, int] = {}
        dropped: dict[str, int] = {}
        for engine in engines:
            for entry in engine.stats.ledger():
                sum_bytes = by_stream.get(entry.stream_id, 0) + entry.transmitted_bytes
                by_stream[entry.stream_id] = sum_bytes
            for reason, number in engine.stats.dropped.items():
                dropped[reason] = dropped.get(reason, 0) + number
        of_streams = sum(size for stream_id, size in by_stream.items() if stream_id != NO_STREAM)
        return SimulationResult(
            seed=self._seed,
            until_s=until_s,
            frames=sum(engine.stats.frames_transmitted for engine in engines),
            transmitted_bytes=sum(engine.stats.bytes_transmitted for engine in engines),
            airtime_s=sum(engine.stats.airtime_ns for engine in engines) / NS_PER_S,
            losses=dict(sorted(self.network.losses.items())),
            dropped=dict(sorted(dropped.items())),
            streams=tuple(
                tally.result(self._table.by_id(stream_id), by_stream.get(stream_id, 0), of_streams)
                for stream_id, tally in sorted(self._tallies.items())
            ),
            digest=self.network.digest,
        )


class _Tally:
    """Counts of one stream."""

    def __init__(self) -> None:
        self.published = 0
        self.failed = 0
        self.refused = 0
        self.took_ns: list[int] = []

    def result(self, stream: Stream, transmitted_bytes: int, of_streams: int) -> StreamResult:
        """Sum up."""
        took = sorted(self.took_ns)
        mean_s = ns_to_seconds(round(sum(took) / len(took))) if took else None
        p95_s = ns_to_seconds(took[min(len(took) - 1, len(took) * 95 // 100)]) if took else None
        return StreamResult(
            stream_id=stream.stream_id,
            name=stream.name,
            published=self.published,
            delivered=len(took),
            failed=self.failed,
            refused=self.refused,
            mean_s=mean_s,
            p95_s=p95_s,
            transmitted_bytes=transmitted_bytes,
            airtime_share=transmitted_bytes / of_streams if of_streams else 0.0,
        )


def _tables(scenario: Scenario, path: Path) -> dict[int, StreamTable]:
    """Return the table of each node: the config's, or one of opaque topics."""
    addresses = [node.address for node in scenario.nodes]
    if scenario.config:
        file = path.parent / scenario.config
        return {address: read_config(file, address=address).table for address in addresses}
    topics = dict.fromkeys(traffic.topic for traffic in scenario.traffic if traffic.topic)
    if any(traffic.service for traffic in scenario.traffic):
        raise ConfigError(
            f"{path}: traffic calls a service, but the scenario names no config",
            hint='add config: "fleet.json5"',
        )
    specs = [
        TopicSpec(stream_id=_FIRST_OPAQUE_ID + index, name=topic)
        for index, topic in enumerate(topics)
    ]
    nodes = {node.address: node.name or f"node{node.address}" for node in scenario.nodes}
    return {address: StreamTable(specs, nodes=nodes) for address in addresses}
