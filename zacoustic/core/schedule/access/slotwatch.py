"""Slot watch: whether a schedule holds, by the instants at which frames of others arrive.

A schedule holds while every clock is right, the guards reach, and all have the same slots. A clock
may be wrong without knowing it, and nodes move. Each frame that arrives is a measurement: its
sender began it in one of its slots, some propagation delay ago. That delay is measured by the modem
or known from a range; otherwise it is anything up to the longest one, and proves less.

- A frame that no delay explains is *outside* the slots of its sender. One of the two clocks is
  wrong, or the sender has no slots at present. If one other time of this node would explain more of
  these nodes than are in their slots by its own time, itself included, its own clock is wrong. Two
  nodes prove nothing to each other, a tie mutes nobody, and nodes that transmit at any instant
  agree on no time.
- A node whose delay is longer than the time between its slot and a slot of this node is *far*: the
  guard does not reach. So is one whose frame still arrives when the own slot has begun. The own
  slot then begins later, or ends sooner, by what is missing, which protects the frames of both:
  a frame that has passed this node before it transmits has the way of the two before it, and by
  the triangle inequality it passes every third node first as well.
- A node that owns the same slot and is heard all the same *shares* it: nobody should have heard
  both. They use the slot in turns, as nodes without slots use an open one.

Frames with an urgent payload go at any instant and are no evidence. Frames that do not open, copies
that the seal refuses, and frames for other nodes never come here.

Evidence is the newest frame of each node and lasts for some cycles, so a node that has left, or has
come back to its place, is forgotten. A new time makes all of it void.
"""

from collections.abc import Sequence
from typing import Final

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.schedule.access.base import Arrival, SlotFault, Trouble
from zacoustic.core.schedule.access.spec import TimedSlot

_LATE_NS: Final = NS_PER_S // 20
"""The instants of a modem and the timers of its host may be wrong by this."""
_EVIDENCE_CYCLES: Final = 16
"""How long a frame says something about its sender: some senders use few of their slots."""
_OVERLAP_CYCLES: Final = 3
"""How long a frame that arrived in a slot of this node makes that slot shorter."""
_MOST_SURE_NS: Final = NS_PER_S // 10
"""A delay counts as measured if its error is at most this: what a vehicle moves in half a
minute."""

Window = tuple[int, int]
"""Begin in the cycle and length, ns."""


