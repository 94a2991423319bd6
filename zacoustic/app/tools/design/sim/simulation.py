"""`zacoustic sim`: a scenario with its traffic, in virtual time, and the result.

The nodes run the real engines with the stream table of the scenario's `config`. A received sample
is matched to the newest publication with the same payload that this node has not received yet,
which is exact as long as payloads differ (`size_bytes`, `vary`).
"""

import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.sim.recorder import SimulationRecorder
from zacoustic.app.tools.fleets import configs_of, tables_of
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.channel.traffic import TrafficSpec
from zacoustic.config import Config
from zacoustic.config.json5 import read_json5
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import ConfigError, LocalError
from zacoustic.testing.counters import Counters, SimulationResult
from zacoustic.testing.scenarios.checker import Arrived, Publication
from zacoustic.testing.virtual import VirtualNetwork

DEFAULT_UNTIL_S: Final = 3600.0
"""Default length of a run, s of virtual time."""


def simulate(
    path: str | Path,
    *,
    seed: int | None = None,
    until_s: float = DEFAULT_UNTIL_S,
    trace: Callable[[TraceRecord], None] | None = None,
    record: SimulationRecorder | None = None,
) -> SimulationResult:
    """Run a scenario file.

    Args:
        path: The file, JSON5.
        seed: Replaces the seed of the file.
        until_s: Length, s of virtual time, > 0.
        trace: Takes each trace record.
        record: Records the engines.

    Raises:
        ConfigError: The scenario, its config or its traffic is wrong.
    """
    scenario = scenario_from_mapping(read_json5(path), source=str(path), folder=Path(path).parent)
    if seed is not None:
        scenario = msgspec.structs.replace(scenario, seed=seed)
    configs = configs_of(scenario, Path(path))
    return simulate_scenario(
        scenario, configs, source=str(path), until_s=until_s, trace=trace, record=record
    )


def simulate_scenario(
    scenario: Scenario,
    configs: dict[int, Config],
    *,
    source: str,
    until_s: float,
    trace: Callable[[TraceRecord], None] | None = None,
    record: SimulationRecorder | None = None,
) -> SimulationResult:
    """Run a scenario.

    Args:
        scenario: The scenario.
        configs: Config of each node by address; empty: each topic is opaque bytes.
        source: Name of the scenario for messages.
        until_s: Length, s of virtual time, > 0.
        trace: Takes each trace record.
        record: Records the engines.

    Raises:
        ConfigError: The traffic is wrong.
    """
    if not scenario.traffic:
        raise ConfigError(
            f"{source}: traffic is empty; allowed: at least one entry",
            hint='add traffic: [ { node: 1, topic: "a/b", every_s: 10, size_bytes: 30 } ]',
        )
    tables = tables_of(scenario, configs, source)
    rules = {address: config.rules for address, config in configs.items()}
    scenario = _with_journals(scenario, configs)
    make = Engine if record is None else record.make
    if record is not None and configs:
        ros = next(iter(configs.values())).ros
        record.ros = ros.streams if ros is not None else {}
    run = _Run(scenario, tables, rules, source=source, trace=trace, build=make)
    if record is not None:
        record.network = run.network
    run.network.run(until_s=until_s)
    return run.counters.result(run.network, until_s)


