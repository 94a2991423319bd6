"""Deadlines on real water: each end is told of each period without a sample, and of no other."""

import itertools
import random
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import DeadlineMissed, DeadlineSide, Event, SampleReceived
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

DEADLINE_S = 30.0
NODES = {1: "shore", 2: "auv1", 3: "buoy"}
OFFERED, REQUESTED = DeadlineSide.OFFERED, DeadlineSide.REQUESTED


def fleet(**settings: Any) -> StreamTable:
    qos = Qos(**{"deadline_s": DEADLINE_S, "depth": 8, **settings})
    sensors = Wildcard(name="sensor", values=("ctd", "sonar"))
    return StreamTable(
        [
            TopicSpec(stream_id=10, name="nav", publishers=(2,), qos=qos),
            TopicSpec(stream_id=11, name="{node}/{sensor}", wildcards=(sensors,), qos=qos),
            TopicSpec(stream_id=12, name="chat", qos=Qos(depth=8)),
        ],
        nodes=NODES,
    )


class Watchers:
    """A network, and what its nodes were told, with the instants in s."""

    def __init__(self, table: StreamTable | None = None, **medium: Any) -> None:
        self.missed: list[tuple[int, float, DeadlineMissed]] = []
        self.handed_on: list[tuple[int, float]] = []
        self.medium = VirtualNetwork(
            line(0, 400, 900, **{"channel": "none", **medium}), table or fleet(), deliver=self._take
        )

    def _take(self, node: int, event: Event) -> None:
        if not isinstance(event, DeadlineMissed | SampleReceived):
            return
        now_s = self.medium.now / NS_PER_S
        if isinstance(event, DeadlineMissed):
            self.missed.append((node, now_s, event))
            # Nobody is told late, or of an instant that is not his.
            assert event.missed_at == self.medium.local_ns(node)
        else:
            self.handed_on.append((node, now_s))

    def told(self, node: int, side: DeadlineSide = REQUESTED) -> list[float]:
        """Return when a node was told of a missed period."""
        return [at for each, at, event in self.missed if each == node and event.side is side]

    def publish_every(self, period_s: float, until_s: float, stream_id: int = 10) -> None:
        """Let node 2 publish."""
        for number in range(int(until_s / period_s)):
            publish = partial(self.publish, stream_id)
            self.medium.at(number * period_s, publish)

    def publish(self, stream_id: int = 10, **settings: Any) -> None:
        if self.medium.is_running(2):
            self.medium.apply(
                2, lambda engine, now: engine.publish(stream_id, b"here", now, **settings)
            )


def test_no_timer_is_armed_before_a_first_sample_nor_without_a_deadline() -> None:
    watchers = Watchers()
    watchers.medium.run()
    assert watchers.medium.is_quiet
    for number in range(3):
        watchers.publish(12)
        watchers.medium.run(until_s=100 * (number + 1))
    assert len(watchers.handed_on) == 6
    assert all(watchers.medium.engine(node).poll_timeout() is None for node in NODES)
    watchers.publish()
    watchers.medium.run(until_s=320)
    assert all(watchers.medium.engine(node).poll_timeout() is not None for node in NODES)


def test_each_end_is_told_of_each_period_without_a_sample() -> None:
    watchers = Watchers()
    watchers.publish_every(20, 100)  # the last one at 80 s
    watchers.medium.at(199, watchers.publish)
    watchers.medium.run(until_s=225)
    assert watchers.told(2, OFFERED) == [110, 140, 170]
    ours = [event for node, _, event in watchers.missed if node == 2]
    assert [event.missed for event in ours] == list(range(1, len(ours) + 1))
    assert [event.is_first for event in ours] == [True, *[False] * (len(ours) - 1)]
    assert {(event.key, event.source, event.side) for event in ours} == {("nav", 2, OFFERED)}
    assert {event.last_at for event in ours} == {80 * NS_PER_S}
    for node in (1, 3):
        last_s = max(at for each, at in watchers.handed_on if each == node and at < 100)
        assert watchers.told(node) == pytest.approx([last_s + 30 * n for n in (1, 2, 3)])
        assert watchers.medium.engine(node).stats.deadlines_missed == {10: 3}
        events = [event for each, _, event in watchers.missed if each == node]
        assert {(event.key, event.source) for event in events} == {("nav", 2)}


