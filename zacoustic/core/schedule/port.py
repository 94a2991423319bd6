"""The engine's side of its link: its capabilities, when it is free, what is under way.

Each part of a frame is told when its transmission begins and how it has ended: by the report with
its id, or as if it had been cut short if the link is replaced before. Between two transmissions the
device gets the gap that it asks for. Three things decide when a frame may start: the gap, the
medium access of the link, and the listen windows, unless the access gives everybody turns or the
device hears while it sends.

A frame that a modem or the channel has duplicated is recognised where that is certain: the same
bytes from the same source, sooner than the source can have sent them again.

The distance of the others decides when a frame has to start to arrive in a listen window: half of
the longest distance is wrong by a second at 1500 m. A modem may measure the delay of each frame.
Otherwise the last measurement of that node is used, less and less exact; without one, half of the
longest delay.
"""

import random
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import (
    BROADCAST,
    UNKNOWN_SOURCE,
    LinkCapabilities,
    ReceivedFrame,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.base.parts import Part
from zacoustic.core.peers.measurements import Measurements
from zacoustic.core.peers.peers import Peers
from zacoustic.core.schedule.access import Listening, MediumAccess, Wanted, choose
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.wire.access import ANYBODY, AccessControl, Turn
from zacoustic.core.wire.envelope import Damaged, Envelope, Opened
from zacoustic.core.wire.objects import ListenHint

# What a modem's own time stamps may be wrong.
_STAMP_ERROR_NS = NS_PER_S // 1000
# A remembered way becomes wrong as fast as two vehicles approach each other: 4 m/s in 1500 m/s.
_WAY_DRIFT = 4 / 1500
_NO_PAUSE = 255
MOST_OUTSTANDING: Final = 1
"""Most transmissions under way: as many as links of `zacoustic.link.contract` take."""


class LinkPort:
    """State of one link, as its engine sees it, from the first UP on.

    Args:
        capabilities: What the link can do.
        address: Address of this node.
        rng: For the back-off of the medium access.
        access: What the config says of medium access, or None.
        envelope: What goes around a frame; None: what the link lacks.
        measurements: What was measured of the others; None: nothing. Only read.

    Raises:
        ConfigError: That choice cannot work on this link.
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
    ) -> None:
        self.capabilities = capabilities
        self.envelope = envelope or Envelope(capabilities, address)
        self.access: MediumAccess = choose(access, capabilities, address, rng)
        self.listening = Listening(capabilities)
        """The pauses of this node and of the others."""
        # Who hears while it sends is reached at any time, and so is whose airtime is waiting.
        self._listens = capabilities.half_duplex and not self.access.is_scheduled
        self._address = address
        self._measurements = measurements or Measurements(Peers())
        self._outstanding: dict[int, tuple[Part, ...]] = {}
        self._gap_until = 0
        self._last_frame: dict[int, tuple[bytes, int]] = {}

    def peer_forgotten(self, address: int, now: int) -> None:
        """Nothing is to be kept of a node."""
        self._last_frame.pop(address, None)
        self.listening.forget(address)

    @property
    def is_busy(self) -> bool:
        """A transmission is under way."""
        return bool(self._outstanding)

    @property
    def is_full(self) -> bool:
        """No other transmission may begin before one has ended."""
        return len(self._outstanding) >= MOST_OUTSTANDING

    def free_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the instant from which a frame may start, ns; None: it depends on an input."""
        if self.is_full:
            return None
        due_at, is_invited = max(wanted.due_at, self._gap_until), False
        if self._listens:
            due_at = self.listening.pauses_until(due_at, now, is_urgent=wanted.is_urgent)
            follows = wanted.is_urgent or wanted.is_copy
            invited_at = self.listening.invited_at(max(due_at, now), follows=follows)
            if invited_at is not None:
                due_at, is_invited = invited_at, True
            else:
                due_at = self.listening.listens_until(
                    max(due_at, now), is_urgent=wanted.is_urgent, follows=follows
                )
        wanted = msgspec.structs.replace(wanted, due_at=due_at, is_invited=is_invited)
        return self.access.ready_at(wanted, now)

    def speak_at(self, now: int) -> int | None:
        """Return the instant at which the medium access wants a frame of its own, ns, or None."""
        if self.is_full:
            return None
        speak_at = self.access.speak_at(now)
        return None if speak_at is None else max(speak_at, self._gap_until)

    def controls(self, room_bytes: int, backlog_bytes: int, now: int, *, has_object: bool) -> bytes:
        """Take the controls of medium access for a frame that starts now.

        Args:
            room_bytes: What it has left.
            backlog_bytes: All that waits, its payload included.
            now: The instant.
            has_object: An object is being sent.
        """
        said = self.access.controls(room_bytes, now, alone=False)
        if self._listens:
            said += self.listening.controls(
                room_bytes - len(said), backlog_bytes, now, has_object=has_object
            )
        return said

    def comfort_bytes(self, now: int, *, is_copy: bool) -> int | None:
        """Return the largest desirable size of a frame that starts now, bytes; None: any.

        Args:
            now: The instant.
            is_copy: It follows itself.
        """
        if not self._listens:
            return None
        comfort_ns = self.listening.comfort_ns(now, is_copy=is_copy)
        if comfort_ns is None:
            return None
        sound_s = comfort_ns / NS_PER_S - self.capabilities.preamble_s
        return max(0, int(sound_s * self.capabilities.bit_rate_bps / 8))

    def transmit(self, transmission_id: int, parts: tuple[Part, ...], now: int) -> None:
        """Take note of a transmission that begins, and tell its parts."""
        self._outstanding[transmission_id] = parts
        self.listening.handle_started(now)
        for part in parts:
            part.transmitted(now)

    def finish(self, report: TransmitReport, now: int) -> bool:
        """Take note of its end; False: the report belongs to no transmission under way."""
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
        """Close the port: no report will come of what is under way."""
        outstanding, self._outstanding = self._outstanding, {}
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
        """Return how many of the largest frames go before a pause, one that starts now included."""
        return self.listening.frames_before_pause(now) if self._listens else _NO_PAUSE

    def ends_run_now(self, now: int) -> bool:
        """Tell whether a largest frame that starts now is the last of several in a run."""
        return self._listens and self.listening.ends_run_now(now)

    def reaches_all(self, record_bytes: int) -> bool:
        """Tell whether only a broadcast frame reaches everybody, and may be that large.

        Args:
            record_bytes: What stands in the frame, without envelope.
        """
        # Frames of a link without addresses are heard by all, whoever they are for.
        limit_bytes = self.capabilities.broadcast_mtu_bytes or self.capabilities.mtu_bytes
        size_bytes = record_bytes + self.capabilities.mtu_bytes - self.envelope.room_bytes
        return self.capabilities.addressed and size_bytes <= limit_bytes

    def end_run(self) -> None:
        """Take note: the frame that is being composed announces a listen window."""
        self.listening.end_run()

    def handle_call(self, source: int, call: ListenHint, frame: ReceivedFrame, now: int) -> None:
        """Take from a fragment of `source` when it will listen."""
        if call is ListenHint.WINDOW:
            airtime_ns = self.capabilities.airtime_ns(len(frame.frame_bytes))
            way_ns, _ = self._way(source, frame, now)
            started_at = frame.received_at - way_ns - airtime_ns
            self.listening.heard_pause(source, airtime_ns, started_at, way_ns, now)
        else:
            self.listening.heard_listening(source, listens=call is not ListenHint.NONE, now=now)

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Somebody else's transmission began or ended."""
        self.access.handle_carrier(busy, now)
        self.listening.handle_carrier(busy, now)

    def heard(self, source: int, size_bytes: int, now: int) -> None:
        """A frame of `source` has arrived, for this node or another one."""
        self.access.handle_heard(source, now)
        self.listening.heard_frame(source, self.capabilities.airtime_ns(size_bytes), now)

    def handle_control(
        self, source: int, control: AccessControl, frame: ReceivedFrame, now: int
    ) -> None:
        """Take a control of medium access that came in a frame of `source`."""
        airtime_ns = self.capabilities.airtime_ns(len(frame.frame_bytes))
        way_ns, error_ns = self._way(source, frame, now)
        started_at = frame.received_at - way_ns - airtime_ns
        if isinstance(control, Turn) and control.node == ANYBODY:
            self.listening.heard_pause(source, control.span_ns, started_at, way_ns, now)
        else:
            self.access.handle_control(source, control, started_at, error_ns, now)

    def _way(self, source: int, frame: ReceivedFrame, now: int) -> tuple[int, int]:
        """Return the propagation delay of a frame, and by how much it may be wrong, ns."""
        measured_s = frame.metrics.propagation_s
        if measured_s is not None:
            return seconds_to_ns(measured_s), _STAMP_ERROR_NS
        # Anywhere between here and the farthest node.
        guessed_ns = seconds_to_ns(self.capabilities.propagation_s) // 2
        known = self._measurements.range(source)
        if known is not None:
            drifted_ns = int((now - known.measured_at) * _WAY_DRIFT)
            if drifted_ns < guessed_ns:
                return seconds_to_ns(known.propagation_s), drifted_ns + _STAMP_ERROR_NS
        return guessed_ns, guessed_ns + _STAMP_ERROR_NS

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
        if not self.capabilities.framed or source == UNKNOWN_SOURCE:
            return False  # one piece of a byte stream may hold several equal frames
        last_bytes, last_at = self._last_frame.get(source, (b"", 0))
        self._last_frame[source] = (frame.frame_bytes, frame.received_at)
        airtime_ns = self.capabilities.airtime_ns(len(frame.frame_bytes))
        return last_bytes == frame.frame_bytes and frame.received_at - last_at < airtime_ns
