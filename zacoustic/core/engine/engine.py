"""The engine: one node's protocol as a function of its inputs. This file holds only the wiring.

Contract for whoever drives an engine (the runtime, the virtual network, a test):

- Four kinds of methods. *Inputs* ``handle_*`` and *commands* (`publish`, `call`, …) change state;
  *outputs* ``poll_*`` take what the engine wants; *getters* change nothing.
- After any input or command poll until dry: `poll_journal`, `poll_transmit`, `poll_event` until
  None; then re-arm one timer from `poll_timeout`.
- ``now`` is an instant in ns of one monotonic clock and never decreases. A timer that fires early
  is handed the instant that was asked for.
- After a transmission `poll_transmit` returns None until `handle_transmit_report` has been called.
- A journal write from `poll_journal` is answered by `handle_journal_committed` when it is safe.
- Inputs from the water never raise; any exception from them is a bug, and another engine goes on
  from the journal then (`zacoustic.run.replacement`). Commands raise `LocalError`s.

Who does what::

    publish, call ──► TransmitQueue ──► Composer ──► Envelope ──► poll_transmit
                                           ▲ Handshake (may it be decoded, what is owed)
    poll_event ◄── Receiver ◄── Envelope ◄── handle_frame
                                MediumAccess: when a frame may start
    ranging.request, .repeat ──► Composer: frames for the sake of the range
    measurements ◄── handle_measurement, handle_frame

What is said and heard depends on the wire profile of the stream table (`StreamTable.wire`); the
rest, when a frame may go and what is booked for it, does not.
"""

import random
from collections import deque
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, TypeVar

