"""Set-points by hand, at a rate that the channel carries: the last ones hold.

A slider moves many times a second, a frame takes a second to get there. So changes are collected:
the first goes at once, whatever changes within the next seconds goes together when they are over.
"""

from typing import Final

LEAST_PERIOD_S: Final = 3.0
"""Between two transmissions of set-points, s."""


class Setpoints:
    """The wanted set-points, and those that were sent."""

    def __init__(self) -> None:
        self.wanted: dict[str, float] = {}
        """By topic; what holds."""
        self._told: dict[str, float] = {}
        self._told_at_s = float("-inf")

    def set(self, topic: str, value: float) -> None:
        """Want another value."""
        self.wanted[topic] = value

    def reset(self) -> None:
        """Nothing is wanted, and sent set-points do not hold any more: others steer."""
        self.wanted.clear()
        self._told.clear()

    @property
    def waiting(self) -> dict[str, float]:
        """What was not sent to the vehicle yet."""
        return {
            topic: value for topic, value in self.wanted.items() if self._told.get(topic) != value
        }

    def due_in_s(self, now_s: float) -> float:
        """Return how long what waits has to wait, s."""
        return max(0.0, self._told_at_s + LEAST_PERIOD_S - now_s)

    def poll(self, now_s: float) -> dict[str, float]:
        """Return what to send now."""
        waiting = self.waiting
        if not waiting or self.due_in_s(now_s) > 0:
            return {}
        self._told |= waiting
        self._told_at_s = now_s
        return waiting
