"""TDMA: each node transmits in its slots of a common clock, so that no two frames ever meet.

The cycle is a list of owners; slot *k* begins at multiples of the cycle since 1970, plus *k* slots.
A frame starts in a slot of this node and ends before the *guard* at the slot's end. The guard is
the propagation delay of the longest distance plus twice the clock error: a node whose clock is late
by the error ends that much later, and one whose clock is early starts that much sooner. Then every
frame of a slot has arrived everywhere before the next slot begins, whatever the geometry: nothing
collides, and no node transmits while another's frame arrives.

The guards of a *schedule* are shorter: each covers the distance to the owners of the next slot
only. A frame of slot *k* then has passed any third node before one of slot *k + 1* arrives there,
since no detour is shorter than the direct way.

In a schedule an emergency goes at once, and may destroy one frame of another node: a cycle of forty
nodes takes the better part of a minute. A slot without owners is for nodes that own none, such as
one that has just joined; each uses it in one of two cycles, since two nodes may want it.

A schedule is also watched (`zacoustic.core.schedule.access.slotwatch`). A node that has just got
the time, or another time, listens for a cycle before it uses its slots: if its clock is wrong,
others in their slots show it. Own slots are used as far as arrivals and measured ranges say that
they are safe; a node whose slots have no room left for a frame uses the open ones.

This holds as long as every clock is within the stated error. So a node that is not sure of its
clock is *muted*: its error, which grows by drift since the last statement, exceeds the stated one;
its clock has jumped; or it was never told the time (`zacoustic.core.schedule.access.networktime`).

The common clock is UTC from each host, or that of one node. That node takes the UTC that its host
shows first, right or not, and continues from there: no step of the host's clock moves the slots of
a fleet. It sends the time by CLOCK in frames that go anyway, at most once a minute, and in frames
of its own if the config says so. The others correct by the propagation delay that the modem
measured, or by half of the longest one, and count the uncertainty as error.
"""

import hashlib
from collections.abc import Iterator
from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.waits import Why
from zacoustic.core.schedule.access.base import AccessState, Arrival, TurnAccess, Wanted
from zacoustic.core.schedule.access.networktime import NetworkTime
from zacoustic.core.schedule.access.slotwatch import SlotWatch, Window
from zacoustic.core.schedule.access.spec import ScheduleSpec, TdmaSpec, TimedSlot
from zacoustic.core.wire.access import CLOCK_BYTES, CLOCK_TICK_NS, AccessControl, ClockTime
from zacoustic.errors import ConfigError

_CLOCK_EVERY_NS: Final = 60 * NS_PER_S
"""A frame that goes anyway carries the time unless it was sent within this time."""


