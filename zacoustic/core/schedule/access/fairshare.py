"""The fair share: what a node leaves free for the others of its fleet.

A node that always has something to say would fill the channel. The others could neither report nor
call for help: with carrier sense they wait for an end that does not come, and without it their
frames are destroyed where they meet that node's sound. It notices nothing, since it transmits. So
a node that knows of at least two others, which may have something to say to each other, takes no
more than its share of the time for what is not urgent, whatever it hears. Between two nodes the
listen windows are enough: whoever is called pauses.

The free time must be of use. A frame fits the gap between two frames only in some geometries, and
where it does not, it never does. So the share is taken in one piece. While a node transmits it gets
into *debt*, and silence pays the debt. Frames follow each other until a run is full
(`zacoustic.core.schedule.access.listening`), or for as long as a run may last while there is a
debt; then the node *rests*. The rest is drawn around the debt: the others repeat what was lost, and
must not meet run after run, nor two nodes that talk each other. A node that transmits less than its
share pays in its gaps, and never rests; but a gap that is shorter than any rest pays nothing.
"""

import random
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.otherruns import RUN_LIMIT_NS

_SENSED_SHARE: Final = 0.4
"""The fair share where the others hear when a node rests."""
_UNSENSED_SHARE: Final = 0.3
"""The same where they do not: what they send meets a run by chance, and a run has two sides."""
_DRAWN_PARTS: Final = (0.5, 1.5)
"""A rest takes between these parts of the debt."""


def fair_share(capabilities: LinkCapabilities, max_airtime: float | None) -> float:
    """Return the share of the time that a node of a fleet takes for what is not urgent.

    Args:
        capabilities: The link's.
        max_airtime: The airtime cap of the node on the link, above 0, at most 1; None: none is
            set. A higher one than the fair share replaces that.
    """
    default = _SENSED_SHARE if capabilities.senses_carrier else _UNSENSED_SHARE
    return max(default, max_airtime or 0.0)


def never() -> bool:
    """Return that this is no crowd; mypyc takes no lambda as a default."""
    return False


class FairShare:
    """The debt of this node to the others on its link.

    Args:
        share: Share of the time, above 0, at most 1; 1: it never rests.
        capabilities: The link's.
        is_crowd: Returns whether at least two other nodes are known.
        rng: Draws the rests.
    """

    def __init__(
        self,
        share: float,
        capabilities: LinkCapabilities,
        is_crowd: Callable[[], bool],
        rng: random.Random,
    ) -> None:
        self.is_crowd = is_crowd
        """Returns whether at least two other nodes are known."""
        self._cost = 1 / share - 1
        self._largest_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        self._most_ns = round(self._cost * max(RUN_LIMIT_NS, self._largest_ns))
        self._rng = rng
        self._debt_ns = 0
        self._reckoned_at = 0
        self._begun_at = 0
        """Since when there is a debt, ns."""
        self.rests_until = 0
        """Until when this node rests, ns."""

    def spend(self, started_at: int, free_at: int, *, fills_run: bool, least_ns: int) -> None:
        """Pay for an own frame.

        Args:
            started_at: Its start, ns.
            free_at: Its end and the pause of the device after it, ns: nobody else can use that.
            fills_run: Whether no further frame fits its run.
            least_ns: The shortest rest, ns: a short frame fits it, wherever it comes from.
        """
        if not self._cost or not self.is_crowd():
            self._debt_ns, self._reckoned_at = 0, free_at
            return
        has_rested = self._reckoned_at < self.rests_until <= started_at
        gap_ns = started_at - self._reckoned_at
        paid_ns = self._debt_ns if has_rested else gap_ns if gap_ns >= least_ns else 0
        debt_ns = max(0, self._debt_ns - paid_ns)
        if debt_ns == 0:
            self._begun_at = started_at
        debt_ns += round((free_at - started_at) * self._cost)
        self._debt_ns, self._reckoned_at = min(debt_ns, self._most_ns), free_at
        if fills_run or free_at + self._largest_ns > self._begun_at + RUN_LIMIT_NS:
            rest_ns = round(self._rng.uniform(*_DRAWN_PARTS) * self._debt_ns)
            self.rests_until = free_at + max(least_ns, rest_ns)
