"""The engine's side of its link: what it can do, when it is free, what is under way.

One transmission is outstanding at most, and between two the device gets the gap that it asks for.
A frame that arrives
twice because a modem or the water made two of it is recognised where that is certain: the same
bytes from the same source, sooner than the source can have sent them again.
"""

import random

from zacoustic.core.access import MediumAccess, choose
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.envelope import Damaged, Envelope, Opened
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkCapabilities,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)


class LinkPort:
    """State of one link, as its engine sees it, from the first UP on.

    Args:
        capabilities: What the link can do.
        address: Address of this node.
        rng: For the back-off of the medium access.
    """

    def __init__(self, capabilities: LinkCapabilities, address: int, rng: random.Random) -> None:
        self.capabilities = capabilities
        self.envelope = Envelope(capabilities, address)
        self.access: MediumAccess = choose(capabilities, rng)
        self._address = address
        self._outstanding: Transmission | None = None
        self._gap_until = 0
        self._last_frame: dict[int, tuple[bytes, int]] = {}

    @property
    def is_busy(self) -> bool:
        """A transmission is under way."""
        return self._outstanding is not None

    def free_at(self, now: int) -> int | None:
        """Return the instant from which a frame may start, ns; None: it depends on an input."""
        ready_at = self.access.ready_at(now)
        if self._outstanding is not None or ready_at is None:
            return None
        return max(ready_at, self._gap_until)

    def transmit(self, transmission: Transmission) -> None:
        """Note that a transmission is under way."""
        self._outstanding = transmission

    def finish(self, report: TransmitReport, now: int) -> bool:
        """Note its end; False for a report that belongs to no transmission under way."""
        outstanding = self._outstanding
        if outstanding is None or report.transmission_id != outstanding.transmission_id:
            return False
        self._outstanding = None
        self._gap_until = report.finished_at + seconds_to_ns(self.capabilities.gap_s)
        self.access.handle_transmitted(now)
        return True

    def refuse(self, opened: Opened | Damaged, frame: ReceivedFrame) -> str | None:
        """Return the reason why a frame is not looked into, or None."""
        if isinstance(opened, Damaged):
            return opened.reason
        if opened.source == self._address:
            return "own"
        if opened.destination not in (self._address, BROADCAST):
            return "not_for_us"
        return "echo" if self._is_echo(opened.source, frame) else None

    def _is_echo(self, source: int, frame: ReceivedFrame) -> bool:
        if not self.capabilities.framed:
            return False  # one piece of a byte stream may hold several equal frames
        last_bytes, last_at = self._last_frame.get(source, (b"", 0))
        self._last_frame[source] = (frame.frame_bytes, frame.received_at)
        airtime_ns = self.capabilities.airtime_ns(len(frame.frame_bytes))
        return last_bytes == frame.frame_bytes and frame.received_at - last_at < airtime_ns
