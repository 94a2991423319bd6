"""Heartbeats and lost nodes on real water: who is there is not lost, who is gone is."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.events import Event, PeerFound, PeerLost
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

HEARTBEAT_S = 60.0
SPAN_S = 6 * 3600.0
NODES = {1: "shore", 2: "auv1", 3: "buoy"}


def fleet() -> StreamTable:
    return StreamTable([TopicSpec(stream_id=10, name="nav", qos=Qos(depth=3))], nodes=NODES)


def network(lost_after_s: float, **medium: Any) -> VirtualNetwork:
    contact = ContactRules(heartbeat_s=HEARTBEAT_S, lost_after_s=dict.fromkeys(NODES, lost_after_s))
    return VirtualNetwork(
        line(0, 400, 900, **{"channel": "none", **medium}),
        fleet(),
        rules=TransmitRules(contact=contact),
    )


def of(kind: type[Event], medium: VirtualNetwork) -> list[tuple[int, int]]:
    """Return who has told of whom."""
    return [
        (node, event.address)
        for node, event in medium.events
        if isinstance(event, kind) and isinstance(event, PeerLost | PeerFound)
    ]


def test_a_quiet_fleet_spends_the_airtime_of_its_heartbeats_only() -> None:
    medium = network(3 * HEARTBEAT_S)
    medium.run(until_s=SPAN_S)
    assert of(PeerLost, medium) == []
    for stats in medium.stats():
        assert 0.97 * SPAN_S / HEARTBEAT_S <= stats.frames_transmitted <= 1.4 * SPAN_S / HEARTBEAT_S
        assert stats.bytes_transmitted <= 1.05 * stats.frames_transmitted + 50


def test_nodes_that_start_together_do_not_collide_for_ever(count: Callable[[int], int]) -> None:
    for seed in range(count(200)):
        medium = network(5 * HEARTBEAT_S, seed=seed)
        medium.run(until_s=SPAN_S)
        assert of(PeerLost, medium) == [], f"seed {seed}"


# Ten heartbeats in a row are lost with a probability of 1e-7 at 20 %: in one full size of thirty.
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_node_that_is_gone_is_lost_in_time_and_found_when_it_is_back(
    count: Callable[[int], int], loss: float
) -> None:
    for seed in range(count(200)):
        medium = network(10 * HEARTBEAT_S, seed=seed, loss={"frame": loss})
        medium.at(7200, partial(medium.crash, 2))
        medium.run(until_s=7200)
        assert of(PeerLost, medium) == [], f"seed {seed}"
        medium.run(until_s=7200 + 10 * HEARTBEAT_S + 5)
        assert sorted(of(PeerLost, medium)) == [(1, 2), (3, 2)], f"seed {seed}"
        medium.at(10_000, partial(medium.start, 2))
        medium.run(until_s=10_000 + 10 * HEARTBEAT_S)
        assert sorted(of(PeerFound, medium)) == [(1, 2), (3, 2)], f"seed {seed}"
        assert sorted(of(PeerLost, medium)) == [(1, 2), (3, 2)], f"seed {seed}"


def test_talk_to_one_node_does_not_make_the_others_miss_anybody() -> None:
    contact = ContactRules(heartbeat_s=HEARTBEAT_S, lost_after_s={1: 180.0, 2: 180.0})
    table = StreamTable([TopicSpec(stream_id=10, name="to2", subscribers=(2,))], nodes=NODES)
    medium = VirtualNetwork(
        line(0, 400, 900, channel="none"),
        table,
        rules=TransmitRules(contact=contact),
    )
    medium.every(20, lambda: medium.publish(1, 10, b"x"))
    medium.run(until_s=SPAN_S / 2)
    assert of(PeerLost, medium) == []
