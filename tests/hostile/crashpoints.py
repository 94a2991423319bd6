"""A run again and again, with a crash at each point where one may hurt.

A crash at a random instant rarely falls between two writes. So a first run counts the points: one
before and one after each commit of a journal, and each event for an application. Further runs
crash the node at one of them, or both ends at two, and the oracle says what did not hold. Until the
crash a run is the same as the first one, so each point is met.
"""

from typing import Final

import msgspec

from tests.hostile import fleet
from tests.hostile.drive import Drive
from tests.hostile.scenario import Hostile
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import (
    CallFailed,
    Event,
    GoalAnswered,
    GoalFailed,
    ResponseReceived,
    ResultReceived,
    SampleReceived,
)

REST_S: Final = 5.0
"""How long a node is down."""


class CrashPoint(msgspec.Struct, frozen=True):
    """A point of a run."""

    number: int
    """How many came before it."""
    node: int
    what: str
    """`commit`, `committed`, `event` or `told`."""
    event: str
    """Name of the event's class, empty at a commit."""


class Crashing(Drive):
    """A run with crashes at given points.

    Args:
        hostile: The scenario.
        at: Numbers of the points, in order; a later one counts in the run with the earlier crash.
    """

    def __init__(self, hostile: Hostile, at: tuple[int, ...] = ()) -> None:
        self.points: list[CrashPoint] = []
        self._at = at
        super().__init__(hostile)

    def _point(self, node: int, what: str, event: Event | None) -> None:
        if not hasattr(self, "network") or not self.network.now:
            return  # it is being made
        number = len(self.points)
        name = "" if event is None else type(event).__name__
        self.points.append(CrashPoint(number, node, what, name))
        if number in self._at:
            if event is not None and what == "event":
                self._not_told(node, event)
            self._kill(node, reboots=False)
            network = self.network
            network.at(network.now / NS_PER_S + REST_S, lambda: network.start(node))

    def _not_told(self, node: int, event: Event) -> None:
        """Excuse an event that the application is never told, since its node dies right before.

        The journal has a journalled sample, and its end, for a later life.
        """
        life = self.network.life(node)
        match event:
            case ResponseReceived() | CallFailed():
                self.oracle.excuse(node, life, "call", event.call_id)
            case GoalAnswered() | GoalFailed() | ResultReceived():
                self.oracle.excuse(node, life, "goal", event.goal)
            case SampleReceived() if event.stream_id == fleet.LIGHT:
                self.oracle.excuse_receiver(node, life, event.value)
            case _:
                pass


def points_of(hostile: Hostile) -> list[CrashPoint]:
    """Return the points of a run without crashes."""
    run = Crashing(hostile)
    violations = run.run()
    assert not violations, violations[0]
    return run.points


def crash_at(hostile: Hostile, *at: int) -> list[str]:
    """Run a scenario with crashes at points; return what must not have happened."""
    return Crashing(hostile, at).run()
