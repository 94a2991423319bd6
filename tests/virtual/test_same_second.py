"""Publishers on several nodes that tick on the same second do not collide for ever."""

from collections.abc import Callable
from functools import partial

import pytest

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

PERIOD_S = 10.0
TICKS = 40


def _arrived(seed: int, nodes: int, *, senses_carrier: bool) -> float:
    """Return the share of the samples that arrive, of each node at each other one."""
    addresses = range(1, nodes + 1)
    scenario = scenario_from_mapping(
        {
            "seed": seed,
            "channel": "none",
            "nodes": [
                {"address": each, "position": [100.0 * each, 10.0 * each**2, 20.0]}
                for each in addresses
            ],
        },
        source="same second",
    )
    came = 0

    def deliver(node: int, event: Event) -> None:
        nonlocal came
        came += isinstance(event, SampleReceived)

    network = VirtualNetwork(
        scenario,
        StreamTable(
            [TopicSpec(stream_id=1, name="{node}/tick")],
            nodes={each: f"n{each}" for each in addresses},
        ),
        modem=Modem(senses_carrier=senses_carrier),
        digest=False,
        deliver=deliver,
    )
    for node in addresses:
        for tick in range(TICKS):
            network.at(60.0 + PERIOD_S * tick, partial(network.publish, node, 1, b"%d" % tick))
    network.run(until_s=60.0 + PERIOD_S * (TICKS + 1))
    return came / (TICKS * nodes * (nodes - 1))


@pytest.mark.parametrize("senses_carrier", [True, False])
@pytest.mark.parametrize(("nodes", "least"), [(2, 0.75), (3, 0.5)])
def test_ticks_of_the_same_second_arrive(
    nodes: int, least: float, *, senses_carrier: bool, count: Callable[[int], int]
) -> None:
    for seed in range(count(400)):
        assert _arrived(seed, nodes, senses_carrier=senses_carrier) >= least
