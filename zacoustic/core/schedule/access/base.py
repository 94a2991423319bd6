"""The interface of a medium access policy: when a frame may start, and what the policy learns.

A policy answers one question, `ready_at`. It is informed of carriers, own transmissions,
acknowledgements and losses, and the network's time. Two policies also transmit: a poller gives
turns, a clock reference sends the time. Their controls take three to eight bytes, in frames that go
anyway (`controls`) or in one of their own (`speak_at`).

A policy owns no timer. The engine asks `ready_at` again after every input, and calls the policy at
an instant that it returned.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.wire.access import AccessControl


class Wanted(msgspec.Struct, frozen=True):
    """A frame that is waiting to go."""

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

    def earliest(self, now: int) -> int:
        """Return the earliest instant at which it could start, ns."""
        return max(self.due_at, now)


class MediumAccess(ABC):
    """Decides when a frame may start."""

    is_scheduled: ClassVar[bool] = False
    """Whether it gives all nodes turns, so that no node needs listen windows."""
    answers_to: int = BROADCAST
    """The node for which a frame of its own is meant, or `BROADCAST`."""

    @abstractmethod
    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the instant at which a frame may start, ns; at or before `now`: at once.

        None: it depends on an input that has not come yet, such as the end of a carrier.
        """

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
