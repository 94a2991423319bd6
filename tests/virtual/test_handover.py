"""Killed between the journal and the application: nothing is lost there, and nothing told twice.

A crash may find a commit on the disk that nobody was told of. A journalled sample whose position
was written so is handed on by the next life, and says that it may come again; the end of a delivery
is told by one life only; and no delivery id is given away twice.
"""

import random
from collections.abc import Callable
from typing import Final

import pytest

from tests.virtual.fleet import line
from zacoustic.core.events import DeliveryEnded, DeliveryOutcome, SampleReceived
from zacoustic.core.qos import Qos, Reliability
from zacoustic.core.streams import StreamTable
from zacoustic.core.streamspecs import TopicSpec
from zacoustic.testing.virtual import VirtualNetwork

LOG: Final = 10
TABLE: Final = StreamTable(
    [
        TopicSpec(
            stream_id=LOG,
            name="log",
            publishers=(1,),
            subscribers=(2,),
            journal=True,
            qos=Qos(reliability=Reliability.RELIABLE, depth=5, lifespan_s=600.0),
        )
    ],
    nodes={1: "shore", 2: "auv1"},
)


@pytest.mark.parametrize("untold", [0.0, 0.5, 1.0])
def test_killed_at_any_instant_of_a_hand_over(count: Callable[[int], int], untold: float) -> None:
    marked = 0
    for seed in range(count(1500)):
        rng = random.Random(seed)
        journal = {"commit_s": rng.choice((0.02, 0.5)), "untold": untold}
        water = VirtualNetwork(
            line(
                0, 300, seed=seed, channel="none", loss={"frame": 0.2}, faults={"journal": journal}
            ),
            TABLE,
        )
        published: dict[int, bytes] = {}
        for number in range(12):
            value = f"sample {number}".encode()
            delivery_id = water.publish(1, LOG, value)
            assert delivery_id not in published, f"seed {seed}: an id comes again"
            published[delivery_id] = value
            water.run(until_s=water.now / 1e9 + rng.choice((0.01, 0.3, 2, 20)) * rng.random())
            if rng.random() < 0.6:
                water.restart(rng.choice((1, 2)))
        water.run(until_s=water.now / 1e9 + 3600)
        ended: set[int] = set()
        first: set[bytes] = set()
        for node, event in water.events:
            match event:
                case SampleReceived():
                    assert event.again or event.value not in first, f"seed {seed}: twice"
                    marked += event.again
                    first.add(event.value)
                case DeliveryEnded():
                    assert node == 1
                    assert event.delivery_id not in ended, f"seed {seed}: ended twice"
                    ended.add(event.delivery_id)
                    if event.outcome is DeliveryOutcome.DELIVERED:
                        value = published[event.delivery_id]
                        assert value in first, f"seed {seed}: {value!r} was lost"
        assert water.engine(1).delivering(LOG) == 0
    assert marked
