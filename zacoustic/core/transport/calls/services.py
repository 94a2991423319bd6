"""Services: the calls that this node makes, and the dispatch of those that it serves.

`zacoustic.core.transport.calls.calls` records who called what and which numbers are in use. This
module queues requests and takes their answers from the channel.
`zacoustic.core.transport.calls.answering` is the server's side.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import Stamp
from zacoustic.core.base.stats import count
from zacoustic.core.base.timers import Due
from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.commands import COMMANDS_STREAM_ID
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import EVERY_NODE, Stream
from zacoustic.core.transport.calls.answering import CONFIRM_LANE, Answering
from zacoustic.core.transport.calls.calls import (
    CallEvent,
    CallFailed,
    ClientCalls,
    ResponseReceived,
)
from zacoustic.core.transport.exchanges.records import confirm, once_qos, repeated_qos
from zacoustic.core.transport.exchanges.repeating import Repeater
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.calls import (
    NAME_BYTES,
    NAMED,
    CallFailure,
    CallKey,
    CallKind,
    decode_call_byte,
    decode_error,
    decode_name,
    encode_call_byte,
)
from zacoustic.core.wire.content import server_bytes, server_of, split_age
from zacoustic.core.wire.frame import Record
from zacoustic.errors import LocalError

_REQUEST_LANE: Final = 1
_HEADER_BYTES: Final = 2


class Services:
    """The services of one node, as client and as server.

    Args:
        context: What the components of its engine share.
        repeater: Repeats requests and answers.
    """

    def __init__(self, context: Context, repeater: Repeater) -> None:
        self._address = context.address
        self._table = context.table
        self._queue = context.queue
        self._repeater = repeater
        self._handshake = context.handshake
        self._lives = context.lives
        self._epoch = context.epoch
        self._timers = context.timers
        self._stats = context.stats
        self._emit: Callable[[CallEvent], None] = context.emit
        self._clients = ClientCalls(
            context.handshake.epoch, context.ids.numbered(), context.sizes.calls
        )
        self._answering = Answering(context, repeater)
        context.reception.on_records(ServiceSpec, self.receive)
        context.epoch.began.connect(self.epoch_changed)
        context.epoch.outlast(lambda: self.is_calling)
        context.peers.restarted.connect(self._answering.peer_restarted)
        context.peers.differs.connect(self.stream_differs)
        context.peers.forgotten.connect(self.peer_forgotten)
        self.reply = self._answering.reply
        """Answers a request; see `Engine.reply`."""
        self.reply_error = self._answering.reply_error
        """Answers a request with an error; see `Engine.reply_error`."""
        self.serve_here = self._answering.serve_here
        """Gives a service's requests to a handler in the engine."""
        self._linger_s = 0.0
        self._takers: dict[int, Callable[[CallEvent, int], CallEvent | None]] = {}

    def take_ends(self, stream_id: int, take: Callable[[CallEvent, int], CallEvent | None]) -> None:
        """Show the ends of calls to a service to a handler, which returns the event to emit."""
        self._takers[stream_id] = take

    def use_link(self, times: LinkTimes, settling_ns: int) -> None:
        """Set the link's airtimes, and how long a frame and all its duplicates take to come, ns."""
        self._linger_s = times.confirm_linger_s
        self._clients.settling_ns = settling_ns
        self._answering.use_link(times, settling_ns)

    def link_up(self, now: int) -> None:
        """Answer the calls left from before the restart, now that the link is up."""
        self._answering.link_up(now)

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the served calls that the journal has."""
        self._answering.recover(stored)

    # For the application

    def call(
        self,
        stream_id: int,
        value: object,
        now: int,
        *,
        timeout_s: float | None,
        server: int | None = None,
    ) -> int:
        """Call a service; see `Engine.call`. `server` is for a service that every node serves."""
        stream, spec = self._table.service(stream_id)
        server = spec.server if server is None else server
        if server in (self._address, EVERY_NODE):
            raise LocalError(f"{stream.name} is served by this node, {self._address}")
        payload = stream.codec.encode(value)
        head = server_bytes(stream, server)
        stamped = stream.qos.stamp is Stamp.AGE
        self._queue.check_size(stream.name, _HEADER_BYTES + len(head) + stamped + len(payload))
        served_at = now + seconds_to_ns(spec.timeout_s)
        deadline_at = served_at if timeout_s is None else now + seconds_to_ns(timeout_s)
        if self._clients.needs_new_epoch(stream_id, server):
            self._epoch.begin(now)
            self._clients.begin_epoch(self._handshake.epoch)
        call_id, number = self._clients.begin(stream_id, server, now)
        self._timers.at((Due.CALL, call_id), deadline_at, partial(self._time_out, call_id))
        if self._handshake.differs(server, stream_id):
            self._mismatch(call_id, server, stream_id, now)
            return call_id
        request = QueuedRecord(
            stream_id=stream_id,
            destination=server,
            head=head + _head(CallKind.REQUEST, number),
            payload=payload,
            stamped=stamped,
            delimits_itself=stream.codec.delimits_itself,
            queued_at=now,
            made_at=now,
        )
        key = (stream_id, _REQUEST_LANE, server)
        # After that the server no longer remembers the number.
        until = min(deadline_at, served_at)
        started = self._repeater.start(
            key,
            request,
            repeated_qos(stream.qos),
            until=until,
            introduces=stream.is_built_in,
        )
        self._clients.attach(call_id, started)
        count(self._stats.published, stream_id)
        return call_id

    def cancel(self, call_id: int, now: int) -> None:
        """Cancel a call; see `Engine.cancel`."""
        if self._clients.locate(call_id) is not None:
            self._end(call_id, CallFailure.CANCELLED, "", now)

    @property
    def is_calling(self) -> bool:
        """Whether a call of this node has no answer yet."""
        return len(self._clients) > 0

    # For the channel

    def receive(self, heard: Heard, stream: Stream, record: Record) -> str | None:
        """Take a record that may be decoded; return why it is dropped, or None."""
        spec, source, now = stream.spec, heard.source, heard.now
        assert isinstance(spec, ServiceSpec)
        introduced = heard.epoch is not None
        server, start = server_of(spec, record.content, 0)
        content = record.content[start:]
        if not content:
            return "payload"
        kind, number = decode_call_byte(content[0])
        if server == source and not heard.is_unicast:
            return "not_for_us"  # it may be to a call of another client
        if server == source:
            return self._receive_answer(heard, stream, content)
        if server != self._address:
            return "not_subscriber" if kind is CallKind.REQUEST else "not_publisher"
        key = CallKey(source, self._handshake.peer(source).present_epoch, stream.stream_id, number)
        if kind is CallKind.CONFIRM:
            if len(content) > 1:
                return "payload"
            self._answering.confirmed(key, now)
            return None
        if kind is not CallKind.REQUEST:
            return "not_publisher"
        if stream.is_built_in and not introduced:
            return "unconfirmed"  # it may be from an earlier boot epoch of its sender
        if self._lives.is_over(source, key.epoch, now):
            self._handshake.ask_for_proof(source, now)
            # A silent node cannot ask, and must hear that its silence ends: commands hold as
            # unproved.
            if not (stream.is_built_in and stream.stream_id == COMMANDS_STREAM_ID):
                return "former_life"
        code, payload = split_age(stream, content[1:])
        age_s = None if code is None else heard.age(code).seconds
        return self._answering.receive_request(
            key, stream, payload, now, age_s=age_s, introduced=introduced
        )

    def peer_forgotten(self, address: int, now: int) -> None:
        """Forget a node and cancel the calls to it."""
        for call_id in self._clients.to_node(address):
            self.cancel(call_id, now)
        self._clients.forget(address)
        self._answering.peer_forgotten(address, now)

    def epoch_changed(self, now: int) -> None:
        """Drop the waiting CONFIRMs after this node has begun a new epoch.

        A CONFIRM identifies its call by the epoch of its frame, so it would confirm a call of the
        new epoch. The server repeats the answer, which is then confirmed again.
        """
        for stream in self._table:
            if isinstance(stream.spec, ServiceSpec):
                self._queue.drop_lanes((stream.stream_id, CONFIRM_LANE))

    def stream_differs(self, server: int, stream_id: int, now: int) -> None:
        """Fail the calls to a service that its server defines differently."""
        for call_id in self._clients.to(server, stream_id):
            self._mismatch(call_id, server, stream_id, now)

    # Below the methods above

    def _receive_answer(self, heard: Heard, stream: Stream, content: bytes) -> str | None:
        server, now = heard.source, heard.now
        kind, number = decode_call_byte(content[0])
        payload, is_named = content[1:], kind is NAMED
        if is_named:
            named = decode_name(payload, self._handshake.epoch)
            if named is None or named is NAMED:
                return "unexpected_answer"
            kind, payload = named, payload[NAME_BYTES:]
        if kind is CallKind.CONFIRM and payload:
            return "payload"
        if not is_named and not self._handshake.peer(server).knows_us:
            self._ask_again(server, stream.stream_id, number, now)
            return "unexpected_answer"
        call_id = self._clients.find(server, stream.stream_id, number)
        if call_id is not None:
            self._clients.proved(call_id, now)
            request = self._clients.request(call_id)
            if request is not None:
                is_prompt = kind is CallKind.CONFIRM
                self._repeater.stop(request, now, answered=True, prompt=is_prompt)
        if kind is CallKind.CONFIRM:
            return None if call_id is not None else "unexpected_answer"
        self._owe_confirm(stream, server, number, now)
        if call_id is None:
            return "unexpected_answer"
        if kind is CallKind.ERROR:
            failure, text = decode_error(payload) or (CallFailure.HANDLER, "")
            self._fail(call_id, failure, text, now)
            return None
        return self._receive_response(heard, call_id, stream, payload)

    def _ask_again(self, server: int, stream_id: int, number: int, now: int) -> None:
        """Repeat the request of a call after an answer that may belong to an earlier boot epoch.

        The server believes that we know that it knows our epoch, but we no longer do: its own HELLO
        was new to us after it had confirmed ours. It would send the same plain answer for ever. A
        request behind our HELLO or TAG makes it send a named answer.
        """
        call_id = self._clients.find(server, stream_id, number)
        request = None if call_id is None else self._clients.request(call_id)
        if request is not None:
            self._repeater.resume(request, now)

    def _owe_confirm(self, stream: Stream, peer: int, number: int, now: int) -> None:
        """Queue a CONFIRM that the answer has arrived."""
        self._clients.confirms(peer, stream.stream_id, number, now)
        head = server_bytes(stream, peer) + _head(CallKind.CONFIRM, number)
        record = confirm(stream.stream_id, peer, head, now)
        key = (stream.stream_id, CONFIRM_LANE, peer, number)
        self._queue.replace(key, record, once_qos(self._linger_s))

    def _receive_response(
        self, heard: Heard, call_id: int, stream: Stream, payload: bytes
    ) -> str | None:
        now = heard.now
        code, payload = split_age(stream, payload)
        age_s = None if code is None else heard.age(code).seconds
        try:
            value = stream.response_codec.decode(payload)
        except PayloadError:
            text = "the response does not decode"
            self._fail(call_id, CallFailure.BAD_RESPONSE, text, now)
            return "payload"
        count(self._stats.received, stream.stream_id)
        self._timers.cancel((Due.CALL, call_id))
        response = self._clients.respond(call_id, value)
        self._tell(msgspec.structs.replace(response, age_s=age_s), now)
        return None

    def _mismatch(self, call_id: int, server: int, stream_id: int, now: int) -> None:
        text = f"node {server} defines stream {stream_id} in another way"
        self._fail(call_id, CallFailure.TABLE_MISMATCH, text, now)

    def _time_out(self, call_id: int, now: int) -> None:
        self._fail(call_id, CallFailure.TIMED_OUT, "no answer before the deadline", now)

    def _fail(self, call_id: int, failure: CallFailure, text: str, now: int) -> None:
        self._tell(self._end(call_id, failure, text, now), now)

    def _tell(self, event: ResponseReceived | CallFailed, now: int) -> None:
        take = self._takers.get(event.stream_id)
        told = event if take is None else take(event, now)
        if told is not None:
            self._emit(told)

    def _end(self, call_id: int, failure: CallFailure, text: str, now: int) -> CallFailed:
        """End a call without an answer and stop its request."""
        request = self._clients.request(call_id)
        if request is not None:
            self._repeater.stop(request, now)
        self._timers.cancel((Due.CALL, call_id))
        return self._clients.fail(call_id, failure, text)


def _head(kind: CallKind, number: int) -> bytes:
    return bytes((encode_call_byte(kind, number),))
