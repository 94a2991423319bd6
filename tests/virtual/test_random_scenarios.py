"""Random scenarios: whatever goes wrong, nothing is altered, doubled, mixed up or quietly lost."""

from collections.abc import Callable

import msgspec
import pytest

from tests.conftest import SOAK
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import SampleReceived
from zacoustic.testing.scenarios import (
    INVARIANTS,
    Checker,
    RandomScenario,
    draw_scenario,
    run_scenario,
)
from zacoustic.testing.scenarios.invariants import InOrder, NothingLost, NothingTwice
from zacoustic.testing.scenarios.running import ScenarioRun
from zacoustic.testing.virtual import VirtualNetwork

BLOCKS = range(10)
COSTLY = 6
"""This scenario takes as long as the other seven of a share together: in a soak only."""


@pytest.mark.parametrize("number", BLOCKS)
def test_all_holds_in_any_scenario(count: Callable[[int], int], number: int) -> None:
    for seed in range(number, count(1_500), len(BLOCKS)):
        if seed == COSTLY and not SOAK:
            continue
        violations = run_scenario(draw_scenario(seed)).violations
        again = f"zacoustic sim --random {seed}"
        assert not violations, f"{again}: {len(violations)} complaints, {violations[0]}"


@pytest.mark.soak  # ten seconds
def test_a_busy_fleet_delivers_what_waits() -> None:
    # Five nodes with a backlog: they do not wait for pauses of objects that nobody sends.
    assert not run_scenario(draw_scenario(540)).violations


def test_last_repetition_before_the_end_does_not_wait_for_a_full_turn() -> None:
    # Due at once and refused at once: the engine's time-out stood still.
    assert not run_scenario(draw_scenario(1515)).violations


def test_a_late_double_of_an_unknown_life_does_not_come_behind_later_lives() -> None:
    # Six seconds late, from a life of which this receiver had heard nothing before it heard a later
    # one: held for ten minutes, and then handed on.
    assert not run_scenario(draw_scenario(1445)).violations


def test_scenarios_are_repeatable_and_differ() -> None:
    digests = [run_scenario(draw_scenario(seed), digest=True).digest for seed in (5, 5, 7)]
    assert digests[0] == digests[1] != digests[2]


def test_scenarios_are_as_bad_as_they_promise() -> None:
    faults = [draw_scenario(seed).scenario for seed in range(200)]
    assert max(link.loss.frame for each in faults for link in each.links if link.loss) > 0.55
    assert max(len(spec.at_s) for each in faults for spec in each.faults.crashes) == 10
    assert max(b.to_s - b.from_s for each in faults for b in each.faults.blackouts) > 1500
    assert max(each.faults.corrupt for each in faults) > 0.2
    assert any(
        abs(jump.by_s) > 3e8 for each in faults for c in each.faults.clocks for jump in c.jumps
    )
    assert {len(each.nodes) for each in faults} == {2, 3, 4, 5}


class Lying(ScenarioRun):
    """Tells witnesses of a sample twice, of no sample, or in disorder."""

    way = ""

    def _take(self, node: int, event: object) -> None:
        if isinstance(event, SampleReceived) and self.way == "deaf":
            return
        super()._take(node, event)  # type: ignore[arg-type]
        if isinstance(event, SampleReceived) and self.way == "twice":
            self.network.at(
                self.network.now / 1e9 + 100, lambda: super(Lying, self)._take(node, event)
            )


def draw_reliable_scenario() -> RandomScenario:
    """Return the first scenario with reliable streams and few nodes, and with no crash."""
    for seed in range(1000):
        drawn = draw_scenario(seed)
        if len(drawn.casts) == 2 and 30 in drawn.casts[1].lanes:
            faults = msgspec.structs.replace(drawn.scenario.faults, crashes=())
            scenario = msgspec.structs.replace(drawn.scenario, faults=faults)
            spec = drawn.casts[1].lanes[30].spec
            if spec.qos.lifespan_s is None and spec.qos.depth == 1000:
                return msgspec.structs.replace(drawn, scenario=scenario)
    raise AssertionError


@pytest.mark.parametrize(
    ("way", "invariant", "expected"),
    [
        ("deaf", NothingLost, "is delivered; [1] never got it"),
        ("twice", NothingTwice, "a second time"),
        ("twice", InOrder, "which is younger"),
    ],
)
def test_invariants_complain(way: str, invariant: type[Checker], expected: str) -> None:
    scenario_run = Lying(draw_reliable_scenario(), [invariant()])
    scenario_run.way = way
    scenario_run.run()
    assert any(expected in violation for violation in scenario_run.violations()), (
        scenario_run.violations()
    )


def test_a_sample_that_nobody_published_is_a_violation() -> None:
    class Altering(ScenarioRun):
        def _take(self, node: int, event: object) -> None:
            if isinstance(event, SampleReceived) and isinstance(event.value, bytes):
                event = msgspec.structs.replace(event, value=event.value[:-1] + b"?")
            super()._take(node, event)  # type: ignore[arg-type]

    scenario_run = Altering(draw_reliable_scenario(), [make() for make in INVARIANTS])
    scenario_run.run()
    assert any("published: Publication" in line for line in scenario_run.misread)


def test_a_scenario_takes_engines_of_ones_own() -> None:
    built: list[int] = []

    class Counted(Engine):
        def __init__(self, **settings: object) -> None:
            super().__init__(**settings)  # type: ignore[arg-type]
            built.append(self.address)

    run_scenario(draw_reliable_scenario(), (), build=Counted)
    assert sorted(built) == [1, 2]
    assert VirtualNetwork is not None
