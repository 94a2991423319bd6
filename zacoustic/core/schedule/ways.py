"""How long sound takes to another node, by how soon it answers: half of the round trip.

Of an answer that comes at once, this node knows when it has asked, how long the other node lingers
and how long the answer's own frame takes; half of the rest is the way. What delays an answer makes
that longer, and a rider on a frame that went anyway shorter by a part of the linger. So of the last
answers the second shortest counts, and the difference of the two is its error.
"""

from collections import deque
from typing import Final

from zacoustic.core.base.clock import NS_PER_S

WAY_DRIFT: Final = 4 / 1500
"""A distance becomes wrong as fast as two vehicles approach: 4 m/s in 1500 m/s."""
_MOST: Final = 8
_LEAST_ERROR_NS: Final = NS_PER_S // 50


class Ways:
    """The propagation delay to one node, as its answers show it."""

    __slots__ = ("_answers",)

    def __init__(self) -> None:
        self._answers: deque[tuple[int, int]] = deque(maxlen=_MOST)

    def answered(self, way_ns: int, at: int) -> None:
        """Take an answer: half of the round trip, ns, without what else it consists of."""
        self._answers.append((max(0, way_ns), at))

    def way(self, now: int) -> tuple[int, int] | None:
        """Return the delay and its largest error, ns; None: it has never answered."""
        if not self._answers:
            return None
        drifted = sorted((way_ns, round((now - at) * WAY_DRIFT)) for way_ns, at in self._answers)
        way_ns, drift_ns = drifted[min(1, len(drifted) - 1)]
        spread_ns = way_ns - drifted[0][0]
        return way_ns, max(_LEAST_ERROR_NS, spread_ns) + drift_ns
