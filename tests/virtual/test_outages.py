"""After outages of hours each estimate is within its bound, and an emergency arrives soon."""

from collections.abc import Callable

import pytest

from tests.virtual.outages import run
from tests.virtual.silentpeer import Way

LATEST_S = 25.0
"""After the bad minute; docs/operations.md states that pauses are 20 s at most."""


@pytest.mark.parametrize("way", Way)
def test_three_outages_poison_no_estimate_and_delay_no_emergency(
    way: Way, count: Callable[[int], int]
) -> None:
    for seed in range(count(200)):
        result = run(seed, way)
        assert max(result.estimates_s) <= result.bound_s, seed
        assert result.stop_s <= LATEST_S, seed
        assert result.lost == 0, seed
