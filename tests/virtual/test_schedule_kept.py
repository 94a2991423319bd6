"""A schedule in which clocks go wrong, nodes go, come and move: the others lose nothing by it."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest

from tests.virtual.slotted import Slotted
from zacoustic.core.schedule.access import Trouble

WRONG = 2
STATEMENT_S = 10.0
"""A host states its time this often, s."""


def ten_guards_s(fleet: Slotted) -> float:
    guards = [slot.guard_ns for slot in fleet.spec.timed_slots]
    return 10 * sum(guards) / len(guards) / 1e9


def jumping(seed: int, **settings: Any) -> Slotted:
    """Return a fleet with a clock that is wrong by ten guards from 300 s to 600 s."""
    by_s = ten_guards_s(Slotted(seed, **settings))
    jumps = [{"at_s": 300.0, "by_s": by_s}, {"at_s": 600.0, "by_s": -by_s}]
    return Slotted(seed, clocks={WRONG: {"jumps": jumps}}, **settings)


def test_nothing_collides_while_nothing_is_wrong(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        fleet = Slotted(seed, measured=seed % 2 == 0)
        fleet.run(300)
        assert len(fleet.sent) > 100, seed
        assert list(fleet.collisions()) == [], seed
        assert fleet.network.losses == {}, seed
        assert fleet.states == {}, seed


def test_the_oracle_sees_what_the_medium_loses() -> None:
    fleet = Slotted(1, clocks={node: {"error_s": None} for node in range(1, 6)}, auto=True)
    fleet.run(300)
    lost = {(frame.at_s, frame.node, receiver) for frame, _, receiver in fleet.collisions()}
    assert lost
    assert len(lost) == sum(fleet.network.losses.values())


@pytest.mark.parametrize(
    ("measured", "auto"),
    [
        (False, False),
        (True, True),
        pytest.param(False, True, marks=pytest.mark.soak),
        pytest.param(True, False, marks=pytest.mark.soak),
    ],
)
def test_clock_that_is_wrong_by_ten_guards_destroys_no_frame_of_others_and_heals(
    measured: bool, auto: bool, count: Callable[[int], int]
) -> None:
    for seed in range(count(100)):
        fleet = jumping(seed, auto=auto, measured=measured)
        fleet.run(800)
        assert list(fleet.collisions(apart_from=(WRONG,))) == [], seed
        back_s = fleet.times(WRONG, 600.0)[0] - 600.0
        assert back_s <= 3 * fleet.cycle_s, seed
        for node in set(fleet.addresses) - {WRONG}:
            times = fleet.times(node, 100.0)
            waits = [after - before for before, after in pairwise(times)]
            assert max(waits) <= 3 * fleet.cycle_s, seed


@pytest.mark.parametrize("auto", [pytest.param(False, marks=pytest.mark.soak), True])
def test_node_that_joins_with_a_wrong_clock_hears_that_it_is_wrong(
    auto: bool, count: Callable[[int], int]
) -> None:
    for seed in range(count(100)):
        off_s = ten_guards_s(Slotted(seed))
        fleet = Slotted(seed, auto=auto, absent=(WRONG,), clocks={WRONG: {"offset_s": off_s}})
        fleet.at(300.0, lambda fleet=fleet: fleet.network.start(WRONG))  # type: ignore[misc]
        fleet.run(600)
        assert list(fleet.collisions(apart_from=(WRONG,))) == [], seed
        assert fleet.times(WRONG) == [], seed


def test_clock_that_creeps_away_is_noticed_before_it_destroys_anything(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(100)):
        fleet = Slotted(seed, clocks={WRONG: {"drift_ppm": 2000.0}})
        fleet.run(900)
        assert list(fleet.collisions(apart_from=(WRONG,))) == [], seed
        told = [state for _, state in fleet.states[WRONG]]
        assert any(fault.trouble is Trouble.OUTSIDE for state in told for fault in state.faults), (
            seed
        )


def test_two_nodes_go_and_one_joins(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        fleet = Slotted(seed, strangers=1, absent=(6,), measured=seed % 2 == 0)

        def change(fleet: Slotted = fleet) -> None:
            fleet.network.crash(1)
            fleet.network.crash(3)
            fleet.network.start(6)

        fleet.at(300.0, change)
        fleet.run(500)
        assert list(fleet.collisions()) == [], seed
        # It listens for a cycle, and may have nothing to say at first.
        assert fleet.times(6)[0] - 300.0 <= 3 * fleet.cycle_s + 6.0, seed
        for node in (2, 4, 5):
            times = fleet.times(node, 290.0)
            assert max(b - a for a, b in pairwise(times)) <= 3 * fleet.cycle_s


def test_guard_that_no_longer_reaches_is_told_and_kept(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        fleet = Slotted(seed)
        first, second = fleet.spec.slots[0].owners[0], fleet.spec.slots[1].owners[0]
        x_m, y_m, _ = fleet.places[first]
        there = (x_m + 900.0, y_m + 900.0, 20.0)
        fleet.run(200)

        fleet.network.move(first, there)
        fleet.places[first] = there
        too_far_m = math.dist(there, fleet.places[second]) - fleet.spec.slots[0].range_m
        assert too_far_m > 0, seed
        fleet.run(500)
        # Both may lose their slots, and then contend for the open one, which may be too near a
        # slot as well; nobody else is hurt.
        assert list(fleet.collisions(250.0, apart_from=(first, second))) == [], seed
        for node in (first, second):
            assert any(at_s > 300.0 and source == node for at_s, source, _ in fleet.delivered), seed
        troubles = {
            (node, fault.node)
            for node, told in fleet.states.items()
            for _, state in told
            for fault in state.faults
            if fault.trouble is Trouble.FAR
        }
        # The instants of a modem may be wrong by a twentieth of a second.
        is_plain = too_far_m > 150.0
        assert not is_plain or {(second, first), (first, second)} & troubles, seed
        assert fleet.times(first, 300.0), seed
        assert fleet.times(second, 300.0), seed


def test_without_any_clock_auto_is_carrier_sense_and_comes_back() -> None:
    jumps = [{"at_s": 400.0, "by_s": 3.0e8}]
    unset = {"offset_s": -3.0e8, "jumps": jumps}
    fleet = Slotted(3, auto=True, clocks=dict.fromkeys(range(1, 6), unset))
    fleet.run(900)
    for node in fleet.addresses:
        assert fleet.times(node)[0] < 60.0
        first, *_, last = [state for _, state in fleet.states[node]]
        assert first.method == "carrier_sense"
        assert first.why
        assert (last.method, last.why) == ("schedule", "")
    assert list(fleet.collisions(400.0 + 2 * STATEMENT_S + 3 * fleet.cycle_s)) == []
    assert fleet.times(1, 800.0)
