"""How much a gateway was on the air, over the last minutes: what a chart of it shows."""

from collections import deque
from typing import Final

import msgspec

from zacoustic.app.tools.watch.views import GatewayView

STEP_S: Final = 2.0
"""Time between two points, s."""
SPAN_S: Final = 600.0
"""So long ago is the first point at most, s."""
_SMOOTHED_S: Final = 20.0


class Point(msgspec.Struct, frozen=True):
    """One point of a chart."""

    unix_s: float
    """When."""
    share: float
    """Of the time before it, how much was airtime, 0…1."""


class History:
    """Points of one gateway; `note` at least every `STEP_S`."""

    def __init__(self) -> None:
        self.points: deque[Point] = deque(maxlen=round(SPAN_S / STEP_S))
        """The oldest first."""
        self._counted: deque[tuple[float, float]] = deque()

    def note(self, view: GatewayView) -> None:
        """Take what holds now; too early for a point, it is left out."""
        counted = self._counted
        if counted and view.airtime_s < counted[-1][1]:
            counted.clear()  # another life of it: counters begin anew
        if counted and view.unix_s - counted[-1][0] < STEP_S * 0.9:
            return
        counted.append((view.unix_s, view.airtime_s))
        while len(counted) > 2 and counted[1][0] <= view.unix_s - _SMOOTHED_S:
            counted.popleft()
        began_s, airtime_s = counted[0]
        if view.unix_s > began_s:
            share = (view.airtime_s - airtime_s) / (view.unix_s - began_s)
            self.points.append(Point(view.unix_s, round(min(max(share, 0.0), 1.0), 4)))
