"""Carrier sense: wait while another node is heard, then back off by a seeded random time.

On a quiet channel a frame goes at once. While another node is heard it waits: modems are
half-duplex, so transmitting would destroy the reception and help nobody. When the carrier ends,
every node that waited would start at the same instant, so each draws a back-off. It is uniform in a
window of one slot; the window doubles each time the channel is taken again before the node's turn,
and is back to one slot after an own transmission. A slot is the time in which the start of another
node is noticed: the airtime of a short frame. A node that had nothing to send meanwhile has no
back-off, and an urgent frame waits only for the end of the carrier.

Where at least two other nodes are heard, the window follows what is heard, as in MACAW (Bharghavan
and others, 1994): it doubles after a sound that gave no frame, which was probably two frames at
once, and halves after one that did; and a wide window also separates own frames. A loss between two
nodes is no collision with a third one, and calls for no wait.

A frame for the announced pause of another node does not wait: it must leave before that pause is
heard (`zacoustic.core.schedule.access.listening`).

The propagation delay weakens carrier sensing (a frame that has left the other end is not heard
yet): it pays for frames longer than the delay. Between few nodes it is a courtesy, not a schedule.

If the end of a carrier is never reported (a modem that forgets a notification), the carrier is
assumed to have ended after twice the airtime of the largest frame.
"""

import random
from typing import Final

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.backoff import BackOff
from zacoustic.core.schedule.access.base import MediumAccess, Wanted

_SHORT_FRAME_BYTES: Final = 8
_CARRIER_LIMIT_FRAMES: Final = 2
_CROWD_NS: Final = 600 * NS_PER_S
"""Nodes that were heard within this time count."""


class CarrierSense(MediumAccess):
    """Waits for the end of a carrier, then for a random time.

    Args:
        capabilities: The link's, for its airtime.
        rng: Draws the back-off.
    """

    def __init__(self, capabilities: LinkCapabilities, rng: random.Random) -> None:
        self._back_off = BackOff(capabilities.airtime_ns(_SHORT_FRAME_BYTES), rng)
        self._carrier_limit_ns = _CARRIER_LIMIT_FRAMES * capabilities.airtime_ns(
            capabilities.mtu_bytes
        )
        self._busy_since: int | None = None
        self._resume_at = 0
        self._apart_until = 0
        """Until when own frames wait in a crowd, ns."""
        self._waits = False
        self._gave_frame = True
        """Whether the present or last sound gave a frame."""
        self._last: tuple[int, int] | None = None
        """The node that was heard last, and when, ns."""
        self._other_at: int | None = None
        """When a node other than that one was heard last, ns."""

    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the end of the back-off, or of the longest possible carrier."""
        if wanted.is_invited:
            return wanted.due_at
        if self._busy_since is not None:
            clear_at = self._busy_since + self._carrier_limit_ns
        elif wanted.is_urgent:
            return wanted.due_at
        else:
            is_apart = not (wanted.is_in_rhythm or wanted.is_copy or wanted.is_in_train)
            clear_at = max(self._resume_at, self._apart_until if is_apart else 0)
        if wanted.due_at <= now < clear_at:
            self._waits = True
        return max(wanted.due_at, clear_at)

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Record the carrier; at its end, draw a back-off if a frame waited for it."""
        is_crowd = self._is_crowd(now)
        if busy:
            if is_crowd:
                self._follow_last_sound()
            elif now < self._resume_at and self._waits:
                self._back_off.grow()
            self._gave_frame = False
            self._busy_since = now
        elif self._busy_since is not None:
            self._busy_since = None
            if self._waits:
                self._waits = False
                self._resume_at = now + self._back_off.draw()
            elif is_crowd and self._back_off.is_wide:
                self._apart_until = now + self._back_off.draw()

    def handle_transmitted(self, now: int) -> None:
        """Start again from the smallest window; in a crowd, back off if the window is wide."""
        self._waits = False
        if not self._is_crowd(now):
            self._back_off.reset()
        elif self._back_off.is_wide:
            self._apart_until = now + self._back_off.draw()

    def handle_heard(self, source: int, now: int) -> None:
        """Record a frame from `source`."""
        self._gave_frame = True
        if self._last is not None and self._last[0] != source:
            self._other_at = self._last[1]
        self._last = source, now

    def _is_crowd(self, now: int) -> bool:
        """Return whether two other nodes or more were heard lately."""
        return self._other_at is not None and now - self._other_at <= _CROWD_NS

    def _follow_last_sound(self) -> None:
        if self._gave_frame:
            self._back_off.shrink()
        else:
            self._back_off.grow()
