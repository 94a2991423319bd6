"""When the next train of a route may begin at one node.

A train that is on its way occupies three hops: the node that transmits it, the next one, which
receives it, and the one after, which transmits it next and is heard by the second. So a node lets
three things pass before it transmits on a route, in either direction: the train that it receives;
the answer to its own train; and the train that it hears one hop further, for as long as the node
after that will need for it.
"""

from typing import Final

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.relay.flow import LONGEST_TRAIN

SLACK_NS: Final = NS_PER_S // 2
"""Time in which a node that has received a train begins to transmit it, ns."""


class Turns:
    """The turns of one route at one node."""

    __slots__ = ("_answered_until", "_heard", "_heard_until", "_held_until", "_received_until")

    def __init__(self) -> None:
        self._received_until = 0
        self._answered_until = 0
        self._held_until = 0
        self._heard = 0
        self._heard_until = 0

    def free_at(self, *, is_urgent: bool = False) -> int:
        """Return the instant from which a train, or an urgent frame, may begin, ns."""
        if is_urgent:  # to send while a frame arrives helps nobody
            return self._received_until
        return max(self._received_until, self._answered_until, self._held_until)

    def received(self, frame_ns: int, now: int, *, more: bool) -> None:
        """Record a frame of a neighbour for this node.

        Args:
            frame_ns: Airtime of a largest frame with the gap after it, ns.
            now: The instant, ns.
            more: Whether another one follows at once.
        """
        self._received_until = now + frame_ns + SLACK_NS if more else now

    def transmitted(self, answered_at: int) -> None:
        """Record the end of an own train, and when its answer is over at the latest, ns."""
        self._answered_until = answered_at

    def answered(self, now: int) -> None:
        """Record that the answer is over."""
        self._answered_until = min(self._answered_until, now)

    def overheard(self, frame_ns: int, way_ns: int, now: int, *, next_is_end: bool) -> None:
        """Record a frame that the next node sends on.

        Args:
            frame_ns: Airtime of a largest frame with the gap after it, ns.
            way_ns: Propagation delay to the next node, ns.
            now: The instant, ns.
            next_is_end: Whether it sends to the end of the route, which only acknowledges.
        """
        # More than a train comes of no node that keeps to the rules.
        self._heard = min(self._heard + 1, LONGEST_TRAIN) if now <= self._heard_until else 1
        self._heard_until = now + 2 * frame_ns + SLACK_NS
        frames = 1 if next_is_end else self._heard
        self._held_until = max(self._held_until, now + frames * frame_ns + way_ns + SLACK_NS)