class SlotWatch:
    """What arrivals say about one schedule.

    Args:
        slots: The slots of a cycle.
        address: Of this node.
        error_ns: The largest error of a clock that is right, ns.
    """

    def __init__(self, slots: Sequence[TimedSlot], address: int, error_ns: int) -> None:
        self._windows: dict[int, list[Window]] = {}
        self._open: list[Window] = []
        self._sharing: set[int] = set()
        """The other owners of slots of this node."""
        begins_ns = 0
        for slot in slots:
            window = begins_ns, slot.window_ns
            for owner in slot.owners:
                self._windows.setdefault(owner, []).append(window)
            if not slot.owners:
                self._open.append(window)
            if address in slot.owners:
                self._sharing |= set(slot.owners) - {address}
            begins_ns += slot.window_ns + slot.guard_ns
        self._cycle_ns = begins_ns
        self._address = address
        self._error_ns = error_ns
        self._shifts: dict[int, list[Window]] = {}
        """By how much the time of this node would have to change for the newest frame of each node
        to be in a slot: least in a cycle, and span of all that would do, ns."""
        self._is_own_wrong = False
        self._heard_at = 0
        self._off: dict[int, tuple[int, int]] = {}
        """How far each node was off its slots, ns, later > 0, and when it was heard, ns."""
        self._ways: dict[int, tuple[int, int]] = {}
        """The shortest possible delay of each node whose delay is measured, ns, and when, ns."""
        self._overlaps: dict[tuple[int, int], tuple[int, int]] = {}
        """By node and begin of an own slot: how far a frame reached into it, ns, and when, ns."""

    def windows_of(self, address: int) -> Sequence[Window]:
        """Return the windows in which a node may transmit."""
        return self._windows.get(address, self._open)

    def forget(self) -> None:
        """Forget what was heard: the time is another one."""
        self._off.clear()
        self._shifts.clear()
        self._is_own_wrong = False
        self._overlaps.clear()

    def hear(self, arrival: Arrival, offset_ns: int, now: int) -> None:
        """Take a frame; the network's time is `now + offset_ns`."""
        if arrival.is_urgent:
            return
        # A node whose own slots are not safe uses open ones.
        windows = {*self.windows_of(arrival.source), *self._open}
        began_at = arrival.began_at + offset_ns
        if windows:
            earliest_at = began_at - arrival.way_ns - arrival.way_error_ns
            latest_at = began_at - max(0, arrival.way_ns - arrival.way_error_ns)
            off_ns = min(
                (self._off_ns(window, earliest_at, latest_at, arrival) for window in windows),
                key=abs,
            )
            self._off[arrival.source] = off_ns, now
            span_ns = latest_at - earliest_at + 2 * (2 * self._error_ns + _LATE_NS)
            least_ns = -latest_at - 2 * self._error_ns - _LATE_NS
            self._shifts[arrival.source] = [
                (
                    (begins_ns + least_ns) % self._cycle_ns,
                    span_ns + max(0, window_ns - arrival.airtime_ns),
                )
                for begins_ns, window_ns in self.windows_of(arrival.source)
            ]
            self._judge(now)
        if arrival.way_error_ns <= _MOST_SURE_NS:
            self._ways[arrival.source] = max(0, arrival.way_ns - arrival.way_error_ns), now
        self._note_overlap(arrival.source, began_at + arrival.airtime_ns, now)

    def outside(self, now: int) -> tuple[int, ...]:
        """Return the nodes whose newest frame was outside their slots."""
        return tuple(node for node, off_ns in self._heard(now) if off_ns)

    def is_own_wrong(self, now: int) -> bool:
        """Return whether this node is the one that differs from most."""
        return self._is_own_wrong and now - self._heard_at <= _EVIDENCE_CYCLES * self._cycle_ns

    def agrees(self, now: int) -> bool:
        """Return whether two nodes or more were heard, all of them in their slots."""
        heard = self._heard(now)
        return len(heard) > 1 and not any(off_ns for _, off_ns in heard)

    def usable(self, window: Window, now: int) -> Window:
        """Return the part of an own window that is safe; its length may be negative."""
        begins_ns, window_ns = window
        delay_ns = max(self._delays(window, now), default=0)
        ends_ns = begins_ns + window_ns - max(self._advances(window, now), default=0)
        begins_ns += max(0, delay_ns)
        return begins_ns, min(ends_ns, window[0] + window_ns) - begins_ns

    def is_shared(self, now: int) -> bool:
        """Return whether another owner of an own slot is heard here."""
        return bool(self._sharing) and any(node in self._sharing for node, _ in self._heard(now))

    def faults(self, now: int) -> tuple[SlotFault, ...]:
        """Return where the schedule does not hold, by address."""
        found = {
            node: SlotFault(node=node, trouble=Trouble.SHARED, by_s=0.0)
            for node, _ in self._heard(now)
            if node in self._sharing
        }
        own = self._windows.get(self._address, ())
        far: dict[int, int] = {}
        for window in own:
            for node in {*self._ways, *(node for node, _ in self._overlaps)}:
                short_ns = max(self._short(node, window, now))
                far[node] = max(far.get(node, 0), short_ns)
        for node, short_ns in far.items():
            if short_ns > 0 and node not in found:
                found[node] = SlotFault(
                    node=node, trouble=Trouble.FAR, by_s=round(short_ns / NS_PER_S, 3)
                )
        for node, off_ns in self._heard(now):
            if off_ns:
                found[node] = SlotFault(
                    node=node, trouble=Trouble.OUTSIDE, by_s=round(abs(off_ns) / NS_PER_S, 3)
                )
        return tuple(found[node] for node in sorted(found))

    # Below the methods above

    def _heard(self, now: int) -> list[tuple[int, int]]:
        """Return each node with valid evidence, and how far it was off its slots, ns."""
        since = now - _EVIDENCE_CYCLES * self._cycle_ns
        return [(node, off_ns) for node, (off_ns, at) in self._off.items() if at >= since]

    def _judge(self, now: int) -> None:
        """Find out whether another time than that of this node explains more frames."""
        self._heard_at = now
        heard = self._heard(now)
        shifts = [self._shifts[node] for node, off_ns in heard if off_ns]
        explained = max(
            sum(
                any((shift_ns - least_ns) % self._cycle_ns <= span_ns for least_ns, span_ns in each)
                for each in shifts
            )
            for shift_ns, _ in (first for each in shifts for first in each)
        ) if any(shifts) else 0  # fmt: skip
        self._is_own_wrong = explained > sum(not off_ns for _, off_ns in heard) + 1

    def _off_ns(self, window: Window, earliest_at: int, latest_at: int, arrival: Arrival) -> int:
        """Return how far a frame is off a window, ns; 0: it may have been in it."""
        begins_ns, window_ns = window
        allowed_ns = 2 * self._error_ns + _LATE_NS
        last_ns = max(0, window_ns - arrival.airtime_ns)
        middle_ns = (earliest_at + latest_at - last_ns) // 2 - begins_ns
        # The window of the cycle that is nearest to the frame.
        cycle = (middle_ns + self._cycle_ns // 2) // self._cycle_ns
        begins_at = begins_ns + cycle * self._cycle_ns
        early_ns = begins_at - allowed_ns - latest_at
        late_ns = earliest_at - (begins_at + last_ns + allowed_ns)
        return -early_ns if early_ns > 0 else max(0, late_ns)

    def _note_overlap(self, source: int, ended_at: int, now: int) -> None:
        """Record how far a frame has reached into a slot of this node."""
        is_outside = bool(self._off.get(source, (0, 0))[0])
        for begins_ns, window_ns in self._windows.get(self._address, ()):
            into_ns = (ended_at - begins_ns) % self._cycle_ns
            key = source, begins_ns
            if _LATE_NS < into_ns < window_ns and not is_outside:
                self._overlaps[key] = into_ns, now
            elif into_ns > self._cycle_ns - window_ns or is_outside:
                # A frame that ended shortly before the slot: what is missing now is nothing.
                self._overlaps.pop(key, None)

    def _short(self, node: int, window: Window, now: int) -> tuple[int, int]:
        """Return what is missing before and behind an own window for another node, ns."""
        before_ns = behind_ns = 0
        begins_ns, window_ns = window
        way_ns, way_at = self._ways.get(node, (0, 0))
        is_known = node in self._ways and way_at >= now - _EVIDENCE_CYCLES * self._cycle_ns
        for other_ns, length_ns in self.windows_of(node) if is_known else ():
            if other_ns == begins_ns:
                continue
            needed_ns = way_ns + 2 * self._error_ns
            gap_ns = (begins_ns - other_ns - length_ns) % self._cycle_ns
            before_ns = max(before_ns, needed_ns - gap_ns)
            gap_ns = (other_ns - begins_ns - window_ns) % self._cycle_ns
            behind_ns = max(behind_ns, needed_ns - gap_ns)
        into_ns, into_at = self._overlaps.get((node, begins_ns), (0, 0))
        if into_at >= now - _OVERLAP_CYCLES * self._cycle_ns:
            before_ns = max(before_ns, into_ns)
        return before_ns, behind_ns

    def _delays(self, window: Window, now: int) -> list[int]:
        nodes = {*self._ways, *(node for node, _ in self._overlaps)}
        return [self._short(node, window, now)[0] for node in nodes]

    def _advances(self, window: Window, now: int) -> list[int]:
        return [self._short(node, window, now)[1] for node in self._ways]
