"""Heartbeats of one node on one link; `zacoustic.core.peers.contact` gives the reason."""

import random
from collections.abc import Sequence
from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.parts import FIRST_BUT_URGENT, Offer
from zacoustic.core.base.stats import Cause

_EARLIEST: Final = 0.75
"""Fixed part of the pause; the rest is random."""


class Heartbeats:
    """The heartbeats of one node on one link.

    Args:
        hearers: Addresses of the other nodes; empty: any.
        heartbeat_s: Longest time between two frames of the node, s; None: no heartbeats.
        rng: Draws the pauses.
        announces: Whether to transmit a frame soon after the first link is up: the node was there
            before, and others repeat to it in ever longer pauses.
    """

    def __init__(
        self,
        hearers: Sequence[int],
        heartbeat_s: float | None,
        rng: random.Random,
        *,
        announces: bool = False,
    ) -> None:
        self._heartbeat_s = heartbeat_s
        self._rng = rng
        self._hearers = list(hearers) or [BROADCAST]
        self._said_at: dict[int, int] = {}
        self._pause_ns = 0
        self.is_held = False
        """Whether none are due: every link that is up costs money."""
        self._announces = announces
        self._announced_at: int | None = None

    def link_up(self, now: int) -> None:
        """Note that the link is up: for the first time, the node may announce itself."""
        if self._announces:
            self.announce(now)
            self._announces = False

    def announce(self, now: int) -> None:
        """Transmit a frame to all soon, unless another one goes to all before."""
        if self._announced_at is None:
            # As many nodes may start together as there are.
            self._announced_at = now + self._rng.randint(0, len(self._hearers) * NS_PER_S)

    def begin(self, now: int) -> None:
        """Note the first instant of the boot epoch; later calls have no effect."""
        if not self._said_at:
            self._said_at = dict.fromkeys(self._hearers, now)
            self._draw_pause()

    def due_at(self, now: int) -> int | None:
        """Return the instant at which a heartbeat is due, ns; None: never."""
        if self._heartbeat_s is None or not self._said_at or self.is_held:
            return self._announced_at
        beat_at = min(self._said_at.values()) + self._pause_ns
        return beat_at if self._announced_at is None else min(beat_at, self._announced_at)

    def offer(self, now: int) -> Offer | None:
        """Offer a heartbeat if one is due."""
        due_at = self.due_at(now)
        if due_at is None or due_at > now:
            return None
        return Offer(destination=BROADCAST, rank=FIRST_BUT_URGENT, must_go=Cause.HEARTBEAT)

    def transmitted(self, destination: int, now: int) -> None:
        """Note a frame to a node, or to all."""
        if destination == BROADCAST or self._hearers == [destination]:
            self._announced_at = None
        if destination == BROADCAST:
            self._said_at = dict.fromkeys(self._hearers, now)
            self._draw_pause()
        elif destination in self._said_at:
            self._said_at[destination] = now

    # Below the methods above

    def _draw_pause(self) -> None:
        if self._heartbeat_s is not None:
            longest_ns = seconds_to_ns(self._heartbeat_s)
            self._pause_ns = self._rng.randint(round(_EARLIEST * longest_ns), longest_ns)
