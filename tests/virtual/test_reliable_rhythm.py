"""Reliable samples in a rhythm: what they cost, and that no change of it loses or delays anything.

Two nodes 1500 m apart, S2C profile; one publishes, the other subscribes.
"""

import random
from collections.abc import Callable, Sequence
from functools import partial

import pytest

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.base.stats import Cause
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

SEEDS = 200
PERIOD_S = 10.0
BEGIN_S = 100.0
MESSAGES = 60


class Sea:
    """A publisher, 1, and a subscriber, 2, that know each other."""

    def __init__(self, seed: int, *, senses_carrier: bool = True) -> None:
        qos = Qos(reliability=Reliability.RELIABLE, depth=40)
        orders = TopicSpec(stream_id=1, name="o", publishers=(1,), subscribers=(2,), qos=qos)
        report = TopicSpec(stream_id=2, name="r", publishers=(2,))
        nodes = [{"address": each, "position": [1500 * (each - 1), 0, 10]} for each in (1, 2)]
        medium = {"seed": seed, "channel": "none", "nodes": nodes}
        self.lost: Callable[[int], bool] = lambda source: False
        """Whether a frame of a node is lost."""
        self.large: dict[int, int] = {}
        """Bytes of samples that fit no frame, by number."""
        self.published_at: list[float] = []
        self.arrived: list[tuple[int, float]] = []
        self.outcomes: list[DeliveryOutcome] = []
        self.network = VirtualNetwork(
            scenario_from_mapping(medium, source="rhythm"),
            StreamTable([orders, report], nodes={1: "a", 2: "b"}),
            modem=Modem(senses_carrier=senses_carrier),
            deliver=self._take,
            disturb=self._disturb,
            digest=False,
        )
        for at_s in (1.0, 20.0, 40.0):
            self.at(at_s)
        self.at(1.5, stream_id=2)

    def at(self, at_s: float, *, stream_id: int = 1) -> None:
        """Publish at an instant."""
        self.network.at(at_s, partial(self._publish, stream_id))

    def series(self, messages: int = MESSAGES, *, period_s: float = PERIOD_S) -> float:
        """Publish in a rhythm; returns when it is over, s."""
        for number in range(messages):
            self.at(BEGIN_S + number * period_s)
        return BEGIN_S + messages * period_s

    def frames(self) -> list[int]:
        """Count what the two have sent."""
        return [each.frames_transmitted for each in self.network.stats()]

    def check(self) -> None:
        """Everything has come, in order and once, and its publisher knows."""
        count = len(self.published_at)
        assert [number for number, _ in self.arrived] == list(range(count))
        assert self.outcomes == [DeliveryOutcome.DELIVERED] * count
        assert self.network.engine(1).is_idle
        assert self.network.engine(2).is_idle

    def latencies_s(self, begin: int = 3) -> list[float]:
        """How long the samples took, s."""
        return [at_s - self.published_at[number] for number, at_s in self.arrived[begin:]]

    def _publish(self, stream_id: int) -> None:
        if stream_id == 2:
            self.network.publish(2, 2, b"report")
            return
        self.published_at.append(ns_to_seconds(self.network.now))
        number = len(self.published_at) - 1
        self.network.publish(1, 1, number.to_bytes(12, "big") + bytes(self.large.get(number, 0)))

    def _take(self, address: int, event: Event) -> None:
        if isinstance(event, SampleReceived) and event.stream_id == 1:
            number = int.from_bytes(event.value[:12], "big")
            self.arrived.append((number, ns_to_seconds(self.network.now)))
        elif isinstance(event, DeliveryEnded):
            self.outcomes.append(event.outcome)

    def _disturb(self, source: int, node: int, now: int) -> Sequence[float]:
        return () if self.lost(source) else (0.0,)


@pytest.mark.parametrize("senses_carrier", [True, False])
def test_in_quiet_medium_one_answer_does_for_four_and_a_few_end_it(senses_carrier: bool) -> None:
    sea = Sea(1, senses_carrier=senses_carrier)
    end_s = sea.series()
    sea.network.run(until_s=BEGIN_S - 1)
    before = sea.frames()
    sea.network.run(until_s=end_s)
    sent, answers = (after - then for after, then in zip(sea.frames(), before, strict=True))
    assert sent == MESSAGES
    assert MESSAGES / 5 < answers < MESSAGES / 3
    sea.network.run(until_s=end_s + 60)
    assert sea.frames()[1] - before[1] <= answers + 4, "it asks for a next one that never comes"
    assert max(sea.latencies_s()) < 1.32
    sea.check()


def test_at_thirty_percent_loss_little_is_sent_for_nothing(count: Callable[[int], int]) -> None:
    sent = answers = 0
    seeds = count(SEEDS)
    for seed in range(seeds):
        sea = Sea(seed)
        rng = random.Random(seed)
        end_s = sea.series()
        sea.network.run(until_s=BEGIN_S - 1)
        before = sea.frames()
        sea.lost = lambda source, rng=rng: rng.random() < 0.3  # type: ignore[misc]
        sea.network.run(until_s=end_s + 600)
        sea.check()
        sent += sea.frames()[0] - before[0]
        answers += sea.frames()[1] - before[1]
    assert sent / seeds / MESSAGES < 1.75, "1.43 with a perfect answer, 2.04 with an ACK for each"
    assert answers / seeds / MESSAGES < 1.7


