"""Burst data for a node whose computer is off cost little, and are there soon when it is back."""

from collections.abc import Callable
from statistics import mean

from tests.links.evologics.driver.absent import Absence
from tests.virtual.absent import EVERYTHING, Kind


def test_one_of_everything_costs_little_and_comes_soon(count: Callable[[int], int]) -> None:
    outcomes = [Absence(seed, EVERYTHING).run() for seed in range(count(300))]
    assert mean(each.frames for each in outcomes) <= 42
    assert mean(each.airtime_s for each in outcomes) <= 30
    last_s = sorted(max(each.arrived_s.values()) for each in outcomes)
    assert last_s[int(0.95 * len(last_s))] <= 60


def test_an_object_alone_is_asked_about_in_few_bytes(count: Callable[[int], int]) -> None:
    outcomes = [Absence(seed, [Kind.OBJECT]).run() for seed in range(count(300))]
    assert mean(each.airtime_s for each in outcomes) <= 15
    last_s = sorted(max(each.arrived_s.values()) for each in outcomes)
    assert last_s[int(0.95 * len(last_s))] <= 60


def test_an_emergency_is_there_at_once(count: Callable[[int], int]) -> None:
    outcomes = [Absence(seed, list(Kind)).run() for seed in range(count(300))]
    first_s = sorted(each.arrived_s[Kind.EMERGENCY] for each in outcomes)
    assert first_s[int(0.95 * len(first_s))] <= 10
