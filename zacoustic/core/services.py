"""Services: the calls that this node makes and serves, between the queue and the application.

`zacoustic.core.calls` keeps who called what and which numbers are in use; here requests and
answers get onto the queue and off the water.
"""

from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.core.calls import (
    CALL_NUMBERS,
    Answer,
    CallKind,
    ClientCalls,
    ServerCalls,
    decode_call_byte,
    decode_error,
    encode_call_byte,
    encode_error,
)
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.events import CallFailure, CallKey, Event
from zacoustic.core.handshake import Handshake
from zacoustic.core.payload import PayloadError
from zacoustic.core.qos import Qos
from zacoustic.core.queue import TransmitQueue, Waiting
from zacoustic.core.stats import EngineStats, count
from zacoustic.core.streams import ServiceSpec, Stream, StreamTable
from zacoustic.errors import LocalError, PayloadInvalidError, UnknownStreamError

_REQUEST_LANE: Final = 1
_ANSWER_LANE: Final = 2
_HEADER_BYTES: Final = 2
# Odd, so that 64 lives in a row begin with 64 different numbers; 23, 46, 5, 28, … are far apart.
_EPOCH_STRIDE: Final = 23


class Services:
    """The services of one node, as client and as server.

    Args:
        address: Address of the node.
        table: Its streams.
        queue: Takes requests and answers.
        handshake: Knows which streams a peer defines in another way, and each peer's epoch.
        stats: Counts.
        emit: Takes the events.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        queue: TransmitQueue,
        handshake: Handshake,
        stats: EngineStats,
        emit: Callable[[Event], None],
    ) -> None:
        self._address = address
        self._table = table
        self._queue = queue
        self._handshake = handshake
        self._stats = stats
        self._emit = emit
        self._clients = ClientCalls(first_number=_first_number(handshake.epoch))
        self._servers = ServerCalls()
        self.settling_ns = 0
        """Time within which a duplicate of a frame can still arrive, ns."""

    # For the application

    def call(self, stream_id: int, value: object, now: int, *, timeout_s: float | None) -> int:
        """Call a service; see `Engine.call`."""
        stream, spec = self._service(stream_id)
        if spec.server == self._address:
            raise LocalError(f"{stream.name} is served by this node, {self._address}")
        payload = stream.codec.encode(value)
        self._queue.check_size(stream.name, _HEADER_BYTES + len(payload))
        served_ns = seconds_to_ns(spec.timeout_s)
        deadline_at = now + (served_ns if timeout_s is None else seconds_to_ns(timeout_s))
        call_id, number = self._clients.begin(
            stream_id, spec.server, deadline_at=deadline_at, served_ns=served_ns, now=now
        )
        if self._handshake.differs(spec.server, stream_id):
            self._mismatch(call_id, spec.server, stream_id, now)
            return call_id
        item = Waiting(
            stream_id=stream_id,
            destination=spec.server,
            head=_head(CallKind.REQUEST, number),
            payload=payload,
            delimits_itself=stream.codec.delimits_itself,
            queued_at=now,
            expires_at=deadline_at,
        )
        self._queue.push((stream_id, _REQUEST_LANE, spec.server), item, _call_qos(stream.qos))
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
        if spec.server != source:
            return "not_publisher"
        if kind is CallKind.CONFIRM:
            return "reserved"
        call_id = self._clients.find(source, stream.stream_id, number)
        if call_id is None:
            return "unexpected_answer"
        if kind is CallKind.ERROR:
            failure, text = decode_error(payload) or (CallFailure.HANDLER, "")
            self._fail(call_id, failure, text, now)
            return None
        return self._receive_response(call_id, stream, payload, now)

    def stream_differs(self, server: int, stream_id: int, now: int) -> None:
        """Fail the calls to a service that its server defines in another way."""
        for call_id in self._clients.to(server, stream_id):
            self._mismatch(call_id, server, stream_id, now)

    def client_restarted(self, client: int, epoch: int, now: int) -> None:
        """Give up the calls of a client's other lives: nobody there knows them any more."""
        abandoned = self._servers.abandon(client, epoch, now=now, settling_ns=self.settling_ns)
        for call in abandoned:
            self._queue.drop_lane((call.stream_id, _ANSWER_LANE, client))

    # For the timer

    def expire(self, now: int) -> None:
        """Fail the calls whose deadline has come."""
        for call_id in self._clients.due(now):
            self._fail(call_id, CallFailure.TIMED_OUT, "no answer before the deadline", now)

    def next_deadline_at(self) -> int | None:
        """Return the earliest deadline of a call, ns, or None."""
        return self._clients.next_deadline_at()

    # Below the methods above

    def _service(self, stream_id: int) -> tuple[Stream, ServiceSpec]:
        stream = self._table.by_id(stream_id)
        if not isinstance(stream.spec, ServiceSpec):
            raise UnknownStreamError(f"stream {stream_id} ({stream.name}) is not a service")
        return stream, stream.spec

    def _receive_request(
        self, key: CallKey, stream: Stream, spec: ServiceSpec, payload: bytes, now: int
    ) -> str | None:
        taken = self._servers.take(key, timeout_ns=seconds_to_ns(spec.timeout_s), now=now)
        if taken is not True:
            if isinstance(taken, Answer):
                self._queue_answer(key, taken, now + self.settling_ns, now)
            return "repeated_request"
        try:
            value = stream.codec.decode(payload)
        except PayloadError:
            text = encode_error(CallFailure.BAD_REQUEST, "the request does not decode")
            self._answer(key, CallKind.ERROR, text, now)
            return "payload"
        count(self._stats.received, stream.stream_id)
        self._emit(self._servers.request(key, value))
        return None

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
        self._emit(self._clients.respond(call_id, value, now=now, settling_ns=self.settling_ns))
        return None

    def _answer(self, call: CallKey, kind: CallKind, payload: bytes, now: int) -> bool:
        answer = Answer(kind, payload)
        settling_ns = self.settling_ns
        deadline_at = self._servers.answer(call, answer, now=now, settling_ns=settling_ns)
        if deadline_at is None:
            return False
        self._queue_answer(call, answer, deadline_at, now)
        count(self._stats.published, call.stream_id)
        return True

    def _queue_answer(self, call: CallKey, answer: Answer, expires_at: int, now: int) -> None:
        stream = self._table.by_id(call.stream_id)
        is_response = answer.kind is CallKind.RESPONSE
        item = Waiting(
            stream_id=call.stream_id,
            destination=call.client,
            head=_head(answer.kind, call.number),
            payload=answer.payload,
            delimits_itself=is_response and stream.response_codec.delimits_itself,
            for_one_node=True,
            queued_at=now,
            expires_at=expires_at,
        )
        self._queue.push((call.stream_id, _ANSWER_LANE, call.client), item, _call_qos(stream.qos))

    def _mismatch(self, call_id: int, server: int, stream_id: int, now: int) -> None:
        text = f"node {server} defines stream {stream_id} in another way"
        self._fail(call_id, CallFailure.TABLE_MISMATCH, text, now)

    def _fail(self, call_id: int, failure: CallFailure, text: str, now: int) -> None:
        self._emit(self._end(call_id, failure, text, now))

    def _end(self, call_id: int, failure: CallFailure, text: str, now: int) -> Event:
        """End a call without an answer; its request does not leave any more."""
        located = self._clients.locate(call_id)
        assert located is not None
        stream_id, server, number = located
        self._queue.remove((stream_id, _REQUEST_LANE, server), _head(CallKind.REQUEST, number))
        return self._clients.fail(call_id, failure, text, now=now, settling_ns=self.settling_ns)


def _first_number(epoch: int) -> int:
    """Return the call number to begin a life with: far from where the lives before began."""
    return (epoch - 1) * _EPOCH_STRIDE % CALL_NUMBERS


def _head(kind: CallKind, number: int) -> bytes:
    return bytes((encode_call_byte(kind, number),))


def _call_qos(qos: Qos) -> Qos:
    """Return the QoS of a lane of calls: none pushes out another, none waits."""
    return msgspec.structs.replace(qos, depth=CALL_NUMBERS, lifespan_s=None, min_interval_s=0.0)
