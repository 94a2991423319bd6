"""Random scenarios for a fleet of real engines, and the invariants that must hold in each.

::

    story = random_story(1234)
    told = tell(story)
    assert not told.complaints, told.complaints[0]

- `story`: a random scenario: channel, faults, tables, traffic.
- `drawing`: one for each seed, `random_story`.
- `telling`: runs it on a `VirtualNetwork`. Every payload carries a *ticket*, which identifies an
  arrival in any case.
- `witness`: the checker; `invariants`: the checkers that complain; `tally`: counters.

`zacoustic sim --story SEED` runs the same scenario.
"""

from zacoustic.testing.stories.drawing import random_story
from zacoustic.testing.stories.invariants import INVARIANTS
from zacoustic.testing.stories.story import Cast, Lane, Shape, Story
from zacoustic.testing.stories.telling import Telling, Told, tell
from zacoustic.testing.stories.witness import Arrived, Publication, Run, Witness

__all__ = [
    "INVARIANTS",
    "Arrived",
    "Cast",
    "Lane",
    "Publication",
    "Run",
    "Shape",
    "Story",
    "Telling",
    "Told",
    "Witness",
    "random_story",
    "tell",
]
