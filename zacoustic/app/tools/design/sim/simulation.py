"""`zacoustic sim`: a scenario with its traffic, in virtual time, and the result.

The nodes run the real engines with the stream table of the scenario's `config`.
"""

import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.sim.fleetrun import FleetRun
from zacoustic.app.tools.design.sim.recorder import SimulationRecorder
from zacoustic.app.tools.design.sim.sealing import security_of
from zacoustic.app.tools.fleets import configs_of, tables_of
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.channel.traffic import TrafficSpec
from zacoustic.config import Config
from zacoustic.config.json5 import read_json5
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import ConfigError
from zacoustic.seal.spec import SecuritySpec
from zacoustic.testing.counters import Counters, SimulationResult

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
    scenario = with_journals(scenario, configs)
    make: Callable[..., Engine] = Engine if record is None else record.make
    if record is not None and configs:
        ros = next(iter(configs.values())).ros
        record.ros = ros.streams if ros is not None else {}
    run = _Run(
        scenario, tables, rules, security_of(configs), source=source, trace=trace, build=make
    )
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
        security: dict[int, SecuritySpec],
        *,
        source: str,
        trace: Callable[[TraceRecord], None] | None,
        build: Callable[..., Engine],
    ) -> None:
        self._rng = random.Random(scenario.seed)
        late_after_s: dict[int, float] = {}
        self.counters = Counters(tables, late_after_s)
        self._fleet = FleetRun(
            scenario, tables, rules, self.counters, security=security, trace=trace, build=build
        )
        self.network = self._fleet.network
        for index, traffic in enumerate(scenario.traffic):
            stream = self._begin(traffic, f"{source}: traffic[{index}]")
            if traffic.late_after_s is not None:
                late_after_s[stream.stream_id] = traffic.late_after_s

    def _begin(self, traffic: TrafficSpec, where: str) -> Stream:
        if traffic.node not in self.network.addresses:
            known = ", ".join(str(address) for address in self.network.addresses)
            raise ConfigError(f"{where}.node: {traffic.node}; allowed: {known}")
        table = self._fleet.table
        found = table.find(traffic.topic or traffic.service or "", traffic.node)
        wanted = TopicSpec if traffic.topic else ServiceSpec
        if found is None or not isinstance(found[0].spec, wanted):
            key = "topic" if traffic.topic else "service"
            known = ", ".join(s.name for s in table if isinstance(s.spec, wanted)) or "none"
            raise ConfigError(
                f'{where}.{key}: "{traffic.topic or traffic.service}"; allowed: {known}'
            )
        stream, instance = found
        self._fleet.answers.setdefault(stream.stream_id, traffic.answer)
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
        self._fleet.say(traffic.node, stream, instance, value)


def with_journals(scenario: Scenario, configs: dict[int, Config]) -> Scenario:
    """Return the scenario with journals that keep entries if the config says so."""
    journal = scenario.faults.journal
    if journal.keeps is not None or not configs:
        return scenario
    keeps = any(config.journal is not None for config in configs.values())
    journal = msgspec.structs.replace(journal, keeps=keeps)
    faults = msgspec.structs.replace(scenario.faults, journal=journal)
    return msgspec.structs.replace(scenario, faults=faults)
