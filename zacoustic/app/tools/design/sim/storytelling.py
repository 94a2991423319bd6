"""`zacoustic sim --story SEED`: a random scenario, and whether all invariants held."""

from collections.abc import Callable

import msgspec

from zacoustic.app.tools.design.sim.recorder import SimulationRecorder
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.testing.stories import INVARIANTS, Story, Telling, random_story
from zacoustic.testing.tally import SimulationResult, Tally


class StoryResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a random scenario."""

    violations: tuple[str, ...]
    """What must not have happened, one line each."""
    summary: str
    """The scenario in one line."""
    simulation: SimulationResult
    """The figures."""


def tell_story(
    seed: int,
    *,
    trace: Callable[[TraceRecord], None] | None = None,
    record: SimulationRecorder | None = None,
) -> StoryResult:
    """Run the random scenario of a seed, as the tests do.

    Args:
        seed: The seed.
        trace: Takes each trace record.
        record: Records the engines.
    """
    story = random_story(seed)
    tally = Tally({address: cast.table for address, cast in story.casts.items()})
    witnesses = [tally, *(make() for make in INVARIANTS)]
    make = Engine if record is None else record.make
    telling = Telling(story, witnesses, trace=trace, digest=True, build=make)
    if record is not None:
        record.network = telling.network
    telling.run()
    return StoryResult(
        violations=tuple(telling.violations()),
        summary=summary_of(story),
        simulation=tally.result(telling.network, story.until_s),
    )


def summary_of(story: Story) -> str:
    """Return a summary of a random scenario, one line."""
    faults = story.scenario.faults
    crashes = sum(len(spec.at_s) for spec in faults.crashes)
    worst = max((link.loss.frame for link in story.scenario.links if link.loss), default=0.0)
    lacking = [
        name
        for name, is_there in (
            ("addresses", story.modem.addressed),
            ("a check", story.modem.checked),
            ("frames", story.modem.framed),
            ("carrier sense", story.modem.senses_carrier),
        )
        if not is_there
    ]
    return (
        f"{len(story.casts)} nodes, {story.busy_s:g} s of faults and {story.calm_s:g} s of calm, "
        f"loss to {worst:.0%}, {crashes} crashes, {len(faults.blackouts)} blackouts, "
        f"modems without {' or '.join(lacking) or 'a flaw'}"
    )
