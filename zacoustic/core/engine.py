"""The engine: one node's protocol as a function of its inputs. This file holds only the wiring.

Contract for whoever drives an engine (the runtime, the virtual network, a test):

- Four kinds of methods. *Inputs* ``handle_*`` and *commands* (`publish`, `call`, …) change state;
  *outputs* ``poll_*`` take what the engine wants; *getters* change nothing.
- After any input or command poll until dry: `poll_journal`, `poll_transmit`, `poll_event` until
  None; then re-arm one timer from `poll_timeout`.
- ``now`` is an instant in ns of one monotonic clock and never decreases. A timer that fires early
  is handed the instant that was asked for.
- After `poll_transmit` has returned a transmission it returns None until `handle_transmit_report`
  brings its report.
- A journal write from `poll_journal` is answered by `handle_journal_committed` when it is safe.
- Inputs from the water never raise; any exception from them is a bug. Commands raise `LocalError`s.

Who does what::

    publish, call ──► TransmitQueue ──► Composer ──► Envelope ──► poll_transmit
                                           ▲ Handshake (may it be decoded, what is owed)
    poll_event ◄── Receiver ◄── Envelope ◄── handle_frame
                                MediumAccess: when a frame may start
    ranging.request, .repeat ──► Composer: frames for the sake of the range
    measurements ◄── handle_measurement, handle_frame
"""

import random
from collections import deque
from collections.abc import Mapping
from types import MappingProxyType

from zacoustic.core.access import Wanted
from zacoustic.core.access.controls import AccessControl
from zacoustic.core.actions.actions import Actions
from zacoustic.core.airtime import AirtimeCaps
from zacoustic.core.arq.receiving import ReliableReceiving
from zacoustic.core.arq.sending import ReliableSending
from zacoustic.core.arq.timing import LinkTimes
from zacoustic.core.composer import Composer
from zacoustic.core.envelope import Opened
from zacoustic.core.events import (
    CallFailure,
    CallKey,
    Event,
    JournalStateChanged,
    LinkStateChanged,
    PeerSeen,
    SampleReceived,
    StreamsDiffer,
)
from zacoustic.core.frame import TAG_BYTES
from zacoustic.core.handshake import Handshake
from zacoustic.core.journal import EPOCH_KEY, JournalPort, JournalWrite
from zacoustic.core.keys import Instance
from zacoustic.core.large import LargeSamples
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    Measurement,
    PeerMeasured,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic.core.measurements import Measurements
from zacoustic.core.objects.wire import Call
from zacoustic.core.port import LinkPort
from zacoustic.core.queue import TransmitQueue
from zacoustic.core.ranging import Ranging
from zacoustic.core.receiver import Receiver
from zacoustic.core.repeating import Repeater
from zacoustic.core.rules import TransmitRules
from zacoustic.core.services import Services
from zacoustic.core.silence import Silence
from zacoustic.core.stats import EngineStats, count
from zacoustic.core.streams import Stream, StreamSpec, StreamTable
from zacoustic.core.topics import Topics
from zacoustic.core.trace import TraceRecord, TraceSink

_NO_RULES = TransmitRules()


