"""Whoever begins to speak at once comes to an end: no state of the protocol repeats for ever."""

from collections.abc import Callable
from functools import partial
from typing import Final

import pytest

from tests.virtual.settling import BEGIN_S, Settling
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.events import DeliveryEnded
from zacoustic.core.qos import Priority, Qos, Reliability
from zacoustic.core.streams import StreamTable
from zacoustic.core.streamspecs import TopicSpec
from zacoustic.testing.virtual import Modem, VirtualNetwork

BLOCKS: Final = range(4)
WORST_S: Final = 1800.0
MOST_P99_S: Final = 600.0


@pytest.mark.parametrize("number", BLOCKS)
@pytest.mark.parametrize("senses_carrier", [False, True])
def test_random_scenarios_come_to_an_end(
    count: Callable[[int], int], senses_carrier: bool, number: int
) -> None:
    settled_s = []
    for seed in range(number, count(2_000), len(BLOCKS)):
        outcome = Settling(seed, senses_carrier=senses_carrier).run()
        again = f"Settling({seed}, senses_carrier={senses_carrier})"
        assert not outcome.unended, f"{again}: {outcome.unended}"
        assert not outcome.failed, f"{again}: {outcome.failed}"
        assert outcome.settled_s <= WORST_S, f"{again}: {outcome.settled_s} s"
        settled_s.append(outcome.settled_s)
    settled_s.sort()
    assert settled_s[len(settled_s) * 99 // 100] <= MOST_P99_S


def settle_two(
    seed: int, distance_m: float, size_bytes: int, priority: Priority, deadline_s: float | None
) -> float:
    """Return when the last of two samples is delivered that are published at once, s."""
    qos = Qos(reliability=Reliability.RELIABLE, depth=10, priority=priority, deadline_s=deadline_s)
    table = StreamTable(
        [
            TopicSpec(stream_id=1, name="a", publishers=(1,), subscribers=(2,), qos=qos),
            TopicSpec(stream_id=2, name="b", publishers=(2,), subscribers=(1,), qos=qos),
        ],
        nodes={1: "a", 2: "b"},
    )
    nodes = [
        {"address": 1, "position": [0, 0, 10]},
        {"address": 2, "position": [distance_m, 0, 10]},
    ]
    water = {"seed": seed, "channel": "none", "nodes": nodes}
    network = VirtualNetwork(
        scenario_from_mapping(water, source="two"),
        table,
        modem=Modem(senses_carrier=False),
        digest=False,
    )
    for address, at_s in ((1, 1.0), (2, 30.0)):  # they have met
        network.at(at_s, partial(network.publish, address, address, b"met"))
    for address in (1, 2):
        network.at(BEGIN_S, partial(network.publish, address, address, bytes(size_bytes)))
    network.run(until_s=BEGIN_S + 2 * WORST_S)
    ended_at = [event.ended_at for _, event in network.events if isinstance(event, DeliveryEnded)]
    assert len(ended_at) == 4
    return ns_to_seconds(max(ended_at)) - BEGIN_S


@pytest.mark.parametrize("priority", [Priority.REAL_TIME, Priority.DATA])
@pytest.mark.parametrize("deadline_s", [None, 6.0, 20.0])
@pytest.mark.parametrize("size_bytes", [12, 40])
def test_two_samples_at_once_do_not_lie_under_each_other_for_ever(
    priority: Priority, deadline_s: float | None, size_bytes: int
) -> None:
    for distance_m in (10.0, 50.0, 150.0):
        for seed in range(4):
            settled_s = settle_two(seed, distance_m, size_bytes, priority, deadline_s)
            assert settled_s <= 120.0, (seed, distance_m, settled_s)
