"""Crosses of all mechanisms: nothing is lost, nothing comes twice, and everything ends."""

from collections.abc import Callable

import pytest

from tests.hostile.crossing import crossed
from tests.hostile.drive import Drive


@pytest.mark.parametrize(
    "seed",
    [
        21,  # a sealed receiver was restarted, and refused the rare tries of a silent fleet
        107,  # a receipt went to a publisher that was never in reach again
        329,  # a receipt that nobody took went on after its life, for ever
        346,  # time stood still: a proof was due, and did not go
    ],
)
def test_what_went_wrong_once(seed: int) -> None:
    assert Drive(crossed(seed)).run() == []


def test_whatever_crosses_nothing_is_lost_and_everything_ends(count: Callable[[int], int]) -> None:
    for seed in range(count(1000)):
        assert Drive(crossed(seed)).run() == [], seed
