"""Auto: the schedule of the file while the clock is good, else what needs no clock.

Slots are worth most and need a clock; carrier sense and ALOHA need none and are always safe to try.
So a node with a schedule in its file uses it while it knows the time and has a slot, and falls back
to what the link offers by itself while it does not.

A node without any time falls back at once. A node whose time has jumped waits for some cycles
first: a jump is often over by then. A node that is alone with its time among nodes that keep to the
schedule knows that others use the slots; it is silent, emergencies apart, until its clock is right
or it hears them no longer. When the clock is good again, the schedule has it back at once; it
listens for a cycle, as ever, before it uses its slots.

Beside nodes on the schedule, a node that has fallen back is a stranger: it waits while it hears
them, but what it sends may meet what it does not hear yet. `AccessState` says which node that is.
"""

from typing import Final

from zacoustic.core.base.waits import Why
from zacoustic.core.schedule.access.base import AccessState, Arrival, MediumAccess, Wanted
from zacoustic.core.schedule.access.tdma import Tdma
from zacoustic.core.wire.access import AccessControl

_PATIENCE_CYCLES: Final = 3
"""How long a node that knew the time waits before it goes on without the schedule."""


class Auto(MediumAccess):
    """The schedule, or what needs no clock.

    Args:
        schedule: The slots.
        otherwise: What is used while they cannot be.
        method: Its word in the config.
    """

    speaks = True
    has_schedule = True

    def __init__(self, schedule: Tdma, otherwise: MediumAccess, method: str) -> None:
        self._schedule = schedule
        self._otherwise = otherwise
        self._method = method
        self._why = "the time is not known yet"
        self._doubted_at: int | None = None
        """Since when a known time is in this doubt, ns; None: it is not, or none was known."""
        self._doubt = ""
        self._was_sure = False

    @property
    def is_scheduled(self) -> bool:
        """Whether the schedule is in use."""
        return not self._why

    @property
    def is_apart(self) -> bool:
        """Whether what is in use separates own frames."""
        return bool(self._why) and self._otherwise.is_apart

    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return when a frame may start by what is in use."""
        if not self._why:
            return self._schedule.ready_at(wanted, now)
        if self._schedule.is_alone(now) and not wanted.is_urgent:
            return wanted.earliest(now) + self._schedule.cycle_ns
        if now < self._patient_until and not wanted.is_urgent:
            return self._patient_until
        return self._otherwise.ready_at(wanted, now)

    def why(self, wanted: Wanted, now: int) -> Why:
        """Return for what a frame waits by what is in use."""
        if not self._why:
            return self._schedule.why(wanted, now)
        return Why.CLOCK if self._hesitates(wanted, now) else self._otherwise.why(wanted, now)

    def handle_waiting(self, wanted: Wanted, now: int) -> None:
        """Record that a frame waits for what is in use."""
        if self._why and not self._hesitates(wanted, now):
            self._otherwise.handle_waiting(wanted, now)

    def speak_at(self, now: int) -> int | None:
        """Return when the node whose clock all follow sends the time, ns, or None."""
        return self._schedule.speak_at(now)

    def controls(self, room_bytes: int, now: int, *, alone: bool) -> bytes:
        """Take the time for a frame."""
        return self._schedule.controls(room_bytes, now, alone=alone)

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Record the begin or end of another node's transmission."""
        self._otherwise.handle_carrier(busy, now)

    def handle_transmitted(self, now: int) -> None:
        """Record the end of an own transmission."""
        self._otherwise.handle_transmitted(now)

    def handle_heard(self, source: int, now: int) -> None:
        """Record a frame from `source`."""
        self._otherwise.handle_heard(source, now)

    def handle_arrival(self, arrival: Arrival, now: int) -> None:
        """Compare the instant of a frame with the slots of its sender."""
        self._schedule.handle_arrival(arrival, now)
        self.review(now)

    def handle_outcome(self, arrived: bool, now: int) -> None:
        """Record whether a frame arrived; a loss in a slot is no reason to back off."""
        if self._why:
            self._otherwise.handle_outcome(arrived, now)

    def handle_clock(self, offset_ns: int, error_ns: int | None, now: int) -> None:
        """Take the host's time."""
        self._schedule.handle_clock(offset_ns, error_ns, now)
        self._otherwise.handle_clock(offset_ns, error_ns, now)
        self.review(now)

    def handle_control(
        self, source: int, control: AccessControl, started_at: int, error_ns: int, now: int
    ) -> None:
        """Take the time that the reference node sends."""
        self._schedule.handle_control(source, control, started_at, error_ns, now)
        self.review(now)

    def state(self, now: int) -> AccessState | None:
        """Return what is in use, and why it is not the schedule."""
        state = self._schedule.state(now)
        if state is None or not self._why:
            return state
        return AccessState(method=self._method, why=self._why, faults=state.faults)

    def review(self, now: int) -> None:
        """Choose, by what is known now."""
        doubt = self._schedule.clock_doubt(now)
        is_new = doubt != self._doubt
        self._doubt = doubt
        self._why = doubt or self._schedule.slot_doubt(now)
        if not doubt:
            self._was_sure, self._doubted_at = True, None
        elif self._was_sure and is_new:
            self._doubted_at = now

    # Below the methods above

    @property
    def _patient_until(self) -> int:
        """Until when this node waits because a known time is in doubt, ns; 0: it does not."""
        if self._doubted_at is None:
            return 0
        return self._doubted_at + _PATIENCE_CYCLES * self._schedule.cycle_ns

    def _hesitates(self, wanted: Wanted, now: int) -> bool:
        """Return whether a frame waits for a better time and not for what is in use."""
        is_alone = self._schedule.is_alone(now)
        return not wanted.is_urgent and (is_alone or now < self._patient_until)
