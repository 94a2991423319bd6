"""Random scenarios over every kind of link; the oracle knows only what applications know."""

from collections.abc import Callable

import pytest

from tests.hostile.drive import Drive
from tests.hostile.scenario import KINDS, hostile

SCENARIOS = 2_000
BLOCKS = 4


@pytest.mark.parametrize("block", range(BLOCKS))
def test_all_holds_whatever_is_done_to_a_fleet(count: Callable[[int], int], block: int) -> None:
    red = {}
    for seed in range(block, count(SCENARIOS), BLOCKS):
        violations = Drive(hostile(seed)).run()
        if violations:
            red[f"python -m tests.hostile {seed}"] = violations[0]
    assert not red


@pytest.mark.parametrize("seed", [13, 97, 399, 471, 615, 1661])
def test_scenarios_that_have_found_something(seed: int) -> None:
    """What each has found.

    Strangers' counts and subscriptions (13, 97); goals that came again late (399, 471, 615);
    samples in a journal without the count of their stream (1661).
    """
    assert not Drive(hostile(seed)).run()


def test_scenarios_are_of_every_kind_and_repeatable() -> None:
    drawn = [hostile(seed) for seed in range(200)]
    assert {each.kind for each in drawn} == set(KINDS)
    assert {each.modem.senses_carrier for each in drawn} == {False, True}
    assert {each.modem.addressed for each in drawn} == {False, True}
    assert {each.modem.checked for each in drawn} == {False, True}
    runs = [Drive(hostile(8)) for _ in range(2)]
    for drive in runs:
        drive.run()
    assert runs[0].frames == runs[1].frames > 0
    assert runs[0].oracle.counts == runs[1].oracle.counts
