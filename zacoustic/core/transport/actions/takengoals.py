"""The goals that a server remembers, by client; their number is bounded, whoever sends them."""

from collections.abc import Collection
from typing import Final

from zacoustic.core.transport.actions.servedgoal import ServedGoal
from zacoustic.core.wire.goals import GOAL_NUMBERS, GoalKey

MOST_OF_ONE: Final = 2 * GOAL_NUMBERS
"""The most goals of one client on one stream, enough for two boot epochs."""
MOST_GOALS: Final = 1024
"""The most goals of all clients, including those under forged addresses."""


class TakenGoals:
    """All goals of one server."""

    def __init__(self) -> None:
        self._by_client: dict[tuple[int, int], dict[GoalKey, ServedGoal]] = {}
        self._all: dict[GoalKey, ServedGoal] = {}

    def get(self, key: GoalKey) -> ServedGoal | None:
        """Return a known goal, or None."""
        return self._all.get(key)

    def values(self) -> Collection[ServedGoal]:
        """Return all goals."""
        return self._all.values()

    def of(self, key: GoalKey) -> Collection[ServedGoal]:
        """Return the goals that a goal's client has sent on its stream, in all its boot epochs."""
        return self._by_client.get((key.client, key.stream_id), {}).values()

    def has_room(self, key: GoalKey) -> bool:
        """Return whether there is room for a new goal."""
        return len(self.of(key)) < MOST_OF_ONE and len(self._all) < MOST_GOALS

    def add(self, goal: ServedGoal) -> None:
        """Add a goal."""
        key = goal.key
        self._all[key] = goal
        self._by_client.setdefault((key.client, key.stream_id), {})[key] = goal

    def remove(self, goal: ServedGoal) -> None:
        """Remove a goal."""
        key = goal.key
        place = (key.client, key.stream_id)
        del self._all[key]
        del self._by_client[place][key]
        if not self._by_client[place]:
            del self._by_client[place]
