"""Ranges between real engines on the simulated channel, with loss, traffic and motion."""

from typing import Any

import pytest

from tests.virtual.fleet import line
from zacoustic.channel.propagation.position import Waypoint
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import PeerMeasured
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

MODEM = Modem(acknowledges=True)


def table() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="all", qos=Qos(depth=64)),
            TopicSpec(stream_id=2, name="to2", subscribers=(2,), qos=Qos(depth=64)),
        ],
        nodes={1: "shore", 2: "auv1", 3: "auv2"},
    )


def network(scenario: Scenario, **settings: Any) -> VirtualNetwork:
    return VirtualNetwork(scenario, table(), modem=MODEM, **settings)


def ask(medium: VirtualNetwork, source: int, peer: int, *, timeout_s: float = 60.0) -> int:
    return medium.apply(
        source, lambda engine, now: engine.ranging.request(peer, now, timeout_s=timeout_s)
    )


def repeat(medium: VirtualNetwork, source: int, peer: int, every_s: float) -> None:
    medium.apply(source, lambda engine, now: engine.ranging.repeat(peer, every_s, now))


def got(medium: VirtualNetwork, kind: type[Any]) -> list[Any]:
    return [event for _, event in medium.events if isinstance(event, kind)]


def test_range_is_what_the_geometry_says_and_everybody_falls_silent_after_it() -> None:
    medium = network(line(0, 1500, 400, channel="none"))
    ids = {peer: ask(medium, 1, peer) for peer in (2, 3)}
    medium.run()
    found = {each.range_id: each.range for each in got(medium, RangeMeasured)}
    assert found[ids[2]].range_m == pytest.approx(1500)
    assert found[ids[2]].propagation_s == pytest.approx(1.0)
    assert found[ids[3]].range_m == pytest.approx(400)
    assert medium.is_quiet
    assert all(medium.engine(address).is_idle for address in medium.addresses)


def test_absent_peer_times_out_in_time_and_the_queue_goes_on() -> None:
    medium = network(line(0, 300, channel="none"))  # node 3 is in the table, not in the water
    ask(medium, 1, 3, timeout_s=40)
    for second in range(60):
        medium.at(second, lambda: medium.publish(1, 1, b"x"))
    medium.run(until_s=41)
    (failed,) = got(medium, RangeFailed)
    assert failed.text == "no range within 40 s: not delivered"
    medium.run()
    assert medium.engine(1).pending(1) == 0
    assert len(medium.samples(2)) >= 55  # the introductions of the two collide now and then


@pytest.mark.parametrize("seed", range(20))
def test_every_request_ends_once_and_in_time_whatever_is_lost(seed: int) -> None:
    scenario = line(0, 700, 1400, channel="none", seed=seed, loss={"frame": 0.4})
    medium = network(scenario)
    asked: dict[tuple[int, int], float] = {}

    def request(source: int, peer: int) -> None:
        asked[source, ask(medium, source, peer)] = medium.now / NS_PER_S

    for step in range(20):
        source = 1 + step % 3
        medium.at(step * 7.0, lambda source=source: request(source, 1 + source % 3))  # type: ignore[misc]
        medium.at(step * 5.0, lambda source=source: medium.publish(source, 1, b"x"))  # type: ignore[misc]
    medium.run(until_s=400)
    ends = [
        (address, event.range_id)
        for address, event in medium.events
        if isinstance(event, RangeMeasured | RangeFailed)
    ]
    assert sorted(ends) == sorted(asked)
    for address, event in medium.events:
        if isinstance(event, RangeMeasured):
            began_s = asked[address, event.range_id]
            assert event.range.measured_at / NS_PER_S >= began_s
            assert event.range.range_m == pytest.approx(
                700 if {address, event.range.address} != {1, 3} else 1400
            )
    assert len(got(medium, RangeMeasured)) >= 10


def test_schedule_follows_a_vehicle_and_costs_one_small_frame_a_period() -> None:
    track = (Waypoint(t=0, position=(300.0, 0, 10)), Waypoint(t=600, position=(900.0, 0, 10)))
    scenario = Scenario(
        nodes=(NodeSpec(address=1, position=(0.0, 0.0, 10.0)), NodeSpec(address=2, track=track)),
        channel="none",
    )
    frames: list[TraceRecord] = []
    medium = network(scenario, trace=frames.append)
    repeat(medium, 1, 2, 30)
    medium.run(until_s=600)
    measured = got(medium, PeerMeasured)
    assert 18 <= len(measured) <= 20
    for each in measured:
        at_s = each.measured_at / NS_PER_S
        assert each.metrics.range_m == pytest.approx(300 + at_s, abs=2)
    sent = [each for each in frames if each.what == "transmit" and each.node == 1]
    assert {each.size_bytes for each in sent} == {1}
    assert not [each for each in frames if each.what == "transmit" and each.node == 2]


def test_frames_for_the_peer_bring_its_range_without_any_other_frame() -> None:
    medium = network(line(0, 300, channel="none"))
    frames: list[TraceRecord] = []
    for second in range(10):
        medium.at(second * 20, lambda: medium.publish(1, 2, b"payload"))
    medium.run(until_s=200)
    medium = network(line(0, 300, channel="none"), trace=frames.append)
    for second in range(10):
        medium.at(second * 20, lambda: medium.publish(1, 2, b"payload"))
        medium.at(second * 20 + 0.001, lambda: ask(medium, 1, 2))
    medium.run(until_s=230)
    assert len(got(medium, RangeMeasured)) == 10
    sent = [each for each in frames if each.what == "transmit" and each.node == 1]
    assert len([each for each in sent if each.frame == "00"]) <= 10


def test_two_runs_are_the_same_byte_for_byte() -> None:
    digests = set()
    for _ in range(2):
        medium = network(line(0, 500, 900, seed=4, loss={"frame": 0.3}))
        for address in (1, 2, 3):
            repeat(medium, address, 1 + address % 3, 9)
        medium.run(until_s=300)
        digests.add(medium.digest)
        assert got(medium, PeerMeasured)
    assert len(digests) == 1


def test_restarted_node_measures_again_and_nothing_of_its_former_life_remains() -> None:
    medium = network(line(0, 500, channel="none"))
    ask(medium, 1, 2)
    medium.at(0.1, lambda: medium.restart(1))
    medium.run(until_s=30)
    assert got(medium, RangeMeasured) == []
    ask(medium, 1, 2)
    medium.run(until_s=90)
    assert len(got(medium, RangeMeasured)) == 1
