"""What a receiver that knows a rhythm asks for, how often, and when it stops."""

import pytest

from tests.core.arq.test_rhythm import LINK, TIMES
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.transport.reliable.receiving.watch import Watch

FRAME_NS = LINK.airtime_ns(14)
DOUBT_S = TIMES.doubt_ns / NS_PER_S


class Receiver:
    """Samples arrive in their order."""

    def __init__(self) -> None:
        self.watch = Watch()
        self.newest = -1

    def take(self, number: int, at_s: float, *, marked: bool = True) -> bool:
        """Take a sample; returns whether it needs no answer of its own."""
        at = seconds_to_ns(at_s)
        silent = self.watch.take(
            number,
            at=at,
            frame_ns=FRAME_NS,
            newest=number > self.newest,
            marked=marked,
            times=TIMES,
        )
        self.newest = max(self.newest, number)
        self.watch.plan(self.newest, is_whole=True, soon_at=at + FRAME_NS, times=TIMES)
        return silent

    def learn(self, samples: int, *, period_s: float = 10.0) -> None:
        """Take the first samples, each on the beat."""
        for number in range(samples):
            self.take(number, number * period_s)

    def asks_s(self) -> list[float]:
        """Ask until it is over; returns when."""
        asked = []
        while (at := self.watch.ask_at) is not None:
            asked.append(at / NS_PER_S)
            self.watch.asks(at, TIMES)
        return asked


def overdue_s(at_s: float) -> float:
    return at_s + FRAME_NS / NS_PER_S + DOUBT_S


def test_nothing_is_asked_for_before_the_rhythm_is_known() -> None:
    receiver = Receiver()
    assert receiver.take(0, 0) is False
    assert receiver.watch.ask_at is None
    assert receiver.take(1, 10) is False, "the publisher does not know yet that it is known"
    assert receiver.watch.ask_at is not None
    assert receiver.take(2, 20) is True


def test_next_sample_is_asked_for_when_it_is_overdue_and_then_a_round_trip_later() -> None:
    receiver = Receiver()
    receiver.learn(5)
    first, second, third, *_ = receiver.asks_s()
    assert first == pytest.approx(overdue_s(50), abs=1e-3)
    assert second == pytest.approx(first + TIMES.ack_slot_ns / NS_PER_S, abs=1e-3), "said twice"
    round_trip_s = TIMES.ask_round_trip_ns(FRAME_NS) / NS_PER_S
    assert third == pytest.approx(first + round_trip_s, abs=1e-3)


def test_asking_ends_and_sooner_where_little_was_missed() -> None:
    clean, lossy = Receiver(), Receiver()
    clean.learn(100)
    lossy.learn(2)
    for number in range(2, 100):
        late_s = 3 if number % 2 else 0
        lossy.take(number, 10 * number + late_s)
    asked, asked_by_lossy = clean.asks_s(), lossy.asks_s()
    assert 1 < len(asked) <= 3
    assert len(asked) < len(asked_by_lossy) < 40
    assert clean.watch.ask_at is None


def test_asking_waits_for_the_beat_when_a_sample_is_about_to_come() -> None:
    receiver = Receiver()
    receiver.learn(2)
    for number in range(2, 60):
        receiver.take(number, 10 * number + (3 if number % 2 else 0))
    asked = receiver.asks_s()
    beats = [overdue_s(600 + 10 * each) for each in range(3)]
    for beat_s in beats[1:]:
        before = [at for at in asked if beat_s - 2 < at < beat_s - 1e-6]
        assert not before, "an ACK on the air would meet the sample"
        assert any(at == pytest.approx(beat_s, abs=1e-3) for at in asked)


def test_late_sample_was_asked_for_and_is_no_beat() -> None:
    receiver = Receiver()
    receiver.learn(5)
    assert receiver.take(5, 53) is True
    assert receiver.asks_s()[0] == pytest.approx(overdue_s(60), abs=1e-3)


def test_unmarked_sample_on_the_beat_is_answered_and_goes_on_with_the_rhythm() -> None:
    receiver = Receiver()
    receiver.learn(5)
    assert receiver.take(5, 50.1, marked=False) is False
    assert receiver.watch.is_known


def test_unmarked_sample_off_the_beat_ends_the_rhythm() -> None:
    for number, at_s in ((5, 45), (5, 53), (3, 50)):
        receiver = Receiver()
        receiver.learn(5)
        assert receiver.take(number, at_s, marked=False) is False
        assert not receiver.watch.is_known
        assert receiver.watch.ask_at is None


def test_marked_sample_that_comes_too_early_begins_another_rhythm() -> None:
    receiver = Receiver()
    receiver.learn(5)
    assert receiver.take(5, 46) is True
    assert not receiver.watch.is_known
    receiver.take(6, 52)
    assert receiver.asks_s()[0] == pytest.approx(overdue_s(58), abs=1e-3)


def test_gap_is_asked_for_at_once() -> None:
    receiver = Receiver()
    receiver.learn(5)
    receiver.take(6, 60)
    soon_at = seconds_to_ns(60.5)
    receiver.watch.plan(6, is_whole=False, soon_at=soon_at, times=TIMES)
    assert receiver.watch.ask_at == soon_at
