"""Services: the calls that this node makes and serves, between the queue and the application.

`zacoustic.core.calls` keeps who called what and which numbers are in use; here requests and
answers get onto the queue and off the water.
"""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.arq.timing import LinkTimes
from zacoustic.core.calls import (
    CALL_NUMBERS,
    Answer,
    CallKind,
    ClientCalls,
    Served,
    ServerCalls,
    decode_call_byte,
    decode_error,
    encode_call_byte,
    encode_error,
)
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.events import CallFailure, CallKey, Event
from zacoustic.core.handshake import Handshake
from zacoustic.core.journal import JournalPort
from zacoustic.core.payload import PayloadError
from zacoustic.core.qos import Priority, Qos
from zacoustic.core.queue import TransmitQueue, Waiting
from zacoustic.core.repeating import RepeatedRecord, Repeater
from zacoustic.core.stats import Cause, EngineStats, count
from zacoustic.core.streams import ServiceSpec, Stream, StreamTable
from zacoustic.errors import LocalError, PayloadInvalidError, UnknownStreamError

_REQUEST_LANE: Final = 1
_ANSWER_LANE: Final = 2
_CONFIRM_LANE: Final = 5
_JOURNAL: Final = "call"
_UNREADABLE: Final = object()
_HEADER_BYTES: Final = 2
# Odd, so that 64 lives in a row begin with 64 different numbers; 23, 46, 5, 28, … are far apart.
_EPOCH_STRIDE: Final = 23


class _Kept(msgspec.Struct, frozen=True, array_like=True):
    """A call in the journal of its server."""

    digest: bytes
    answer: Answer | None


