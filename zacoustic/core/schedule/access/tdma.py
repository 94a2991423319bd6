"""TDMA: each node transmits in its slots of a common clock, so that no two frames ever meet.

The cycle is a list of owners; slot *k* begins at multiples of the cycle since 1970, plus *k* slots.
A frame starts in a slot of this node and ends before the *guard* at the slot's end. The guard is
the propagation delay of the longest distance plus twice the clock error: a node whose clock is late
by the error ends that much later, and one whose clock is early starts that much sooner. Then every
frame of a slot has arrived everywhere before the next slot begins, whatever the geometry: nothing
collides, and no node transmits while another's frame arrives.

This holds as long as every clock is within the stated error. So a node that is not sure of its
clock is *muted*: its error, which grows by drift since the last statement, exceeds the stated one;
its clock has jumped; or it was never told the time (`zacoustic.core.schedule.access.networktime`).

The common clock is UTC from each host, or that of one node. That node takes the UTC that its host
shows first, right or not, and continues from there: no step of the host's clock moves the slots of
a fleet. It sends the time by CLOCK in frames that go anyway, at most once a minute, and in frames
of its own if the config says so. The others correct by the propagation delay that the modem
measured, or by half of the longest one, and count the uncertainty as error.
"""

from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.base import MediumAccess, Wanted
from zacoustic.core.schedule.access.networktime import NetworkTime
from zacoustic.core.schedule.access.spec import TdmaSpec
from zacoustic.core.wire.access import CLOCK_BYTES, CLOCK_TICK_NS, AccessControl, ClockTime
from zacoustic.errors import ConfigError

_CLOCK_EVERY_NS: Final = 60 * NS_PER_S
"""A frame that goes anyway carries the time unless it was sent within this time."""


class Tdma(MediumAccess):
    """Waits for the slots of this node.

    Args:
        spec: The schedule.
        capabilities: The link's, for its airtime.
        address: Of this node.

    Raises:
        ConfigError: A slot does not hold the largest frame and the guard.
    """

    is_scheduled = True

    def __init__(self, spec: TdmaSpec, capabilities: LinkCapabilities, address: int) -> None:
        self._largest_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        self._slot_ns = seconds_to_ns(spec.slot_s)
        self._window_ns = self._slot_ns - spec.guard_ns
        if self._largest_ns > self._window_ns:
            least_s = (self._largest_ns + spec.guard_ns) / NS_PER_S
            raise ConfigError(
                f"access.slot_s: {spec.slot_s:g} s; the largest frame of this link takes "
                f"{self._largest_ns / NS_PER_S:.3f} s and the guard {spec.guard_ns / NS_PER_S:.3f} "
                f"s; allowed: at least {least_s:.3f}"
            )
        self._slots = spec.slots
        self._own = tuple(index for index, owner in enumerate(spec.slots) if owner == address)
        self._cycle_ns = len(spec.slots) * self._slot_ns
        self._error_limit_ns = spec.error_limit_ns
        self._stated_s = spec.clock_error_s
        self._reference = spec.clock
        self._is_reference = spec.clock == address
        self._beacon_ns = None if spec.beacon_s is None else seconds_to_ns(spec.beacon_s)
        self._time = NetworkTime(spec.drift_ppm)
        self._clock_told_at: int | None = None

    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the first instant in an own slot at which the largest frame fits, ns, or None."""
        earliest = wanted.earliest(now)
        offset_ns = self._time.offset_ns
        if offset_ns is None or not self._own:
            return None
        sure_at = self._time.sure_at
        if sure_at is not None:
            return sure_at if sure_at > now else None
        ready_at = self._opening(earliest + offset_ns) - offset_ns
        # Whoever drives the engine states the time again before that instant, if possible.
        error_ns = self._time.error_at(now)
        return None if error_ns is None or error_ns > self._error_limit_ns else ready_at

    def speak_at(self, now: int) -> int | None:
        """Return when to send the time in a frame of its own, ns, or None."""
        if self._beacon_ns is None or not self._is_reference:
            return None
        told_at = self._clock_told_at
        due_at = now if told_at is None else told_at + self._beacon_ns
        return self.ready_at(Wanted(due_at), now)

    def controls(self, room_bytes: int, now: int, *, alone: bool) -> bytes:
        """Return the time control, if this node sends the time and there is room."""
        offset_ns = self._time.offset_ns
        if not self._is_reference or offset_ns is None or room_bytes < CLOCK_BYTES:
            return b""
        told_at = self._clock_told_at
        if not alone and told_at is not None and now - told_at < _CLOCK_EVERY_NS:
            return b""
        self._clock_told_at = now
        return ClockTime(now + offset_ns, self._time.error_at(now)).encode()

    def handle_clock(self, offset_ns: int, error_ns: int | None, now: int) -> None:
        """Take the host's time where it counts."""
        if self._is_reference:
            # Its clock is the common one by definition.
            known_ns = self._time.offset_ns
            self._time.tell(offset_ns if known_ns is None else known_ns, 0, now)
        elif self._reference is None:
            self._time.tell(offset_ns, error_ns, now)

    def clock_doubt(self, now: int) -> str:
        """Return why this node does not use its slots for want of the time; empty: it does."""
        if not self._own:
            return ""
        if self._time.offset_ns is None:
            who = None if self._is_reference else self._reference
            return (
                "UTC is not known" if who is None else f"node {who} has not announced the time yet"
            )
        error_ns = self._time.error_at(now)
        if error_ns is None:
            return "the clock has jumped"
        if error_ns > self._error_limit_ns:
            return f"the time may be wrong by more than clock_error_s, {self._stated_s:g} s"
        return ""

    def handle_control(
        self, source: int, control: AccessControl, started_at: int, error_ns: int, now: int
    ) -> None:
        """Take the time that the reference node sends."""
        if not isinstance(control, ClockTime) or source != self._reference or self._is_reference:
            return
        if control.error_ns is not None:
            known_ns = control.error_ns + error_ns + CLOCK_TICK_NS
            self._time.tell(control.time_ns - started_at, known_ns, now)

    def _opening(self, network_ns: int) -> int:
        """Return the first network time from `network_ns` on at which a frame may start, ns."""
        cycle_at = network_ns // self._cycle_ns * self._cycle_ns
        while True:
            for index in self._own:
                begins_at = cycle_at + index * self._slot_ns
                start_at = max(begins_at, network_ns)
                if start_at + self._largest_ns <= begins_at + self._window_ns:
                    return start_at
            cycle_at += self._cycle_ns
