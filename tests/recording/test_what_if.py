"""The load of a trial once more: as it was, and another way."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.recording.memory import MemorySink, recorded
from tests.recording.smalltrial import CHANNEL, FLEET
from tests.recording.test_exact import run_survey, survey
from tests.virtual.fleet import line
from zacoustic.app.cli import main
from zacoustic.app.tools.design.sim.recorder import SimulationRecorder, recorded_to
from zacoustic.app.tools.design.sim.simulation import simulate
from zacoustic.app.tools.inspect.recordings.facts.facts import Facts
from zacoustic.app.tools.inspect.recordings.facts.gathering import add_messages
from zacoustic.app.tools.inspect.recordings.report.figures import Figures, StreamFigures
from zacoustic.app.tools.inspect.recordings.whatif.changes import Wanted, what_if
from zacoustic.app.tools.inspect.recordings.whatif.measuredchannel import measure_channel, with_loss
from zacoustic.app.tools.inspect.recordings.whatif.whatif import Change, Trial, configured
from zacoustic.core.engine.events import Event, GoalStatus
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import GoalReceived
from zacoustic.testing.virtual import VirtualNetwork


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    (tmp_path / "water.json5").write_text(CHANNEL, encoding="utf-8")
    (tmp_path / "fleet.json5").write_text(FLEET, encoding="utf-8")
    path = tmp_path / "trial.mcap"
    channel = str(tmp_path / "water.json5")
    assert main(["sim", channel, "--until", "1800", "--record", str(path)]) == 0
    return path


def stream(figures: Figures, name: str) -> StreamFigures:
    (found,) = [each for each in figures.streams if each.name == name]
    return found


def share(figures: Figures, name: str) -> float:
    found = stream(figures, name)
    return found.delivered / found.expected


def test_channel_is_measured_as_it_was() -> None:
    sink = MemorySink()
    recorder = SimulationRecorder(sink)
    channel = line(0, 600, 1500, loss={"frame": 0.25}, channel="none")
    network = recorder.network = VirtualNetwork(channel, survey(), build=recorder.make)
    run_survey(network)
    facts = Facts()
    add_messages(facts, sink.messages)
    measured = measure_channel(facts, seed=1)
    assert [node.position for node in measured.scenario.nodes] == [
        pytest.approx((0, 0, 10)),
        pytest.approx((600, 0, 10), abs=1),
        pytest.approx((1500, 0, 10), abs=40),
    ]
    assert measured.scenario.profile == "evologics_s2c_18_34"
    assert len(measured.losses) == 6
    shares = list(measured.losses.values())
    assert 0.2 < sum(shares) / len(shares) < 0.3
    assert all(0.1 < each < 0.4 for each in shares), measured.losses
    assert measured.notes == []


def test_losses_are_added_or_replaced() -> None:
    recorder, sink = recorded()
    channel = line(0, 600, loss={"frame": 0.1}, channel="none")
    run_survey(VirtualNetwork(channel, survey(), build=recorder.make), until_s=600)
    facts = Facts()
    add_messages(facts, sink.messages)
    scenario = measure_channel(facts, seed=1).scenario
    for link in with_loss(scenario, add=0.2).links:
        before = scenario.loss_between(link.source, link.target).frame
        assert link.loss is not None
        assert link.loss.frame == pytest.approx(before + 0.2)
    halves, most = with_loss(scenario, instead=0.5), with_loss(scenario, add=5)
    assert {each.loss.frame for each in halves.links if each.loss} == {0.5}
    assert {each.loss.frame for each in most.links if each.loss} == {0.99}


def test_as_it_was_is_near_and_more_loss_is_worse(trial: Path) -> None:
    found = what_if([str(trial)], Wanted(add_loss=0.3))
    for name in ("auv1/nav", "auv1/raw"):
        assert share(found.again, name) == pytest.approx(share(found.recorded, name), abs=0.1)
        assert share(found.changed, name) == pytest.approx(
            share(found.recorded, name) - 0.3, abs=0.12
        )
        assert stream(found.again, name).published == stream(found.recorded, name).published
    latency = stream(found.again, "auv1/raw").latency_s
    was = stream(found.recorded, "auv1/raw").latency_s
    assert latency is not None
    assert was is not None
    assert latency.p50 == pytest.approx(was.p50, abs=0.05)
    arm = stream(found.again, "auv1/arm")
    assert arm.delivered / arm.expected > 0.9, "who was asked answers as it did"
    airtimes = [
        sum(node.airtime_s for node in each.nodes) for each in (found.recorded, found.again)
    ]
    assert airtimes[1] == pytest.approx(airtimes[0], rel=0.1)
    assert all(node.ledger_is_exact for node in found.changed.nodes)


def test_another_codec_or_configuration_changes_the_bytes(trial: Path) -> None:
    packed = what_if([str(trial)], Wanted(codec="packed"))
    nav = [stream(each, "auv1/nav").transmitted_bytes for each in (packed.again, packed.changed)]
    assert nav[1] < nav[0]
    slower = trial.with_name("slower.json5")
    slower.write_text(
        FLEET.replace('id: 11, topic: "auv1/raw"', 'id: 99, topic: "auv1/raw", min_interval_s: 60')
    )
    found = what_if([str(trial)], Wanted(config=str(slower)))
    raw = stream(found.changed, "auv1/raw")
    assert raw.stream_id == 99, "streams are found by their names"
    assert raw.published == stream(found.recorded, "auv1/raw").published
    assert raw.delivered < 0.7 * stream(found.again, "auv1/raw").delivered
    assert found.not_taken == 0


def test_what_the_configuration_does_not_have_is_counted(trial: Path) -> None:
    without = trial.with_name("without.json5")
    without.write_text(FLEET.replace('             { id: 11, topic: "auv1/raw" },\n', ""))
    found = what_if([str(trial)], Wanted(config=str(without)))
    assert found.not_taken == stream(found.recorded, "auv1/raw").published


def test_it_runs_no_longer_than_the_trial_did(tmp_path: Path) -> None:
    fleet = FLEET.replace("address: 1, nodes", "address: 1, heartbeat_s: 10, nodes")
    assert fleet != FLEET
    (tmp_path / "water.json5").write_text(CHANNEL, encoding="utf-8")
    (tmp_path / "fleet.json5").write_text(fleet, encoding="utf-8")
    with recorded_to(tmp_path / "a.mcap") as recorder:
        simulate(tmp_path / "water.json5", until_s=300, record=recorder)
    found = what_if([str(tmp_path / "a.mcap")], Wanted())
    assert found.again.duration_s <= found.recorded.duration_s + 1
    assert found.again.utilisation == pytest.approx(found.recorded.utilisation, rel=0.15)


def test_one_end_alone_stands_for_what_arrived_from_the_other(tmp_path: Path) -> None:
    (tmp_path / "water.json5").write_text(CHANNEL, encoding="utf-8")
    (tmp_path / "fleet.json5").write_text(FLEET, encoding="utf-8")
    whole, shore = tmp_path / "whole.mcap", tmp_path / "shore.mcap"
    with recorded_to(whole) as recorder:
        simulate(tmp_path / "water.json5", until_s=1800, record=recorder)
    only(whole, shore, node=1)
    found = what_if([str(shore)], Wanted())
    assert stream(found.recorded, "auv1/nav").expected == 0
    arrived = stream(found.recorded, "auv1/nav").arrived
    assert stream(found.again, "auv1/nav").published == arrived
    # A sample of a steady period lingers as long as is drawn anew: one comes while shore transmits.
    assert arrived - 1 <= stream(found.again, "auv1/nav").delivered <= arrived
    arm = stream(found.again, "auv1/arm")
    was = stream(found.recorded, "auv1/arm")
    assert (arm.delivered, arm.expected) == (was.delivered, was.expected)
    assert any("one end alone" in note for note in found.notes)


def only(source: Path, target: Path, *, node: int) -> None:
    """Write what one node has recorded."""
    from zacoustic.run.recording.channels import Channel
    from zacoustic.run.recording.reading import RecordingReader
    from zacoustic.run.recording.writing import RecordingFile

    file = RecordingFile(target, waits=True)
    for each in RecordingReader(source):
        if each.topic.startswith(f"/{node}/"):
            channel = Channel(topic=each.topic, encoding=each.encoding, metadata=each.metadata)
            file.put(channel, each.utc_ns, each.data)
    file.close()


def test_goals_are_pursued_as_they_were() -> None:
    table = StreamTable(
        [ActionSpec(stream_id=30, name="goto", server=1)], nodes={1: "auv", 2: "shore"}
    )
    recorder, sink = recorded()
    networks: list[VirtualNetwork] = []

    def pursue(address: int, event: Event) -> None:
        if isinstance(event, GoalReceived):
            goal, network = event.goal, networks[0]
            serve: Callable[[str, dict[str, Any]], Any] = partial(_serve, network)
            serve("accept", {"goal": goal})
            at_s = network.now / 1e9
            network.at(
                at_s + 20, partial(serve, "publish_feedback", {"goal": goal, "value": b"half"})
            )
            done = {"goal": goal, "status": GoalStatus.SUCCEEDED, "value": b"there"}
            network.at(at_s + 40, partial(serve, "finish", done))

    networks.append(VirtualNetwork(line(0, 700), table, deliver=pursue, build=recorder.make))
    for number in range(4):
        networks[0].at(
            5.0 + 100 * number,
            lambda: networks[0].apply(
                2, lambda engine, now: engine.actions.send_goal(30, b"where", now)
            ),
        )
    networks[0].run(until_s=600)
    facts = Facts()
    add_messages(facts, sink.messages)
    channel = measure_channel(facts, seed=2)
    tables, rules = configured(facts, channel.scenario, {})
    trial = Trial(
        facts, Change(scenario=channel.scenario, modem=channel.modem, tables=tables, rules=rules)
    )
    goto = stream(trial.run(), "goto")
    assert (goto.published, goto.delivered, goto.failed) == (4, 4, 0)
    assert goto.latency_s is not None
    assert 40 < goto.latency_s.p50 < 46


def _serve(network: VirtualNetwork, name: str, arguments: dict[str, Any]) -> None:
    network.apply(1, lambda engine, now: getattr(engine.actions, name)(now=now, **arguments))


def test_the_command_prints_three_columns_or_json(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["replay", str(trial), "--what-if", "--loss", "0"]) == 0
    said = capsys.readouterr().out
    assert "what if" in said
    assert "airtime: recorded" in said
    assert main(["replay", str(trial), "--what-if", "--access", "aloha", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) >= {"recorded", "again", "changed", "losses"}
    assert msgspec.convert(found["changed"], Figures).streams
    assert main(["replay", str(trial), str(trial), "--check"]) == 2
    assert "several recordings" in capsys.readouterr().err
    assert main(["replay", str(trial), "--what-if", "--loss", "7"]) == 2
    assert "--loss 7; allowed" in capsys.readouterr().err
    assert main(["replay", str(trial), "--what-if", "--scenario", str(trial)]) == 2


def test_the_channel_can_be_another_one(trial: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    near = trial.with_name("near.json5")
    near.write_text(CHANNEL.replace("loss: { frame: 0.1 }", "loss: { frame: 0 }, channel: 'none'"))
    found = what_if([str(trial)], Wanted(scenario=str(near)))
    assert share(found.again, "auv1/raw") > 0.97
    lonely = trial.with_name("lonely.json5")
    lonely.write_text("{ nodes: [ { address: 1, position: [0, 0, 10] } ] }")
    assert main(["replay", str(trial), "--what-if", "--scenario", str(lonely)]) == 2
    assert "nodes: lacks [2]" in capsys.readouterr().err
