"""The interface of a medium access policy: when a frame may start, and what the policy learns.

A policy answers one question, `ready_at`. It is informed of carriers, own transmissions,
acknowledgements and losses, and the network's time. Two policies also transmit: a poller gives
turns, a clock reference sends the time. Their controls take three to eight bytes, in frames that go
anyway (`controls`) or in one of their own (`speak_at`).

A policy owns no timer. The engine asks `ready_at` again after every input, and calls the policy at
an instant that it returned. To ask changes nothing: what a policy must know of waiting frames comes
by `handle_waiting`.
"""

import enum
from abc import ABC, abstractmethod

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.waits import Why
from zacoustic.core.wire.access import AccessControl


class Wanted(msgspec.Struct):
    """A frame that is waiting to go, on its way through the gate."""

    due_at: int
    """Instant from which it should go, ns; may have passed."""
    is_urgent: bool = False
    """Whether it carries a REAL_TIME payload."""
    is_invited: bool = False
    """Whether it should arrive in an announced pause of a node that is heard."""
    is_copy: bool = False
    """Whether it repeats what was just sent, and may follow at once if the other node listens
    on."""
    is_in_rhythm: bool = False
    """Whether other nodes count on the run that it belongs to, or it is part of an object."""
    rides_back: bool = False
    """Whether it may go with what the device says to a node that sends this one much data."""
    is_for_others: bool = False
    """Whether it is for another node than that one."""
    is_in_train: bool = False
    """Whether the last frame has announced that this one follows at once."""

    def earliest(self, now: int) -> int:
        """Return the earliest instant at which it could start, ns."""
        return max(self.due_at, now)


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """A frame of another node, as it arrived here."""

    source: int
    """Its sender."""
    began_at: int
    """Instant at which it began to arrive, ns."""
    airtime_ns: int
    """Its airtime, ns."""
    way_ns: int
    """Propagation delay, ns: measured, or half of the longest one."""
    way_error_ns: int
    """The largest error of that, ns."""
    is_urgent: bool = False
    """Whether it carries a REAL_TIME payload, which goes at any instant."""


class Trouble(enum.Enum):
    """What is wrong between a schedule and another node."""

    OUTSIDE = "outside"
    """It transmits outside its slots."""
    FAR = "far"
    """Its frames reach into a slot of this node, or those of this node into its slot."""
    SHARED = "shared"
    """It shares a slot with this node, and is heard."""


class SlotFault(msgspec.Struct, frozen=True, kw_only=True):
    """A schedule that does not hold for another node."""

    node: int
    """Its address."""
    trouble: Trouble
    """What is wrong."""
    by_s: float
    """By how much, s, ≥ 0; 0 for a shared slot."""


class AccessState(msgspec.Struct, frozen=True, kw_only=True):
    """What a policy with a schedule does at present."""

    method: str
    """The method in use, a word of the config."""
    why: str = ""
    """Why it is not the schedule, or why the schedule has no slot for this node; or empty."""
    faults: tuple[SlotFault, ...] = ()
    """Where the schedule does not hold, by address."""

    @property
    def is_trouble(self) -> bool:
        """Whether something is not as the schedule has it."""
        return bool(self.why or self.faults)

    @property
    def kind(self) -> tuple[object, ...]:
        """What makes two states differ, beyond figures."""
        return self.method, self.why, tuple((each.node, each.trouble) for each in self.faults)


class MediumAccess(ABC):
    """Decides when a frame may start."""

    answers_to: int = BROADCAST
    """The node for which a frame of its own is meant, or `BROADCAST`."""
    speaks: bool = False
    """Whether its controls may need a frame of their own: otherwise `speak_at` is never asked."""
    has_schedule: bool = False
    """Whether it has a schedule, which depends on the clock: only then it has a state or a doubt,
    and anything to review."""

    @property
    def is_scheduled(self) -> bool:
        """Whether it gives all nodes turns, so that no node needs listen windows."""
        return False

    @property
    def is_apart(self) -> bool:
        """Whether it separates own frames, except for those in a rhythm (`Wanted.is_in_rhythm`)."""
        return False

    @abstractmethod
    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the instant at which a frame may start, ns; at or before `now`: at once.

        None: it depends on an input that has not come yet, such as the end of a carrier.
        """

    def why(self, wanted: Wanted, now: int) -> Why:
        """Return for what a frame waits that may not start now by `ready_at`."""
        return Why.SLOT

    def handle_waiting(  # noqa: B027  a policy may ignore it
        self, wanted: Wanted, now: int
    ) -> None:
        """Record that a frame waits for this policy now, and for nothing before it."""

    def review(self, now: int) -> None:  # noqa: B027  a policy may ignore it
        """Choose by what is known now; called before each decision."""

    def speak_at(self, now: int) -> int | None:
        """Return the instant at which `controls` should go without any payload, ns, or None."""
        return None

    def controls(self, room_bytes: int, now: int, *, alone: bool) -> bytes:
        """Take the controls for a frame, of at most `room_bytes`.

        Args:
            room_bytes: Room left in the frame, bytes.
            now: Instant at which it starts.
            alone: The frame carries nothing else: `speak_at` has asked for it.
        """
        return b""

    def handle_carrier(self, busy: bool, now: int) -> None:  # noqa: B027  a policy may ignore it
        """Record the begin or end of another node's transmission."""

    def handle_transmitted(self, now: int) -> None:  # noqa: B027  a policy may ignore it
        """Record the end of an own transmission."""

    def handle_heard(self, source: int, now: int) -> None:  # noqa: B027  a policy may ignore it
        """Record a frame from `source`, whatever its content."""

    def handle_arrival(self, arrival: Arrival, now: int) -> None:  # noqa: B027  as above
        """Record when an authentic frame for this node or all has arrived."""

    def state(self, now: int) -> AccessState | None:
        """Return what a policy with a schedule does at present; None: it has none."""
        return None

    def handle_outcome(self, arrived: bool, now: int) -> None:  # noqa: B027  as above
        """Record whether the other engine acknowledged a frame of this node in time."""

    def handle_timeout(self, now: int) -> None:  # noqa: B027  a policy may ignore it
        """Handle an instant that `ready_at` or `speak_at` returned."""

    def handle_clock(  # noqa: B027  a policy may ignore it
        self, offset_ns: int, error_ns: int | None, now: int
    ) -> None:
        """Take the host's time: UTC is `now + offset_ns`, within `error_ns`; None: unknown."""

    def clock_doubt(self, now: int) -> str:
        """Return why the clock keeps this node from transmitting, one line; empty: it does not."""
        return ""

    def handle_control(  # noqa: B027  a policy may ignore it
        self, source: int, control: AccessControl, started_at: int, error_ns: int, now: int
    ) -> None:
        """Take a control.

        Args:
            source: Its sender.
            control: The control.
            started_at: Instant at which its frame began to leave there, in this node's time, ns.
            error_ns: The largest error of that instant, ns.
            now: The instant.
        """


class TurnAccess(MediumAccess):
    """Gives all nodes turns, so that no node needs listen windows."""

    @property
    def is_scheduled(self) -> bool:
        """Whether it gives all nodes turns: yes."""
        return True

    def why(self, wanted: Wanted, now: int) -> Why:
        """Return for what a frame waits: this node's turn."""
        return Why.TURN
