"""ALOHA: a frame goes when it is due, or at the next slot.

Nothing is better where the propagation delay exceeds the frame: whatever a carrier sense could hear
is over, and a schedule would mostly be guard time. With random traffic G of all nodes (in frames
per frame's airtime), G·exp(-2G) gets through, at most 18 % of the channel.

Slots (starts at multiples of a length, in network time) help only as far as the slot has a guard
for the differences in delay: with a guard of the longest delay aT, 1/(e(1 + a)). A slot as long as
the frame gains nothing: frames that start together arrive at different times. Without a sure clock,
frames go at any instant; a wrong slot is no worse than none.

Back-off: a frame without any answer probably collided, and the other sender will repeat its frame
as well. Until the channel carries something again, each node waits a random time whose window
doubles. An urgent frame does not wait.
"""

import random
from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.waits import Why
from zacoustic.core.schedule.access.backoff import BackOff
from zacoustic.core.schedule.access.base import MediumAccess, Wanted
from zacoustic.core.schedule.access.networktime import NetworkTime
from zacoustic.core.schedule.access.spec import AlohaSpec

# A timer that fires late still meets its slot: within a fiftieth of it, and at most 20 ms.
_LATE_PARTS: Final = 50
_LATE_LIMIT_NS: Final = NS_PER_S // 50


class Aloha(MediumAccess):
    """ALOHA: waits for no other node.

    Args:
        spec: The settings.
        capabilities: The link's, for its airtime.
        rng: Draws the back-off.
    """

    def __init__(self, spec: AlohaSpec, capabilities: LinkCapabilities, rng: random.Random) -> None:
        self._slot_ns = None if spec.slot_s is None else seconds_to_ns(spec.slot_s)
        self._late_ns = min(_LATE_LIMIT_NS, (self._slot_ns or 0) // _LATE_PARTS)
        self._backs_off = spec.back_off
        self._back_off = BackOff(capabilities.airtime_ns(capabilities.mtu_bytes), rng)
        self._time = NetworkTime(drift_ppm=0.0)
        self._resume_at = 0

    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the due instant, or the next slot, after the back-off."""
        due_at = wanted.due_at if wanted.is_urgent else max(wanted.due_at, self._resume_at)
        offset_ns = self._time.offset_ns
        if self._slot_ns is None or offset_ns is None or self._time.sure_at is not None:
            return due_at
        begun_at = (now + offset_ns) // self._slot_ns * self._slot_ns - offset_ns
        if due_at <= begun_at and now - begun_at <= self._late_ns:
            return now
        earliest = max(due_at, now) + offset_ns
        return -(-earliest // self._slot_ns) * self._slot_ns - offset_ns

    def why(self, wanted: Wanted, now: int) -> Why:
        """Return whether it waits for a back-off or a slot."""
        ready_at = self.ready_at(wanted, now)
        is_slotted = ready_at != max(wanted.due_at, self._resume_at)
        return Why.SLOT if wanted.is_urgent or is_slotted else Why.BACK_OFF

    def handle_outcome(self, arrived: bool, now: int) -> None:
        """Back off after a loss."""
        if arrived:
            self._back_off.reset()
            self._resume_at = 0
        elif self._backs_off:
            self._resume_at = now + self._back_off.draw()
            self._back_off.grow()

    def handle_clock(self, offset_ns: int, error_ns: int | None, now: int) -> None:
        """Take the host's time."""
        self._time.tell(offset_ns, error_ns, now)
