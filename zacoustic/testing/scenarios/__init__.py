"""Random scenarios for a fleet of real engines, and the invariants that hold in each.

::

    drawn = draw_scenario(1234)
    result = run_scenario(drawn)
    assert not result.violations, result.violations[0]

- `randomscenario`: a random scenario: channel, faults, tables, traffic.
- `drawing`: draws one for each seed, `draw_scenario`.
- `running`: runs it on a `VirtualNetwork`. Every payload carries a *ticket*, which identifies its
  arrival.
- `checker`: the contract of checkers; `invariants`: checkers that report violations; `counters`: a
  checker that counts.

`zacoustic sim --random SEED` runs the same scenario.
"""

from zacoustic.testing.scenarios.checker import Arrived, Checker, Publication, Run
from zacoustic.testing.scenarios.drawing import draw_scenario
from zacoustic.testing.scenarios.invariants import INVARIANTS
from zacoustic.testing.scenarios.randomscenario import Cast, Lane, RandomScenario, Shape
from zacoustic.testing.scenarios.running import RunResult, ScenarioRun, run_scenario

__all__ = [
    "INVARIANTS",
    "Arrived",
    "Cast",
    "Checker",
    "Lane",
    "Publication",
    "RandomScenario",
    "Run",
    "RunResult",
    "ScenarioRun",
    "Shape",
    "draw_scenario",
    "run_scenario",
]
