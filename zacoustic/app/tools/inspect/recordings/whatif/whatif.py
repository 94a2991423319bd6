"""`zacoustic replay --what-if`: the load of a trial again, without and with changes.

Engines of all nodes get the inputs that their applications gave them in the recording, at the same
times: samples, calls, goals, subscriptions; servers answer as recorded, after the same time. The
channel between them is simulated, with the delays and losses of the recording (`measuredchannel`).
It runs twice: without a change, which shows the difference between simulation and trial, and with
the change. The same figures report all three.

For a node that is not recorded, samples received from it stand for its published ones.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import msgspec

from zacoustic.app.tools.design.sim.recorder import SimulationRecorder
from zacoustic.app.tools.inspect.recordings.facts.facts import (
    Arrived,
    Asked,
    Command,
    Facts,
    Published,
)
from zacoustic.app.tools.inspect.recordings.facts.gathering import add_messages
from zacoustic.app.tools.inspect.recordings.facts.reactions import Step
from zacoustic.app.tools.inspect.recordings.report.figures import Figures, figures_of
from zacoustic.channel.scenario import Scenario
from zacoustic.config import Config
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailure, Event, RequestReceived
from zacoustic.core.engine.tap import call_engine
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.actions.events import GoalReceived
from zacoustic.errors import ConfigError, LocalError
from zacoustic.run.recording.calls import plain
from zacoustic.run.recording.channels import Channel
from zacoustic.run.recording.reading import ReadMessage
from zacoustic.testing.virtual import Modem, VirtualNetwork

_TRAVEL_S = 1.0


class Change(msgspec.Struct, frozen=True, kw_only=True):
    """The parameters of a run."""

    scenario: Scenario
    """The channel."""
    modem: Modem
    """Behaviour of the modems."""
    tables: Mapping[int, StreamTable]
    """Streams of each node."""
    rules: Mapping[int, TransmitRules]
    """Rules of transmission of each node."""


class WhatIf(msgspec.Struct, kw_only=True):
    """The same load three times."""

    recorded: Figures
    """As recorded."""
    again: Figures
    """Simulated without a change: shows the difference between simulation and trial."""
    changed: Figures
    """Simulated with the change."""
    losses: dict[str, float]
    """Measured share of frames lost without an overlap, by `SOURCE to NODE`."""
    not_taken: int = 0
    """Samples, calls and commands that the changed engines refused."""
    notes: list[str] = []
    """Remarks for the reader, one line each."""


class Trial:
    """One run of the load.

    Args:
        facts: The recording.
        change: The parameters.
    """

    def __init__(self, facts: Facts, change: Change) -> None:
        self.not_taken = 0
        self._facts = facts
        self._messages: list[ReadMessage] = []
        self._reactions = facts.reactions.copy()
        recorder = SimulationRecorder(_Kept(self._messages))
        self.network = network = VirtualNetwork(
            change.scenario,
            dict(change.tables),
            modem=change.modem,
            deliver=self._deliver,
            digest=False,
            rules=dict(change.rules),
            build=recorder.make,
        )
        recorder.network = network
        self._recorder = recorder
        self._names = {stream_id: each.name for stream_id, each in facts.streams.items()}
        self._load()

    def run(self) -> Figures:
        """Run for the length of the recording; return the figures.

        Not longer: samples missing then were missing in the trial as well, and heartbeats go on.
        """
        self.network.run(until_s=self._facts.duration_s)
        self._recorder.finish()
        found = Facts()
        add_messages(found, self._messages)
        return figures_of(found)

    # The load

    def _load(self) -> None:
        facts = self._facts
        for published in facts.published:
            self._at(published.at_ns, partial(self._publish, published))
        for arrived in facts.arrived:
            if arrived.source not in facts.tables and arrived.source in self.network.addresses:
                ago_s = _TRAVEL_S if arrived.age_s is None else arrived.age_s
                ago_ns = round(ago_s * 1e9)
                self._at(arrived.at_ns - ago_ns, partial(self._stand_in, arrived))
        for asked in facts.asked:
            self._at(asked.at_ns, partial(self._ask, asked))
            self._learn(asked)
        for command in facts.commands:
            self._at(command.at_ns, partial(self._execute, command))
        first: set[int] = set()
        for at_ns, life in facts.births:
            if life.address in first:
                self._at(at_ns, partial(self.network.restart, life.address))
            first.add(life.address)

    def _learn(self, was: Asked) -> None:
        """Let a server that is not recorded give the recorded answer."""
        spec = self._facts.streams[was.stream_id].spec
        is_answered = was.ended_at_ns is not None and not was.failure
        if is_answered and isinstance(spec, ServiceSpec) and spec.server not in self._facts.tables:
            self._reactions.note_answer(spec.server, was.stream_id, was.value, 0, was.answer)

    def _at(self, at_ns: int, action: Any) -> None:  # noqa: ANN401 (any callable)
        self.network.at(max(0.0, (at_ns - self._facts.began_ns) / 1e9), action)

    def _publish(self, was: Published) -> None:
        arguments: dict[str, Any] = {"value": was.value, "instance": was.instance}
        if was.delete:
            arguments["delete"] = True
        if was.encoding is not None:
            arguments["encoding"] = was.encoding
        self._give(was.node, "publish", was.stream_id, arguments)

    def _stand_in(self, was: Arrived) -> None:
        arguments = {"value": was.value, "instance": was.instance}
        self._give(was.source, "publish", was.stream_id, arguments)

    def _ask(self, was: Asked) -> None:
        stream = self._stream(was.node, was.stream_id)
        name = "call" if stream is None or _is_service(stream) else "actions.send_goal"
        arguments = {"value": was.value}
        if was.timeout_s is not None:
            arguments["timeout_s"] = was.timeout_s
        self._give(was.node, name, was.stream_id, arguments)

    def _execute(self, was: Command) -> None:
        arguments = dict(was.arguments)
        stream_id = arguments.pop("stream_id", None)
        self._give(was.node, was.name, stream_id, arguments)

    def _give(self, node: int, name: str, stream_id: int | None, arguments: dict[str, Any]) -> None:
        if stream_id is not None:
            stream = self._stream(node, stream_id)
            if stream is None:
                self.not_taken += 1
                return
            arguments = {**arguments, "stream_id": stream.stream_id}
        if not self.network.is_running(node):
            self.not_taken += 1
            return
        try:
            self.network.apply(node, partial(_call, name, arguments))
        except (LocalError, ConfigError):
            self.not_taken += 1

    def _stream(self, node: int, stream_id: int) -> Stream | None:
        """Return the stream with the name of a recorded one; its id may differ."""
        name = self._names.get(stream_id)
        table = self.network.engine(node).table if self.network.is_running(node) else None
        if table is None or name is None:
            return None
        return next((each for each in table if each.name == name), None)

    # Servers

    def _deliver(self, address: int, event: Event) -> None:
        if isinstance(event, RequestReceived):
            self._react(address, event.call.stream_id, event.value, {"call": event.call})
        elif isinstance(event, GoalReceived):
            self._react(address, event.goal.stream_id, event.value, {"goal": event.goal})

    def _react(self, node: int, stream_id: int, value: object, key: dict[str, Any]) -> None:
        name = self.network.engine(node).table.by_id(stream_id).name
        was = next((known for known, each in self._names.items() if each == name), stream_id)
        steps = self._reactions.of(node, was, plain(value))
        if steps is None:
            unknown = "what it answers is not recorded"
            said = {"failure": CallFailure.HANDLER, "text": unknown}
            refused = Step(0, "reply_error", said)
            rejected = Step(0, "actions.reject", {"text": unknown})
            steps = [refused if "call" in key else rejected]
        for step in steps:
            arguments = {**step.arguments, **key}
            after_s = self.network.now / 1e9 + step.after_ns / 1e9
            self.network.at(after_s, partial(self._give, node, step.name, None, arguments))


def _call(name: str, arguments: dict[str, Any], engine: Engine, now: int) -> object:
    return call_engine(engine, name, {**arguments, "now": now})


def _is_service(stream: Stream) -> bool:
    return isinstance(stream.spec, ServiceSpec)


class _Kept:
    """Stores messages in memory."""

    def __init__(self, messages: list[ReadMessage]) -> None:
        self._messages = messages

    def put(self, channel: Channel, utc_ns: int, data: bytes) -> bool:
        """Store a message."""
        self._messages.append(
            ReadMessage(channel.topic, utc_ns, channel.encoding, channel.metadata, data)
        )
        return True


def configured(
    facts: Facts, scenario: Scenario, configs: Mapping[int, Config]
) -> tuple[dict[int, StreamTable], dict[int, TransmitRules]]:
    """Return tables and rules of all nodes: those of the configurations, or as recorded.

    A node that is not recorded gets the table of one that is.
    """
    epochs = {life.address: life for _, life in facts.births}
    if not epochs:
        raise ConfigError(
            "no engine was recorded", hint="record with --record at the gateway or the Node"
        )
    anybody = next(iter(epochs.values()))
    tables, rules = {}, {}
    for spec in scenario.nodes:
        address = spec.address
        life = epochs.get(address, anybody)
        config = configs.get(address)
        tables[address] = life.table.table() if config is None else config.table
        rules[address] = life.transmit_rules() if config is None else config.rules
    return tables, rules


def compare(facts: Facts, was: Change, change: Change, losses: Mapping[str, float]) -> WhatIf:
    """Run the load without and with the change."""
    recorded = figures_of(facts)
    again = Trial(facts, was).run()
    trial = Trial(facts, change)
    return WhatIf(
        recorded=recorded,
        again=again,
        changed=trial.run(),
        losses=dict(losses),
        not_taken=trial.not_taken,
    )
