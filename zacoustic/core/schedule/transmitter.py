"""When a frame goes and what it costs: the link, its access, silence and airtime caps.

The instant of the next frame (`Transmitter.next_at`) is computed on demand and is not a timer: it
depends on queue, port, medium access, caps and silence at that moment, and any input may change
each of them.
"""

import enum
from collections.abc import Callable
from typing import Final, Protocol

import msgspec

from zacoustic.core.base.linktypes import (
    BROADCAST,
    ONE_LINK,
    LinkCapabilities,
    LinkState,
    Service,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.base.stats import LinkStats
from zacoustic.core.schedule.access import AccessState, Wanted
from zacoustic.core.schedule.airtime import AirtimeCaps
from zacoustic.core.schedule.composer import Composed
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import LaneKey, TransmitQueue
from zacoustic.core.schedule.replybudget import ReplyBudget
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.wire.envelope import Envelope

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


class FrameSource(Protocol):
    """The source of a node's frames, as the transmitter sees it."""

    @property
    def queue(self) -> TransmitQueue:
        """The waiting records."""

    @property
    def is_exclusive(self) -> bool:
        """Whether the object under way needs the channel to itself."""

    @property
    def goes_on(self) -> bool:
        """Whether its last frame has announced that another one follows at once."""

    def has_fragment(self, now: int) -> bool:
        """Return whether a fragment of an object is due, which fills its frame."""

    def hold(self, stream_id: int, until: int) -> None:
        """Hold everything of a stream until an instant, ns."""

    def is_urgent(self, now: int) -> bool:
        """Return whether something waits that goes before everything else."""

    @property
    def has_granted(self) -> bool:
        """Whether a frame of another link waits that may go although the node is silent."""

    def compose_granted(self, port: LinkPort, now: int) -> Composed | None:
        """Make that frame, or return None."""

    @property
    def may_speak(self) -> bool:
        """Whether the boot epoch is journalled, so that the node will not use it again."""

    def envelope(self, capabilities: LinkCapabilities) -> Envelope:
        """Make the envelope of the frames on a link."""

    def use_link(self, port: LinkPort, now: int) -> None:
        """Set the link's airtimes, and drop what is too large for it."""

    def due_at(self, now: int) -> int | None:
        """Return the instant from which a frame should go, ns; None: nothing to send."""

    def compose(self, port: LinkPort, now: int) -> Composed | None:
        """Make the frame that is worth most now, or return None."""

    def compose_only(self, port: LinkPort, lane: LaneKey, now: int) -> Composed | None:
        """Make a frame of one lane's payloads, or return None."""

    def bulk_due_at(self, now: int) -> int | None:
        """Return the instant from which a frame of the bulk service should go, ns, or None."""

    def compose_bulk(self, port: LinkPort, now: int) -> Composed | None:
        """Make a frame of the bulk service, or return None."""

    def rides_back(self, address: int, now: int) -> bool:
        """Return whether all that is urgent may go with what the device says to a node."""

    def ride_back(self, address: int, port: LinkPort, now: int) -> Composed | None:
        """Make a frame that goes with the acknowledgement of a node's bulk frames, or None."""

    def speak(self, port: LinkPort, now: int) -> Composed | None:
        """Make a frame with only the controls of medium access, or return None."""


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
        source: What the engine has to send there.
        silence: The transmit silence, and what is known of UTC.
        airtime: The airtime caps.
        replies: The reply budget of the node.
        stats: The link's counters.
        make_port: Makes the link's port from its capabilities and envelope.
        emit: Takes `NothingHeard` and `AccessStateChanged`.
    """

    def __init__(
        self,
        link: str,
        source: FrameSource,
        silence: Silence,
        airtime: AirtimeCaps,
        replies: ReplyBudget,
        stats: LinkStats,
        make_port: Callable[[LinkCapabilities, Envelope], LinkPort],
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
        self._replies = replies
        self._source = source
        self._silence = silence
        self._stats = stats
        self._make_port = make_port
        self._offset_ns: int | None = None
        self._emit = emit
        self._access_kind: tuple[object, ...] | None = None
        self._up_at = 0
        self._frames_at_up: tuple[int, int] | None = None
        """Frames sent and heard when the link came up; None: it is not up, something was heard
        since, or `NothingHeard` was emitted."""
        self._next_transmission_id = 1

    def use_link(self, capabilities: LinkCapabilities, now: int) -> None:
        """Begin with a link, or with new capabilities of it.

        Raises:
            ConfigError: It cannot do what the config asks of it; nothing has changed.
        """
        port = self._make_port(capabilities, self._source.envelope(capabilities))
        if self.port is not None:
            self.port.close(now)
        self.port = port
        self._tell_access(port, now)
        self._source.use_link(port, now)

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
        if state is LinkState.UP:
            self._frames_at_up = self._stats.frames_transmitted, self._stats.frames_received

    def handle_timeout(self, now: int) -> None:
        """Handle an instant that `next_at` or a timer has named."""
        if self.port is not None:
            self.port.access.handle_timeout(now)

    def review(self, now: int) -> None:
        """Emit an event if nothing is heard, or medium access has changed."""
        self._review_access(now)
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
        port = self.port
        if port is None:
            return None
        source = self._source
        composed = None
        granted = self._silence.granted(now)
        if granted is not None:
            if _is_over(self._last_word_at(granted, now), now):
                composed = source.compose_only(port, granted, now)
                self._silence.use_grant()
        elif (composed := self._ride_back(port, now)) is not None:
            pass  # better than a frame of its own, which may meet one of that node
        elif _is_over(self._transmit_at(now), now):
            composed = source.compose(port, now)
        elif _is_over(self._granted_at(now), now):
            composed = source.compose_granted(port, now)
        if composed is None and _is_over(self._speak_at(now), now):
            composed = source.speak(port, now)
        service = Service.PLAIN
        if composed is None and granted is None and _is_over(self._bulk_at(now), now):
            composed, service = source.compose_bulk(port, now), Service.BULK
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
            self._source.hold(stream_id, until)
        if composed.caused_by is not None:
            even_at = self._replies.spend(composed.caused_by, airtime_ns, now)
            if even_at > now:
                source.queue.hold_replies(composed.caused_by, even_at)
        return transmission, composed

    def _ride_back(self, port: LinkPort, now: int) -> Composed | None:
        """Make a frame to a node that sends this one much data, if anything waits."""
        address = port.rides_back_to(now, is_urgent=self._source.is_urgent(now))
        if address is None or self.link_state is not LinkState.UP or not self._source.may_speak:
            return None
        if not _is_over(self._source.due_at(now), now):
            return None
        if not _is_over(self._after_silence(now, now), now):
            return None
        if self.airtime.free_at(now) > now and not self._source.is_urgent(now):
            return None
        return self._source.ride_back(address, port, now)

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
        granted = self._silence.granted(now)
        if granted is not None:
            return self._last_word_at(granted, now)
        transmit_at, speak_at = self._transmit_at(now), self._speak_at(now)
        if self._source.has_granted and self._silence.is_silent(now):
            return self._granted_at(now)
        if self.port is not None and self.port.bulk is not None:
            instants = (transmit_at, speak_at, self._bulk_at(now))
            return min((at for at in instants if at is not None), default=None)
        if transmit_at is None or speak_at is None:
            return speak_at if transmit_at is None else transmit_at
        return min(transmit_at, speak_at)

    def opening(self, now: int) -> Opening:
        """Return whether a frame goes now, or could if there were a record for it."""
        if _is_over(self._transmit_at(now), now):
            return Opening.DUE
        is_open = _is_over(self._transmit_at(now, now), now)
        return Opening.FREE if is_open else Opening.CLOSED

    def clock_doubt(self, now: int) -> str:
        """Return why a doubtful time keeps this node silent, one line; empty: it does not."""
        if self.port is None:
            return self._silence.clock_doubt
        return self._silence.clock_doubt or self.port.access.clock_doubt(now)

    def access_state(self, now: int) -> AccessState | None:
        """Return what a schedule does at present; None: there is none, or no link yet."""
        return None if self.port is None else self.port.access.state(now)

    # Below the methods above

    def _review_access(self, now: int) -> None:
        state = self.access_state(now)
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

    def _transmit_at(self, now: int, due_at: int | None = None) -> int | None:
        """Return when a frame of waiting records goes, ns, or None.

        Args:
            now: The instant.
            due_at: Instant from which a record should go, ns; None: that of the waiting ones.
        """
        if self.link_state is not LinkState.UP or self.port is None:
            return None
        is_full = self.port.is_full
        if is_full and not (self.port.keeps_reserve and self._source.is_urgent(now)):
            return None
        if not self._source.may_speak:
            return None
        due_at = self._source.due_at(now) if due_at is None else due_at
        if due_at is None:
            return None
        self.port.listening.exclusive = self._source.is_exclusive
        self.port.listening.sends_full = self._source.has_fragment(now)
        is_urgent = self._source.is_urgent(now)
        if not is_urgent:
            even_at = self.airtime.free_at(now)
            due_at = max(due_at, even_at) if even_at > now else due_at
        source = self._source
        wanted = Wanted(
            due_at, is_urgent, is_copy=source.queue.has_copy, is_in_train=source.goes_on
        )
        if bulk_source := self.port.bulk_source:
            wanted = self._beside_bulk(wanted, bulk_source, now)
        return self._after_silence(self.port.free_at(wanted, now), now)

    def _beside_bulk(self, wanted: Wanted, address: int, now: int) -> Wanted:
        """Return what waits, as it concerns a node that sends this one much data."""
        if wanted.is_urgent:
            rides_back = self._source.rides_back(address, now)
            return msgspec.structs.replace(wanted, rides_back=rides_back)
        _, first = next(self._source.queue.candidates(now), (None, None))
        is_for_others = first is not None and first.destination not in (BROADCAST, address)
        return msgspec.structs.replace(wanted, is_for_others=is_for_others)

    def _last_word_at(self, lane: LaneKey, now: int) -> int | None:
        """Return the instant of the frame that a silence grants to a lane, ns."""
        if self.link_state is not LinkState.UP or self.port is None:
            return None
        due_at = self._source.queue.due_at(now, lane)
        return None if due_at is None else self.port.free_at(Wanted(due_at, is_urgent=True), now)

    def _granted_at(self, now: int) -> int | None:
        """Return the instant of a frame of another link that may go in silence, ns."""
        if self.link_state is not LinkState.UP or self.port is None:
            return None
        if not self._source.has_granted or not self._silence.is_silent(now):
            return None
        return self.port.free_at(Wanted(now, is_urgent=True), now)

    def _speak_at(self, now: int) -> int | None:
        """Return when medium access wants a frame of its own, ns, or None."""
        if self.link_state is not LinkState.UP or self.port is None:
            return None
        return self._after_silence(self.port.speak_at(now), now)

    def _bulk_at(self, now: int) -> int | None:
        """Return when a frame of the bulk service goes, ns, or None."""
        port = self.port
        if self.link_state is not LinkState.UP or port is None or not port.takes_bulk:
            return None
        if not self._source.may_speak:
            return None
        due_at = self._source.bulk_due_at(now)
        if due_at is None:
            return None
        return self._after_silence(max(due_at, self.airtime.free_at(now)), now)

    def _after_silence(self, instant: int | None, now: int) -> int | None:
        silent_until = self._silence.until(now)
        if instant is None or silent_until is None:
            return None
        return max(instant, silent_until) if silent_until > now else instant


def _is_over(instant: int | None, now: int) -> bool:
    return instant is not None and instant <= now