class Services:
    """The services of one node, as client and as server.

    Args:
        address: Address of the node.
        table: Its streams.
        queue: Takes what confirms.
        repeater: Takes requests and answers.
        journal: Keeps the calls that this node serves.
        handshake: Knows which streams a peer defines in another way, and each peer's epoch.
        begin_epoch: Begins a new boot epoch of this node.
        stats: Counts.
        emit: Takes the events.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        queue: TransmitQueue,
        repeater: Repeater,
        journal: JournalPort,
        handshake: Handshake,
        begin_epoch: Callable[[], None],
        stats: EngineStats,
        emit: Callable[[Event], None],
    ) -> None:
        self._address = address
        self._table = table
        self._queue = queue
        self._repeater = repeater
        self._journal = journal
        self._handshake = handshake
        self._begin_epoch = begin_epoch
        self._stats = stats
        self._emit = emit
        self._clients = ClientCalls(first_number=_first_number(handshake.epoch))
        self._servers = ServerCalls()
        self._linger_s = 0.0
        self._settling_ns = 0

    def use_link(self, times: LinkTimes, settling_ns: int) -> None:
        """Take the airtimes of a link, and within what time a repetition of a frame arrives."""
        self._linger_s = times.ack_linger_ns / NS_PER_S
        self._settling_ns = settling_ns

    def link_up(self, now: int) -> None:
        """The link is up: the times of what a former life has left begin."""
        for key, served in self._servers.restored():
            spec = self._table.by_id(key.stream_id).spec
            assert isinstance(spec, ServiceSpec)
            served.deadline_at = now + seconds_to_ns(spec.timeout_s)
            served.forget_at = served.deadline_at + self._settling_ns
            self._send_answer(key, served)

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Go on with the calls that a former life has left: what ran then is answered UNKNOWN."""
        for name, value in stored.items():
            if not name.startswith(f"{_JOURNAL}/"):
                continue
            client, epoch, stream_id, number = map(int, name.split("/")[1:])
            kept = msgspec.msgpack.decode(value, type=_Kept)
            stream = self._table.get(stream_id)
            if stream is None or stream.digest != kept.digest:
                self._journal.write(name, None)
                continue
            lost = encode_error(CallFailure.UNKNOWN, "the server died while the service ran")
            answer = kept.answer or Answer(CallKind.ERROR, lost)
            self._servers.restore(CallKey(client, epoch, stream_id, number), answer)

    # For the application

    def call(self, stream_id: int, value: object, now: int, *, timeout_s: float | None) -> int:
        """Call a service; see `Engine.call`."""
        stream, spec = self._service(stream_id)
        if spec.server == self._address:
            raise LocalError(f"{stream.name} is served by this node, {self._address}")
        payload = stream.codec.encode(value)
        self._queue.check_size(stream.name, _HEADER_BYTES + len(payload))
        served_at = now + seconds_to_ns(spec.timeout_s)
        deadline_at = served_at if timeout_s is None else now + seconds_to_ns(timeout_s)
        if self._clients.needs_new_epoch(stream_id, spec.server):
            self._begin_epoch()
            self._clients.begin_epoch(_first_number(self._handshake.epoch))
        call_id, number = self._clients.begin(
            stream_id, spec.server, deadline_at=deadline_at, now=now
        )
        if self._handshake.differs(spec.server, stream_id):
            self._mismatch(call_id, spec.server, stream_id, now)
            return call_id
        request = RepeatedRecord(
            stream_id=stream_id,
            destination=spec.server,
            head=_head(CallKind.REQUEST, number),
            payload=payload,
            delimits_itself=stream.codec.delimits_itself,
            queued_at=now,
        )
        key = (stream_id, _REQUEST_LANE, spec.server)
        # Longer than that the server does not remember the number.
        until = min(deadline_at, served_at)
        started = self._repeater.start(key, request, _call_qos(stream.qos), until=until)
        self._clients.attach(call_id, started)
        count(self._stats.published, stream_id)
        return call_id

    def cancel(self, call_id: int, now: int) -> None:
        """Give up a call; see `Engine.cancel`."""
        if self._clients.locate(call_id) is not None:
            self._end(call_id, CallFailure.CANCELLED, "", now)

    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """Answer a request; see `Engine.reply`."""
        stream = self._table.by_id(call.stream_id)
        try:
            payload = stream.response_codec.encode(value)
            self._queue.check_size(stream.name, _HEADER_BYTES + len(payload))
        except (PayloadInvalidError, LocalError) as error:
            self._answer(call, CallKind.ERROR, encode_error(CallFailure.HANDLER, str(error)), now)
            raise
        return self._answer(call, CallKind.RESPONSE, payload, now)

    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """Answer a request with an error; see `Engine.reply_error`."""
        return self._answer(call, CallKind.ERROR, encode_error(failure, text), now)

    # For the water

    def receive(
        self, source: int, stream: Stream, spec: ServiceSpec, content: bytes, now: int
    ) -> str | None:
        """Take a record that may be decoded; returns why it is dropped, or None."""
        if not content:
            return "payload"
        kind, number = decode_call_byte(content[0])
        payload = content[1:]
        if kind is CallKind.REQUEST:
            if spec.server != self._address:
                return "not_subscriber"
            key = CallKey(source, self._handshake.epoch_of(source), stream.stream_id, number)
            return self._receive_request(key, stream, spec, payload, now)
        if kind is CallKind.CONFIRM and spec.server == self._address:
            self._answer_confirmed(source, stream, number, now)
            return None
        if spec.server != source:
            return "not_publisher"
        call_id = self._clients.find(source, stream.stream_id, number)
        if call_id is not None:
            self._clients.proved(call_id)
            request = self._clients.request(call_id)
            if request is not None:
                self._repeater.stop(request, now, answered=True)
        if kind is CallKind.CONFIRM:
            return None if call_id is not None else "unexpected_answer"
        self._owe_confirm(stream, source, number, now)
        if call_id is None:
            return "unexpected_answer"
        if kind is CallKind.ERROR:
            failure, text = decode_error(payload) or (CallFailure.HANDLER, "")
            self._fail(call_id, failure, text, now)
            return None
        return self._receive_response(call_id, stream, payload, now)

    def heard(self, source: int) -> None:
        """A frame of a node arrived: what had become rare for it is due."""
        self._repeater.heard(source)

    def stream_differs(self, server: int, stream_id: int, now: int) -> None:
        """Fail the calls to a service that its server defines in another way."""
        for call_id in self._clients.to(server, stream_id):
            self._mismatch(call_id, server, stream_id, now)

    def client_restarted(self, client: int, epoch: int, now: int) -> None:
        """Give up the calls of a client's other lives: nobody there knows them any more."""
        for key in self._servers.of_other_lives(client, epoch):
            served = self._servers.find(key)
            if served is not None and not served.is_abandoned:
                served.is_abandoned = True
                served.forget_at = now + self._settling_ns
                self._stop_answer(served, now)

    # For the timer

    def expire(self, now: int) -> None:
        """Fail the calls whose deadline has come."""
        for call_id in self._clients.due(now):
            self._fail(call_id, CallFailure.TIMED_OUT, "no answer before the deadline", now)
        for key in self._servers.due(now):
            self._forget(key, now)

    def next_deadline_at(self) -> int | None:
        """Return the earliest instant at which a call ends or is forgotten, ns, or None."""
        instants = (self._clients.next_deadline_at(), self._servers.next_forget_at())
        return min((at for at in instants if at is not None), default=None)

    # Below the methods above

    def _service(self, stream_id: int) -> tuple[Stream, ServiceSpec]:
        stream = self._table.by_id(stream_id)
        if not isinstance(stream.spec, ServiceSpec):
            raise UnknownStreamError(f"stream {stream_id} ({stream.name}) is not a service")
        return stream, stream.spec

    def _receive_request(
        self, key: CallKey, stream: Stream, spec: ServiceSpec, payload: bytes, now: int
    ) -> str | None:
        served = self._servers.find(key)
        if served is not None:
            return self._receive_repetition(key, served, stream, now)
        for closed in self._servers.closed_by(key):
            self._forget(closed, now)
        try:
            value = stream.codec.decode(payload)
        except PayloadError:
            value = _UNREADABLE
        timeout_ns = seconds_to_ns(spec.timeout_s)
        served = self._servers.take(
            key, timeout_ns=timeout_ns, settling_ns=self._settling_ns, now=now
        )
        if served is None:
            return "too_many_calls"
        if value is _UNREADABLE:
            text = encode_error(CallFailure.BAD_REQUEST, "the request does not decode")
            self._answer(key, CallKind.ERROR, text, now)
            return "payload"
        count(self._stats.received, stream.stream_id)
        request = self._servers.request(key, value)

        def kept(at: int) -> None:
            if served.is_abandoned or served.answer is not None:
                return
            self._emit(request)
            self._owe_confirm(stream, key.client, key.number, at)

        self._keep(key, stream, None, kept, now)
        return None

    def _receive_repetition(self, key: CallKey, served: Served, stream: Stream, now: int) -> str:
        if served.repetition is not None and not served.is_closed:
            self._repeater.again(served.repetition)
        elif served.answer is None and not served.is_abandoned:
            self._owe_confirm(stream, key.client, key.number, now)
        return "repeated_request"

    def _answer_confirmed(self, client: int, stream: Stream, number: int, now: int) -> None:
        key = CallKey(client, self._handshake.epoch_of(client), stream.stream_id, number)
        served = self._servers.find(key)
        if served is None or served.answer is None:
            return
        self._stop_answer(served, now, answered=True)
        served.is_closed = True

    def _stop_answer(self, served: Served, now: int, *, answered: bool = False) -> None:
        if served.repetition is not None:
            self._repeater.stop(served.repetition, now, answered=answered)

    def _forget(self, key: CallKey, now: int) -> None:
        served = self._servers.forget(key)
        if served is not None:
            self._stop_answer(served, now)
            if self._is_kept(key):
                self._journal.write(_journal_name(key), None)

    def _is_kept(self, key: CallKey) -> bool:
        return self._table.by_id(key.stream_id).spec.journal

    def _keep(
        self,
        key: CallKey,
        stream: Stream,
        answer: Answer | None,
        then: Callable[[int], None],
        now: int,
    ) -> None:
        """Write down how far a call is, then go on."""
        if not stream.spec.journal:
            then(now)
            return
        value = msgspec.msgpack.encode(_Kept(stream.digest, answer))
        self._journal.write(_journal_name(key), value, then)

    def _owe_confirm(self, stream: Stream, peer: int, number: int, now: int) -> None:
        """Tell a node that its request, or its answer, has arrived; for a moment it may wait."""
        record = Waiting(
            stream_id=stream.stream_id,
            destination=peer,
            head=_head(CallKind.CONFIRM, number),
            payload=b"",
            delimits_itself=True,
            for_one_node=True,
            cause=Cause.ACK,
            queued_at=now,
        )
        qos = Qos(priority=Priority.INTERACTIVE_HIGH, linger_s=self._linger_s)
        self._queue.replace((stream.stream_id, _CONFIRM_LANE, peer, number), record, qos)

    def _receive_response(
        self, call_id: int, stream: Stream, payload: bytes, now: int
    ) -> str | None:
        try:
            value = stream.response_codec.decode(payload)
        except PayloadError:
            text = "the response does not decode"
            self._fail(call_id, CallFailure.BAD_RESPONSE, text, now)
            return "payload"
        count(self._stats.received, stream.stream_id)
        self._emit(self._clients.respond(call_id, value, now=now, settling_ns=self._settling_ns))
        return None

    def _answer(self, call: CallKey, kind: CallKind, payload: bytes, now: int) -> bool:
        served = self._servers.answerable(call, now)
        if served is None:
            return False
        stream = self._table.by_id(call.stream_id)
        served.answer = Answer(kind, payload)
        # The answer says that the request has arrived, too.
        self._queue.drop_lane((call.stream_id, _CONFIRM_LANE, call.client, call.number))
        count(self._stats.published, call.stream_id)

        def kept(at: int) -> None:
            if not served.is_abandoned and self._servers.find(call) is served:
                self._send_answer(call, served, at)

        self._keep(call, stream, served.answer, kept, now)
        return True

    def _send_answer(self, call: CallKey, served: Served, now: int = 0) -> None:
        stream, answer = self._table.by_id(call.stream_id), served.answer
        assert answer is not None
        is_response = answer.kind is CallKind.RESPONSE
        record = RepeatedRecord(
            stream_id=call.stream_id,
            destination=call.client,
            head=_head(answer.kind, call.number),
            payload=answer.payload,
            delimits_itself=is_response and stream.response_codec.delimits_itself,
            for_one_node=True,
            queued_at=now,
        )
        key = (call.stream_id, _ANSWER_LANE, call.client)
        served.repetition = self._repeater.start(
            key, record, _call_qos(stream.qos), until=served.deadline_at
        )

    def _mismatch(self, call_id: int, server: int, stream_id: int, now: int) -> None:
        text = f"node {server} defines stream {stream_id} in another way"
        self._fail(call_id, CallFailure.TABLE_MISMATCH, text, now)

    def _fail(self, call_id: int, failure: CallFailure, text: str, now: int) -> None:
        self._emit(self._end(call_id, failure, text, now))

    def _end(self, call_id: int, failure: CallFailure, text: str, now: int) -> Event:
        """End a call without an answer; its request does not leave any more."""
        request = self._clients.request(call_id)
        if request is not None:
            self._repeater.stop(request, now)
        return self._clients.fail(call_id, failure, text, now=now, settling_ns=self._settling_ns)


def _journal_name(key: CallKey) -> str:
    return f"{_JOURNAL}/{key.client}/{key.epoch}/{key.stream_id}/{key.number}"


def _first_number(epoch: int) -> int:
    """Return the call number to begin a life with: far from where the lives before began."""
    return (epoch - 1) * _EPOCH_STRIDE % CALL_NUMBERS


def _head(kind: CallKind, number: int) -> bytes:
    return bytes((encode_call_byte(kind, number),))


def _call_qos(qos: Qos) -> Qos:
    """Return the QoS of a lane of calls: none pushes out another, none waits."""
    return msgspec.structs.replace(qos, depth=CALL_NUMBERS, lifespan_s=None, min_interval_s=0.0)
