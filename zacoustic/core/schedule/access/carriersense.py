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
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.waits import Why
from zacoustic.core.schedule.access.backoff import BackOff
from zacoustic.core.schedule.access.base import MediumAccess, Wanted
from zacoustic.core.schedule.access.fairshare import never
from zacoustic.core.schedule.access.otherruns import MARGIN_NS

_SHORT_FRAME_BYTES: Final = 8
_CARRIER_LIMIT_FRAMES: Final = 2


class CarrierSense(MediumAccess):
    """Waits for the end of a carrier, then for a random time.

    Args:
        capabilities: The link's, for its airtime.
        rng: Draws the back-off.
        is_crowd: Returns whether at least two other nodes are known.
    """

    def __init__(
        self,
        capabilities: LinkCapabilities,
        rng: random.Random,
        is_crowd: Callable[[], bool] = never,
    ) -> None:
        self._slot_ns = capabilities.airtime_ns(_SHORT_FRAME_BYTES)
        self._back_off = BackOff(self._slot_ns, rng)
        self._urgent_back_off = BackOff(self._slot_ns, rng)
        self._space_ns = seconds_to_ns(capabilities.gap_s) + MARGIN_NS
        """A node in a run begins its next frame sooner than this after the last one, ns."""
        self._carrier_limit_ns = _CARRIER_LIMIT_FRAMES * capabilities.airtime_ns(
            capabilities.mtu_bytes
        )
        self._is_crowd = is_crowd
        self._busy_since: int | None = None
        self._idle_since = 0
        """Instant from which the back-off counts, ns."""
        self._left_ns = 0
        """The rest of the back-off, ns."""
        self._urgent_left_ns = 0
        """The same for an urgent frame."""
        self._is_apart = False
        """Whether that separates own frames only: none of them waited for the carrier."""
        self._waits = False
        self._gave_frame = True
        """Whether the present or last sound gave a frame."""

    @property
    def is_apart(self) -> bool:
        """Whether the back-off separates own frames only: none of them waited for a carrier."""
        return self._is_apart

    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the end of the back-off, or of the longest possible carrier."""
        if wanted.is_invited:
            return wanted.due_at
        if self._busy_since is not None:
            clear_at = self._busy_since + self._carrier_limit_ns
        elif wanted.is_urgent:
            clear_at = 0 if wanted.is_copy else self._idle_since + self._urgent_left_ns
        else:
            follows = wanted.is_in_rhythm or wanted.is_copy or wanted.is_in_train
            is_free = follows and self._is_apart
            clear_at = 0 if is_free else self._idle_since + self._left_ns
        return max(wanted.due_at, clear_at)

    def why(self, wanted: Wanted, now: int) -> Why:
        """Return whether it waits for a carrier or a back-off."""
        return Why.BACK_OFF if self._busy_since is None else Why.CARRIER

    def handle_waiting(self, wanted: Wanted, now: int) -> None:
        """Record that a frame waits: it takes part in the back-off."""
        self._waits = True

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Record the carrier; at its end, draw a back-off if a frame waited for it."""
        if busy:
            self._begins(now)
        elif self._busy_since is not None:
            self._busy_since = None
            self._ends(now)

    def handle_transmitted(self, now: int) -> None:
        """Start again from the smallest window; in a crowd, back off if the window is wide."""
        self._waits = False
        if not self._is_crowd():
            self._back_off.reset()
        elif self._back_off.is_wide:
            self._idle_since, self._left_ns = now, self._back_off.draw()
            self._urgent_left_ns, self._is_apart = 0, True

    def handle_heard(self, source: int, now: int) -> None:
        """Record a frame from `source`."""
        self._gave_frame = True

    # Below the methods above

    def _begins(self, now: int) -> None:
        if not self._is_crowd():
            if now < self._idle_since + self._left_ns and self._waits:
                self._back_off.grow()
        else:
            self._follow_last_sound()
            if self._busy_since is None:
                self._left_ns = max(0, self._left_ns - max(0, now - self._idle_since))
        self._gave_frame = False
        self._busy_since = now

    def _ends(self, now: int) -> None:
        if not self._is_crowd():
            if self._waits:
                self._waits, self._idle_since, self._left_ns = False, now, self._back_off.draw()
            return
        self._idle_since = now + self._space_ns
        self._urgent_left_ns = self._urgent_back_off.draw()
        if self._left_ns == 0 and (self._waits or self._back_off.is_wide):
            self._left_ns = self._back_off.draw() + self._slot_ns
        self._is_apart = not self._waits

    def _follow_last_sound(self) -> None:
        if self._gave_frame:
            self._back_off.shrink()
        else:
            self._back_off.grow()