def test_lost_sample_is_asked_for_and_lost_answers_cost_nothing() -> None:
    sea = Sea(3)
    end_s = sea.series()
    sea.network.run(until_s=BEGIN_S + 10 * PERIOD_S - 1)
    before = sea.frames()[0]
    sea.lost = lambda source: source == 2
    sea.network.run(until_s=BEGIN_S + 14 * PERIOD_S - 1)
    assert sea.frames()[0] - before == 4, "nobody has asked, so nothing is missing"
    sea.lost = lambda source: source == 1
    sea.network.run(until_s=BEGIN_S + 14 * PERIOD_S + 2)
    sea.lost = lambda source: False
    sea.network.run(until_s=end_s + 60)
    sea.check()
    assert 3.5 < sorted(sea.latencies_s())[-1] < 4.5, "one was lost: asked for, and sent again"
    assert sorted(sea.latencies_s())[-2] < 1.32


@pytest.mark.parametrize("shift_s", [-6.0, -2.0, 3.0, 25.0])
def test_rhythm_that_changes_is_learned_anew_without_asking_in_vain(shift_s: float) -> None:
    sea = Sea(4)
    middle_s = sea.series(20)
    for number in range(20):
        sea.at(middle_s + shift_s + number * 1.5 * PERIOD_S)
    end_s = middle_s + shift_s + 300
    sea.network.run(until_s=BEGIN_S - 1)
    before = sea.frames()
    sea.network.run(until_s=end_s + 120)
    sent, answers = (after - then for after, then in zip(sea.frames(), before, strict=True))
    assert sent == 40
    assert answers < 28, "one for four, one for each until it is known, and a few at its two ends"
    assert max(sea.latencies_s()) < 1.32
    sea.check()


@pytest.mark.parametrize("jitter_s", [0.05, 0.2, 1.0])
def test_unsteady_rhythm_costs_no_more_than_answers_to_each(jitter_s: float) -> None:
    sea, rng = Sea(5), random.Random(5)
    for number in range(MESSAGES):
        sea.at(BEGIN_S + number * PERIOD_S + rng.uniform(0, jitter_s))
    sea.network.run(until_s=BEGIN_S - 1)
    before = sea.frames()
    sea.network.run(until_s=BEGIN_S + MESSAGES * PERIOD_S + 120)
    sent, answers = (after - then for after, then in zip(sea.frames(), before, strict=True))
    assert sent <= MESSAGES + 6
    assert answers <= MESSAGES + 6
    sea.check()


@pytest.mark.parametrize("node", [1, 2])
def test_node_that_restarts_in_the_middle_ends_the_rhythm_and_nothing_else(node: int) -> None:
    sea = Sea(6)
    end_s = sea.series(30)
    sea.network.at(BEGIN_S + 14.4 * PERIOD_S, lambda: sea.network.restart(node))
    sea.network.run(until_s=end_s + 200)
    assert [number for number, _ in sea.arrived] == list(range(33))
    assert sorted(sea.latencies_s())[-4] < 1.5
    assert sea.network.engine(1).is_idle
    assert sea.network.engine(2).is_idle


def test_silence_for_long_is_taken_for_that_of_somebody_who_is_gone() -> None:
    sea = Sea(7)
    end_s = sea.series()
    sea.network.run(until_s=BEGIN_S + 20 * PERIOD_S - 1)
    before = sea.frames()[0]
    sea.lost = lambda source: True
    sea.network.run(until_s=BEGIN_S + 35 * PERIOD_S)
    assert sea.frames()[0] - before > 15 + 5, "it repeats, as to anybody who does not answer"
    sea.lost = lambda source: False
    sea.network.run(until_s=end_s + 200)
    sea.check()


def _ack_bytes(sea: Sea) -> int:
    ledger = sea.network.engine(2).stats.ledger()
    return sum(each.transmitted_bytes for each in ledger if each.cause is Cause.ACK)


def test_large_sample_in_a_rhythm_is_not_asked_for() -> None:
    sea = Sea(5)
    end_s = sea.series(40)
    sea.large = {23: 4000}
    sea.network.run(until_s=BEGIN_S + 20 * PERIOD_S + 5)
    before = _ack_bytes(sea)
    sea.network.run(until_s=BEGIN_S + 26 * PERIOD_S - 1)
    assert len(sea.arrived) == 23, "it is still under way, and five wait behind it"
    assert _ack_bytes(sea) - before < 36, "38 where it is asked for"
    sea.network.run(until_s=end_s + 60)
    sea.check()
    assert max(sea.latencies_s()[33:]) < 1.32, "all but what was published as its last piece came"