def test_what_is_published_in_time_and_lost_is_missed_by_the_receiver_alone() -> None:
    watchers = Watchers(faults={"blackouts": [{"node": 3, "from_s": 95, "to_s": 400}]})
    watchers.publish_every(20, 600)
    watchers.medium.run(until_s=590)
    assert watchers.told(2, OFFERED) == watchers.told(1) == []
    heard = [at for node, at in watchers.handed_on if node == 3]
    (gap,) = [(a, b) for a, b in itertools.pairwise(heard) if b - a > 30]
    assert watchers.told(3) == pytest.approx([gap[0] + 30 * n for n in range(1, 11)])
    (first,) = [event for node, _, event in watchers.missed if node == 3 and event.is_first]
    assert first.last_at == round(gap[0] * NS_PER_S)


def test_receivers_are_told_exactly_of_the_gaps_in_any_weather(count: Callable[[int], int]) -> None:
    for seed in range(count(300)):
        rng = random.Random(f"deadlines {seed}")
        reliable = rng.random() < 0.5
        table = fleet(
            reliability=Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT,
            deadline_s=rng.choice((5.0, 30.0, 100.0)),
        )
        deadline_s = table.by_id(10).qos.deadline_s
        assert deadline_s is not None
        crashes = [{"node": 1, "at_s": [rng.uniform(100, 900)], "restart_after_s": 20}]
        watchers = Watchers(
            table,
            seed=seed,
            loss={"frame": rng.uniform(0, 0.6)},
            faults={
                "blackouts": [{"node": 3, "from_s": 300, "to_s": rng.uniform(310, 600)}],
                "duplicate": rng.choice((0.0, 0.3)),
                "crashes": crashes if rng.random() < 0.5 else [],
            },
        )
        for number in range(100):
            watchers.medium.at(10 * number + rng.uniform(0, 20), watchers.publish)
        watchers.medium.run(until_s=1200)
        for node in (1, 3):
            if node == 1 and watchers.medium.life(1) > 1:
                continue  # a new life knows of nothing before
            heard = [at for each, at in watchers.handed_on if each == node]
            expected = [
                before + deadline_s * number
                for before, after in itertools.pairwise([*heard, 1200.0])
                for number in range(1, 1000)
                if before + deadline_s * number < after - 1e-9
            ]
            assert watchers.told(node) == pytest.approx(expected), f"seed {seed}, node {node}"


def test_keys_are_watched_each_by_itself_and_a_deleted_one_no_longer() -> None:
    watchers = Watchers()
    for at_s in (0, 20, 40, 60):
        watchers.medium.at(at_s, partial(watchers.publish, 11, instance=(0,)))
    watchers.medium.at(1, partial(watchers.publish, 11, instance=(1,)))
    watchers.medium.at(65, partial(watchers.publish, 11, instance=(0,), delete=True))
    watchers.medium.run(until_s=100)
    for node in NODES:
        events = [event for each, _, event in watchers.missed if each == node]
        assert {event.key for event in events} == {"auv1/sonar"}
        assert [event.missed for event in events] == [1, 2, 3]
        awaited = watchers.medium.engine(node).deadlines.awaited()
        assert {each.key: (each.is_late, each.missed) for each in awaited} == {
            "auv1/ctd": (False, 0),
            "auv1/sonar": (True, 3),
        }