class _Run:
    """One run of a scenario."""

    def __init__(
        self,
        scenario: Scenario,
        tables: dict[int, StreamTable],
        rules: dict[int, TransmitRules],
        *,
        source: str,
        trace: Callable[[TraceRecord], None] | None,
        build: MakeEngine,
    ) -> None:
        self._table = next(iter(tables.values()))
        self._rng = random.Random(scenario.seed)
        self._number = 0
        self._published: dict[tuple[int, int, Instance, bytes], list[_Sent]] = {}
        self._called: dict[tuple[int, int, int], Publication] = {}
        self._answers: dict[int, object] = {}
        late_after_s: dict[int, float] = {}
        self.counters = Counters(tables, late_after_s)

        self.network = VirtualNetwork(
            scenario,
            tables,
            deliver=self._deliver,
            trace=trace,
            lives=self._live,
            rules=rules,
            build=build,
        )
        for address in self.network.addresses:
            self._subscribe(address)
        for index, traffic in enumerate(scenario.traffic):
            stream = self._begin(traffic, f"{source}: traffic[{index}]")
            if traffic.late_after_s is not None:
                late_after_s[stream.stream_id] = traffic.late_after_s

    def _begin(self, traffic: TrafficSpec, where: str) -> Stream:
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
        act = partial(self._act, traffic, stream, instance)

        def step(due_s: float) -> None:
            for _ in range(traffic.burst):
                self.network.at(due_s + self._rng.random() * traffic.jitter_s, act)
            pause_s = traffic.every_s
            if traffic.pattern == "random":
                pause_s = self._rng.expovariate(1.0 / pause_s)
            go_on(due_s + pause_s)

        def go_on(due_s: float) -> None:
            if traffic.until_s is None or due_s < traffic.until_s:
                self.network.at(due_s, partial(step, due_s))

        go_on(traffic.first_s)
        return stream

    def _act(self, traffic: TrafficSpec, stream: Stream, instance: Instance) -> None:
        """Publish or call once."""
        value: Any = traffic.value
        size = traffic.size_bytes
        if isinstance(size, tuple):
            size = self._rng.randint(*size)
        if size is not None:
            value = self._rng.randbytes(size)
        if traffic.vary:
            drawn = {key: self._rng.uniform(low, high) for key, (low, high) in traffic.vary.items()}
            value = {**value, **drawn}
        is_topic = traffic.topic is not None

        def command(engine: Engine, now: int) -> None:
            if is_topic:
                result = engine.publish(stream.stream_id, value, now, instance=instance)
            else:
                result = engine.call(stream.stream_id, value, now)
            self._note(traffic.node, stream, instance, value, result, is_topic=is_topic)

        try:
            self.network.apply(traffic.node, command)
        except LocalError:
            self.counters.refused(traffic.node, stream)

    def _note(
        self,
        node: int,
        stream: Stream,
        instance: Instance,
        value: object,
        result: int,
        *,
        is_topic: bool,
    ) -> None:
        self._number += 1
        life = self.network.life(node)
        publication = Publication(
            number=self._number,
            node=node,
            life=life,
            stream=stream,
            instance=instance,
            value=value,
            at=self.network.now,
            result=result,
            written=self.network.journal(node).handed_out + 1,
        )
        if is_topic:
            key = (stream.stream_id, node, instance, stream.codec.encode(value))
            self._published.setdefault(key, []).append(_Sent(publication))
            self.counters.published(publication)
        else:
            self._called[node, life, result] = publication
            self.counters.called(publication)

    def _deliver(self, address: int, event: Event) -> None:
        if isinstance(event, SampleReceived):
            stream = self._table.by_id(event.stream_id)
            payload = stream.codec.encode(event.value)
            key = (event.stream_id, event.source, event.instance, payload)
            if known := self._published.get(key):
                lacking = (sent for sent in reversed(known) if address not in sent.got)
                sent = next(lacking, known[-1])
                sent.got.add(address)
                self.counters.received(self._arrived(sent.publication, address))
        elif isinstance(event, RequestReceived):
            answer = self._answers.get(event.call.stream_id)
            self.network.apply(
                address,
                lambda engine, at: engine.reply(event.call, b"" if answer is None else answer, at),
            )
        elif isinstance(event, ResponseReceived | CallFailed):
            call = (address, self.network.life(address), event.call_id)
            publication = self._called.pop(call, None)
            if publication is not None:
                arrived = self._arrived(publication, address)
                if isinstance(event, CallFailed):
                    self.counters.failed(arrived)
                else:
                    self.counters.answered(arrived)

    def _arrived(self, publication: Publication, node: int) -> Arrived:
        network = self.network
        return Arrived(publication=publication, node=node, life=network.life(node), at=network.now)

    def _live(self, address: int, is_alive: bool) -> None:
        if is_alive:
            self.network.at(self.network.now / NS_PER_S, partial(self._subscribe, address))
        else:
            self.counters.crashed(address, self.network.now)

    def _subscribe(self, address: int) -> None:
        """Subscribe to all on-demand topics."""
        if not self.network.is_running(address):
            return
        for stream in self.network.engine(address).table:
            if stream.is_on_demand and stream.may_subscribe(address):
                want = partial(_want, stream.stream_id)
                self.network.apply(address, want)


def _want(stream_id: int, engine: Engine, now: int) -> None:
    engine.subscriptions.want(stream_id, now)


class _Sent:
    """A publication, and the nodes that have received it."""

    __slots__ = ("got", "publication")

    def __init__(self, publication: Publication) -> None:
        self.publication = publication
        self.got: set[int] = set()


def _with_journals(scenario: Scenario, configs: dict[int, Config]) -> Scenario:
    """Return the scenario with journals that keep entries if the config says so."""
    journal = scenario.faults.journal
    if journal.keeps is not None or not configs:
        return scenario
    keeps = any(config.journal is not None for config in configs.values())
    journal = msgspec.structs.replace(journal, keeps=keeps)
    faults = msgspec.structs.replace(scenario.faults, journal=journal)
    return msgspec.structs.replace(scenario, faults=faults)
