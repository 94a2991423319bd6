"""The simulator against theory: ALOHA, slotted ALOHA with delays, carrier sense."""

import math
from collections.abc import Callable

import pytest

from tests.virtual.throughput import (
    Point,
    carrier_sense,
    carrier_sense_theory,
    pure_aloha,
    pure_aloha_theory,
    slotted_aloha,
    slotted_aloha_theory,
)

SHARE = 0.05
FULL_ONLY = pytest.mark.soak
"""Points of a curve of which `make test` measures the ends or one."""
ARRIVALS = 2_000


def check(point: Point, theory: float) -> None:
    """Within 5 %, and three standard deviations of so few arrivals."""
    chance = 3.0 / math.sqrt(point.arrived)
    assert point.throughput == pytest.approx(theory, rel=SHARE + chance)


def messages(count: Callable[[int], int], load: float, throughput: float) -> int:
    """How many it takes to see enough arrive."""
    return round(max(150, count(ARRIVALS)) * load / throughput)


@pytest.mark.parametrize("load", [0.2, 0.5, pytest.param(1.0, marks=FULL_ONLY)])
def test_pure_aloha(load: float, count: Callable[[int], int]) -> None:
    point = pure_aloha(load, messages(count, load, pure_aloha_theory(load)))
    check(point, pure_aloha_theory(point.offered))


# Delay, best guard, load: the slot's guard decides what slots are worth.
@pytest.mark.parametrize(
    ("delay", "guard", "load", "known"),
    [
        pytest.param(0.1, 0.1, 0.9, 0.3344, marks=FULL_ONLY),
        pytest.param(0.25, 0.225, 0.8, 0.2974, marks=FULL_ONLY),
        (0.5, 0.4, 0.7, 0.2531),
        pytest.param(1.0, 0.6, 0.55, 0.1995, marks=FULL_ONLY),
        (2.0, 0.4, 0.525, 0.1880),
    ],
)
def test_slotted_aloha_with_delays(
    delay: float, guard: float, load: float, known: float, count: Callable[[int], int]
) -> None:
    assert slotted_aloha_theory(delay, guard, load) == pytest.approx(known, rel=0.01)
    point = slotted_aloha(delay, guard, load, messages(count, load, known))
    check(point, slotted_aloha_theory(delay, guard, point.offered))


def test_slots_as_long_as_a_frame_gain_nothing(count: Callable[[int], int]) -> None:
    point = slotted_aloha(2.0, 0.0, 0.5, messages(count, 0.5, 0.184))
    check(point, pure_aloha_theory(point.offered))


@pytest.mark.parametrize(
    ("load", "delay"),
    [
        (0.5, 0.01),
        (0.5, 0.1),
        (1.0, 1.0),
        *(
            pytest.param(load, delay, marks=FULL_ONLY)
            for load, delay in ((0.5, 0.5), (0.5, 1.0), (1.0, 0.01), (1.0, 0.1), (1.0, 0.5))
        ),
    ],
)
def test_carrier_sense_at_several_delays(
    load: float, delay: float, count: Callable[[int], int]
) -> None:
    theory = carrier_sense_theory(delay, load)
    point = carrier_sense(delay, load, messages(count, load, theory))
    check(point, carrier_sense_theory(delay, point.load))
