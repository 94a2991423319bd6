"""One frame, one write, one packet: when the next frame may be written to DESERT's socket.

DESERT makes a packet of the bytes of one read. Two frames written within about a millisecond may
share a packet, or lie across two; then one lost packet costs both. DESERT also accepts everything
at once and queues it without limit. So the sender must pace its writes::

    submit ──► waits ──ready_at──► poll_write ──airtime──► poll_report: SENT
                 │                     │
                 └──────── abort ──────┴──► poll_report: ABORTED

- At most one transmission is outstanding; another one is REJECTED.
- The next write comes no sooner than the airtime of the last frame after its write, even if the
  connection was lost in between: DESERT may still hold what it has read.
- Every transmission that was submitted or refused has exactly one report.

SENT means that DESERT had the time to send the frame. Its outcome is never known.
"""

from collections import deque

from zacoustic.core.linktypes import (
    LinkCapabilities,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)


class Pacer:
    """Decides when frames are written, and reports them.

    Args:
        capabilities: For the airtime of a frame.
    """

    def __init__(self, capabilities: LinkCapabilities) -> None:
        self._capabilities = capabilities
        self._outstanding: _Outstanding | None = None
        self._reports: deque[TransmitReport] = deque()
        self._ready_at = 0

    def submit(self, transmission: Transmission, now: int) -> None:
        """Take a transmission; reject it if another one is outstanding."""
        if self._outstanding is not None:
            other = self._outstanding.transmission.transmission_id
            self.refuse(
                transmission, TransmitOutcome.REJECTED, f"transmission {other} is outstanding", now
            )
            return
        self._outstanding = _Outstanding(transmission, now)

    def refuse(
        self, transmission: Transmission, outcome: TransmitOutcome, reason: str, now: int
    ) -> None:
        """Report a transmission as not accepted."""
        self._reports.append(
            TransmitReport(
                transmission_id=transmission.transmission_id,
                outcome=outcome,
                started_at=now,
                finished_at=now,
                detail=reason,
            )
        )

    def abort(self, reason: str, now: int) -> None:
        """End the outstanding transmission."""
        if self._outstanding is not None:
            self._finish(self._outstanding, TransmitOutcome.ABORTED, now, reason)

    def poll_write(self, now: int) -> bytes | None:
        """Return the frame to write now, if one is due; it counts as written."""
        outstanding = self._outstanding
        if outstanding is None or outstanding.ends_at is not None or now < self._ready_at:
            return None
        frame_bytes = outstanding.transmission.frame_bytes
        outstanding.started_at = now
        outstanding.ends_at = now + self._capabilities.airtime_ns(len(frame_bytes))
        self._ready_at = outstanding.ends_at
        return frame_bytes

    def poll_report(self, now: int) -> TransmitReport | None:
        """Return the next report, if there is one."""
        outstanding = self._outstanding
        if outstanding is not None and outstanding.ends_at is not None:
            ends_at = outstanding.ends_at
            if ends_at <= now:
                self._finish(outstanding, TransmitOutcome.SENT, ends_at)
        return self._reports.popleft() if self._reports else None

    def poll_timeout(self) -> int | None:
        """Return the instant at which a write or a report is due, ns; None: none is."""
        if self._reports:
            return 0
        outstanding = self._outstanding
        if outstanding is None:
            return None
        return self._ready_at if outstanding.ends_at is None else outstanding.ends_at

    def _finish(
        self, outstanding: "_Outstanding", outcome: TransmitOutcome, at: int, detail: str = ""
    ) -> None:
        self._outstanding = None
        self._reports.append(
            TransmitReport(
                transmission_id=outstanding.transmission.transmission_id,
                outcome=outcome,
                started_at=outstanding.started_at,
                finished_at=at,
                detail=detail,
            )
        )


class _Outstanding:
    """The transmission that has no report yet."""

    def __init__(self, transmission: Transmission, now: int) -> None:
        self.transmission = transmission
        # The call of `transmit`, then the write.
        self.started_at = now
        # When DESERT has had the time to send it; None: not written yet.
        self.ends_at: int | None = None
