"""Whatever happens at sea: engines made again from a recording say and deliver the same."""

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

import tests.virtual.commandscenario
from tests.recording.memory import MemorySink, record_networks, recorded
from tests.virtual import lineoffive
from tests.virtual.callscenario import CallScenario
from tests.virtual.commandscenario import CommandScenario
from tests.virtual.fleet import line
from tests.virtual.goalscenario import GoalScenario
from tests.virtual.lineoffive import LineOfFive
from tests.virtual.sealed import KEY, SealedFleet
from tests.virtual.twolinks import ARM, BESIDE, PLAN, RADIO, SOUND, TwoLinks
from zacoustic.app.tools.design.sim.recorder import recorded_to
from zacoustic.app.tools.inspect.recordings.replaying.checking import Verdict, check_messages
from zacoustic.core.base.qos import Forward, Qos, Reliability, Stamp
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.tap import CALLS
from zacoustic.core.linktypes import LinkMetrics, ModemRead, PeerMeasured
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import ConfigError
from zacoustic.run.recording.reading import ReadMessage
from zacoustic.run.recording.recorder import EngineRecorder
from zacoustic.seal.ccm import FleetCipher
from zacoustic.testing.scenarios import draw_scenario, run_scenario
from zacoustic.testing.virtual import VirtualNetwork


def checked(recorder: EngineRecorder, sink: MemorySink) -> Verdict:
    """Replay a recording; everything has to be the same, and there has to be something."""
    recorder.finish()
    verdict = check_messages(sink.messages, "memory")
    for life in verdict.epochs:
        assert not life.difference, f"node {life.node}: {life.difference}"
        assert life.ledger_bytes == life.frame_bytes
    assert verdict.is_same
    return verdict


def test_scenarios_with_loss_delay_repetition_and_restarts(count: Callable[[int], int]) -> None:
    frames = deliveries = 0
    for seed in range(4, 4 + count(200)):
        recorder, sink = recorded()
        told = run_scenario(draw_scenario(seed), (), build=recorder.make)
        assert not told.violations
        verdict = checked(recorder, sink)
        sent = sink.of("/frames")
        sizes = [
            record["size_bytes"]
            for record in (msgspec.json.decode(message.data) for message in sent)
            if record["direction"] == "sent"
        ]
        assert sum(sizes) == sum(life.ledger_bytes for life in verdict.epochs)
        frames += sum(life.frames for life in verdict.epochs)
        deliveries += sum(life.deliveries for life in verdict.epochs)
    assert frames > 100
    assert deliveries > 50


def test_two_links_are_recorded_and_replayed() -> None:
    recorder, sink = recorded()
    fleet = TwoLinks(loss=(0.2, 0.2), build=recorder.make)
    fleet.acquaint()
    for first in (0, BESIDE):
        fleet.network.publish(2, first + PLAN, bytes(2000))
        fleet.call(2, first + ARM, b"arm")
    fleet.network.set_link(1, up=False, link=RADIO)
    fleet.network.run(until_s=200.0)
    fleet.network.set_link(1, up=True, link=RADIO)
    fleet.network.restart(2)
    fleet.network.run(until_s=400.0)
    verdict = checked(recorder, sink)
    assert len(verdict.epochs) == 3
    for kind in ("/frames", "/reports", "/links"):
        links = {msgspec.json.decode(message.data)["link"] for message in sink.of(kind)}
        assert links == {SOUND, RADIO}, kind


@pytest.mark.parametrize("drawn", [GoalScenario, CallScenario])
def test_goals_and_calls_with_restarts(
    monkeypatch: pytest.MonkeyPatch, count: Callable[[int], int], drawn: Any
) -> None:
    for seed in range(count(100)):
        with monkeypatch.context() as patch:
            recorder, sink = record_networks(patch)
            drawn(seed).run()
        assert len(checked(recorder, sink).epochs) >= 2