from zacoustic.core.base.journal import BOOT_KEY, JournalWrite
from zacoustic.core.base.linktypes import (
    UNKNOWN_SOURCE,
    LinkCapabilities,
    LinkState,
    Measurement,
    PeerMeasured,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic.core.base.trace import Tracer, TraceSink
from zacoustic.core.engine.events import Event, JournalStateChanged, LinkStateChanged
from zacoustic.core.peers.handshake import PeerSeen, StreamsDiffer
from zacoustic.core.peers.measurements import Measurements
from zacoustic.core.profiles.native.protocols import MakeTransport, Protocols
from zacoustic.core.profiles.rmw_desert.protocols import RmwDesertProtocols
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.airtime import AirtimeCaps
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.hosttime import HostTime
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.schedule.transmitter import Transmitter
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.transport.commands.ledger import Ledger
from zacoustic.core.transport.commands.orders import Orders
from zacoustic.core.transport.commands.tunings import Tunings
from zacoustic.core.transport.contract import Transport
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic.errors import LocalError

OtherTransport = TypeVar("OtherTransport", bound=Transport)
_NO_RULES = TransmitRules()
_PROTOCOLS: Final = {WireProfile.NATIVE: Protocols, WireProfile.RMW_DESERT: RmwDesertProtocols}


class Engine:
    """One node's protocol.

    Args:
        address: Address of this node, 1…254.
        table: Its streams.
        epoch: Boot epoch, 0…65535: another one in each life of the node.
        rng: Source of all randomness; one number is drawn from it.
        stored: What the journal has kept from earlier lives.
        rules: What the config says of transmitting.
        trace: Takes a record of each thing done, or None.
        transports: Make transports of somebody else (`zacoustic.core.transport.contract`).
    """

    def __init__(
        self,
        *,
        address: int,
        table: StreamTable,
        epoch: int,
        rng: random.Random,
        stored: Mapping[str, bytes] = MappingProxyType({}),
        rules: TransmitRules = _NO_RULES,
        trace: TraceSink | None = None,
        transports: Sequence[MakeTransport] = (),
    ) -> None:
        self.address = address
        self.table = table
        self.stored = {key: each for key, each in stored.items() if key != BOOT_KEY}
        self.journal_failure = ""
        """Why the journal cannot be written now; empty: it can. To be read only."""
        self._trace = Tracer(address, trace)
        self._now = 0
        self._events: deque[Event] = deque()
        context = Context(address, table, epoch, rng, stored, self._events.append)
        self.stats = context.stats
        self._journal = journal = context.journal
        self._timers = timers = context.timers
        self._peers = peers = context.peers
        emit = context.emit
        self.measurements = Measurements(peers)
        """What was measured of peers and modem; to be read only."""
        self.doubt = context.doubt
        """Whether something of former lives is forgotten; to be read only."""
        self._protocols = protocols = _PROTOCOLS[table.wire](context, rules, transports)
        self.ranging = protocols.ranging
        """Commands about ranges: `request`, `cancel` and `repeat`."""
        self.actions = protocols.actions
        """Commands about goals: `send_goal` and `cancel_goal`, `accept`, `finish` and others."""
        self.demand = protocols.demand
        """Commands about on-demand topics: `want`; and who wants them of this node."""
        self.deadlines = protocols.deadlines
        """Of what a sample is awaited; to be read only."""
        self.contact = protocols.contact
        """Who is lost; to be read only."""
        self.clock = HostTime(
            rules.access, bool(rules.quiet), stored, journal=journal, timers=timers, emit=emit
        )
        """What is known of UTC; to be read only."""
        self.silence = Silence(
            rules.quiet, stored, host=self.clock, journal=journal, timers=timers, emit=emit
        )
        """Orders to be silent: `begin` and `resume`."""
        ledger = Ledger(stored, journal)
        peers.forgotten.connect(ledger.peer_forgotten)
        self.orders = Orders(
            address,
            table,
            protocols.services,
            protocols.handshake,
            Tunings(
                address,
                table,
                queue=protocols.queue,
                objects=protocols.objects,
                stored=stored,
                journal=journal,
            ),
            ledger,
            self.silence,
            rules.orders_from,
            emit,
        )
        """Orders to other nodes, and to this one: `send`, `obey`."""

        access_rng = context.generators.of("access")

        def make_port(capabilities: LinkCapabilities, envelope: Envelope) -> LinkPort:
            return LinkPort(
                capabilities,
                address,
                access_rng,
                rules.access,
                envelope=envelope,
                measurements=self.measurements,
            )

        self._transmitter = Transmitter(
            protocols,
            self.silence,
            self.clock,
            AirtimeCaps(rules.max_airtime),
            self.stats,
            make_port,
            emit,
        )
        peers.forgotten.connect(self._transmitter.peer_forgotten)
        for stream in table:
            self._transmitter.airtime.limit(stream.stream_id, stream.qos.max_airtime)
        protocols.recover(stored)

    # Inputs

    def handle_frame(self, frame: ReceivedFrame, now: int) -> None:
        """A frame, or a piece of a byte stream, arrived."""
        self._now = now
        port = self._transmitter.port
        if port is None:
            self.stats.drop("link_down")
            return
        self.stats.frames_received += 1
        self.stats.bytes_received += len(frame.frame_bytes)
        for opened in port.envelope.open(frame):
            reason = port.refuse(opened, frame)
            if isinstance(opened, Opened) and reason in (None, "not_for_us"):
                if opened.source != UNKNOWN_SOURCE:
                    self._protocols.contact.heard(opened.source, now)
                    self.measurements.note(opened.source, frame.metrics, frame.received_at)
                port.heard(opened.source, len(frame.frame_bytes), now)
                if reason is None:
                    streams = self._protocols.receive(opened, frame, port, now)
                    self._trace.note(
                        now, "receive", peer=opened.source, frame=frame.frame_bytes, streams=streams
                    )
                    continue
                self._protocols.overhear(opened, frame, port, now)
            assert reason is not None
            self.stats.drop(reason)
            self._trace.note(now, "drop", peer=frame.source, frame=frame.frame_bytes, detail=reason)
        for news in self._protocols.handshake.news:
            self._events.append(news)
            self._trace_news(news, now)
        self._protocols.handshake.news.clear()

    def handle_transmit_report(self, report: TransmitReport, now: int) -> None:
        """A transmission has ended."""
        self._now = now
        if not self._transmitter.finish(report, now):
            self.stats.drop("stray_report")
            return
        outcome = report.outcome.value
        self.stats.reports[outcome] = self.stats.reports.get(outcome, 0) + 1
        self._trace.note(now, "report", detail=outcome)

    def handle_link_state(
        self, state: LinkState, now: int, capabilities: LinkCapabilities | None = None
    ) -> None:
        """The link went up or down; `capabilities` come with UP, and when they change."""
        self._now = now
        self._protocols.begin(now)
        if capabilities is not None and capabilities != self.capabilities:
            self._transmitter.use_link(capabilities, now)
        if state is not self._transmitter.link_state:
            self._transmitter.change_state(state, now)
            if state is LinkState.UP:
                self.silence.wake(now)
                self._protocols.link_up(now)
            self._events.append(LinkStateChanged(state=state, changed_at=now))
            self._trace.note(now, "link", detail=state.value)

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Somebody else's transmission began or ended."""
        self._now = now
        if self._transmitter.port is not None:
            self._transmitter.port.handle_carrier(busy, now)

    def handle_clock(self, offset_ns: int, error_ns: int | None, now: int) -> None:
        """The host says that UTC is `now + offset_ns`, wrong by `error_ns` at most; None: unknown.

        To be told once before the link is up, when the offset has changed by more than the driver's
        own jitter, and every ten seconds at least where the engine is driven at all.
        """
        self._now = now
        self._protocols.begin(now)
        error_ns = self.clock.tell(offset_ns, error_ns, now)
        self.silence.handle_clock(now)
        self._transmitter.handle_clock(offset_ns, error_ns, now)

    def handle_measurement(self, measurement: Measurement, now: int) -> None:
        """The link has measured something of a peer, or says something of its modem."""
        self._now = now
        peer = measurement.address if isinstance(measurement, PeerMeasured) else 0
        if isinstance(measurement, PeerMeasured):
            if not 1 <= peer <= 254 or peer == self.address:
                self.stats.drop("address")
                return
            self.ranging.measured(measurement)
        self.measurements.handle(measurement)
        self._events.append(measurement)
        self._trace.note(now, "measure", peer=peer)

    def handle_timeout(self, now: int) -> None:
        """The instant that `poll_timeout` named has come."""
        self._now = now
        self.silence.keep(now)
        self._protocols.handle_timeout(now)
        self._timers.fire(now)
        self._transmitter.handle_timeout(now)

    def handle_journal_committed(self, write_id: int, now: int) -> None:
        """A journal write is safe."""
        self._now = now
        self._protocols.large.at(now)
        self._journal.committed(write_id, now)

    def handle_journal_state(self, failure: str, now: int) -> None:
        """The journal cannot be written, for this reason; empty: it can be again."""
        self._now = now
        if failure != self.journal_failure:
            self.journal_failure = self._journal.failure = failure
            self._events.append(JournalStateChanged(failure=failure, changed_at=now))
            self._trace.note(now, "journal", detail="fails" if failure else "works")

    # Commands

    def declare(self, spec: StreamSpec, now: int) -> Stream:
        """Add a stream to the table; begins a new epoch, since peers have confirmed another table.

        Raises:
            ConfigError: The id or name is taken, or the spec is wrong.
        """
        self._now = now
        stream = self.table.declare(spec)
        self._transmitter.airtime.limit(stream.stream_id, stream.qos.max_airtime)
        self._protocols.begin_epoch(now)
        return stream

    def publish(
        self,
        stream_id: int,
        value: object,
        now: int,
        *,
        instance: Instance = (),
        encoding: str | None = None,
        delete: bool = False,
        queued_at: int | None = None,
    ) -> int:
        """Queue a sample of a topic.

        Args:
            stream_id: The topic's stream.
            value: As the stream's type says; bytes for an opaque stream; ignored for a delete.
            now: The instant.
            instance: One value number for each wildcard of the topic's name.
            encoding: Zenoh encoding, where it is not the stream's.
            delete: Delete the key instead.
            queued_at: Instant at which the sample was made, ns, where it is before `now`.

        Returns:
            For a reliable topic the delivery id that `DeliveryEnded` will name, else 0.

        Raises:
            UnknownStreamError: No such topic, or an instance that its name does not have.
            LocalError: This node may not publish it.
            PayloadInvalidError: The type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
        """
        self._now = now
        return self._protocols.publish(
            stream_id, value, now, instance=instance, encoding=encoding, delete=delete,
            queued_at=queued_at,
        )  # fmt: skip

    def cancel_delivery(self, delivery_id: int, now: int) -> bool:
        """Give up a reliable sample; False when it is not on its way.

        `DeliveryEnded` follows; receivers that have part of a large one are told.
        """
        self._now = now
        return self._protocols.large.cancel(delivery_id, now)

    def refuse_object(self, source: int, transfer: int, now: int) -> bool:
        """Refuse the rest of an object that `ObjectProgress` has told of; False when it is over."""
        self._now = now
        return self._protocols.large.at(now).objects.cancel_incoming(source, transfer)

    def call(
        self, stream_id: int, value: object, now: int, *, timeout_s: float | None = None
    ) -> int:
        """Call a service; returns the call id that the answer will name.

        Raises:
            UnknownStreamError: No such service.
            LocalError: This node is the server.
            PayloadInvalidError: The request's type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
            QueueFullError: 16 calls to this service are under way, or have been just now.
        """
        self._now = now
        return self._protocols.call(stream_id, value, now, timeout_s=timeout_s)

    def cancel(self, call_id: int, now: int) -> None:
        """Give up a call: its request is not sent if it still waits, and no event follows."""
        self._now = now
        self._protocols.cancel(call_id, now)

    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """Answer a request; False when it is too late or was answered before.

        A response that cannot be sent is an error of the service, and the caller is told so
        before it is raised here.

        Raises:
            PayloadInvalidError: The response's type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
        """
        self._now = now
        return self._protocols.reply(call, value, now)

    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """Answer a request with an error; the text is cut to 48 bytes. False as for `reply`."""
        self._now = now
        return self._protocols.reply_error(call, failure, text, now)

    # Outputs

    def poll_transmit(self, now: int) -> Transmission | None:
        """Return the frame that is worth most now, if the link can take one."""
        self._now = now
        made = self._transmitter.make(now)
        if made is None:
            return None
        transmission, streams = made
        self._trace.note(
            now,
            "transmit",
            peer=transmission.destination,
            frame=transmission.frame_bytes,
            streams=streams,
        )
        return transmission

    def poll_journal(self) -> JournalWrite | None:
        """Return the next write that a promise waits for."""
        return self._journal.poll()

    def poll_event(self) -> Event | None:
        """Return the next event for the application."""
        self._transmitter.review(self._now)
        return self._events.popleft() if self._events else None

    def poll_timeout(self) -> int | None:
        """Return the instant at which `handle_timeout` is to be called, ns.

        None means that the engine waits for inputs only.
        """
        instants = (self._timers.next_at(), self._transmitter.next_at(self._now))
        earliest = min((at for at in instants if at is not None), default=None)
        return None if earliest is None else max(earliest, self._now)

    # Getters

    @property
    def epoch(self) -> int:
        """The current boot epoch."""
        return self._protocols.handshake.epoch

    @property
    def link_state(self) -> LinkState:
        """What the link last said of itself."""
        return self._transmitter.link_state

    @property
    def capabilities(self) -> LinkCapabilities | None:
        """What the link can do; None before it was up."""
        port = self._transmitter.port
        return port.capabilities if port else None

    @property
    def is_idle(self) -> bool:
        """Nothing waits, nothing is under way, no timer is armed."""
        port = self._transmitter.port
        is_busy = port is not None and port.is_busy
        return not is_busy and self._protocols.is_idle and self.poll_timeout() is None

    @property
    def owes_acknowledgement(self) -> bool:
        """Something waits that says what has come, and this node may transmit."""
        may_speak = self.link_state is LinkState.UP and not self.silence.is_silent(self._now)
        return may_speak and self._protocols.owes_acknowledgement(self._now)

    def transport(self, kind: type[OtherTransport]) -> OtherTransport:
        """Return the transport of somebody else that is of a class.

        Raises:
            LocalError: This engine was made without it.
        """
        for each in self._protocols.transports.values():
            if isinstance(each, kind):
                return each
        made = ", ".join(self._protocols.transports) or "none"
        raise LocalError(f"no transport {kind.name}; this engine has: {made}")

    def delivering(self, stream_id: int) -> int:
        """Count the reliable samples of a stream that have not ended."""
        return self._protocols.sending.delivering(stream_id)

    def is_delivering(self, delivery_id: int) -> bool:
        """Tell whether a reliable sample has not ended."""
        return self._protocols.sending.is_delivering(delivery_id)

    def pending(self, stream_id: int) -> int:
        """Count the payloads of a stream that wait."""
        return self._protocols.pending(stream_id)

    def forget(self, address: int, now: int) -> None:
        """Free everything that is kept of another node, in the journal too.

        It is for a node that has left the fleet: what ran of its calls and goals, and what was
        handed on of its samples, is not known any more, so that it must not come again. Calls to it
        end as cancelled; what waits for it in the queue waits on.

        Args:
            address: The node.
            now: The instant, ns.
        """
        self._now = now
        self._peers.forget(address, now)

    def expire(self, now: int) -> int | None:
        """Forget what waits and is too old; returns when something else will be, ns, or None."""
        return self._protocols.queue.drop_expired(now)

    @property
    def expired(self) -> dict[int, int]:
        """Payloads that became too old before they could be sent, by stream."""
        return dict(self._protocols.queue.expired)

    @property
    def superseded(self) -> dict[int, int]:
        """Payloads pushed out by newer ones before they could be sent, by stream."""
        return dict(self._protocols.queue.superseded)

    def peers(self) -> dict[int, bool]:
        """Return the nodes heard so far, and whether each has confirmed our table."""
        known = self._protocols.handshake.peers()
        return {address: peer.confirmed_us for address, peer in known.items()}

    # Below the methods above

    def _trace_news(self, news: PeerSeen | StreamsDiffer, now: int) -> None:
        if isinstance(news, PeerSeen):
            detail = "same_table" if news.same_table else "other_table"
            self._trace.note(now, "peer", peer=news.address, detail=detail)
        else:
            self._trace.note(now, "differ", peer=news.address, streams=(news.stream_id,))
