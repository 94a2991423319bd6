"""Heartbeats of one node on one link; `zacoustic.core.peers.contact` gives the reason."""

import random
from collections.abc import Sequence
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
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
    """

    def __init__(
        self, hearers: Sequence[int], heartbeat_s: float | None, rng: random.Random
    ) -> None:
        self._heartbeat_s = heartbeat_s
        self._rng = rng
        self._hearers = list(hearers) or [BROADCAST]
        self._said_at: dict[int, int] = {}
        self._pause_ns = 0

    def begin(self, now: int) -> None:
        """Note the first instant of the boot epoch; later calls have no effect."""
        if not self._said_at:
            self._said_at = dict.fromkeys(self._hearers, now)
            self._draw_pause()

    def due_at(self, now: int) -> int | None:
        """Return the instant at which a heartbeat is due, ns; None: never."""
        if self._heartbeat_s is None or not self._said_at:
            return None
        return min(self._said_at.values()) + self._pause_ns

    def offer(self, now: int) -> Offer | None:
        """Offer a heartbeat if one is due."""
        due_at = self.due_at(now)
        if due_at is None or due_at > now:
            return None
        return Offer(destination=BROADCAST, rank=FIRST_BUT_URGENT, must_go=Cause.HEARTBEAT)

    def transmitted(self, destination: int, now: int) -> None:
        """Note a frame to a node, or to all."""
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
