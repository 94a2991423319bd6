"""Two third nodes have emergencies at one instant while two others have burst data."""

import random
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from tests.links.evologics.driver.crew import CrewedSea, CrewNode
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.scenario import NodeSpec
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import EmulatedFleet, burst_guess, scenario_of

APART_M: Final = 1500.0
LOSS: Final = 0.4
PHOTO, PHOTO_BYTES = 10, 64 << 10
STREAMS: Final = {3: 13, 4: 14}
"""The stream of emergencies of each third node, all for node 2."""
PAIRS: Final = 30
"""Emergencies of each third node, one every 40 s in the mean."""
LIMIT_S: Final = 12_000.0
"""For the large sample, most of which goes when the emergencies are over."""
LATE_S: Final = 90.0
"""For 95 of a hundred emergencies: two at one instant collide, four of ten frames are lost. Over
sixty guesses it is 48 s, and 310 s if they do not go into the holes between trains."""


class Fleet:
    """A large sample from node 1 to node 2; nodes 3 and 4 are as far from both, on either side."""

    def __init__(self, seed: int) -> None:
        self.delays_s: list[float] = []
        self.published = 0
        self._has_arrived = False
        self._at: dict[bytes, int] = {}
        self._rng = random.Random(f"two/{seed}")
        scenario = scenario_of(4, spacing_m=APART_M, seed=seed + 1)
        aside_m = APART_M * 0.75**0.5
        thirds = (
            NodeSpec(address=address, position=(APART_M / 2, y_m, 10.0))
            for address, y_m in ((3, aside_m), (4, -aside_m))
        )
        scenario = msgspec.structs.replace(
            scenario, nodes=(*scenario.nodes[:2], *thirds), loss=LossSpec(frame=LOSS)
        )
        guess = burst_guess(seed)
        fleet = EmulatedFleet(scenario, behaviour=guess.behaviour, settings=guess.settings)
        self._sea = CrewedSea(fleet, _table(), self._deliver, config=EvologicsConfig())

    def run(self) -> None:
        """Publish all, until all has arrived."""
        self._sea.until(lambda: all(node.is_up for node in self._sea.crew))
        self._sea.after(self._rng.uniform(5.0, 30.0), self._alarm)
        self._publish(1, PHOTO, self._rng.randbytes(PHOTO_BYTES))
        everything = PAIRS * len(STREAMS)
        self._sea.until(
            lambda: self._has_arrived and len(self.delays_s) == everything, limit_s=LIMIT_S
        )

    def _alarm(self) -> None:
        for node, stream_id in STREAMS.items():
            self.published += 1
            value = self.published.to_bytes(8, "big")
            self._at[value] = self._sea.now
            self._publish(node, stream_id, value)
        if self.published < PAIRS * len(STREAMS):
            self._sea.after(self._rng.uniform(20.0, 60.0), self._alarm)

    def _publish(self, source: int, stream_id: int, value: bytes) -> None:
        node = self._sea.crew[source - 1]
        self._sea.apply(node, lambda engine, now: engine.publish(stream_id, value, now))

    def _deliver(self, node: CrewNode, event: Event) -> None:
        if isinstance(event, SampleReceived) and node.address == 2:
            assert isinstance(event.value, bytes)
            if event.stream_id == PHOTO:
                self._has_arrived = True
            else:
                at = self._at.pop(event.value)  # raises if it comes twice
                self.delays_s.append(ns_to_seconds(self._sea.now - at))


def _table() -> StreamTable:
    plain = Qos(reliability=Reliability.RELIABLE, depth=2)
    urgent = Qos(priority=Priority.REAL_TIME, reliability=Reliability.RELIABLE, depth=PAIRS)
    spec = partial(TopicSpec, subscribers=(2,))
    return StreamTable(
        [
            spec(stream_id=PHOTO, name="photo", publishers=(1,), qos=plain),
            *(
                spec(stream_id=stream_id, name=f"alarm{node}", publishers=(node,), qos=urgent)
                for node, stream_id in STREAMS.items()
            ),
        ],
        nodes={1: "shore", 2: "vehicle", 3: "third", 4: "fourth"},
    )


def test_emergencies_of_two_nodes_and_the_large_sample_all_arrive(
    count: Callable[[int], int],
) -> None:
    delays_s: list[float] = []
    for seed in range(count(60)):
        fleet = Fleet(seed)
        fleet.run()
        delays_s += fleet.delays_s
    assert sorted(delays_s)[int(0.95 * len(delays_s))] <= LATE_S
