"""An engine on one link: its transports, the link's port, and its transmitter.

Each link has transports of its own: airtimes, pauses, windows and runs of two links are unrelated,
so the loss of one link disturbs nothing on the other. Agreement with other nodes is common to all
links (`zacoustic.core.schedule.context`). The engine knows which link a stream uses.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import (
    UNKNOWN_SOURCE,
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Service,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.base.qos import Priority
from zacoustic.core.base.stats import Entries
from zacoustic.core.base.trace import Tracer
from zacoustic.core.engine.forwarding import Forwarding
from zacoustic.core.peers.sealing import Inside, SealRefusal
from zacoustic.core.profiles.native.protocols import Protocols
from zacoustic.core.profiles.profile import Profile
from zacoustic.core.profiles.rmw_desert.protocols import RmwDesertProtocols
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.flow import LONGEST_TRAIN
from zacoustic.core.relay.relay import Relay
from zacoustic.core.schedule.airtime import AirtimeCaps
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.port import MOST_OUTSTANDING, LinkPort
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.schedule.transmitter import Transmitter
from zacoustic.core.streams.table import Stream
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.transport.contract import MakeTransport
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic.core.wire.relay import is_relayed
from zacoustic.core.wire.seal import NO_TABLE, Way

_MAYBE_UNSEALED: Final = (SealRefusal.UNSEALED, SealRefusal.FORGED, SealRefusal.OUT_OF_STEP)
_PROTOCOLS: Final = {WireProfile.NATIVE: Protocols, WireProfile.RMW_DESERT: RmwDesertProtocols}


class MadeFrame(msgspec.Struct, frozen=True):
    """A frame on its way to what is below a stack."""

    transmission: Transmission
    """The frame."""
    is_urgent: bool
    """Whether it goes before all others."""
    expires_at: int | None
    """Instant after which the first of its records is worthless, ns; None: none ever is."""
    is_heartbeat: bool
    """Whether it has nothing but the sign that this node is there."""
    entries: Entries
    """What it is still to enter into the ledger."""


class LinkStack:
    """One link of an engine.

    Args:
        context: The node on this link.
        rules: The rules of the config for the node.
        own: The rules for this link.
        silence: The transmit silence.
        trace: Takes a record of each action.
        transports: Make third-party transports.
        forwarding: The routes and bonds over this link; None: there are none.
    """

    def __init__(
        self,
        context: Context,
        rules: TransmitRules,
        own: LinkRules,
        silence: Silence,
        trace: Tracer,
        transports: Sequence[MakeTransport],
        forwarding: Forwarding | None = None,
    ) -> None:
        self.name = context.link
        """Name of the link."""
        self.ids = context.ids
        """The ids that the application sees."""
        self.stats = context.stats
        """The link's counters."""
        self._forwarding = forwarding
        self._context = context
        self._seal = context.node.seal
        self._silence = silence
        self._trace = trace
        carries = forwarding is not None and forwarding.carries
        self.protocols: Profile = _PROTOCOLS[context.table.wire](
            context, rules, transports, forwarding if carries else None
        )
        """The transports."""
        if forwarding is not None and not carries:
            forwarding.began.connect(partial(self._forward, forwarding))
        self._access_rng = context.generators.of("access")
        self._access = own.access
        self._max_airtime = own.max_airtime
        on_desert = context.table.wire is WireProfile.RMW_DESERT
        self._max_frame_s = None if on_desert else own.max_frame_s
        """Longest airtime of a frame, s; None: as the wire, or a link below,
        has it."""
        self._told: LinkCapabilities | None = None
        """The capabilities as the link told them."""
        self.transmitter = Transmitter(
            context.link,
            self.protocols.frames,
            silence,
            AirtimeCaps(own.max_airtime),
            context.node.replies,
            context.stats,
            context.emit,
        )
        """Decides when a frame goes."""
        context.peers.forgotten.connect(self.transmitter.peer_forgotten)
        for stream in context.table:
            self.declared(stream)

    def declared(self, stream: Stream) -> None:
        """Apply the airtime cap of a stream in the table."""
        self.transmitter.airtime.limit(stream.stream_id, stream.qos.max_airtime)

    # Inputs

    def handle_frame(
        self, frame: ReceivedFrame, now: int, opened_at: Callable[[int], None] | None = None
    ) -> None:
        """Take a frame, or a piece of a byte stream.

        Args:
            frame: The frame.
            now: The instant, ns.
            opened_at: Called with the instant at which a sealed frame has been opened; None: nobody
                wants to know.
        """
        port = self.transmitter.port
        if port is None:
            self.stats.drop("link_down")
            return
        self.stats.heard(len(frame.frame_bytes))
        for opened in port.envelope.open(frame):
            reason = port.refuse(opened, frame)
            if isinstance(opened, Opened) and self._is_relayed(opened):
                reason = reason or self._take_relayed(opened, frame, port, now)
            elif isinstance(opened, Opened):
                if self._seal is None:
                    reason = self._take_plain(opened, frame, port, reason, now)
                else:
                    reason = self._take_sealed(opened, frame, port, reason, opened_at, now)
            self._drop(reason, frame, now)

    def handle_report(self, report: TransmitReport, now: int) -> None:
        """Take the report of a transmission that has ended."""
        port = self.transmitter.port
        service = Service.BULK if port is not None and port.is_bulk(report) else Service.PLAIN
        if self.transmitter.finish(report, now):
            detail = report.outcome.value
            self._trace.note(now, "report", detail=detail, link=self.name, service=service)
        else:
            self.stats.drop("stray_report")

    def sent(self, transmission_id: int, started_at: int, now: int) -> None:
        """Take the end of a transmission that went inside the frames of another link.

        Args:
            transmission_id: Its id.
            started_at: When it was handed over, ns.
            now: The instant, ns.
        """
        report = TransmitReport(
            transmission_id=transmission_id,
            outcome=TransmitOutcome.SENT,
            started_at=started_at,
            finished_at=now,
        )
        self.handle_report(report, now)

    def handle_state(
        self, state: LinkState, capabilities: LinkCapabilities | None, now: int
    ) -> bool:
        """Take the link's state; return whether it has changed."""
        if capabilities is not None and capabilities != self._told:
            self._use_link(capabilities, now)
        if state is self.transmitter.link_state:
            return False
        self.transmitter.change_state(state, now)
        if state is LinkState.UP:
            self._silence.wake(now)
            self.protocols.link_up(now)
        return True

    def switch(self, capabilities: LinkCapabilities, now: int) -> None:
        """Go on by another medium, by which whatever waits for an answer is due at once."""
        self._context.pacers.begin_anew()
        self._use_link(capabilities, now)
        self.protocols.link_up(now)

    # Outputs

    def make(self, now: int) -> Transmission | None:
        """Return the frame that is worth most now, if the link can take one."""
        made = self.make_ranked(now)
        return None if made is None else made.transmission

    def make_ranked(self, now: int) -> MadeFrame | None:
        """Return that frame, and what matters for its way."""
        made = self.transmitter.make(now)
        if made is None:
            return None
        transmission, composed = made
        self._context.node.twins.sent(transmission.frame_bytes)
        self._trace.note(
            now,
            "transmit",
            peer=transmission.destination,
            frame=transmission.frame_bytes,
            streams=composed.streams,
            link=self.name,
            service=transmission.service,
        )
        is_urgent = composed.is_urgent or any(map(self._is_urgent, composed.streams))
        if is_urgent and transmission.service is Service.PLAIN:
            transmission = msgspec.structs.replace(transmission, is_urgent=True)
        return MadeFrame(
            transmission,
            is_urgent,
            composed.expires_at,
            composed.is_heartbeat,
            self.stats.made(),
        )

    # Getters

    @property
    def state(self) -> LinkState:
        """The last reported state of the link."""
        return self.transmitter.link_state

    @property
    def capabilities(self) -> LinkCapabilities | None:
        """The link's capabilities, its frames bounded in airtime; None before it was up."""
        port = self.transmitter.port
        return port.capabilities if port else None

    @property
    def hop_room_bytes(self) -> int:
        """The most that a frame of a route, or a flooded one, has over this link, bytes."""
        port, overhead_bytes = self.transmitter.port, self._context.seal.hop_overhead_bytes
        return 0 if port is None else port.envelope.room_bytes - overhead_bytes

    @property
    def relay(self) -> Relay | None:
        """The routes over this link; None: there are none."""
        return None if self._forwarding is None else self._forwarding.relay

    @property
    def is_busy(self) -> bool:
        """Whether a transmission is under way."""
        port = self.transmitter.port
        return port is not None and port.is_busy

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits and nothing is under way."""
        return not self.is_busy and self.protocols.is_idle

    # Below the methods above

    def _forward(self, forwarding: Forwarding, now: int) -> None:
        """Begin to transmit what is forwarded: the first command has come."""
        if self.protocols.frames.forwarding is None:
            self.protocols.frames.forward(forwarding)

    def _is_relayed(self, opened: Opened) -> bool:
        """Return whether a frame is of a route or bond, or flooded, and not sealed on this hop."""
        forwarding, records = self._forwarding, opened.records
        if not is_relayed(records) or forwarding is None or not forwarding.takes(records):
            return False
        return self._seal is None or forwarding.goes_in_clear(records)

    def _take_relayed(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int
    ) -> str | None:
        """Take such a frame; return why it is dropped, or None."""
        assert self._forwarding is not None
        if self._seal is None:
            self._hear(opened, frame, port, now)
        else:
            port.heard(opened.source, len(frame.frame_bytes), now, frame.service)
        return self._forwarding.handle(opened, self._timed(opened, frame, port, now), now)

    def _take_from_hop(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int
    ) -> None:
        """Take a frame of a route, or a flooded one, that its hop has sealed."""
        self._hear(opened, frame, port, now)
        reason: str | None = "relay_route"
        if self._forwarding is not None and self._forwarding.takes(opened.records):
            reason = self._forwarding.handle(opened, self._timed(opened, frame, port, now), now)
        self._drop(reason, frame, now)

    def _timed(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int
    ) -> ReceivedFrame:
        """Return a frame with how long it was on its way."""
        travel = port.travel(opened.source, frame, len(opened.records), now)
        return msgspec.structs.replace(frame, travel=travel)

    def _take_plain(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, reason: str | None, now: int
    ) -> str | None:
        """Take a frame on a link without a seal; return why it is dropped, or None."""
        if reason is None:
            self._receive(opened, frame, port, now)
        elif reason == "not_for_us":
            self._hear(opened, frame, port, now)
            self.protocols.overhear(opened, frame, port, now)
        return reason

    def _take_sealed(
        self,
        opened: Opened,
        frame: ReceivedFrame,
        port: LinkPort,
        reason: str | None,
        opened_at: Callable[[int], None] | None,
        now: int,
    ) -> str | None:
        """Take a frame on a sealed link; return why it is dropped, or None.

        Nothing is believed of a frame for another node, not even its sender.
        """
        seal, context = self._seal, self._context
        assert seal is not None
        way = Way(opened.source, opened.destination, context.port_number)
        digest = context.handshake.digest
        if reason == "own":
            refusal = seal.overhear_own(opened.records, way, digest)
        elif reason is None:
            opens = partial(self._opened, opened, frame, port, opened_at)
            refusal = seal.open(opened.records, way, digest, now, opens)
        else:
            return reason
        if refusal is None:
            return reason
        if refusal in _MAYBE_UNSEALED and self._take_unsealed(opened, frame, port, now):
            refusal = SealRefusal.UNSEALED
        context.node.alarms.refused(refusal, opened.source, now)
        return refusal.value

    def _take_unsealed(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int
    ) -> bool:
        """Take what the config allows from an unsealed frame; return False if that is nothing."""
        allowed = self._context.node.sealing.unsealed
        plain = port.envelope.unsealed(opened) if allowed else None
        if plain is None:
            return False
        return bool(self.protocols.receive_unsealed(plain, frame, port, allowed, now))

    def _opened(
        self,
        opened: Opened,
        frame: ReceivedFrame,
        port: LinkPort,
        opened_at: Callable[[int], None] | None,
        inside: Inside,
        now: int,
    ) -> None:
        """Take an opened frame, which no later start of this node will open again."""
        self._context.node.alarms.opened(opened.source)
        if not inside.records and self._seal is not None:
            self._seal.reintroduce(opened.source, to_all=False)
        digest = b"" if inside.digest == NO_TABLE else inside.digest
        opened = msgspec.structs.replace(
            opened,
            records=inside.records,
            life=inside.life,
            digest=digest,
            strong=inside.strong,
        )
        if is_relayed(opened.records):
            self._take_from_hop(opened, frame, port, now)
        else:
            self._receive(opened, frame, port, now)
        if opened_at is not None:
            opened_at(now)

    def _drop(self, reason: str | None, frame: ReceivedFrame, now: int) -> None:
        """Count a frame that is dropped; None: it is not."""
        if reason is None:
            return
        if reason == "own" and self._seal is None:
            self._context.node.twins.heard_own(frame.frame_bytes, now)
        self.stats.drop(reason)
        self._trace.note(
            now,
            "drop",
            peer=frame.source,
            frame=frame.frame_bytes,
            detail=reason,
            link=self.name,
            service=frame.service,
        )

    def _receive(self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int) -> None:
        self._hear(opened, frame, port, now)
        streams = self.protocols.receive(opened, frame, port, now)
        port.arrived(opened.source, frame, now, is_urgent=any(map(self._is_urgent, streams)))
        self._trace.note(
            now,
            "receive",
            peer=opened.source,
            frame=frame.frame_bytes,
            streams=streams,
            link=self.name,
            service=frame.service,
        )

    def _is_urgent(self, stream_id: int) -> bool:
        """Return whether payloads of a stream go at once."""
        stream = self._context.table.get(stream_id)
        return stream is not None and stream.qos.priority is Priority.REAL_TIME

    def _hear(self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int) -> None:
        """Record that a node was heard."""
        airtime_ns = port.airtime_ns(len(frame.frame_bytes), frame.service)
        self._context.pacers.arrives(opened.source, frame.received_at, airtime_ns)
        if opened.source != UNKNOWN_SOURCE:
            self._context.node.contact.heard(opened.source, now)
            self._context.node.lost_contact.heard(opened.source, now)
            measurements = self._context.node.measurements
            measurements.note(opened.source, frame.metrics, frame.received_at)
        port.heard(opened.source, len(frame.frame_bytes), now, frame.service)

    def _use_link(self, told: LinkCapabilities, now: int) -> None:
        """Begin with a link, or with new capabilities of it.

        Raises:
            ConfigError: It cannot do what the config asks of it; nothing has changed.
        """
        bounded = told if self._max_frame_s is None else told.bounded(self._max_frame_s)
        port = self._make_port(bounded, self.protocols.envelope(bounded))
        self.transmitter.use_link(port, now)
        self.protocols.use_link(port, now)
        self._told = told

    def _make_port(self, capabilities: LinkCapabilities, envelope: Envelope) -> LinkPort:
        return LinkPort(
            capabilities,
            self._context.address,
            self._access_rng,
            self._access,
            envelope=envelope,
            measurements=self._context.node.measurements,
            most_outstanding=LONGEST_TRAIN if self._context.is_route else MOST_OUTSTANDING,
            is_crowd=self._context.is_crowd,
            max_airtime=self._max_airtime,
            answered=self._context.pacers.way,
        )