def test_a_new_life_awaits_nothing_before_a_first_sample() -> None:
    watchers = Watchers()
    watchers.publish_every(20, 100)
    watchers.medium.run(until_s=85)
    for node in (1, 2):
        watchers.medium.restart(node)
    watchers.medium.run(until_s=300)
    assert {node for node, *_ in watchers.missed} == {3}
    watchers.publish()
    watchers.medium.run(until_s=340)
    assert {node for node, *_ in watchers.missed} == {1, 2, 3}


def test_who_unsubscribes_is_told_no_more() -> None:
    watchers = Watchers(fleet(forward=Forward.ON_DEMAND))
    want = watchers.medium.apply
    for node in (1, 3):
        want(node, lambda engine, now: engine.subscriptions.want(10, now, frozenset({2})))
    watchers.publish_every(20, 300)
    watchers.medium.run(until_s=100)
    want(1, lambda engine, now: engine.subscriptions.want(10, now, frozenset()))
    watchers.medium.run(until_s=500)
    assert watchers.told(1) == []
    assert len(watchers.told(3)) > 5
    assert watchers.medium.engine(1).poll_timeout() is None


def _transmissions(table: StreamTable, span_s: float, **medium: Any) -> list[float]:
    """Return when frames went out for one reliable sample that nobody can hear."""
    sent: list[float] = []
    network = VirtualNetwork(
        line(0, 400, channel="none", **medium),
        table,
        trace=lambda record: (
            sent.append(record.at / NS_PER_S) if record.what == "transmit" else None
        ),
        disturb=lambda source, node, now: (),
    )
    network.publish(2, 10, b"x")
    network.run(until_s=span_s)
    return sent


def _reliable(deadline_s: float | None) -> StreamTable:
    qos = Qos(reliability=Reliability.RELIABLE, depth=8, deadline_s=deadline_s)
    spec = TopicSpec(stream_id=10, name="nav", publishers=(2,), subscribers=(1,), qos=qos)
    return StreamTable([spec], nodes={1: "shore", 2: "auv1"})


@pytest.mark.parametrize("seed", range(5))
def test_repetitions_become_no_rarer_than_the_deadline(seed: int) -> None:
    without = _transmissions(_reliable(None), 600, seed=seed)
    gaps = [b - a for a, b in itertools.pairwise(without)]
    assert max(gaps) > 25
    within = _transmissions(_reliable(15.0), 600, seed=seed)
    gaps = [b - a for a, b in itertools.pairwise(within)]
    assert max(gaps) <= 15.0
    assert sum(gap > 10 for gap in gaps) > 0.8 * len(gaps)


def test_no_deadline_makes_repetitions_come_before_an_answer_can() -> None:
    without = _transmissions(_reliable(None), 60)
    within = _transmissions(_reliable(0.2), 60)
    least_s = min(b - a for a, b in itertools.pairwise(without))
    gaps = [b - a for a, b in itertools.pairwise(within)]
    # As often as before repetitions become rare, and then after a few round trips each.
    assert least_s * 0.8 <= min(gaps)
    assert 3 * least_s < gaps[-1] <= max(gaps) < 5 * least_s


def test_after_minutes_of_darkness_a_sample_comes_within_the_deadline() -> None:
    longest_s: dict[float | None, float] = {}
    for deadline_s in (None, 20.0):
        came_s = []
        for seed in range(20):
            end_s = 450.0 + 7 * seed
            faults = {"blackouts": [{"node": 1, "from_s": 5, "to_s": end_s}]}
            medium = line(0, 400, channel="none", faults=faults, seed=seed)
            network = VirtualNetwork(medium, _reliable(deadline_s))
            network.at(10, partial(network.publish, 2, 10, b"x"))
            network.run(until_s=1000)
            (sample,) = network.samples(1)
            came_s.append(sample.received_at / NS_PER_S - end_s)
        longest_s[deadline_s] = max(came_s)
    assert longest_s[20.0] <= 20.0
    assert longest_s[None] > 20.0
