"""The confidence intervals of a campaign: Student's t."""

import random

import pytest

from zacoustic.app.tools.design.campaign.interval import interval_of, student_t

# Two-sided quantiles as any table of the distribution has them.
KNOWN = {
    (0.90, 1): 6.314, (0.95, 1): 12.706, (0.99, 1): 63.657, (0.95, 2): 4.303, (0.99, 2): 9.925,
    (0.95, 3): 3.182, (0.95, 4): 2.776, (0.90, 5): 2.015, (0.95, 9): 2.262, (0.99, 10): 3.169,
    (0.95, 29): 2.045, (0.99, 60): 2.660, (0.95, 120): 1.980, (0.95, 99_999): 1.960,
}  # fmt: skip


@pytest.mark.parametrize(("confidence", "degrees"), KNOWN)
def test_quantiles_are_those_of_the_tables(confidence: float, degrees: int) -> None:
    quantile = student_t(confidence, degrees)
    assert quantile == pytest.approx(KNOWN[confidence, degrees], abs=6e-4)


@pytest.mark.parametrize("seeds", [2, 5, 10])
def test_an_interval_has_the_true_mean_as_often_as_it_says(seeds: int) -> None:
    rng = random.Random(seeds)
    hits = 0
    for _ in range(4000):
        interval = interval_of([rng.gauss(3.0, 2.0) for _ in range(seeds)], 0.95)
        assert interval is not None
        assert interval.low is not None
        assert interval.high is not None
        hits += interval.low <= 3.0 <= interval.high
    assert hits / 4000 == pytest.approx(0.95, abs=0.012)


def test_one_seed_says_nothing_of_the_others() -> None:
    interval = interval_of([0.5], 0.95)
    assert interval is not None
    assert (interval.count, interval.mean, interval.low, interval.high) == (1, 0.5, None, None)
    assert interval_of([], 0.95) is None
