"""One engine driven by hand in virtual time: what it sends when, and why its next frame waits."""

import random
from collections.abc import Callable

from zacoustic.core.base.waits import Waits, Why
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable

LINK = LinkCapabilities(
    mtu_bytes=64, bit_rate_bps=640.0, preamble_s=0.1, propagation_s=1.0, half_duplex=False
)


class Waiter:
    """One engine, and a modem that takes the airtime of each frame.

    Args:
        table: Its streams.
        rules: Of transmission.
        capabilities: Of its link.
        seed: Of its randomness.
        is_up: Whether the link is up from the start.
        commits: Whether the journal is written at once.
        offset_s: Adjusts UTC to its time, s; None: nobody tells the time.
    """

    def __init__(
        self,
        table: StreamTable,
        rules: TransmitRules | None = None,
        capabilities: LinkCapabilities = LINK,
        *,
        seed: int = 1,
        is_up: bool = True,
        commits: bool = True,
        offset_s: float | None = None,
    ) -> None:
        self.now = 0
        self.capabilities = capabilities
        self.commits = commits
        self.sent: list[tuple[int, Transmission]] = []
        self.reports = True
        """Whether the modem reports the end of a frame."""
        self._offset_s = offset_s
        self._ends_at: int | None = None
        self._began_at = 0
        self.engine = Engine(
            address=1, table=table, epoch=7, rng=random.Random(seed), rules=rules or TransmitRules()
        )
        if is_up:
            self.change(LinkState.UP)

    def change(self, state: LinkState) -> None:
        """Change the state of the link."""
        if self._offset_s is not None:
            self.engine.handle_clock(seconds_to_ns(self._offset_s), 0, self.now)
        self.engine.handle_link_state(state, self.now, self.capabilities)
        self.poll()

    def publish(self, stream_id: int, payload: bytes = b"x") -> None:
        """Publish a sample."""
        self.engine.publish(stream_id, payload, self.now)
        self.poll()

    def tell(self, told: Callable[[int], object]) -> None:
        """Give the engine something at this instant."""
        told(self.now)
        self.poll()

    def poll(self) -> None:
        """Poll the engine until it is dry."""
        while True:
            write = self.engine.poll_journal() if self.commits else None
            if write is not None:
                self.engine.handle_journal_committed(write.write_id, self.now)
            elif (made := self.engine.poll_transmit(self.now)) is not None:
                self.sent.append((self.now, made))
                airtime_ns = self.capabilities.airtime_ns(len(made.frame_bytes))
                self._began_at, self._ends_at = self.now, self.now + airtime_ns
            elif self.engine.poll_event() is None:
                return

    def run(self, until: int, *, frames: int | None = None) -> None:
        """Let time pass until an instant, ns, or until so many frames have been sent in all."""
        while frames is None or len(self.sent) < frames:
            ends_at = self._ends_at if self.reports else None
            instants = [at for at in (self.engine.poll_timeout(), ends_at) if at is not None]
            at = min(instants, default=until)
            if at >= until:
                self.now = max(self.now, until)
                return
            self.now = max(self.now, at)
            if ends_at is not None and ends_at <= self.now:
                self._report()
            else:
                self.engine.handle_timeout(self.now)
            self.poll()

    @property
    def waits(self) -> Waits | None:
        """Why its next frame waits."""
        return self.engine.waits(self.now)

    def sends_as_told(self, why: Why) -> int:
        """Check that the next frame waits for a reason and goes when it is said to; return when."""
        waits, before = self.waits, len(self.sent)
        assert waits is not None
        assert waits.why is why
        assert waits.until is not None
        assert waits.until > self.now
        self.run(waits.until + 3600 * NS_PER_S, frames=before + 1)
        assert self.sent[before][0] == waits.until
        return waits.until

    def _report(self) -> None:
        ended_at, self._ends_at = self._ends_at, None
        assert ended_at is not None
        report = TransmitReport(
            transmission_id=self.sent[-1][1].transmission_id,
            outcome=TransmitOutcome.SENT,
            started_at=self._began_at,
            finished_at=ended_at,
        )
        self.engine.handle_transmit_report(report, self.now)