class Tdma(TurnAccess):
    """Waits for the slots of this node.

    Args:
        spec: The schedule.
        capabilities: The link's, for its airtime.
        address: Of this node.

    Raises:
        ConfigError: A slot does not hold the largest frame and the guard.
    """

    speaks = True
    has_schedule = True

    def __init__(
        self, spec: TdmaSpec | ScheduleSpec, capabilities: LinkCapabilities, address: int
    ) -> None:
        self._largest_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        slots = spec.timed_slots
        _check_room(spec, slots, self._largest_ns)
        self._address = address
        self._own = tuple(_windows_of(slots, (address,)))
        is_schedule = isinstance(spec, ScheduleSpec)
        self._open = () if self._own and not is_schedule else tuple(_windows_of(slots, ()))
        """Windows of slots without owners, for a node that owns none or cannot use its own."""
        self._cycle_ns = sum(slot.window_ns + slot.guard_ns for slot in slots)
        self._watch = SlotWatch(slots, address, spec.error_limit_ns) if is_schedule else None
        self._listens_until: int | None = None
        """Until when this node only listens, since its time is new, ns; None: it need not."""
        self._joined_at = 0
        """Network time from which it counts the open slots, ns."""
        self._is_urgent_at_once = is_schedule
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
        if wanted.is_urgent and self._is_urgent_at_once:
            return wanted.due_at
        offset_ns = self._time.offset_ns
        if offset_ns is None or not (self._own or self._open):
            return None
        sure_at = self._time.sure_at
        if sure_at is not None:
            return sure_at if sure_at > now else None
        if self.is_alone(now):
            return None
        windows = self._usable(now)
        if not windows:
            return None
        earliest = max(earliest, self._listens_until or earliest)
        ready_at = self._opening(windows, earliest + offset_ns, now) - offset_ns
        # Whoever drives the engine states the time again before that instant, if possible.
        error_ns = self._time.error_at(now)
        return None if error_ns is None or error_ns > self._error_limit_ns else ready_at

    def why(self, wanted: Wanted, now: int) -> Why:
        """Return whether it waits for a slot, or for the time."""
        return Why.CLOCK if self.clock_doubt(now) else Why.SLOT

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
            self._tell(offset_ns, error_ns, now)

    def clock_doubt(self, now: int) -> str:
        """Return why this node does not use its slots for want of the time; empty: it does."""
        if not (self._own or self._open):
            return ""
        if self._time.offset_ns is None:
            who = None if self._is_reference else self._reference
            return (
                "UTC is not known" if who is None else f"node {who} has not announced the time yet"
            )
        if self._watch is not None and self.is_alone(now):
            nodes = ", ".join(map(str, sorted(self._watch.outside(now))))
            return f"frames of nodes {nodes} do not come in their slots by the clock of this node"
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
            self._tell(control.time_ns - started_at, known_ns, now)

    def handle_arrival(self, arrival: Arrival, now: int) -> None:
        """Compare the instant of a frame with the slots of its sender."""
        if self._watch is None or self._time.offset_ns is None:
            return
        self._watch.hear(arrival, self._time.offset_ns, now)
        if self._time.sure_at is not None and self._watch.agrees(now):
            self._time.confirm()

    def state(self, now: int) -> AccessState | None:
        """Return where the schedule does not hold; None: these slots are not watched."""
        if self._watch is None:
            return None
        return AccessState(
            method="schedule", why=self.slot_doubt(now), faults=self._watch.faults(now)
        )

    def slot_doubt(self, now: int) -> str:
        """Return why no slot of this node can be used, one line; empty: one can."""
        if not (self._own or self._open):
            return "there is no slot for this node, and no open one"
        if not self._usable(now):
            return "the guards around every slot of this node are too short, and no slot is open"
        return ""

    def is_alone(self, now: int) -> bool:
        """Return whether others keep to the slots by another time than this node's."""
        is_alone = self._watch is not None and self._watch.is_own_wrong(now)
        return is_alone and not self._is_reference

    @property
    def cycle_ns(self) -> int:
        """Length of a cycle, ns."""
        return self._cycle_ns

    # Below the methods above

    def _tell(self, offset_ns: int, error_ns: int | None, now: int) -> None:
        """Take a statement of the time; listen first if it makes the time another one."""
        before_ns = self._time.offset_ns
        self._time.tell(offset_ns, error_ns, now)
        known_ns = self._time.offset_ns
        if self._watch is None or known_ns is None:
            return
        if before_ns is None or abs(known_ns - before_ns) > self._error_limit_ns:
            self._watch.forget()
            self._listens_until = now + self._cycle_ns
            self._joined_at = self._listens_until + known_ns

    def _usable(self, now: int) -> tuple[Window, ...]:
        """Return the windows for frames of this node, own ones first."""
        if self._watch is None:
            return self._own or self._open
        safe = (self._watch.usable(window, now) for window in self._own)
        own = tuple(window for window in safe if window[1] >= self._largest_ns)
        return own or self._open

    def _opening(self, windows: tuple[Window, ...], network_ns: int, now: int) -> int:
        """Return the first network time from `network_ns` on at which a frame may start, ns."""
        cycle = network_ns // self._cycle_ns
        while True:
            for window in windows:
                begins_ns, window_ns = window
                begins_at = cycle * self._cycle_ns + begins_ns
                start_at = max(begins_at, network_ns)
                fits = start_at + self._largest_ns <= begins_at + window_ns
                if fits and (not self._is_in_turns(window, now) or self._takes(cycle, begins_ns)):
                    return start_at
            cycle += 1

    def _is_in_turns(self, window: Window, now: int) -> bool:
        """Return whether other nodes may use a window as well."""
        if window in self._open:
            return True
        return self._watch is not None and self._watch.is_shared(now)

    def _takes(self, cycle: int, begins_ns: int) -> bool:
        """Return whether this node uses a common slot of a cycle: in one of each two."""
        first = -((begins_ns - self._joined_at) // self._cycle_ns)
        pair, place = divmod(cycle - first, 2)
        drawn = hashlib.sha256(b"%d/%d/%d" % (self._address, first + 2 * pair, begins_ns)).digest()
        return drawn[0] % 2 == place


def _windows_of(slots: tuple[TimedSlot, ...], owners: tuple[int, ...]) -> Iterator[Window]:
    """Yield where in the cycle each slot of an owner begins, and how long it may transmit, ns.

    Args:
        slots: All slots.
        owners: The owner; empty: slots without owners.
    """
    begins_ns = 0
    for slot in slots:
        if set(owners) & set(slot.owners) if owners else not slot.owners:
            yield begins_ns, slot.window_ns
        begins_ns += slot.window_ns + slot.guard_ns


def _check_room(
    spec: TdmaSpec | ScheduleSpec, slots: tuple[TimedSlot, ...], largest_ns: int
) -> None:
    short = next((index for index, slot in enumerate(slots) if slot.window_ns < largest_ns), None)
    if short is None:
        return
    largest_s, guard_s = largest_ns / NS_PER_S, slots[short].guard_ns / NS_PER_S
    if isinstance(spec, ScheduleSpec):
        raise ConfigError(
            f"access.slots[{short}].for_s: {spec.slots[short].for_s:g} s; the largest frame of "
            f"this link takes {largest_s:.3f} s; allowed: at least that"
        )
    raise ConfigError(
        f"access.slot_s: {spec.slot_s:g} s; the largest frame of this link takes {largest_s:.3f} "
        f"s and the guard {guard_s:.3f} s; allowed: at least {largest_s + guard_s:.3f}"
    )
