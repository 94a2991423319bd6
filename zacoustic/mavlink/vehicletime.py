"""The time of the vehicle on shore: commands carry their instant without a common clock.

The vehicle's bridge has a clock that starts at a random time, so that no time is used again after a
restart. Each report carries it to shore, where it is behind by the delay that the report's age does
not count. So a command seems older than it is, never younger, apart from half a second of rounding.
"""

from collections import deque
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns

PERIOD_MS: Final = 2**32
"""The clock begins again at 0 after this time: 49 days."""
_REPORTS: Final = 16
# Reports that differ by more are of two runs of the vehicle's bridge.
_JUMP_NS: Final = seconds_to_ns(300.0)
# Stamps that differ by less are of one run.
_JUMP_MS: Final = _JUMP_NS // 1_000_000


class VehicleTime:
    """The time of a vehicle, from its last reports."""

    def __init__(self) -> None:
        # For each report, the instant at which the clock was 0; the earliest had the least delay.
        self._origins: deque[int] = deque(maxlen=_REPORTS)
        self._stamped: int | None = None

    def take(self, time_ms: int, at: int) -> None:
        """Take a report.

        Args:
            time_ms: Its time, ms.
            at: The instant for which it is true.
        """
        origin_at = at - time_ms * 1_000_000
        if self._origins and abs(origin_at - self._origins[-1]) > _JUMP_NS:
            self._origins.clear()
        self._origins.append(origin_at)

    def stamp(self, now: int) -> int | None:
        """Return the time of a command, ms: later than any before; None: not known."""
        if not self._origins:
            return None
        time = (now - min(self._origins)) // 1_000_000 % PERIOD_MS
        if self._stamped is not None and 0 <= later_by(self._stamped, time) < _JUMP_MS:
            time = (self._stamped + 1) % PERIOD_MS
        self._stamped = time
        return time


def later_by(time: int, other: int) -> int:
    """Return how much later one of two times is, ms; negative: it is earlier."""
    half = PERIOD_MS // 2
    return (time - other + half) % PERIOD_MS - half
