"""`zacoustic sim --random SEED`: a random scenario, and whether all invariants held."""

from collections.abc import Callable

import msgspec

from zacoustic.app.tools.design.sim.recorder import SimulationRecorder
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.testing.counters import Counters, SimulationResult
from zacoustic.testing.scenarios import INVARIANTS, RandomScenario, ScenarioRun, draw_scenario


class ScenarioResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a random scenario."""

    violations: tuple[str, ...]
    """Violated invariants, one line each."""
    summary: str
    """The scenario in one line."""
    simulation: SimulationResult
    """The figures."""


def run_random_scenario(
    seed: int,
    *,
    trace: Callable[[TraceRecord], None] | None = None,
    record: SimulationRecorder | None = None,
) -> ScenarioResult:
    """Run the random scenario of a seed, like the tests.

    Args:
        seed: The seed.
        trace: Takes each trace record.
        record: Records the engines.
    """
    drawn = draw_scenario(seed)
    counters = Counters({address: cast.table for address, cast in drawn.casts.items()})
    checkers = [counters, *(make() for make in INVARIANTS)]
    make = Engine if record is None else record.make
    scenario_run = ScenarioRun(drawn, checkers, trace=trace, digest=True, build=make)
    if record is not None:
        record.network = scenario_run.network
    scenario_run.run()
    return ScenarioResult(
        violations=tuple(scenario_run.violations()),
        summary=summary_of(drawn),
        simulation=counters.result(scenario_run.network, drawn.until_s),
    )


def summary_of(drawn: RandomScenario) -> str:
    """Return a summary of a random scenario, one line."""
    faults = drawn.scenario.faults
    crashes = sum(len(spec.at_s) for spec in faults.crashes)
    worst = max((link.loss.frame for link in drawn.scenario.links if link.loss), default=0.0)
    lacking = [
        name
        for name, is_there in (
            ("addresses", drawn.modem.addressed),
            ("a check", drawn.modem.checked),
            ("frames", drawn.modem.framed),
            ("carrier sense", drawn.modem.senses_carrier),
        )
        if not is_there
    ]
    return (
        f"{len(drawn.casts)} nodes, {drawn.busy_s:g} s of faults and {drawn.calm_s:g} s of calm, "
        f"loss to {worst:.0%}, {crashes} crashes, {len(faults.blackouts)} blackouts, "
        f"modems without {' or '.join(lacking) or 'a flaw'}"
    )
