"""Defer while receiving, then back off by a seeded random time.

On a quiet channel a frame goes at once. While somebody else is heard it waits; transmitting would
destroy the reception, since modems are half-duplex, and help nobody. When the carrier ends, every
node that waited would start in the same instant, so each draws a back-off: uniform in a window of
one slot, doubled each time the channel is taken again before the node's turn, back to one slot
after an own transmission. A slot is the time in which a start of another node can be
noticed: the airtime of a short frame.

The delay of sound makes carrier sensing weak (a frame that has left the other end is not heard
yet), so this is a courtesy between few nodes, not a schedule.

A carrier whose end is never reported (a modem that forgets a notification) is taken to have ended
after twice the airtime of the largest frame.
"""

import random
from typing import Final

from zacoustic.core.access.base import MediumAccess
from zacoustic.core.linktypes import LinkCapabilities

_SHORT_FRAME_BYTES: Final = 8
_LARGEST_WINDOW_SLOTS: Final = 32
_CARRIER_LIMIT_FRAMES: Final = 2


class Defer(MediumAccess):
    """Waits for the end of a carrier and a random time behind it.

    Args:
        capabilities: The link's, for its airtime.
        rng: Draws the back-off.
    """

    def __init__(self, capabilities: LinkCapabilities, rng: random.Random) -> None:
        self._rng = rng
        self._slot_ns = capabilities.airtime_ns(_SHORT_FRAME_BYTES)
        self._carrier_limit_ns = _CARRIER_LIMIT_FRAMES * capabilities.airtime_ns(
            capabilities.mtu_bytes
        )
        self._window_slots = 1
        self._busy_since: int | None = None
        self._resume_at = 0

    def ready_at(self, now: int) -> int | None:
        """Return the end of the back-off, or of the longest carrier that is possible."""
        if self._busy_since is None:
            return self._resume_at
        return self._busy_since + self._carrier_limit_ns

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Note the carrier; draw a back-off at its end."""
        if busy:
            if now < self._resume_at:
                self._window_slots = min(2 * self._window_slots, _LARGEST_WINDOW_SLOTS)
            self._busy_since = now
        elif self._busy_since is not None:
            self._busy_since = None
            self._resume_at = now + self._rng.randrange(self._window_slots * self._slot_ns + 1)

    def handle_transmitted(self, now: int) -> None:
        """Start again from the smallest window."""
        self._window_slots = 1
