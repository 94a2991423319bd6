"""Several mechanisms with something for one node: together they take no longer than in turn."""

from collections.abc import Callable

import pytest

from tests.virtual.together import NEVER, PAIRS, Load, finished_s

MOST = 1.2
"""Time to finish, in parts of the sum of both alone."""
MOST_OF_FEW = 1.5
"""The same of a few runs only: in one of them chance may favour either."""


@pytest.fixture(scope="module")
def alone_s(count: Callable[[int], int]) -> dict[Load, float]:
    """How long each takes alone, summed up over the seeds, s."""
    return {load: _sum_s(count, (load,)) for load in Load}


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: " and ".join(each.value for each in pair))
def test_two_mechanisms_do_not_hold_each_other_back(
    count: Callable[[int], int], alone_s: dict[Load, float], pair: tuple[Load, Load]
) -> None:
    most = MOST if count(500) == 500 else MOST_OF_FEW
    assert _sum_s(count, pair) <= most * sum(alone_s[load] for load in pair)


def test_all_at_once_end_as_well(count: Callable[[int], int], alone_s: dict[Load, float]) -> None:
    assert _sum_s(count, tuple(Load)) <= MOST * sum(alone_s.values())


def _sum_s(count: Callable[[int], int], loads: tuple[Load, ...]) -> float:
    times_s = {seed: finished_s(seed, loads) for seed in range(count(500))}
    assert NEVER not in times_s.values(), times_s
    return sum(times_s.values())
