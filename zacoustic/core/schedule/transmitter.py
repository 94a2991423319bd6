"""What goes when the gate is open, and what it costs.

The instant of the next frame (`Transmitter.next_at`) is computed on demand and is not a timer: it
depends on queue, port, medium access, caps and silence at that moment, and any input may change
each of them (`zacoustic.core.schedule.gate`).
"""

import enum
from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import (
    ONE_LINK,
    LinkState,
    Service,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.base.stats import LinkStats
from zacoustic.core.base.waits import Waits, Why
from zacoustic.core.schedule.access import AccessState
from zacoustic.core.schedule.access.base import MediumAccess
from zacoustic.core.schedule.airtime import AirtimeCaps
from zacoustic.core.schedule.frames import Composed, Frames
from zacoustic.core.schedule.gate import Gate
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.replybudget import ReplyBudget
from zacoustic.core.schedule.silence import Silence

UNHEARD_FRAMES: Final = 20
"""After this many frames without any reception the application gets an event."""


class NothingHeard(msgspec.Struct, frozen=True, kw_only=True):
    """Frames were sent since the link came up, and nothing was heard at all; emitted once."""

    frames: int
    """Number of frames sent."""
    up_at: int
    """Instant at which the link came up, ns."""
    changed_at: int
    """Instant of the event, ns."""
    link: str = ONE_LINK
    """Name of the link."""


class AccessStateChanged(msgspec.Struct, frozen=True, kw_only=True):
    """A schedule does not hold, is not in use, or is as it should be again."""

    state: AccessState
    """What medium access does now."""
    changed_at: int
    """Instant of the change, ns."""
    link: str = ONE_LINK
    """Name of the link."""


class Opening(enum.Enum):
    """Whether a link can take a frame of records."""

    CLOSED = "closed"
    """None goes now."""
    FREE = "free"
    """A record that is queued now could go at once; none is due."""
    DUE = "due"
    """A frame goes now."""


class Transmitter:
    """Makes the transmissions of one engine on one link.

    Args:
        link: Name of the link.
        frames: What the engine has to send there.
        silence: The transmit silence, and what is known of UTC.
        airtime: The airtime caps.
        replies: The reply budget of the node.
        stats: The link's counters.
        emit: Takes `NothingHeard` and `AccessStateChanged`.
    """

    def __init__(
        self,
        link: str,
        frames: Frames,
        silence: Silence,
        airtime: AirtimeCaps,
        replies: ReplyBudget,
        stats: LinkStats,
        emit: Callable[[NothingHeard | AccessStateChanged], None],
    ) -> None:
        self.link = link
        """Name of the link."""
        self.port: LinkPort | None = None
        """The port of the link; None before the link was up."""
        self.link_state = LinkState.OPENING
        """The last reported state of the link."""
        self.airtime = airtime
        """The airtime caps of streams and node."""
        self.has_schedule = False
        """Whether medium access has a schedule, which depends on the clock."""
        self._gate: Gate | None = None
        """Decides when a frame goes; None before the link was up."""
        self._replies = replies
        self._frames = frames
        self._silence = silence
        self._stats = stats
        self._offset_ns: int | None = None
        self._emit = emit
        self._access_kind: tuple[object, ...] | None = None
        self._up_at = 0
        self._frames_at_up: tuple[int, int] | None = None
        """Frames sent and heard when the link came up; None: it is not up, something was heard
        since, or `NothingHeard` was emitted."""
        self._next_transmission_id = 1

    def use_link(self, port: LinkPort, now: int) -> None:
        """Begin with a port: the link is up for the first time, or its capabilities are new."""
        if self.port is not None:
            self.port.close(now)
        self.port, self.has_schedule = port, port.access.has_schedule
        is_up = self.link_state is LinkState.UP
        self._gate = Gate(port, self._frames, self._silence, self.airtime, is_up=is_up)
        self._tell_access(port, now)

    def peer_forgotten(self, address: int, now: int) -> None:
        """Forget a node."""
        if self.port is not None:
            self.port.peer_forgotten(address, now)

    def handle_clock(self, offset_ns: int, error_ns: int | None, now: int) -> None:
        """Take the time of the host's clock; see `Engine.handle_clock`."""
        self._offset_ns = offset_ns
        if self.port is not None:
            self.port.access.handle_clock(offset_ns, error_ns, now)

    def change_state(self, state: LinkState, now: int) -> None:
        """Record a new state of the link."""
        self.link_state, self._up_at, self._frames_at_up = state, now, None
        if self._gate is not None:
            self._gate.is_up = state is LinkState.UP
        if state is LinkState.UP:
            self._frames_at_up = self._stats.frames_transmitted, self._stats.frames_received

    def handle_timeout(self, now: int) -> None:
        """Handle an instant that `next_at` or a timer has named."""
        if self.port is not None:
            self.port.access.handle_timeout(now)

    def review(self, now: int) -> None:
        """Emit an event if nothing is heard, or medium access has changed."""
        if self.port is not None and self.has_schedule:
            self._review_access(self.port.access, now)
        if self._frames_at_up is None:
            return
        sent = self._stats.frames_transmitted - self._frames_at_up[0]
        if self._stats.frames_received > self._frames_at_up[1]:
            self._frames_at_up = None
        elif sent >= UNHEARD_FRAMES:
            self._frames_at_up = None
            self._emit(NothingHeard(frames=sent, up_at=self._up_at, changed_at=now, link=self.link))

    def make(self, now: int) -> tuple[Transmission, Composed] | None:
        """Make the transmission that is worth most now, if one may begin.

        Returns:
            The transmission, and what it is made of; None: none may begin.
        """
        port, gate, frames = self.port, self._gate, self._frames
        if port is None or gate is None:
            return None
        if self.has_schedule:
            port.access.review(now)
        composed = None
        granted = self._silence.granted(now)
        if granted is not None:
            if gate.opens_to_last_word(granted, now):
                composed = frames.compose_only(port, granted, now)
                self._silence.use_grant()
        elif (
            gate.rides_back
            and (address := gate.rides_back_to(now)) is not None
            and (composed := frames.ride_back(address, port, now)) is not None
        ):
            pass  # better than a frame of its own, which may meet one of that node
        elif gate.opens(now):
            composed = frames.compose(port, now)
        elif gate.opens_to_granted(now):
            composed = frames.compose_granted(port, now)
        if composed is None and gate.speaks and gate.opens_to_access(now):
            composed = frames.speak(port, now)
        service = Service.PLAIN
        may_bulk = gate.has_bulk and granted is None
        if composed is None and may_bulk and gate.opens_to_bulk(now):
            composed, service = frames.compose_bulk(port, now), Service.BULK
        if composed is None:
            return None
        transmission = Transmission(
            transmission_id=self._next_transmission_id,
            frame_bytes=composed.frame_bytes,
            destination=composed.destination,
            acknowledge=composed.acknowledge,
            link=self.link,
            service=service,
            rides_back=composed.rides_back,
        )
        self._next_transmission_id += 1
        port.transmit(transmission.transmission_id, composed.parts, now, service)
        airtime_ns = port.airtime_ns(len(composed.frame_bytes), service)
        self._stats.sent(len(composed.frame_bytes), airtime_ns)
        held = self.airtime.spend(composed.stream_bytes, airtime_ns, now)
        for stream_id, until in held.items():
            self._frames.hold(stream_id, until)
        if composed.caused_by is not None:
            even_at = self._replies.spend(composed.caused_by, airtime_ns, now)
            if even_at > now:
                frames.queue.hold_replies(composed.caused_by, even_at)
        return transmission, composed

    def finish(self, report: TransmitReport, now: int) -> bool:
        """Record the end of a transmission; return False if the report fits none under way."""
        is_bulk = self.port is not None and self.port.is_bulk(report)
        if self.port is None or not self.port.finish(report, now):
            return False
        if is_bulk and report.outcome is TransmitOutcome.DELIVERED:
            self._frames_at_up = None  # its device hears the other one, if the node does not
        self._stats.reported(report.outcome.value)
        return True

    def next_at(self, now: int) -> int | None:
        """Return the instant from which a frame can and should go, ns, or None."""
        return None if self._gate is None else self._gate.next_at(now)

    def waits(self, now: int) -> Waits | None:
        """Return why the next frame waits; None: nothing waits, or it goes at once."""
        if self._gate is not None:
            return self._gate.waits(now)
        return Waits(why=Why.LINK, until=None) if self._frames.held(now) else None

    def opening(self, now: int) -> Opening:
        """Return whether a frame goes now, or could if there were a record for it."""
        gate = self._gate
        if gate is None:
            return Opening.CLOSED
        if gate.is_due(now):
            return Opening.DUE
        return Opening.FREE if gate.is_free(now) else Opening.CLOSED

    def handle_waiting(self, now: int) -> None:
        """Tell what holds the frames of this link that a record waits outside of the engine."""
        if self._gate is not None:
            self._gate.is_free(now, holds=True)

    def clock_doubt(self, now: int) -> str:
        """Return why a doubtful time keeps the schedule silent, one line; empty: it does not."""
        return "" if self.port is None else self.port.access.clock_doubt(now)

    def access_state(self, now: int) -> AccessState | None:
        """Return what a schedule does at present; None: there is none, or no link yet."""
        return None if self.port is None else self.port.access.state(now)

    # Below the methods above

    def _review_access(self, access: MediumAccess, now: int) -> None:
        access.review(now)
        state = access.state(now)
        if state is None or state.kind == self._access_kind:
            return
        is_first = self._access_kind is None
        self._access_kind = state.kind
        if state.is_trouble or not is_first:
            self._emit(AccessStateChanged(state=state, changed_at=now, link=self.link))

    def _tell_access(self, port: LinkPort, now: int) -> None:
        """Tell a new policy what is known of UTC, or else what the host says."""
        known = self._silence.host.time
        if known.offset_ns is not None:
            port.access.handle_clock(known.offset_ns, known.error_at(now), now)
        elif self._offset_ns is not None:
            port.access.handle_clock(self._offset_ns, None, now)
