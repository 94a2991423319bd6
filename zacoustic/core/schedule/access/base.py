"""The interface of a medium access policy: when a frame may start, and what the policy hears.

A policy answers one question, `ready_at`. It is told what happens: carriers, own transmissions,
acknowledgements and losses, the network's time. Two policies also transmit: a poller gives turns, a
clock reference tells the time. Their controls take three to eight bytes, in frames that go anyway
(`controls`) or in one of their own (`speak_at`).

A policy owns no timer. `ready_at` is asked again after every input, and an instant that it returned
comes back as a time-out.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.wire.access import AccessControl


class Wanted(msgspec.Struct, frozen=True):
    """A frame that wants to go."""

    due_at: int
    """Instant from which it is to go, ns; may be over."""
    is_urgent: bool = False
    """It carries a REAL_TIME payload."""
    is_invited: bool = False
    """It shall arrive in an announced pause of a node that is heard."""
    is_copy: bool = False
    """It repeats what was just sent, and may follow that at once if the other node hears it out."""

    def earliest(self, now: int) -> int:
        """The earliest instant at which it could start, ns."""
        return max(self.due_at, now)


class MediumAccess(ABC):
    """Decides when a frame may start."""

    is_scheduled: ClassVar[bool] = False
    """It gives all nodes turns, so nobody needs listen windows."""
    answers_to: int = BROADCAST
    """Node for which a frame of its own is meant, or `BROADCAST`."""

    @abstractmethod
    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the instant, ns, at which a frame may start: at or before `now` means at once.

        None: it depends on an input that has not come yet, such as the end of a carrier.
        """

    def speak_at(self, now: int) -> int | None:
        """Return the instant, ns, at which `controls` are to go without any payload, or None."""
        return None

    def controls(self, room_bytes: int, now: int, *, alone: bool) -> bytes:
        """Take the controls for a frame, of at most `room_bytes`.

        Args:
            room_bytes: What the frame has left.
            now: Instant at which it starts.
            alone: The frame carries nothing else: `speak_at` has asked for it.
        """
        return b""

    def handle_carrier(self, busy: bool, now: int) -> None:  # noqa: B027  a policy may ignore it
        """Another node's transmission began or ended."""

    def handle_transmitted(self, now: int) -> None:  # noqa: B027  a policy may ignore it
        """An own transmission has ended."""

    def handle_heard(self, source: int, now: int) -> None:  # noqa: B027  a policy may ignore it
        """A frame of `source` has arrived, whatever is in it."""

    def handle_outcome(self, arrived: bool, now: int) -> None:  # noqa: B027  as above
        """The other engine acknowledged a frame of ours, or did not in time."""

    def handle_timeout(self, now: int) -> None:  # noqa: B027  a policy may ignore it
        """An instant that `ready_at` or `speak_at` named has come."""

    def handle_clock(  # noqa: B027  a policy may ignore it
        self, offset_ns: int, error_ns: int | None, now: int
    ) -> None:
        """This host says: UTC is `now + offset_ns`, wrong by `error_ns` at most; None: unknown."""

    def clock_doubt(self, now: int) -> str:
        """Return why the clock keeps this node from transmitting, one line; empty: it does not."""
        return ""

    def handle_control(  # noqa: B027  a policy may ignore it
        self, source: int, control: AccessControl, started_at: int, error_ns: int, now: int
    ) -> None:
        """A control arrived.

        Args:
            source: Who sent it.
            control: What it says.
            started_at: Instant at which its frame began to leave there, in our time, ns.
            error_ns: By how much that may be wrong, ns.
            now: The instant.
        """