def test_commands_and_silence(monkeypatch: pytest.MonkeyPatch, count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        recorder, sink = recorded()
        monkeypatch.setattr(
            tests.virtual.commandscenario, "Engine", partial(_with_defaults, recorder.make)
        )
        CommandScenario(seed).run()
        checked(recorder, sink)


def _with_defaults(make: Any, **arguments: Any) -> Engine:
    made: Engine = make(**arguments)
    return made


NAV = TypeSpec(
    name="Nav",
    fields=(
        FieldSpec(name="depth", type="float32", range=(0, 100), step=0.1, outside="clamp"),
        FieldSpec(name="heading", type="float64", range=(0, 360), step=0.1, wraps=True),
        FieldSpec(name="mode", type="enum", values=("idle", "survey")),
        FieldSpec(name="note", type="bytes", max_length=8, optional=True),
    ),
)


def survey() -> StreamTable:
    """Return dense telemetry, an object, and a topic that goes on demand."""
    large = Qos(reliability=Reliability.RELIABLE, depth=4)
    return StreamTable(
        [
            TopicSpec(
                stream_id=1, name="{node}/nav", type_name="Nav", codec="dense",
                qos=Qos(depth=9, stamp=Stamp.AGE),
            ),
            TopicSpec(stream_id=2, name="photo", publishers=(2,), qos=large, journal=True),
            TopicSpec(stream_id=3, name="view", qos=Qos(forward=Forward.ON_DEMAND)),
            TopicSpec(stream_id=4, name="log", qos=Qos(min_interval_s=30, max_airtime=0.05)),
        ],
        types=TypeTable([NAV]),
        nodes={1: "shore", 2: "auv", 3: "glider"},
    )  # fmt: skip


def run_survey(network: VirtualNetwork, *, until_s: float = 1500.0) -> None:
    """Let three nodes speak for a while; one of them crashes, another one's modem is unplugged."""

    def nav(node: int) -> None:
        if network.is_running(node):
            drift = network.now / 1e10
            value = {
                "depth": 101 if node == 2 else drift % 90,
                "heading": drift % 720,
                "mode": ("idle", "survey")[node % 2],
                "note": b"x" if node == 3 else None,
            }
            network.publish(node, 1, value)
            network.publish(node, 3, b"view of %d" % node)
            network.publish(node, 4, b"log %d" % network.now)

    for node in network.addresses:
        network.every(20.0, partial(nav, node), first_s=1.0 + node)
    network.at(5.0, lambda: network.apply(1, lambda engine, now: engine.subscriptions.want(3, now)))
    network.at(9.0, lambda: network.publish(2, 2, bytes(range(256)) * 12))
    network.at(600.0, lambda: network.restart(2))
    network.at(900.0, lambda: network.set_link(3, up=False))
    network.at(1000.0, lambda: network.set_link(3, up=True))
    network.at(1200.0, lambda: network.crash(1, reboots=True))
    network.at(1205.0, lambda: network.start(1))
    network.run(until_s=until_s)


def measure(
    network: VirtualNetwork, at_s: float, node: int, peer: int, metrics: LinkMetrics
) -> None:
    """Let a modem measure something of another one."""

    def run_scenario(engine: Engine, now: int) -> None:
        measured = PeerMeasured(address=peer, measured_at=now, metrics=metrics)
        engine.handle_measurement(measured, now)

    network.at(at_s, lambda: network.apply(node, run_scenario))


def test_what_modems_measure_is_an_input_like_others() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    for at_s in (4.0, 50.0):
        measure(network, at_s, 1, 2, LinkMetrics(range_m=800.0, propagation_s=0.533))

    def read(engine: Engine, now: int) -> None:
        engine.handle_measurement(ModemRead(read_at=now, firmware="1.9", battery_v=24.1), now)

    network.at(6.0, lambda: network.apply(2, read))
    run_survey(network, until_s=100)
    events = [life.events for life in checked(recorder, sink).epochs]
    assert [each.get("PeerMeasured", 0) for each in events] == [2, 0]
    assert [each.get("ModemRead", 0) for each in events] == [0, 1]


@pytest.mark.parametrize("seed", range(2))
def test_dense_streams_objects_and_demand(seed: int) -> None:
    recorder, sink = recorded()
    channel = line(0, 800, 1500, seed=seed, loss={"frame": 0.2})
    network = VirtualNetwork(channel, survey(), build=recorder.make)
    run_survey(network)
    verdict = checked(recorder, sink)
    assert len(verdict.epochs) == 5
    events = [life.events for life in verdict.epochs]
    assert any(each.get("ObjectProgress") for each in events)
    assert sum(each.get("SampleReceived", 0) for each in events) > 100


def test_another_process_finds_the_same(tmp_path: Path) -> None:
    path = tmp_path / "scenario.mcap"
    with recorded_to(path) as recorder:
        assert recorder is not None
        network = VirtualNetwork(line(0, 800, 1500, loss={"frame": 0.2}), survey(),
                                 build=recorder.make)  # fmt: skip
        recorder.network = network
        run_survey(network, until_s=1300)
    command = [sys.executable, "-m", "zacoustic", "replay", str(path), "--check", "--json"]
    found = subprocess.run(command, capture_output=True, check=False, timeout=120)
    assert found.returncode == 0, found.stderr
    said = msgspec.json.decode(found.stdout)
    assert said["is_same"] is True
    assert len(said["epochs"]) == 5


def altered(messages: list[ReadMessage], change: Callable[[bytes], bytes]) -> list[ReadMessage]:
    """Return the messages of engines with other calls."""
    return [
        msgspec.structs.replace(message, data=change(message.data))
        if message.topic.endswith("/engine")
        else message
        for message in messages
    ]


def test_the_check_fails_when_a_single_bit_was_another(monkeypatch: pytest.MonkeyPatch) -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    network.publish(2, 4, b"this is a log")
    network.run(until_s=60)
    recorder.finish()
    assert b"this is a log" in b"".join(message.data for message in sink.of("/1/engine"))
    messages = altered(sink.messages, lambda data: data.replace(b"is a log", b"is a fog"))
    assert not any("fog" in life.difference for life in check_messages(messages, "").epochs)
    # The command says "fog", and so the frame, but the recorded frame was altered as well: so only
    # one of the two.
    messages = altered(sink.messages, lambda data: data.replace(b"is a log", b"is a fog", 1))
    verdict = check_messages(messages, "")
    assert not verdict.is_same
    assert any("poll_transmit" in life.difference for life in verdict.epochs)


def test_a_ledger_that_does_not_sum_is_found() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    network.publish(2, 4, b"this is a log")
    network.run(until_s=60)
    recorder.finish()
    (first, *_) = [at for at, each in enumerate(sink.messages) if each.topic == "/2/ledger"][-1:]
    record = msgspec.json.decode(sink.messages[first].data)
    record["rows"][0]["transmitted_bytes"] += 1
    changed = msgspec.structs.replace(sink.messages[first], data=msgspec.json.encode(record))
    messages = [*sink.messages[:first], changed, *sink.messages[first + 1 :]]
    verdict = check_messages(messages, "")
    assert [life.node for life in verdict.epochs if "ledger" in life.difference] == [2]


def test_after_a_gap_a_life_is_recorded_no_more_and_the_next_one_is() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    network.every(10.0, lambda: network.publish(2, 4, b"log"))
    network.run(until_s=100)
    sink.is_full = True
    network.run(until_s=200)
    sink.is_full = False
    before = len(sink.of("/engine"))
    network.run(until_s=300)
    assert len(sink.of("/engine")) == before
    network.restart(2)
    network.run(until_s=400)
    assert len(sink.of("/2/engine")) > 5
    verdict = check_messages(sink.messages, "")
    assert [life.node for life in verdict.epochs] == [1, 2, 2]
    assert not any(life.difference for life in verdict.epochs if life.epoch == 2)


def test_what_an_engine_refuses_is_refused_again() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    refused = [(1, {"depth": "deep"}), (99, b""), (4, object()), (1, 3 + 4j), (2, b"")]
    for stream_id, value in refused:
        with pytest.raises(Exception):  # noqa: B017, PT011 (whatever it is)
            network.publish(1, stream_id, value)
    network.run(until_s=10)
    checked(recorder, sink)


def test_the_tap_stands_on_every_public_method_that_is_no_getter() -> None:
    getters = {"delivering", "pending", "peers", "epoch", "link_state", "capabilities", "is_idle",
               "expired", "superseded", "is_delivering", "owes_acknowledgement",
               "links", "link_of", "state_of", "capabilities_of", "transport",
               "seal_failure", "access_state", "hops", "routes", "bonds",
               "carry", "changed_paths", "opening", "waits"}  # fmt: skip
    public = {name for name in vars(Engine) if not name.startswith("_")}
    assert public - getters == {name for name in CALLS if "." not in name}


def test_an_engine_without_a_recorder_is_untouched() -> None:
    network = VirtualNetwork(line(0, 800), survey())
    engine = network.engine(1)
    assert "handle_frame" not in vars(engine)
    recorder, _ = recorded()
    tapped = VirtualNetwork(line(0, 800), survey(), build=recorder.make).engine(1)
    assert "handle_frame" in vars(tapped)


def test_numbers_of_a_spec_are_kept_as_they_were_written() -> None:
    def service(timeout_s: float, stream_id: int = 20) -> ServiceSpec:
        return ServiceSpec(stream_id=stream_id, name=f"s{stream_id}", server=1, timeout_s=timeout_s)

    for timeout_s in (60, 60.0):
        recorder, sink = recorded()
        table = StreamTable([service(timeout_s)])
        network = VirtualNetwork(line(0, 800), table, build=recorder.make)
        network.apply(1, partial(_declare, service(timeout_s, 21)))
        network.apply(2, lambda engine, now: engine.call(20, b"?", now))
        network.run(until_s=100)
        checked(recorder, sink)


def _declare(spec: ServiceSpec, engine: Engine, now: int) -> None:
    engine.declare(spec, now)


def test_sealed_engines_are_made_again_with_their_key_and_not_without() -> None:
    recorder, sink = recorded()
    fleet = SealedFleet(make=recorder.make)
    assert not run_scenario(draw_scenario(5), (), build=fleet).violations
    recorder.finish()
    verdict = check_messages(sink.messages, "memory", lambda address: FleetCipher(KEY))
    assert verdict.is_same, [life.difference for life in verdict.epochs]
    assert sum(life.frames for life in verdict.epochs) > 10
    with pytest.raises(ConfigError, match="were sealed"):
        check_messages(sink.messages, "memory")
    assert not any(KEY.secret in message.data for message in sink.messages)


def test_nodes_of_a_route() -> None:
    recorder, sink = recorded()
    five = LineOfFive(0.1, seed=2, build=recorder.make)
    for number in range(6):
        five.network.at(100.0 * number, partial(five.publish, lineoffive.PLAN, b"plan %d" % number))
    five.network.at(350.0, partial(five.network.restart, 3))
    five.network.run(until_s=2000)
    assert len(five.values(lineoffive.PLAN)) == 6
    verdict = checked(recorder, sink)
    assert [life.node for life in verdict.epochs].count(3) == 2
