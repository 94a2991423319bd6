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
"""

import random
from collections import deque

from zacoustic.core.composer import Composer
from zacoustic.core.envelope import Opened
from zacoustic.core.events import (
    CallFailure,
    CallKey,
    Event,
    LinkStateChanged,
    PeerSeen,
    StreamsDiffer,
)
from zacoustic.core.frame import TAG_BYTES
from zacoustic.core.handshake import Handshake
from zacoustic.core.journal import EPOCH_KEY, JournalWrite
from zacoustic.core.keys import Instance
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic.core.port import LinkPort
from zacoustic.core.queue import TransmitQueue
from zacoustic.core.receiver import Receiver
from zacoustic.core.services import Services
from zacoustic.core.stats import EngineStats
from zacoustic.core.streams import Stream, StreamSpec, StreamTable
from zacoustic.core.topics import Topics
from zacoustic.core.trace import TraceRecord, TraceSink


class Engine:
    """One node's protocol.

    Args:
        address: Address of this node, 1…254.
        table: Its streams.
        epoch: Boot epoch, 0…65535: another one in each life of the node.
        rng: Source of all randomness.
        trace: Takes a record of each thing done, or None.
    """

    def __init__(
        self,
        *,
        address: int,
        table: StreamTable,
        epoch: int,
        rng: random.Random,
        trace: TraceSink | None = None,
    ) -> None:
        self.address = address
        self.table = table
        self.stats = EngineStats()
        self._rng = rng
        self._trace = trace
        self._now = 0
        self._events: deque[Event] = deque()
        emit = self._events.append
        stats = self.stats
        self._queue = queue = TransmitQueue()
        self._handshake = handshake = Handshake(address, epoch, table, rng)
        self._composer = Composer(queue, handshake, stats)
        self._topics = Topics(address, table, queue=queue, stats=stats, emit=emit)
        self._services = Services(
            address, table, queue=queue, handshake=handshake, stats=stats, emit=emit
        )
        self._receiver = Receiver(table, handshake, self._topics, self._services, stats)
        self._port: LinkPort | None = None
        self._link_state = LinkState.OPENING
        self._next_transmission_id = 1
        self._writes: deque[JournalWrite] = deque()
        self._uncommitted: set[int] = set()
        self._next_write_id = 1
        self._write_epoch()

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
            self._events.append(LinkStateChanged(state=state, changed_at=now))
            self._note("link", 0, b"", (), state.value)

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Somebody else's transmission began or ended."""
        self._now = now
        if self._port is not None:
            self._port.access.handle_carrier(busy, now)

    def handle_timeout(self, now: int) -> None:
        """The instant that `poll_timeout` named has come."""
        self._now = now
        self._services.expire(now)

    def handle_journal_committed(self, write_id: int, now: int) -> None:
        """A journal write is safe."""
        self._now = now
        self._uncommitted.discard(write_id)

    # Commands

    def declare(self, spec: StreamSpec, now: int) -> Stream:
        """Add a stream to the table; begins a new epoch, since peers have confirmed another table.

        Raises:
            ConfigError: The id or name is taken, or the spec is wrong.
        """
        self._now = now
        stream = self.table.declare(spec)
        self._handshake.table_changed()
        self._write_epoch()
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
    ) -> None:
        """Queue a sample of a topic.

        Args:
            stream_id: The topic's stream.
            value: As the stream's type says; bytes for an opaque stream; ignored for a delete.
            now: The instant.
            instance: One value number for each wildcard of the topic's name.
            encoding: Zenoh encoding, where it is not the stream's.
            delete: Delete the key instead.
            queued_at: Instant at which the sample was made, ns, where it is before `now`.

        Raises:
            UnknownStreamError: No such topic, or an instance that its name does not have.
            LocalError: This node may not publish it.
            PayloadInvalidError: The type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
        """
        self._now = now
        self._topics.publish(
            stream_id,
            value,
            now,
            instance=instance,
            encoding=encoding,
            delete=delete,
            queued_at=queued_at,
        )

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
        port, transmit_at = self._port, self._transmit_at()
        if port is None or transmit_at is None or transmit_at > now:
            return None
        composed = self._composer.compose(port.envelope, now)
        if composed is None:
            return None
        transmission = Transmission(
            transmission_id=self._next_transmission_id,
            frame_bytes=composed.frame_bytes,
            destination=composed.destination,
        )
        self._next_transmission_id += 1
        port.transmit(transmission)
        self.stats.frames_transmitted += 1
        self.stats.bytes_transmitted += len(composed.frame_bytes)
        self.stats.airtime_ns += port.capabilities.airtime_ns(len(composed.frame_bytes))
        self._note("transmit", composed.destination, composed.frame_bytes, composed.streams)
        return transmission

    def poll_journal(self) -> JournalWrite | None:
        """Return the next write that a promise waits for."""
        return self._writes.popleft() if self._writes else None

    def poll_event(self) -> Event | None:
        """Return the next event for the application."""
        return self._events.popleft() if self._events else None

    def poll_timeout(self) -> int | None:
        """Return the instant at which `handle_timeout` is to be called, ns.

        None means that the engine waits for inputs only.
        """
        instants = (self._services.next_deadline_at(), self._transmit_at())
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
        return not busy and not self._queue and self.poll_timeout() is None

    def pending(self, stream_id: int) -> int:
        """Count the payloads of a stream that wait."""
        return self._queue.pending(stream_id)

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
        self._port = LinkPort(capabilities, self.address, self._rng)
        self._handshake.use_link(capabilities)
        self._services.settling_ns = self._handshake.settling_ns
        for _ in range(self._queue.limit(self._port.envelope.room_bytes - TAG_BYTES)):
            self.stats.drop("oversized")

    def _transmit_at(self) -> int | None:
        """Return the instant from which a frame can and should go, or None."""
        if self._link_state is not LinkState.UP or self._port is None or self._uncommitted:
            return None
        due_at = self._composer.due_at(self._now)
        free_at = self._port.free_at(self._now) if due_at is not None else None
        return None if due_at is None or free_at is None else max(due_at, free_at)

    def _write_epoch(self) -> None:
        write_id = self._next_write_id
        self._next_write_id += 1
        self._uncommitted.add(write_id)
        epoch_bytes = self.epoch.to_bytes(2, "big")
        self._writes.append(JournalWrite(write_id=write_id, key=EPOCH_KEY, value=epoch_bytes))

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
