"""Services over rmw_desert: each request is sent once, and each one that arrives is served.

The wire has a sequence id and nothing else: no client, no acknowledgement, no error, no repetition.
So a call without an answer at its deadline has failed, and whether it was executed is unknown. It
is never repeated, since its server would execute it again. This wire cannot carry a server's error:
the client hears nothing and times out.

An answer goes to all clients of the service; each finds its own by the sequence id. Clients of
rmw_desert draw theirs from 0…999, this node counts from 1000 on (`specs.FIRST_SEQUENCE`). Two
clients may draw the same one at the same time. Both requests are served: a server that dropped one
would tell its client that it was executed. But identical bytes, within the time in which a modem or
the channel may duplicate a frame, are one request: its answer is sent again, if there is one.
"""

from collections.abc import Callable
from functools import partial

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.stats import count
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.streams.rmwdesert import FIRST_SEQUENCE, LAST_SEQUENCE
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.calls.calls import (
    CallEvent,
    CallFailed,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.transport.exchanges.records import repeated_qos
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.rmw_desert.messages import Kind, Message, check_limits, encode_head
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.errors import LocalError, QueueFullError

CALLS_LIMIT = 16
"""The most calls of this node to one service at the same time."""
SERVED_LIMIT = 64
"""The most unanswered requests of one service; further ones are dropped."""
SETTLING_UNITS = 4
"""A duplicate by a modem or the channel arrives within this many durations of the largest frame."""

_REQUEST_LANE = 1
_ANSWER_LANE = 2
_KIND_BYTES = 1


class _Call(msgspec.Struct):
    """A call of this node."""

    stream_id: int
    sequence: int


class _Served(msgspec.Struct):
    """A request that this node serves or has just answered."""

    fields: bytes
    response: bytes | None = None
    """The fields of the answer."""


class DesertCalls:
    """The services of one node, as client and as server.

    Args:
        context: What the components of its engine share.
    """

    def __init__(self, context: Context) -> None:
        self._address = context.address
        self._table = context.table
        self._queue = context.queue
        self._timers = context.timers
        self._stats = context.stats
        self._emit: Callable[[CallEvent], None] = context.emit
        rng = context.generators.of("rmw_desert calls")
        self._next_sequence = rng.randint(FIRST_SEQUENCE, LAST_SEQUENCE)
        self._ids = context.ids.numbered()
        self._arrivals = 0
        self._calls: dict[int, _Call] = {}
        self._by_sequence: dict[tuple[int, int], int] = {}
        self._served: dict[CallKey, _Served] = {}
        self.settling_ns = 0
        """Time in which a duplicate of a frame can arrive, ns."""

    # As client

    def call(self, stream_id: int, value: object, now: int, *, timeout_s: float | None) -> int:
        """Call a service; see `Engine.call`."""
        stream, spec = self._table.service(stream_id)
        if spec.server == self._address:
            raise LocalError(f"{stream.name} is served by this node, {self._address}")
        fields = stream.codec.encode(value)
        under_way = sum(call.stream_id == stream_id for call in self._calls.values())
        if under_way >= CALLS_LIMIT:
            raise QueueFullError(
                f"stream {stream_id}: {CALLS_LIMIT} calls are under way",
                hint="wait for answers, or set a shorter timeout_s",
            )
        sequence = self._take_sequence(stream_id)
        limit_s = spec.timeout_s if timeout_s is None else timeout_s
        deadline_at = now + seconds_to_ns(limit_s)
        self._send(Kind.REQUEST, stream, sequence, fields, now, expires_at=deadline_at)
        call_id = next(self._ids)
        self._calls[call_id] = _Call(stream_id, sequence)
        self._timers.at((Due.DESERT_CALL, call_id), deadline_at, partial(self._time_out, call_id))
        self._by_sequence[stream_id, sequence] = call_id
        count(self._stats.published, stream_id)
        return call_id

    def cancel(self, call_id: int) -> None:
        """Cancel a call; see `Engine.cancel`."""
        if call_id in self._calls:
            self._end(call_id)

    # As server

    def reply(self, key: CallKey, value: object, now: int) -> bool:
        """Answer a request; see `Engine.reply`."""
        served = self._served.get(key)
        if served is None or served.response is not None:
            return False
        del self._served[key]
        stream = self._table.by_id(key.stream_id)
        served.response = stream.response_codec.encode(value)
        self._respond(stream, key.number, served.response, now)
        self._serve(key, served, now + self.settling_ns)  # now the newest of the answered requests
        return True

    def reply_error(self, key: CallKey, now: int) -> bool:
        """Forget a request that failed; return False, since this wire cannot report it."""
        self._forget(key, now)
        return False

    # For the channel

    def receive(self, source: int, stream: Stream, message: Message, now: int) -> str | None:
        """Take a request or a response; return why it is dropped, or None."""
        spec = stream.spec
        if not isinstance(spec, ServiceSpec):
            return "unknown_stream"
        is_server = spec.server == self._address
        if message.kind is Kind.RESPONSE:
            return "not_publisher" if is_server else self._receive_response(stream, message)
        return self._receive_request(source, stream, message, now) if is_server else "not_for_us"

    # Below the methods above

    def _serve(self, key: CallKey, served: _Served, until: int) -> None:
        """Remember a request until an instant, ns."""
        self._served[key] = served
        self._timers.at((Due.DESERT_SERVED_CALL, key), until, partial(self._forget, key))

    def _forget(self, key: CallKey, now: int) -> None:
        self._served.pop(key, None)
        self._timers.cancel((Due.DESERT_SERVED_CALL, key))

    def _time_out(self, call_id: int, now: int) -> None:
        text = "no answer in time; whether the service ran is unknown"
        self._fail(call_id, CallFailure.TIMED_OUT, text)

    def _receive_request(
        self, source: int, stream: Stream, message: Message, now: int
    ) -> str | None:
        known = [key for key in self._served if key.stream_id == stream.stream_id]
        for key in known:
            served = self._served[key]
            if key.number == message.sequence and served.fields == message.fields:
                if served.response is not None:
                    self._respond(stream, key.number, served.response, now)
                return "repeated_request"
        if len(known) >= SERVED_LIMIT:
            answered = [key for key in known if self._served[key].response is not None]
            if not answered:
                return "too_many_calls"
            self._forget(answered[0], now)
        try:
            value = stream.codec.decode(message.fields)
        except PayloadError:
            return "payload"
        # Two clients may draw the same number: this count tells them apart.
        self._arrivals += 1
        key = CallKey(source, self._arrivals, stream.stream_id, message.sequence)
        deadline_at = now + self._timeout_ns(stream)
        self._serve(key, _Served(message.fields), deadline_at)
        count(self._stats.received, stream.stream_id)
        self._emit(RequestReceived(call=key, value=value, deadline_at=deadline_at))
        return None

    def _respond(self, stream: Stream, sequence: int, fields: bytes, now: int) -> None:
        expires_at = now + self._timeout_ns(stream)
        self._send(Kind.RESPONSE, stream, sequence, fields, now, expires_at=expires_at)

    def _receive_response(self, stream: Stream, message: Message) -> str | None:
        call_id = self._by_sequence.get((stream.stream_id, message.sequence))
        if call_id is None:
            return "unexpected_answer"
        try:
            value = stream.response_codec.decode(message.fields)
        except PayloadError:
            self._fail(call_id, CallFailure.BAD_RESPONSE, "the response does not decode")
            return "payload"
        self._end(call_id)
        count(self._stats.received, stream.stream_id)
        self._emit(ResponseReceived(call_id=call_id, stream_id=stream.stream_id, value=value))
        return None

    def _send(
        self,
        kind: Kind,
        stream: Stream,
        sequence: int,
        fields: bytes,
        now: int,
        *,
        expires_at: int,
    ) -> None:
        head = encode_head(stream.stream_id, sequence)
        size_bytes = _KIND_BYTES + len(head) + len(fields)
        check_limits(stream.name, 0, size_bytes)  # a client's sequence id may take nine bytes
        self._queue.check_size(stream.name, size_bytes)
        item = QueuedRecord(
            stream_id=stream.stream_id,
            destination=BROADCAST,
            code=kind,
            head=head,
            payload=fields,
            queued_at=now,
            expires_at=expires_at,
        )
        lane = _REQUEST_LANE if kind is Kind.REQUEST else _ANSWER_LANE
        self._queue.push((stream.stream_id, lane), item, repeated_qos(stream.qos))

    def _take_sequence(self, stream_id: int) -> int:
        while True:
            sequence = self._next_sequence
            self._next_sequence = FIRST_SEQUENCE if sequence == LAST_SEQUENCE else sequence + 1
            if (stream_id, sequence) not in self._by_sequence:
                return sequence

    def _fail(self, call_id: int, failure: CallFailure, text: str) -> None:
        call = self._end(call_id)
        failed = CallFailed(call_id=call_id, stream_id=call.stream_id, failure=failure, text=text)
        self._emit(failed)

    def _end(self, call_id: int) -> _Call:
        """End a call; a request that still waits is not sent."""
        call = self._calls.pop(call_id)
        self._timers.cancel((Due.DESERT_CALL, call_id))
        del self._by_sequence[call.stream_id, call.sequence]
        head = encode_head(call.stream_id, call.sequence)
        self._queue.remove((call.stream_id, _REQUEST_LANE), head)
        return call

    def _timeout_ns(self, stream: Stream) -> int:
        assert isinstance(stream.spec, ServiceSpec)
        return seconds_to_ns(stream.spec.timeout_s)
