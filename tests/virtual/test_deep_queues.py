"""A deep queue costs no more for each frame than a short one.

Counted in calls, Python's and C's, generators' steps included: that is the same on each machine.
"""

import sys
from collections.abc import Callable
from types import FrameType

import pytest

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

SHORT, DEEP = 200, 2000
DEPTH = 4000
KINDS = {
    "reliable": Qos(reliability=Reliability.RELIABLE, depth=DEPTH),
    "reliable, with a lifespan": Qos(
        reliability=Reliability.RELIABLE, depth=DEPTH, lifespan_s=36_000.0
    ),
    "best effort": Qos(depth=DEPTH),
    "best effort, with a lifespan": Qos(depth=DEPTH, lifespan_s=36_000.0),
}


def two_nodes(qos: Qos, receivers: int = 1) -> VirtualNetwork:
    """Nodes that know each other; stream 1 goes from node 1 to the others."""
    nodes = range(1, receivers + 2)
    spec = TopicSpec(stream_id=1, name="t", publishers=(1,), subscribers=tuple(nodes[1:]), qos=qos)
    positions = [{"address": each, "position": [500 * each, 0, 10]} for each in nodes]
    medium = scenario_from_mapping({"seed": 1, "channel": "none", "nodes": positions}, source="t")
    network = VirtualNetwork(medium, StreamTable([spec], nodes={n: f"n{n}" for n in nodes}))
    for at_s in (1, 20, 40):
        network.at(at_s, lambda: network.publish(1, 1, b"known to all"))
    network.run(until_s=60)
    return network


def calls(do: Callable[[], object]) -> int:
    """Count the calls that something takes."""
    counted = 0

    def count(frame: FrameType, event: str, arg: object) -> None:
        nonlocal counted
        counted += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        do()
    finally:
        sys.setprofile(None)
    return counted


def cost(qos: Qos, waiting: int, receivers: int) -> float:
    """Return the calls of one frame while so many samples wait."""
    network = two_nodes(qos, receivers)
    for number in range(waiting):
        network.publish(1, 1, b"%012d" % number)
    network.run(until_s=70)
    before = next(iter(network.stats())).frames_transmitted
    spent = calls(lambda: network.run(until_s=100))
    return spent / (next(iter(network.stats())).frames_transmitted - before)


@pytest.mark.parametrize("receivers", [1, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_frame_costs_the_same_however_many_samples_wait(kind: str, receivers: int) -> None:
    short, deep = (cost(KINDS[kind], waiting, receivers) for waiting in (SHORT, DEEP))
    assert deep < 1.15 * short


@pytest.mark.parametrize("kind", KINDS)
def test_put_into_a_full_queue_costs_the_same_however_deep_it_is(kind: str) -> None:
    costs = []
    for waiting in (SHORT, DEEP):
        network = two_nodes(KINDS[kind])
        for number in range(waiting):
            network.publish(1, 1, b"%012d" % number)
        costs.append(calls(lambda network=network: network.publish(1, 1, b"x" * 12)))  # type: ignore[misc]
    assert costs[1] < 1.15 * costs[0]


def test_emergency_waits_behind_a_deep_queue_at_the_same_cost() -> None:
    qos = Qos(reliability=Reliability.RELIABLE, depth=DEPTH, priority=Priority.REAL_TIME)
    short, deep = (cost(qos, waiting, 1) for waiting in (SHORT, DEEP))
    assert deep < 1.15 * short
