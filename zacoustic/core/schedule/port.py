"""The engine's side of its link: its capabilities, when it is free, which frames are under way.

Each part of a frame learns when its transmission begins and how it ends: from the report with its
id, or as aborted if the link is replaced before. Between two transmissions the device gets the gap
that it asks for. Three things decide when a frame may start: the gap, the link's medium access, and
the listen windows, unless the access gives every node turns or the device hears while it sends.

A frame that a modem or the channel has duplicated is recognised where that is certain: the same
bytes from the same source, sooner than the source can have sent them again.

The distance of the other nodes decides when a frame must start to arrive in a listen window: half
of the longest distance is wrong by a second at 1500 m. A modem may measure the delay of each frame.
Otherwise the last measurement of that node is used, with a growing error; without one, half of the
longest delay. The age of a sample uses what is likely, half of a round trip (`ways`) included.

A link may have a second service, for much data to one node. Its device decides when the sound of
such a frame begins, so none of the three applies to it: only how many frames the link takes
(`BulkWindow`). It gets no further ones while a plain frame is under way, since the device may have
to empty its buffer before it sends that one. Where nodes have turns by schedule, it is not used.
"""

import random
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import (
    BROADCAST,
    UNKNOWN_SOURCE,
    LinkCapabilities,
    ReceivedFrame,
    Service,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.base.parts import Part
from zacoustic.core.base.signals import Signal
from zacoustic.core.base.waits import Why
from zacoustic.core.peers.measurements import Measurements
from zacoustic.core.peers.peers import Peers
from zacoustic.core.schedule.access import Listening, MediumAccess, Wanted, choose
from zacoustic.core.schedule.access.base import Arrival
from zacoustic.core.schedule.access.fairshare import FairShare, fair_share, never
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.schedule.bulkwindow import BulkWindow
from zacoustic.core.schedule.othertrains import OtherTrains
from zacoustic.core.schedule.ways import WAY_DRIFT
from zacoustic.core.wire.access import ANYBODY, AccessControl, Turn
from zacoustic.core.wire.envelope import Damaged, Envelope, Opened
from zacoustic.core.wire.objects import ListenHint

# The possible error of a modem's own time stamps.
_STAMP_ERROR_NS = NS_PER_S // 1000
_NO_PAUSE = 255
# Longest time from one train of a bulk service to the next, as far as a waiting frame trusts that
# there is one.
_BULK_RUN_NS: Final = 12 * NS_PER_S
# The same for an urgent frame.
_LONGEST_TRAIN_NS: Final = 10 * NS_PER_S
BULK_PAUSE_MARGIN_NS: Final = 8 * NS_PER_S // 10
"""Time of devices and computers in a pause between runs of a bulk service, ns."""
MOST_OUTSTANDING: Final = 1
"""The most transmissions of the plain service under way: as many as links of
`zacoustic.link.contract` accept."""


def _unknown(address: int, now: int) -> None:
    return None


class LinkPort:
    """The engine's state of one link, from its first UP on.

    Args:
        capabilities: What the link can do.
        address: Address of this node.
        rng: For the back-off of the medium access.
        access: The medium access settings of the config, or None.
        envelope: Wraps frames; None: what the link lacks.
        measurements: Measurements of the other nodes, read-only; None: none.
        most_outstanding: The most transmissions of the plain service under way.
        is_crowd: Returns whether at least two other nodes are known on the link.
        max_airtime: The airtime cap of the node; None: none is set.
        answered: Returns the delay to a node as its answers show it, and its error; None: unknown.

    Raises:
        ConfigError: That medium access cannot work on this link.
    """

    def __init__(
        self,
        capabilities: LinkCapabilities,
        address: int,
        rng: random.Random,
        access: AccessSpec | None = None,
        *,
        envelope: Envelope | None = None,
        measurements: Measurements | None = None,
        most_outstanding: int = MOST_OUTSTANDING,
        is_crowd: Callable[[], bool] = never,
        max_airtime: float | None = None,
        answered: Callable[[int, int], tuple[int, int] | None] = _unknown,
    ) -> None:
        self._answered = answered
        self.capabilities = capabilities
        self.envelope = envelope or Envelope(capabilities, address)
        self.access: MediumAccess = choose(access, capabilities, address, rng, is_crowd)
        share = fair_share(capabilities, max_airtime)
        self.listening = Listening(capabilities, FairShare(share, capabilities, is_crowd, rng))
        """The pauses of this node and of others."""
        self.extra_bytes = 0
        """What a frame of records may have beyond `mtu_bytes`, because of the link of a bond that
        it goes by now."""
        self._address = address
        self._measurements = measurements or Measurements(Peers())
        has_bulk = capabilities.bulk is not None and not self.access.is_scheduled
        self.bulk = BulkWindow(capabilities.bulk) if has_bulk and capabilities.bulk else None
        """The frames of the service for much data; None: there is none, or nodes have turns."""
        self._most_outstanding = most_outstanding
        self._outstanding: dict[int, tuple[Part, ...]] = {}
        self._bulk_run_until = 0
        """Instant until which a node that sends this one much data is taken to go on, ns."""
        self._bulk_pause_until = 0
        """Instant until which a frame may start in that node's present pause, ns."""
        self._bulk_heard = (0, 0)
        """That node, unless it pauses, and when its last frame came, ns."""
        self._bulk_asks = 0
        """The node that awaits an answer to what it has sent; 0: none does."""
        self._asked_for_pause_at: int | None = None
        self.hole_begins = Signal[int]()
        """``(now)``: both ends of other nodes' bulk service can be reached for a moment."""
        self._trains = OtherTrains(capabilities)
        self._gap_until = 0
        self._last_frame: dict[int, tuple[bytes, int]] = {}

    @property
    def _listens(self) -> bool:
        """Whether frames keep to listen windows."""
        return self.capabilities.half_duplex and not self.access.is_scheduled

    def peer_forgotten(self, address: int, now: int) -> None:
        """Forget a node."""
        self._last_frame.pop(address, None)
        self.listening.forget(address)

    @property
    def is_busy(self) -> bool:
        """Whether a transmission is under way."""
        return bool(self._outstanding) or (self.bulk is not None and bool(self.bulk))

    @property
    def takes_bulk(self) -> bool:
        """Whether a frame of the service for much data may be given to the link."""
        return self.bulk is not None and not self.bulk.is_full and not self._outstanding

    @property
    def room_bytes(self) -> int:
        """The largest content of a frame of records without envelope, bytes."""
        return self.envelope.room_bytes + self.extra_bytes

    @property
    def bulk_room_bytes(self) -> int:
        """The largest content of a frame of that service without envelope, bytes; 0: none."""
        if self.bulk is None:
            return 0
        extra_bytes = self.bulk.service.mtu_bytes - self.capabilities.mtu_bytes
        return self.envelope.room_bytes + extra_bytes

    @property
    def is_full(self) -> bool:
        """Whether a transmission must end before another one may begin."""
        return len(self._outstanding) >= self._most_outstanding

    @property
    def keeps_reserve(self) -> bool:
        """Whether an urgent frame may begin although the port is full: it overtakes the others."""
        if self.bulk is not None and self.bulk.service.overtakes and self.bulk:
            return len(self._outstanding) <= MOST_OUTSTANDING
        return self._most_outstanding > MOST_OUTSTANDING

    # Reasons for which a frame waits; see `zacoustic.core.schedule.gate`

    def after_gap(self, wanted: Wanted, at: int, now: int) -> int:
        """Return the end of the gap that the device needs after its last frame, ns, or `at`."""
        return max(at, self._gap_until)

    def after_burst(self, wanted: Wanted, at: int, now: int) -> int:
        """Return until when a node that sends this one much data hears nothing, ns, or `at`."""
        if not self._bulk_run_until or now <= self._bulk_pause_until or wanted.is_for_others:
            return at
        if not wanted.is_urgent:
            return max(at, self._bulk_run_until)
        # What cannot ride back is perhaps heard by others, if that node does not hear it.
        return max(at, self._bulk_heard[1] + _LONGEST_TRAIN_NS) if wanted.rides_back else at

    def after_pause(self, wanted: Wanted, at: int, now: int) -> int:
        """Return the end of an own pause, or when to start to arrive in a pause of others, ns."""
        # A device that hears while it sends can always be reached; so can one whose airtime is
        # waiting.
        if self.access.is_scheduled:
            return at
        goes_on = wanted.is_copy or wanted.is_in_train
        at = self.listening.pauses_until(at, now, is_urgent=wanted.is_urgent, goes_on=goes_on)
        at = max(at, now)
        follows = wanted.is_urgent or wanted.is_copy
        invited_at = self.listening.invited_at(at, follows=follows)
        if invited_at is not None:
            wanted.is_invited = True
            return invited_at
        return self.listening.listens_until(at, is_urgent=wanted.is_urgent, follows=follows)

    def by_access(self, wanted: Wanted, at: int, now: int) -> int | None:
        """Return when medium access allows a frame, ns; None: it depends on an input."""
        wanted.due_at = at
        if self.access.is_apart:
            wanted.is_in_rhythm = self._listens and self.listening.keeps_rhythm(now)
        return self.access.ready_at(wanted, now)

    def why_not_by_access(self, wanted: Wanted, at: int, now: int) -> Why:
        """Return for what medium access lets a frame wait."""
        wanted.due_at = at
        return self.access.why(wanted, now)

    @property
    def bulk_source(self) -> int:
        """The node that sends this one much data and has frames ride back; 0: none does."""
        return self._bulk_heard[0] if self.rides_back and self._bulk_run_until else 0

    @property
    def rides_back(self) -> bool:
        """Whether frames to a node that sends this one much data ride back."""
        return self.bulk is not None and self.bulk.service.rides_back

    def rides_back_to(self, now: int, *, is_urgent: bool) -> int | None:
        """Return the node to which a frame that is given now rides back; None: to none.

        A frame of a bulk service has just come, and the device will acknowledge it. An urgent frame
        is given at once: it goes with whatever the device says to that node next.
        """
        address, heard_at = self._bulk_heard
        if not self.rides_back or not address or self.is_full:
            return None
        return address if heard_at == now or (is_urgent and now < self._bulk_run_until) else None

    def may_ask_for_pause(self, now: int) -> bool:
        """Return whether it is time to ask that node for a pause: it first sends what it has."""
        asked_at = self._asked_for_pause_at
        return asked_at is None or now - asked_at >= _BULK_RUN_NS

    def ask_for_pause(self, now: int) -> None:
        """Record that a pause is asked for."""
        self._asked_for_pause_at = now

    def controls(
        self, room_bytes: int, has_bytes: Callable[[int], bool], now: int, *, has_object: bool
    ) -> bytes:
        """Take the controls of medium access for a frame that starts now.

        Args:
            room_bytes: Room left in the frame, bytes.
            has_bytes: Tells whether at least so many bytes wait, those of the frame included.
            now: The instant.
            has_object: Whether an object is being sent.
        """
        said = self.access.controls(room_bytes, now, alone=False)
        if self._listens:
            said += self.listening.controls(
                room_bytes - len(said), has_bytes, now, has_object=has_object
            )
        return said

    def comfort_bytes(self, now: int, *, is_copy: bool) -> int | None:
        """Return the preferred largest size of a frame that starts now, bytes; None: any.

        Args:
            now: The instant.
            is_copy: Whether it follows a copy of itself.
        """
        if not self._listens:
            return None
        comfort_ns = self.listening.comfort_ns(now, is_copy=is_copy)
        if comfort_ns is None:
            return None
        sound_s = comfort_ns / NS_PER_S - self.capabilities.preamble_s
        return max(0, int(sound_s * self.capabilities.bit_rate_bps / 8))

    def airtime_ns(self, frame_bytes: int, service: Service) -> int:
        """Return the airtime of a frame of a service, ns."""
        return self.capabilities.airtime_ns(frame_bytes, service)

    def transmit(
        self,
        transmission_id: int,
        parts: tuple[Part, ...],
        now: int,
        service: Service = Service.PLAIN,
    ) -> None:
        """Record a transmission that begins, and inform its parts."""
        if service is Service.BULK:
            assert self.bulk is not None
            self.bulk.give(transmission_id, parts)
        else:
            self._outstanding[transmission_id] = parts
            self.listening.handle_started(now)
        for part in parts:
            part.transmitted(now)

    def is_bulk(self, report: TransmitReport) -> bool:
        """Return whether a report is of a frame of the service for much data."""
        return self.bulk is not None and report.transmission_id in self.bulk

    def finish(self, report: TransmitReport, now: int) -> bool:
        """Record the end of a transmission; return False if the report fits none under way."""
        if self.bulk is not None and self.is_bulk(report):
            for part in self.bulk.take(report):
                part.reported(report, now)
            return True
        parts = self._outstanding.pop(report.transmission_id, None)
        if parts is None:
            return False
        self._gap_until = report.finished_at + seconds_to_ns(self.capabilities.gap_s)
        self.listening.handle_transmitted(report.started_at, report.finished_at)
        self.access.handle_transmitted(now)
        if report.outcome in (TransmitOutcome.DELIVERED, TransmitOutcome.NOT_DELIVERED):
            self.access.handle_outcome(report.outcome is TransmitOutcome.DELIVERED, now)
        for part in parts:
            part.reported(report, now)
        return True

    def close(self, now: int) -> None:
        """Close the port and report the transmissions under way as aborted."""
        outstanding, self._outstanding = self._outstanding, {}
        if self.bulk is not None:
            outstanding |= self.bulk.take_all()
        for transmission_id, parts in outstanding.items():
            report = TransmitReport(
                transmission_id=transmission_id,
                outcome=TransmitOutcome.ABORTED,
                started_at=now,
                finished_at=now,
                detail="the link was replaced",
            )
            for part in parts:
                part.reported(report, now)

    def frames_before_pause(self, now: int) -> int:
        """Return how many largest frames fit before a pause, one that starts now included."""
        return self.listening.frames_before_pause(now) if self._listens else _NO_PAUSE

    def ends_run_now(self, now: int) -> bool:
        """Return whether a largest frame that starts now is the last of several in a run."""
        return self._listens and self.listening.ends_run_now(now)

    def reaches_all(self, record_bytes: int) -> bool:
        """Return whether a broadcast frame, and only that, reaches all nodes at this size.

        Args:
            record_bytes: Content of the frame without envelope, bytes.
        """
        # All nodes hear the frames of a link without addresses, whatever their destination.
        return self.capabilities.addressed and record_bytes <= self.broadcast_bytes

    @property
    def broadcast_bytes(self) -> int:
        """The largest content of a broadcast frame without envelope, bytes."""
        limit_bytes = self.capabilities.broadcast_mtu_bytes or self.capabilities.mtu_bytes
        return limit_bytes - self.capabilities.mtu_bytes + self.room_bytes

    def end_run(self) -> None:
        """Record that the frame that is being composed announces a listen window."""
        self.listening.end_run()

    def handle_call(self, source: int, call: ListenHint, frame: ReceivedFrame, now: int) -> None:
        """Learn from a fragment of `source` when it will listen."""
        if call is ListenHint.ANSWER:
            self._bulk_asks = source if frame.service is Service.BULK else 0
            if source == self._bulk_heard[0]:
                self._bulk_run_until = 0
        if frame.service is Service.BULK:
            goes_on = call is not ListenHint.ANSWER
            self._bulk_run_until = now + _BULK_RUN_NS if goes_on else 0
            self._bulk_heard = (source if goes_on else 0, now)
            if call is ListenHint.WINDOW:
                gap_ns = seconds_to_ns(self.capabilities.gap_s)
                self._bulk_pause_until = now + gap_ns + BULK_PAUSE_MARGIN_NS
            return
        if call is ListenHint.WINDOW:
            airtime_ns = self.capabilities.airtime_ns(len(frame.frame_bytes))
            way_ns, _ = self._way(source, frame, now)
            started_at = frame.received_at - way_ns - airtime_ns
            self.listening.heard_pause(source, airtime_ns, started_at, way_ns, now)
        else:
            self.listening.heard_listening(source, listens=call is not ListenHint.NONE, now=now)

    def bulk_goes_on(self, source: int, now: int) -> None:
        """Record an answer to a node that has sent this one much data, but not yet all of it.

        Its next train follows as soon as it has the answer: the channel is not free.
        """
        if source == self._bulk_asks:
            self._bulk_asks = 0
            self._bulk_run_until = now + _BULK_RUN_NS
            self._bulk_heard = source, self._bulk_heard[1]

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Record the begin or end of another node's transmission."""
        self.access.handle_carrier(busy, now)
        self.listening.handle_carrier(busy, now)
        # An end of the trains has its own ways: between them, or with an acknowledgement.
        is_hole = self.bulk is not None and self._trains.begins_hole(busy, now)
        if is_hole and not self.bulk and now >= self._bulk_run_until:
            self.hole_begins(now)

    def heard(
        self, source: int, size_bytes: int, now: int, service: Service = Service.PLAIN
    ) -> None:
        """Record a frame from `source`, for this node or another one."""
        self.access.handle_heard(source, now)
        self._trains.heard(now)
        if service is Service.PLAIN:
            self.listening.heard_frame(source, self.capabilities.airtime_ns(size_bytes), now)

    def arrived(self, source: int, frame: ReceivedFrame, now: int, *, is_urgent: bool) -> None:
        """Record when an authentic frame of `source` for this node or all has arrived."""
        # A piece of a byte stream has no instant of its own.
        if source == UNKNOWN_SOURCE or not self.capabilities.framed:
            return
        airtime_ns = self.airtime_ns(len(frame.frame_bytes), frame.service)
        way_ns, error_ns = self._way(source, frame, now)
        self.access.handle_arrival(
            Arrival(
                source=source,
                began_at=frame.received_at - airtime_ns,
                airtime_ns=airtime_ns,
                way_ns=way_ns,
                way_error_ns=error_ns,
                is_urgent=is_urgent,
            ),
            now,
        )

    def handle_control(
        self, source: int, control: AccessControl, frame: ReceivedFrame, now: int
    ) -> None:
        """Take a control of medium access from a frame of `source`."""
        airtime_ns = self.airtime_ns(len(frame.frame_bytes), frame.service)
        way_ns, error_ns = self._way(source, frame, now)
        started_at = frame.received_at - way_ns - airtime_ns
        if isinstance(control, Turn) and control.node == ANYBODY:
            self.listening.heard_pause(source, control.span_ns, started_at, way_ns, now)
        else:
            self.access.handle_control(source, control, started_at, error_ns, now)

    def travel(
        self, source: int, frame: ReceivedFrame, content_bytes: int, now: int
    ) -> tuple[int, int | None]:
        """Return how long a frame was on its way: from its first bit there to its last one here.

        Args:
            source: Its source.
            frame: The frame.
            content_bytes: Size of its records, bytes.
            now: The instant.

        Returns:
            The duration, and its largest error, ns; None: nothing bounds that, since the device
            decides when a frame begins.
        """
        if frame.travel is not None:
            return frame.travel
        size_bytes = len(frame.frame_bytes)
        if not self.capabilities.framed:  # a piece of a byte stream may hold any part of frames
            size_bytes = content_bytes + self.capabilities.mtu_bytes - self.envelope.room_bytes
        way_ns, error_ns = self._likely_way(source, frame, now)
        travel_ns = self.airtime_ns(size_bytes, frame.service) + way_ns
        is_bounded = frame.service is Service.PLAIN and not self.capabilities.controls_access
        return travel_ns, error_ns if is_bounded else None

    def _way(self, source: int, frame: ReceivedFrame, now: int) -> tuple[int, int]:
        """Return the propagation delay of a frame and its largest error, ns."""
        measured_s = frame.metrics.propagation_s
        if measured_s is not None:
            return seconds_to_ns(measured_s), _STAMP_ERROR_NS
        # Anywhere between here and the farthest node.
        guessed_ns = seconds_to_ns(self.capabilities.propagation_s) // 2
        known = self._measurements.range(source)
        if known is not None:
            drifted_ns = int((now - known.measured_at) * WAY_DRIFT)
            if drifted_ns < guessed_ns:
                return seconds_to_ns(known.propagation_s), drifted_ns + _STAMP_ERROR_NS
        return guessed_ns, guessed_ns + _STAMP_ERROR_NS

    def _likely_way(self, source: int, frame: ReceivedFrame, now: int) -> tuple[int, int]:
        """Return the most likely propagation delay of a frame and its largest error, ns.

        `_way` takes the middle between here and the farthest node as soon as that is surer; but a
        node is mostly about where it was.
        """
        told = self.capabilities
        longest_ns = seconds_to_ns(told.propagation_s)
        known = self._measurements.range(source)
        found: list[tuple[int, int]] = []
        if known is not None and (told.measures_range or "propagation_s" in told.reports):
            drifted_ns = int((now - known.measured_at) * WAY_DRIFT)
            found.append((seconds_to_ns(known.propagation_s), drifted_ns))
        answered = self._answered(source, now)
        if answered is not None and not told.controls_access:
            found.append(answered)
        if frame.metrics.propagation_s is not None or not found:
            return self._way(source, frame, now)
        way_ns, error_ns = min(found, key=_error_of)
        farthest_ns = max(way_ns, longest_ns - way_ns)
        return way_ns, min(error_ns, farthest_ns) + _STAMP_ERROR_NS

    def refuse(self, opened: Opened | Damaged, frame: ReceivedFrame) -> str | None:
        """Return why a frame is not decoded, or None."""
        if isinstance(opened, Damaged):
            return opened.reason
        if opened.source == self._address:
            return "own"
        if opened.destination not in (self._address, BROADCAST):
            return "not_for_us"
        return "echo" if self._is_echo(opened.source, frame) else None

    def _is_echo(self, source: int, frame: ReceivedFrame) -> bool:
        if not self.capabilities.framed or source == UNKNOWN_SOURCE:
            return False  # one piece of a byte stream may hold several equal frames
        last_bytes, last_at = self._last_frame.get(source, (b"", 0))
        self._last_frame[source] = (frame.frame_bytes, frame.received_at)
        airtime_ns = self.airtime_ns(len(frame.frame_bytes), frame.service)
        return last_bytes == frame.frame_bytes and frame.received_at - last_at < airtime_ns


def _error_of(way: tuple[int, int]) -> int:
    return way[1]
