"""Whoever begins to speak at once comes to an end: no state of the protocol repeats for ever."""

from collections.abc import Callable
from functools import partial
from typing import Final

import pytest

from tests.virtual.settling import BEGIN_S, Settling
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.engine.events import DeliveryEnded, RequestReceived
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

WORST_S: Final = 1800.0
MOST_P99_S: Final = 600.0


@pytest.mark.parametrize("senses_carrier", [False, True])
def test_random_scenarios_come_to_an_end(count: Callable[[int], int], senses_carrier: bool) -> None:
    settled_s = []
    for seed in range(count(2_000)):
        outcome = Settling(seed, senses_carrier=senses_carrier).run()
        again = f"Settling({seed}, senses_carrier={senses_carrier})"
        assert not outcome.unended, f"{again}: {outcome.unended}"
        assert not outcome.failed, f"{again}: {outcome.failed}"
        assert outcome.settled_s <= WORST_S, f"{again}: {outcome.settled_s} s"
        settled_s.append(outcome.settled_s)
    settled_s.sort()
    assert settled_s[len(settled_s) * 99 // 100] <= MOST_P99_S


def line(seed: int, distance_m: float, table: StreamTable) -> VirtualNetwork:
    """Return two nodes without losses, whose modems sense no carrier."""
    nodes = [
        {"address": 1, "position": [0, 0, 10]},
        {"address": 2, "position": [distance_m, 0, 10]},
    ]
    medium = {"seed": seed, "channel": "none", "nodes": nodes}
    return VirtualNetwork(
        scenario_from_mapping(medium, source="two"),
        table,
        modem=Modem(senses_carrier=False),
        digest=False,
    )


def call(network: VirtualNetwork, request: bytes) -> int:
    """Let node 1 call service 20."""
    return network.apply(1, lambda engine, now: engine.call(20, request, now))


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
    network = line(seed, distance_m, table)
    for address, at_s in ((1, 1.0), (2, 30.0)):  # they have met
        network.at(at_s, partial(network.publish, address, address, b"met"))
    for address in (1, 2):
        network.at(BEGIN_S, partial(network.publish, address, address, bytes(size_bytes)))
    network.run(until_s=BEGIN_S + 2 * WORST_S)
    ended_at = [event.ended_at for _, event in network.events if isinstance(event, DeliveryEnded)]
    assert len(ended_at) == 4
    return ns_to_seconds(max(ended_at)) - BEGIN_S


@pytest.mark.parametrize("topics", [1, 2])
@pytest.mark.parametrize("distance_m", [10.0, 50.0, 150.0, 1500.0])
def test_answer_to_one_of_two_samples_does_not_fall_under_the_other_for_ever(
    distance_m: float, topics: int
) -> None:
    qos = Qos(reliability=Reliability.RELIABLE, depth=10)
    specs = [
        TopicSpec(stream_id=each, name=f"t{each}", publishers=(1,), subscribers=(2,), qos=qos)
        for each in (1, 2)
    ]
    for seed in range(6):
        network = line(seed, distance_m, StreamTable(specs, nodes={1: "a", 2: "b"}))
        for number, size_bytes in enumerate((12, 40)):  # together they fit no frame
            publish = partial(network.publish, 1, 1 + number % topics, bytes(size_bytes))
            network.at(BEGIN_S, publish)
        network.run(until_s=BEGIN_S + 60.0)
        ended = [event for _, event in network.events if isinstance(event, DeliveryEnded)]
        assert len(ended) == 2, (seed, sum(each.frames_transmitted for each in network.stats()))


def test_confirm_of_one_of_two_requests_does_not_fall_under_the_other_for_ever() -> None:
    service = ServiceSpec(stream_id=20, name="s", server=2, timeout_s=3600.0)
    for seed in range(6):
        network = line(seed, 50.0, StreamTable([service], nodes={1: "a", 2: "b"}))
        for size_bytes in (12, 40):
            request = bytes(size_bytes)
            network.at(
                BEGIN_S,
                partial(call, network, request),
            )
        network.run(until_s=BEGIN_S + 1800.0)  # nobody answers them, so each is confirmed
        requests = [event for _, event in network.events if isinstance(event, RequestReceived)]
        assert len(requests) == 2
        assert network.engine(1).stats.frames_transmitted <= 12


@pytest.mark.parametrize("priority", [Priority.REAL_TIME, Priority.DATA])
@pytest.mark.parametrize("deadline_s", [None, 6.0, 20.0])
@pytest.mark.parametrize("size_bytes", [12, 40])
def test_two_samples_at_once_do_not_lie_under_each_other_for_ever(
    priority: Priority, deadline_s: float | None, size_bytes: int
) -> None:
    for distance_m in (10.0, 50.0, 150.0):
        for seed in range(2):
            settled_s = settle_two(seed, distance_m, size_bytes, priority, deadline_s)
            assert settled_s <= 120.0, (seed, distance_m, settled_s)
