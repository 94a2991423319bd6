"""Services: calls of the island to servers beyond the water, and calls from the water.

A call of the island is a `Query` that is held until the engine has the answer or gives up at the
stream's deadline; then it is answered or refused, never left silent. Zenoh does not tell how long
the caller waits: 10 s unless it says otherwise, which on sound is short.

A call from the water becomes a `get` on the island. The first good reply is the answer; if there is
none, the first error; if there is nothing at all, nobody serves.
"""

import threading
from collections import deque
from collections.abc import Callable
from typing import Final

import zenoh

from zacoustic.core.clock import Clock, ns_to_seconds
from zacoustic.core.engine import Engine
from zacoustic.core.events import (
    CallFailed,
    CallFailure,
    CallKey,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.streams import ServiceSpec, Stream, StreamTable
from zacoustic.errors import PayloadInvalidError, ZacousticError
from zacoustic.gateway.complaints import Complaints
from zacoustic.gateway.island import Island, zenoh_priority
from zacoustic.gateway.marker import Marker, is_marked
from zacoustic.gateway.queries import Answer, HeldQuery
from zacoustic.gateway.topics import read_value, write_value

REASONS: Final = {
    CallFailure.HANDLER: "the server failed",
    CallFailure.NO_SERVER: "nobody on the island of the server's node serves it",
    CallFailure.BAD_REQUEST: "the request does not decode",
    CallFailure.TABLE_MISMATCH: "the two nodes define the stream in different ways",
    CallFailure.BAD_RESPONSE: "the response does not decode",
    CallFailure.TIMED_OUT: "no answer before the deadline",
    CallFailure.CANCELLED: "given up",
}
"""Text of an error reply where the other end sent none, which costs no airtime."""


class Services:
    """The services of one gateway; for the loop.

    Args:
        table: All streams.
        island: Where servers are asked.
        complaints: Takes what is wrong with answers of the island.
        clock: Where instants come from.
        ring: Wakes the loop, which then calls `drain`.
    """

    def __init__(
        self,
        table: StreamTable,
        island: Island,
        complaints: Complaints,
        *,
        clock: Clock,
        ring: Callable[[], None],
    ) -> None:
        self._table = table
        self._island = island
        self._complaints = complaints
        self._clock = clock
        self._ring = ring
        # Own calls: call id → who waits, and in which encoding.
        self._calls: dict[int, tuple[HeldQuery, str]] = {}
        self._gets: dict[CallKey, _Get] = {}
        self._settled: deque[_Get] = deque()

    def call(self, held: HeldQuery, stream_id: int, engine: Engine, now: int) -> None:
        """Bring a call of the island to the water."""
        stream = self._table.by_id(stream_id)
        query = held.query
        if str(query.key_expr) != stream.name:
            # Whoever looks around with a wildcard does not mean to run a service on a vehicle.
            held.refuse(f"{stream.name}: a wildcard calls no service, only its own key does")
            return
        if query.attachment is not None and is_marked(query.attachment.to_bytes()):
            held.refuse(f"{stream.name}: the call came off the water, it does not go back")
            return
        said = str(query.encoding) if query.encoding is not None else stream.encoding
        try:
            value, encoding = _read_request(query.payload, said, stream)
            call_id = engine.call(stream_id, value, now)
        except ZacousticError as error:
            self._complaints.add(stream.name, "request", str(error))
            held.refuse(f"{stream.name}: {error}")
            return
        self._calls[call_id] = (held, encoding or stream.encoding)

    def respond(self, event: ResponseReceived) -> None:
        """Answer a call of the island."""
        stream = self._table.by_id(event.stream_id)
        held, encoding = self._calls.pop(event.call_id)
        payload, encoding = write_value(
            event.value, stream.response_type, encoding, stream.encoding
        )
        assert isinstance(stream.spec, ServiceSpec)
        marker = Marker(acoustic=stream.spec.server).encode()
        held.answer(
            [Answer(key=stream.name, payload=payload, encoding=encoding, attachment=marker)]
        )

    def fail(self, event: CallFailed) -> None:
        """Refuse a call of the island."""
        stream = self._table.by_id(event.stream_id)
        held, _ = self._calls.pop(event.call_id)
        reason = event.text or REASONS[event.failure]
        held.refuse(f"{stream.name}: {event.failure.name}: {reason}")

    def serve(self, event: RequestReceived) -> None:
        """Ask the island for an answer to a call from the water."""
        stream = self._table.by_id(event.call.stream_id)
        payload, encoding = write_value(event.value, stream.type, stream.encoding, stream.encoding)
        left_s = ns_to_seconds(event.deadline_at - self._clock())
        get = _Get(event.call, self._settle)
        self._gets[event.call] = get
        session = self._island.session

        def ask() -> None:
            try:
                session.get(
                    stream.name,
                    self._island.callback(get.take, get.end),
                    payload=payload,
                    encoding=encoding,
                    attachment=Marker(acoustic=event.call.client).encode(),
                    timeout=max(left_s, 0.001),
                    # Each reply at once: by default the newest of all is delivered at the end.
                    consolidation=zenoh.ConsolidationMode.NONE,
                    priority=zenoh_priority(stream.qos.priority),
                    congestion_control=zenoh.CongestionControl.DROP,
                    allowed_destination=zenoh.Locality.REMOTE,
                    cancellation_token=get.cancellation,
                )
            except zenoh.ZError:
                get.end()
                raise

        self._island.worker.submit(ask)

    def drain(self, engine: Engine, now: int) -> None:
        """Bring the answers of the island to the water."""
        while self._settled:
            get = self._settled.popleft()
            if self._gets.pop(get.call, None) is not None:
                self._answer(engine, self._table.by_id(get.call.stream_id), get, now)

    def close(self) -> None:
        """Stop to ask the island."""
        gets = list(self._gets.values())
        self._gets.clear()
        # Cancelling waits for a callback that runs: not on the loop.
        for get in gets:
            self._island.worker.submit(get.cancel)

    def _settle(self, get: "_Get") -> None:
        self._settled.append(get)
        self._ring()

    def _answer(self, engine: Engine, stream: Stream, get: "_Get", now: int) -> None:
        if get.good is None:
            failure = CallFailure.NO_SERVER if get.error is None else CallFailure.HANDLER
            engine.reply_error(get.call, failure, get.error or "", now)
            return
        payload, said = get.good
        try:
            value, _ = read_value(payload, said, stream.response_type, stream.encoding)
        except PayloadInvalidError as error:
            self._complaints.add(stream.name, "response", str(error))
            engine.reply_error(get.call, CallFailure.HANDLER, f"bad response: {error}", now)
            return
        try:
            engine.reply(get.call, value, now)
        except ZacousticError as error:  # the engine has told the caller
            self._complaints.add(stream.name, "response", str(error))


class _Get:
    """A `get` on the island for one call from the water; filled on Zenoh's thread."""

    def __init__(self, call: CallKey, settle: Callable[["_Get"], None]) -> None:
        self.call = call
        self.cancellation = zenoh.CancellationToken()
        self.good: tuple[bytes, str] | None = None
        self.error: str | None = None
        self._settle = settle
        self._guard = threading.Lock()
        self._is_settled = False

    def take(self, reply: zenoh.Reply) -> None:
        """Keep the first good reply, and the first error until then."""
        if reply.ok is not None:
            good = (reply.ok.payload.to_bytes(), str(reply.ok.encoding))
            self._finish(good)
        elif reply.err is not None and self.error is None:
            text = reply.err.payload.to_bytes().decode(errors="replace")
            self.error = " ".join(text.split())

    def end(self) -> None:
        """No more replies come."""
        self._finish(None)

    def cancel(self) -> None:
        """Ask no further; may block."""
        self.cancellation.cancel()  # type: ignore[no-untyped-call]

    def _finish(self, good: tuple[bytes, str] | None) -> None:
        with self._guard:
            if self._is_settled:
                return
            self._is_settled = True
            self.good = good
        self._settle(self)


def _read_request(
    payload: zenoh.ZBytes | None, said: str, stream: Stream
) -> tuple[object, str | None]:
    """Read a request; a `get` without payload is an empty one."""
    if payload is None or not len(payload):
        return ({} if stream.type is not None else b""), None
    return read_value(payload.to_bytes(), said, stream.type, stream.encoding)
