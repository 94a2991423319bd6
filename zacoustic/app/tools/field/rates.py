"""The rate of arrivals over the last ones: mean, shortest and longest time between two."""

import itertools
import statistics
from collections import deque

import msgspec


class Rate(msgspec.Struct, frozen=True, kw_only=True):
    """The rate of some arrivals."""

    samples: int
    """Arrivals in the window."""
    rate_hz: float
    """Arrivals per second."""
    min_s: float
    """Shortest time between two, s."""
    max_s: float
    """Longest time between two, s."""
    deviation_s: float
    """Standard deviation of the times between two, s."""


class RateMeter:
    """Measures the rate of arrivals.

    Args:
        window: Number of the last arrivals that count, at least 2.
    """

    def __init__(self, window: int) -> None:
        self._instants_s: deque[float] = deque(maxlen=window)
        self.total = 0
        """Arrivals so far."""

    def note(self, instant_s: float) -> None:
        """Note an arrival.

        Args:
            instant_s: Its instant, s, not before the last one's.
        """
        self._instants_s.append(instant_s)
        self.total += 1

    def rate(self) -> Rate | None:
        """Return the rate; None: less than two arrivals."""
        instants = list(self._instants_s)
        if len(instants) < 2 or instants[-1] <= instants[0]:
            return None
        gaps = [later - earlier for earlier, later in itertools.pairwise(instants)]
        return Rate(
            samples=len(instants),
            rate_hz=len(gaps) / (instants[-1] - instants[0]),
            min_s=min(gaps),
            max_s=max(gaps),
            deviation_s=statistics.pstdev(gaps),
        )
