"""The durations of a transfer, all derived from the link's capabilities.

No number of seconds here belongs to one modem: a *slot* is the time from the start of a full frame
to the start of the next, and the other durations follow from slots and the propagation delay.
"""

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.otherruns import RUN_LIMIT_NS
from zacoustic.core.schedule.port import BULK_PAUSE_MARGIN_NS
from zacoustic.core.wire.objects import FEEDBACK_BYTES


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """Durations on one link, ns."""

    frame_ns: int
    """Airtime of a full frame."""
    gap_ns: int
    """The device's pause after a frame."""
    feedback_ns: int
    """Airtime of a frame with one feedback."""
    propagation_ns: int
    """Assumed propagation delay, one way."""
    pause_ns: int
    """Length of a listen window."""
    bulk_pause_ns: int = 0
    """Length of a pause between runs on the bulk service."""
    senses_carrier: bool = True
    """Whether two nodes that start at once hear each other, except within a propagation delay."""
    longest_answer_ns: int | None = None
    """Bound of what is learnt of the time until an answer; None: many listen windows."""

    @classmethod
    def of(
        cls,
        capabilities: LinkCapabilities,
        envelope_bytes: int,
        pause_ns: int,
        longest_answer_ns: int | None = None,
    ) -> "Timing":
        """Derive the durations from a link, given the bytes that the envelope adds to a frame."""
        feedback_bytes = min(capabilities.mtu_bytes, FEEDBACK_BYTES + envelope_bytes)
        return cls(
            frame_ns=capabilities.airtime_ns(capabilities.mtu_bytes),
            gap_ns=seconds_to_ns(capabilities.gap_s),
            feedback_ns=capabilities.airtime_ns(feedback_bytes),
            propagation_ns=seconds_to_ns(capabilities.propagation_s),
            pause_ns=pause_ns,
            # The receiver knows of it and begins at once; others do when they hear nothing.
            bulk_pause_ns=seconds_to_ns(capabilities.gap_s)
            + capabilities.airtime_ns(capabilities.mtu_bytes // 2)
            + BULK_PAUSE_MARGIN_NS,
            senses_carrier=capabilities.senses_carrier,
            longest_answer_ns=longest_answer_ns,
        )

    @property
    def slot_ns(self) -> int:
        """Time from the start of a full frame to the start of the next, ns, ≥ 1."""
        return max(1, self.frame_ns + self.gap_ns)

    @property
    def feedback_slot_ns(self) -> int:
        """Time from the start of a feedback to the start of the frame after it, ns, ≥ 1."""
        return max(1, self.feedback_ns + self.gap_ns)

    @property
    def exchange_ns(self) -> int:
        """Time from the end of a fragment that requests an answer to the end of the answer, ns."""
        return 2 * self.propagation_ns + self.feedback_slot_ns

    @property
    def run_frames(self) -> int:
        """Number of full frames between two listen windows."""
        return max(1, (RUN_LIMIT_NS + self.gap_ns) // self.slot_ns)

    @property
    def period_ns(self) -> int:
        """Time from the end of a listen window to the end of the next, ns."""
        return self.run_frames * self.slot_ns + self.pause_ns
