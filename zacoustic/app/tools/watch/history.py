"""The utilisation of a gateway over the last minutes, for a chart."""

from collections import deque
from typing import Final

import msgspec

from zacoustic.app.tools.watch.views import GatewayView

STEP_S: Final = 2.0
"""Time between two points, s."""
SPAN_S: Final = 600.0
"""Longest time in the chart, s."""
_SMOOTHED_S: Final = 20.0


class Point(msgspec.Struct, frozen=True):
    """One point of a chart."""

    unix_s: float
    """Instant, s since 1970."""
    share: float
    """Share of airtime in the time before it, 0…1."""


class History:
    """Points of one gateway; `note` at least every `STEP_S`."""

    def __init__(self) -> None:
        self.points: deque[Point] = deque(maxlen=round(SPAN_S / STEP_S))
        """The oldest first."""
        self._counted: deque[tuple[float, float]] = deque()

    def note(self, view: GatewayView) -> None:
        """Take a present view; ignored if it is too early for a point."""
        counted = self._counted
        if counted and view.whole.airtime_s < counted[-1][1]:
            counted.clear()  # it was restarted: counters begin at 0
        if counted and view.unix_s - counted[-1][0] < STEP_S * 0.9:
            return
        counted.append((view.unix_s, view.whole.airtime_s))
        while len(counted) > 2 and counted[1][0] <= view.unix_s - _SMOOTHED_S:
            counted.popleft()
        began_s, airtime_s = counted[0]
        if view.unix_s > began_s:
            share = (view.whole.airtime_s - airtime_s) / (view.unix_s - began_s)
            self.points.append(Point(view.unix_s, round(min(max(share, 0.0), 1.0), 4)))