class Engine:
    """One node's protocol.

    Args:
        address: Address of this node, 1…254.
        table: Its streams.
        epoch: Boot epoch, 0…65535: another one in each life of the node.
        rng: Source of all randomness.
        stored: What the journal has kept from earlier lives.
        rules: What the config says of transmitting.
        trace: Takes a record of each thing done, or None.
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
    ) -> None:
        self.address = address
        self.table = table
        self.stored = stored
        self.journal_failure = ""
        """Why the journal cannot be written now; empty: it can. To be read only."""
        self.stats = EngineStats()
        self.measurements = Measurements()
        """What was measured of peers and modem; to be read only."""
        self._rng = rng
        self._trace = trace
        self._now = 0
        self._events: deque[Event] = deque()
        emit = self._events.append
        stats = self.stats
        self._queue = queue = TransmitQueue()
        self._handshake = handshake = Handshake(address, epoch, table, rng)
        self.ranging = ranging = Ranging(address, table, rng, emit)
        """Commands about ranges: `request`, `cancel` and `repeat`."""
        self._composer = Composer(queue, handshake, ranging, stats)
        self._journal = journal = JournalPort()
        self._sending = sending = ReliableSending(
            address, table, queue=queue, handshake=handshake, journal=journal, rng=rng, emit=emit
        )
        self._receiving = receiving = ReliableReceiving(
            address, table, queue=queue, journal=journal, rng=rng, emit=self._hand_on
        )
        self._large = large = LargeSamples(
            address,
            table,
            handshake=handshake,
            journal=journal,
            stats=stats,
            rng=rng,
            emit=emit,
            hand_on=self._hand_on,
        )
        self._composer.objects = large.objects
        self._topics = Topics(
            address,
            table,
            queue=queue,
            stats=stats,
            sending=sending,
            receiving=receiving,
            emit=self._hand_on,
        )
        self._topics.large = large
        self._repeater = repeater = Repeater(queue, rng)
        self._services = Services(
            address,
            table,
            queue=queue,
            repeater=repeater,
            journal=journal,
            handshake=handshake,
            begin_epoch=self._begin_epoch,
            stats=stats,
            emit=emit,
        )
        self.actions = Actions(
            address,
            table,
            queue=queue,
            repeater=repeater,
            journal=journal,
            handshake=handshake,
            begin_epoch=self._renew_epoch,
            stats=stats,
            emit=emit,
        )
        """Commands about goals: `send_goal` and `cancel_goal`, `accept`, `finish` and others."""
        self._receiver = Receiver(
            table, handshake, self._topics, self._services, self.actions, sending, large, stats
        )
        self._receiver.handle_access = self._handle_access
        self._receiver.handle_call = self._handle_call
        self._rules = rules
        self.silence = Silence(rules.quiet, stored, journal=journal, emit=emit)
        """Orders to be silent: `begin` and `resume`."""
        self._airtime = AirtimeCaps(rules.max_airtime)
        for stream in table:
            self._airtime.limit(stream.stream_id, stream.qos.max_airtime)
        self._clock: tuple[int, int] | None = None
        self._port: LinkPort | None = None
        self._link_state = LinkState.OPENING
        self._next_transmission_id = 1
        self._epochs_to_keep = 0
        self._write_epoch()
        sending.recover(stored)
        receiving.recover(stored)
        self._services.recover(stored)
        self.actions.recover(stored)
        sending.next_delivery_id(above=large.recover(stored))

    # Inputs

    def handle_frame(self, frame: ReceivedFrame, now: int) -> None:
        """A frame, or a piece of a byte stream, arrived."""
        self._now = now
        port = self._port
        if port is None:
            self.stats.drop("link_down")
            return
        self.stats.frames_received += 1
        self.stats.bytes_received += len(frame.frame_bytes)
        for opened in port.envelope.open(frame):
            reason = port.refuse(opened, frame)
            if reason is None and isinstance(opened, Opened):
                self.measurements.note(opened.source, frame.metrics, frame.received_at)
                port.heard(opened.source, now)
                streams = self._receiver.handle(opened, frame, now)
                self._note("receive", opened.source, frame.frame_bytes, streams)
            elif reason is not None:
                self.stats.drop(reason)
                self._note("drop", frame.source, frame.frame_bytes, (), reason)
        for news in self._handshake.news:
            self._events.append(news)
            self._note_news(news)
        self._handshake.news.clear()

    def handle_transmit_report(self, report: TransmitReport, now: int) -> None:
        """A transmission has ended."""
        self._now = now
        if self._port is None or not self._port.finish(report, now):
            self.stats.drop("stray_report")
            return
        self._sending.handle_report(report)
        self._repeater.handle_report(report)
        self._large.objects.transmitted(report.finished_at)
        self.ranging.handle_report(report, now)
        outcome = report.outcome.value
        self.stats.reports[outcome] = self.stats.reports.get(outcome, 0) + 1
        self._note("report", 0, b"", (), outcome)

    def handle_link_state(
        self, state: LinkState, now: int, capabilities: LinkCapabilities | None = None
    ) -> None:
        """The link went up or down; `capabilities` come with UP, and when they change."""
        self._now = now
        known = self._port.capabilities if self._port else None
        if capabilities is not None and capabilities != known:
            self._use_link(capabilities)
        if state is not self._link_state:
            self._link_state = state
            if state is LinkState.UP:
                self.silence.wake(now)
                self._sending.link_up(now)
                self._repeater.link_up(now)
                self._services.link_up(now)
                self.actions.link_up(now)
            self._events.append(LinkStateChanged(state=state, changed_at=now))
            self._note("link", 0, b"", (), state.value)

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Somebody else's transmission began or ended."""
        self._now = now
        if self._port is not None:
            self._port.handle_carrier(busy, now)

    def handle_clock(self, offset_ns: int, error_ns: int, now: int) -> None:
        """The host says that UTC is `now + offset_ns`, wrong by `error_ns` at most.

        To be told once before the link is up, when the offset has changed by more than the driver's
        own jitter, and every ten seconds at least where the engine is driven at all.
        """
        self._now = now
        self._clock = (offset_ns, error_ns)
        self.silence.handle_clock(offset_ns, now)
        if self._port is not None:
            self._port.access.handle_clock(offset_ns, error_ns, now)

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
        self._note("measure", peer, b"", ())

    def handle_timeout(self, now: int) -> None:
        """The instant that `poll_timeout` named has come."""
        self._now = now
        self._services.expire(now)
        self.actions.expire(now)
        self.silence.expire(now)
        self._sending.expire(now)
        self._repeater.expire(now)
        self._large.at(now).objects.expire(now)
        if self._port is not None:
            self._port.access.handle_timeout(now)
        self.ranging.expire(now)

    def handle_journal_committed(self, write_id: int, now: int) -> None:
        """A journal write is safe."""
        self._now = now
        self._large.at(now)
        self._journal.committed(write_id, now)

    def handle_journal_state(self, failure: str, now: int) -> None:
        """The journal cannot be written, for this reason; empty: it can be again."""
        self._now = now
        if failure != self.journal_failure:
            self.journal_failure = self._journal.failure = failure
            self._events.append(JournalStateChanged(failure=failure, changed_at=now))
            self._note("journal", 0, b"", (), "fails" if failure else "works")

    # Commands

    def declare(self, spec: StreamSpec, now: int) -> Stream:
        """Add a stream to the table; begins a new epoch, since peers have confirmed another table.

        Raises:
            ConfigError: The id or name is taken, or the spec is wrong.
        """
        self._now = now
        stream = self.table.declare(spec)
        self._airtime.limit(stream.stream_id, stream.qos.max_airtime)
        self._begin_epoch()
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
        return self._topics.publish(
            stream_id,
            value,
            now,
            instance=instance,
            encoding=encoding,
            delete=delete,
            queued_at=queued_at,
        )

    def cancel_delivery(self, delivery_id: int, now: int) -> bool:
        """Give up a sample that is larger than a frame; False when it is not on its way.

        `DeliveryEnded` follows, and its receivers are told.
        """
        self._now = now
        return self._large.at(now).objects.cancel(delivery_id, now)

    def refuse_object(self, source: int, transfer: int, now: int) -> bool:
        """Refuse the rest of an object that `ObjectProgress` has told of; False when it is over."""
        self._now = now
        return self._large.at(now).objects.cancel_incoming(source, transfer)

    def call(
        self, stream_id: int, value: object, now: int, *, timeout_s: float | None = None
    ) -> int:
        """Call a service; returns the call id that the answer will name.

        Raises:
            UnknownStreamError: No such service.
            LocalError: This node is the server.
            PayloadInvalidError: The request's type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
            QueueFullError: 64 calls to this service are under way.
        """
        self._now = now
        return self._services.call(stream_id, value, now, timeout_s=timeout_s)

    def cancel(self, call_id: int, now: int) -> None:
        """Give up a call: its request is not sent if it still waits, and no event follows."""
        self._now = now
        self._services.cancel(call_id, now)

    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """Answer a request; False when it is too late or was answered before.

        A response that cannot be sent is an error of the service, and the caller is told so
        before it is raised here.

        Raises:
            PayloadInvalidError: The response's type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
        """
        self._now = now
        return self._services.reply(call, value, now)

    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """Answer a request with an error; the text is cut to 48 bytes. False as for `reply`."""
        self._now = now
        return self._services.reply_error(call, failure, text, now)

    # Outputs

    def poll_transmit(self, now: int) -> Transmission | None:
        """Return the frame that is worth most now, if the link can take one."""
        self._now = now
        port = self._port
        if port is None:
            return None
        composed = None
        if _is_over(self._transmit_at(), now):
            composed = self._composer.compose(port.envelope, now)
        if composed is None and _is_over(self._speak_at(), now):
            composed = self._composer.speak(port, now)
        if composed is None:
            return None
        transmission = Transmission(
            transmission_id=self._next_transmission_id,
            frame_bytes=composed.frame_bytes,
            destination=composed.destination,
            acknowledge=self.ranging.wants(composed.destination, now),
        )
        self._next_transmission_id += 1
        port.transmit(transmission, now)
        self._sending.transmitted(composed.records)
        self._repeater.transmitted(composed.records)
        self.ranging.transmitted(transmission, now)
        self.stats.frames_transmitted += 1
        self.stats.bytes_transmitted += len(composed.frame_bytes)
        airtime_ns = port.capabilities.airtime_ns(len(composed.frame_bytes))
        self.stats.airtime_ns += airtime_ns
        held = self._airtime.spend(composed.stream_bytes, airtime_ns, now)
        for stream_id, until in held.items():
            self._queue.hold(stream_id, until)
            self._large.objects.hold(stream_id, until)
        self._note("transmit", composed.destination, composed.frame_bytes, composed.streams)
        return transmission

    def poll_journal(self) -> JournalWrite | None:
        """Return the next write that a promise waits for."""
        return self._journal.poll()

    def poll_event(self) -> Event | None:
        """Return the next event for the application."""
        return self._events.popleft() if self._events else None

    def poll_timeout(self) -> int | None:
        """Return the instant at which `handle_timeout` is to be called, ns.

        None means that the engine waits for inputs only.
        """
        instants = (
            self._services.next_deadline_at(),
            self.actions.next_due_at(),
            self._sending.next_deadline_at(),
            self._repeater.next_due_at(),
            self._large.objects.next_deadline_at(),
            self.ranging.next_deadline_at(),
            self.silence.next_deadline_at,
            self._transmit_at(),
            self._speak_at(),
        )
        return min((at for at in instants if at is not None), default=None)

    # Getters

    @property
    def epoch(self) -> int:
        """The current boot epoch."""
        return self._handshake.epoch

    @property
    def link_state(self) -> LinkState:
        """What the link last said of itself."""
        return self._link_state

    @property
    def capabilities(self) -> LinkCapabilities | None:
        """What the link can do; None before it was up."""
        return self._port.capabilities if self._port else None

    @property
    def is_idle(self) -> bool:
        """Nothing waits, nothing is under way, no timer is armed."""
        busy = self._port is not None and self._port.is_busy
        waits = bool(self._queue) or not self._large.objects.is_idle
        return not busy and not waits and self.poll_timeout() is None

    def delivering(self) -> int:
        """Count the reliable samples that not all subscribers have acknowledged."""
        return self._sending.delivering()

    def pending(self, stream_id: int) -> int:
        """Count the payloads of a stream that wait."""
        return self._queue.pending(stream_id) + self._large.objects.pending(stream_id)

    @property
    def expired(self) -> dict[int, int]:
        """Payloads that became too old before they could be sent, by stream."""
        return dict(self._queue.expired)

    @property
    def superseded(self) -> dict[int, int]:
        """Payloads pushed out by newer ones before they could be sent, by stream."""
        return dict(self._queue.superseded)

    def peers(self) -> dict[int, bool]:
        """Return the nodes heard so far, and whether each has confirmed our table."""
        return {address: peer.confirmed_us for address, peer in self._handshake.peers().items()}

    # Below the methods above

    def _use_link(self, capabilities: LinkCapabilities) -> None:
        self._port = LinkPort(capabilities, self.address, self._rng, self._rules.access)
        self._composer.port = self._port
        if self._clock is not None:
            self._port.access.handle_clock(*self._clock, self._now)
        self._handshake.use_link(capabilities)
        self.ranging.use_link(capabilities)
        times = LinkTimes(capabilities)
        self._sending.use_link(times, self._handshake.settling_ns)
        self._services.use_link(times, self._handshake.settling_ns)
        self.actions.use_link(times, self._handshake.settling_ns)
        self._repeater.use_link(times, self._now)
        self._receiving.use_link(times)
        port = self._port
        self._large.objects.use_link(
            capabilities, port.envelope.room_bytes, port.listening.pause_ns, self._now
        )
        oversized = self._queue.limit(self._port.envelope.room_bytes - TAG_BYTES)
        self._sending.dropped(oversized, self._now)
        for _ in oversized:
            self.stats.drop("oversized")

    def _transmit_at(self) -> int | None:
        """Return the instant from which a frame can and should go, or None."""
        if self._link_state is not LinkState.UP or self._port is None or self._epochs_to_keep:
            return None
        due_at = self._composer.due_at(self._now)
        if due_at is None:
            return None
        self._port.listening.exclusive = self._large.objects.is_exclusive
        is_urgent = self._queue.is_urgent
        if not is_urgent:
            even_at = self._airtime.free_at(self._now)
            due_at = max(due_at, even_at) if even_at > self._now else due_at
        return self._after_silence(self._port.free_at(Wanted(due_at, is_urgent), self._now))

    def _speak_at(self) -> int | None:
        """Return the instant at which medium access wants a frame of its own, or None."""
        if self._link_state is not LinkState.UP or self._port is None:
            return None
        return self._after_silence(self._port.speak_at(self._now))

    def _after_silence(self, instant: int | None) -> int | None:
        silent_until = self.silence.until(self._now)
        if instant is None or silent_until is None:
            return None
        return max(instant, silent_until) if silent_until > self._now else instant

    def _handle_access(
        self, source: int, control: AccessControl, frame: ReceivedFrame, now: int
    ) -> None:
        if self._port is not None:
            self._port.handle_control(source, control, frame, now)

    def _handle_call(self, source: int, call: Call, frame: ReceivedFrame, now: int) -> None:
        if self._port is not None:
            self._port.handle_call(source, call, frame, now)

    def _begin_epoch(self) -> None:
        self._handshake.table_changed()
        self._write_epoch()
        self.actions.epoch_changed(self._now)

    def _renew_epoch(self) -> bool:
        """Begin a new epoch unless a call is under way, which would not survive it."""
        if self._services.is_calling:
            return False
        self._begin_epoch()
        return True

    def _write_epoch(self) -> None:
        self._epochs_to_keep += 1
        self._journal.write(EPOCH_KEY, self.epoch.to_bytes(2, "big"), self._epoch_kept)

    def _epoch_kept(self, now: int) -> None:
        self._epochs_to_keep -= 1

    def _hand_on(self, sample: SampleReceived) -> None:
        count(self.stats.received, sample.stream_id)
        self._events.append(sample)

    def _note_news(self, news: PeerSeen | StreamsDiffer) -> None:
        if isinstance(news, PeerSeen):
            detail = "same_table" if news.same_table else "other_table"
            self._note("peer", news.address, b"", (), detail)
        else:
            self._note("differ", news.address, b"", (news.stream_id,))

    def _note(
        self, what: str, peer: int, frame_bytes: bytes, streams: tuple[int, ...], detail: str = ""
    ) -> None:
        if self._trace is not None:
            self._trace(
                TraceRecord(
                    at=self._now,
                    node=self.address,
                    what=what,
                    peer=peer,
                    size_bytes=len(frame_bytes),
                    streams=streams,
                    detail=detail,
                    frame=frame_bytes.hex(),
                )
            )


def _is_over(instant: int | None, now: int) -> bool:
    return instant is not None and instant <= now
