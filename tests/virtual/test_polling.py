"""Polling over the simulated water: nobody collides, everything arrives, quiet when idle."""

import random
from collections.abc import Callable
from functools import partial

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import PollingSpec
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

NODES = range(1, 5)


def network(seed: int, *, loss: float = 0.0, modem: Modem | None = None) -> VirtualNetwork:
    rng = random.Random(seed)
    scenario = scenario_from_mapping(
        {
            "nodes": [
                {"address": node, "position": [rng.uniform(0, 1500), rng.uniform(0, 900), 10]}
                for node in NODES
            ],
            "seed": seed,
            "channel": "none",
            "collisions": "protocol",
            "loss": {"frame": loss},
        },
        source="test",
    )
    table = StreamTable(
        [TopicSpec(stream_id=1, name="{node}/t", qos=Qos(depth=200))],
        nodes={node: f"n{node}" for node in NODES},
    )
    spec = PollingSpec(poller=1, nodes=(2, 3, 4), idle_s=20.0)
    return VirtualNetwork(
        scenario,
        table,
        modem=modem,
        rules=TransmitRules(access=spec),
        digest=False,
    )


def test_nothing_collides_and_everything_arrives(count: Callable[[int], int]) -> None:
    for seed in range(count(500)):
        medium = network(seed, modem=Modem(addressed=seed % 2 == 0, checked=seed % 3 == 0))
        rng = random.Random(seed)
        for node in NODES:
            for _ in range(20):
                at_s = rng.uniform(60, 900)
                medium.at(at_s, partial(medium.publish, node, 1, bytes(rng.randrange(50))))
        for node in NODES:  # an introduction first: nothing of the rest is lost to it
            medium.at(node, partial(medium.publish, node, 1, b""))
        medium.run(until_s=1500)
        assert sum(medium.losses.values()) == 0, seed
        for node in NODES:
            arrived = [
                event for event in medium.samples(node) if event.received_at > 100 * NS_PER_S
            ]
            assert len(arrived) > 3 * 17, (seed, node)
            assert medium.engine(node).pending(1) == 0


def test_lost_turns_cost_time_only(count: Callable[[int], int]) -> None:
    for seed in range(count(300)):
        medium = network(seed, loss=0.3)
        for node in NODES:
            for step in range(10):
                medium.at(60 + 30 * step, partial(medium.publish, node, 1, b"x"))
        medium.run(until_s=3000)
        assert set(medium.losses) <= {"noise"}, (seed, medium.losses)  # what the scenario loses
        for node in NODES:
            assert medium.engine(node).pending(1) == 0


def test_empty_rounds_rest() -> None:
    medium = network(1)
    medium.run(until_s=3600)
    sent = sum(stats.frames_transmitted for stats in medium.stats())
    assert sent < 2 * 3 * 3600 / 20
