"""A crash at each point of a run: at each commit and each event, of either end."""

from typing import Final

import pytest

from tests.conftest import SOAK
from tests.hostile.crashpoints import crash_at, points_of
from tests.hostile.crossing import crossed

_POINTS: Final = 400 if SOAK else 12
"""About the most points of a run at which a node is crashed."""


@pytest.mark.parametrize(
    "seed",
    [*range(3), *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(3, 12))],
)
@pytest.mark.timeout(1800)
def test_a_crash_at_any_point_loses_nothing(seed: int) -> None:
    points = points_of(crossed(seed, is_brief=True))
    step = max(1, len(points) // _POINTS)
    for point in points[seed % step :: step]:
        assert crash_at(crossed(seed, is_brief=True), point.number) == [], point


def test_a_node_that_restarts_hears_a_sealed_one_that_answers_rarely() -> None:
    """Its marks refused the next sixteen answers, one in each quarter of an hour."""
    assert crash_at(crossed(5, is_brief=True), 185) == []
