"""Blackouts: who is concerned, and which instants they cover."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.channel.faults.blackout import BlackoutSpec, Darkness
from zacoustic.channel.medium import Medium
from zacoustic.channel.scenario import Scenario

S = 1_000_000_000
Line = Callable[..., Scenario]


def test_a_node_is_cut_off_from_all_and_a_pair_only_from_each_other() -> None:
    node = BlackoutSpec(node=2, from_s=0, to_s=1)
    pair = BlackoutSpec(pair=(1, 2), from_s=0, to_s=1)
    assert [node.concerns(*way) for way in ((1, 2), (2, 3), (1, 3))] == [True, True, False]
    assert [pair.concerns(*way) for way in ((1, 2), (2, 1), (2, 3))] == [True, True, False]


@given(
    st.integers(0, 50), st.integers(1, 20), st.one_of(st.none(), st.integers(21, 60)),
    st.integers(0, 300), st.integers(1, 30),
)  # fmt: skip
def test_a_blackout_covers_what_meets_any_of_its_repetitions(
    begin: int, length: int, period: int | None, start: int, lasts: int
) -> None:
    spec = BlackoutSpec(node=1, from_s=begin, to_s=begin + length, every_s=period)
    repeats = [begin] if period is None else [begin + period * number for number in range(20)]
    expected = any(start < each + length and start + lasts > each for each in repeats)
    assert Darkness([spec], None).covers(start * S, (start + lasts) * S) == expected


def test_faults_end_and_blackouts_with_them() -> None:
    spec = BlackoutSpec(node=1, from_s=0, to_s=5, every_s=10)
    darkness = Darkness([spec], until_s=22.0)
    assert darkness.covers(21 * S, 22 * S)
    assert not darkness.covers(22 * S, 23 * S)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"from_s": 0, "to_s": 1}, "node is missing; allowed: exactly one of node and pair"),
        ({"node": 1, "pair": (1, 2), "from_s": 0, "to_s": 1}, "exactly one"),
        ({"pair": (2, 2), "from_s": 0, "to_s": 1}, "allowed: two different nodes"),
        ({"node": 1, "from_s": 2, "to_s": 2}, "to_s is 2; allowed: above from_s"),
        ({"node": 1, "from_s": 0, "to_s": 5, "every_s": 5}, "every_s is 5; allowed: above"),
    ],
)
def test_a_blackout_that_makes_no_sense_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        BlackoutSpec(**settings)


def test_what_a_blackout_hides_is_no_sound_at_all_there(line: Line) -> None:
    faults = {"blackouts": [{"pair": [1, 2], "from_s": 0, "to_s": 60}]}
    medium = Medium(line(0, 500, 1000, channel="none", faults=faults))
    emission = medium.transmit(1, 20, 0)
    assert [arrival.node for arrival in emission.arrivals] == [3]
    assert emission.unheard == (2,)
    later = medium.transmit(1, 20, 60 * S)
    assert [arrival.node for arrival in later.arrivals] == [2, 3]


def test_a_direction_may_be_weaker_than_the_other(line: Line) -> None:
    links = [{"from": 1, "to": 2, "gain_db": -30}]
    medium = Medium(line(0, 500, channel="awgn", links=links))
    there = medium.transmit(1, 20, 0).arrivals[0]
    back = medium.transmit(2, 20, 60 * S).arrivals[0]
    assert back.snr_db - there.snr_db == pytest.approx(30)
    assert back.effective_snr_db - there.effective_snr_db == pytest.approx(30)


def test_received_frames_may_be_late_by_any_time_up_to_the_jitter(line: Line) -> None:
    faults = {"jitter_s": 0.5, "until_s": 5000, "duplicate": 1, "duplicate_after_s": [1, 2]}
    medium = Medium(line(0, 500, channel="none", faults=faults))
    receptions = []
    for second in range(0, 10_000, 10):
        (arrival,) = medium.transmit(1, 20, second * S).arrivals
        receptions.append(medium.finish(arrival))
    delays_s = [reception.delay_s for reception in receptions]
    assert 0 <= min(delays_s[:500]) < 0.02 < 0.48 < max(delays_s[:500]) <= 0.5
    again_s = [reception.duplicates_after_s[0] for reception in receptions[:500]]
    assert 1 <= min(again_s) < 1.05 < 1.95 < max(again_s) <= 2
    assert set(delays_s[500:]) == {0.0}
    assert not any(reception.duplicates_after_s for reception in receptions[500:])


def test_losses_end_when_they_are_told_to(line: Line) -> None:
    medium = Medium(line(0, 500, channel="none", loss={"frame": 1.0, "until_s": 100}))
    received = []
    for second in range(0, 200, 10):
        (arrival,) = medium.transmit(1, 20, second * S).arrivals
        received.append(medium.finish(arrival).is_received)
    assert received == [False] * 10 + [True] * 10
