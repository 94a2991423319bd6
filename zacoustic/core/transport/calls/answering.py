"""The calls that this node serves: each runs once and is answered until its client confirms.

`zacoustic.core.transport.calls.calls` records which calls exist. This module takes requests from
the channel, journals them, gives them to the application and queues the answers. A service that the
engine itself serves has a handler here in place of the application.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import Stamp
from zacoustic.core.base.stats import count
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import LaneKey, QueuedRecord
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.calls.calls import CallAnswer, RequestReceived, Served
from zacoustic.core.transport.exchanges.journal import ExchangeJournal
from zacoustic.core.transport.exchanges.records import confirm, once_qos, repeated_qos
from zacoustic.core.transport.exchanges.repeating import Repeater
from zacoustic.core.transport.exchanges.taken import TakenExchanges
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.calls import (
    NAME_BYTES,
    NAMED,
    CallFailure,
    CallKey,
    CallKind,
    encode_call_byte,
    encode_error,
    encode_name,
)
from zacoustic.core.wire.content import server_bytes
from zacoustic.errors import LocalError, PayloadInvalidError

ANSWER_LANE: Final = 2
"""Second part of the key of an answer lane; the client's address follows."""
CONFIRM_LANE: Final = 5
_JOURNAL: Final = "call"
_UNREADABLE: Final = object()
_HEADER_BYTES: Final = 2 + NAME_BYTES


class Answering:
    """The server's side of calls.

    Args:
        context: What the components of its engine share.
        repeater: Sends the answers until they are confirmed.
    """

    def __init__(self, context: Context, repeater: Repeater) -> None:
        self._address = context.address
        self._table = context.table
        self._queue = context.queue
        self._repeater = repeater
        self._doubt = context.doubt
        self._stats = context.stats
        self._emit: Callable[[RequestReceived], None] = context.emit
        self._calls: TakenExchanges[Served] = TakenExchanges(
            ExchangeJournal(_JOURNAL, context.table, context.journal),
            context.timers,
            repeater,
            Due.SERVED_CALL,
            context.sizes.calls,
        )
        self._handlers: dict[int, Callable[[RequestReceived, int], None]] = {}
        self._linger_s = 0.0
        self._settling_ns = 0

    def serve_here(self, stream_id: int, handler: Callable[[RequestReceived, int], None]) -> None:
        """Give a service's requests to a handler that answers soon, not to the application."""
        self._handlers[stream_id] = handler

    def use_link(self, times: LinkTimes, settling_ns: int) -> None:
        """Set the link's airtimes and the time in which every copy of a request arrives, ns."""
        self._linger_s = times.confirm_linger_s
        self._settling_ns = settling_ns

    def link_up(self, now: int) -> None:
        """Start the timers of calls from before the restart and send their answers."""
        for served in self._calls.recovered():
            self._calls.forget_at(served, self._begin(served, now))
            self._send_answer(served, now)

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore journalled calls; answer UNKNOWN where a call had no answer yet."""

        def restore(parts: list[int], state: list[Any]) -> Served:
            served = Served(CallKey(*parts))
            (answer,) = state
            if answer is None:
                served.answer = CallAnswer(CallKind.ERROR, encode_error(CallFailure.UNKNOWN, ""))
            else:
                served.answer = msgspec.convert(answer, CallAnswer)
            return served

        self._calls.recover(stored, restore)

    # For the application

    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """CallAnswer a request; see `Engine.reply`."""
        stream = self._table.by_id(call.stream_id)
        try:
            payload = stream.response_codec.encode(value)
            self._queue.check_size(stream.name, _HEADER_BYTES + len(payload))
        except (PayloadInvalidError, LocalError) as error:
            self.reply_error(call, CallFailure.HANDLER, str(error), now)
            raise
        return self._answer(call, CallKind.RESPONSE, payload, now)

    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """CallAnswer a request with an error; see `Engine.reply_error`."""
        return self._answer(call, CallKind.ERROR, self._error(failure, text), now)

    # For the channel

    def receive_request(
        self,
        key: CallKey,
        stream: Stream,
        payload: bytes,
        now: int,
        *,
        age_s: float | None,
        introduced: bool,
    ) -> str | None:
        """Take a request; return why it is dropped, or None.

        Args:
            key: Identifies the call.
            stream: The service.
            payload: The encoded request.
            now: The instant.
            age_s: Its age, s; None: unknown.
            introduced: Its frame began with HELLO or TAG, so the answer must be named.
        """
        served = self._calls.get(key)
        if served is not None:
            self._receive_repetition(served, now, introduced=introduced)
            return "repeated_request"
        if _keeps(stream) and self._doubt.suspends(_timeout_s(stream), now):
            return "suspended"
        try:
            value = stream.codec.decode(payload)
        except PayloadError:
            value = _UNREADABLE
        for other in self._calls.of(key.client):
            if self._is_abandoned(other, now):
                self._calls.forget(other, now)
        served = Served(key)
        if not self._calls.take(served, self._begin(served, now), now):
            return "too_many_calls"
        served.is_named = introduced
        if value is _UNREADABLE:
            self.reply_error(key, CallFailure.BAD_REQUEST, "the request does not decode", now)
            return "payload"
        if _keeps(stream) and self._doubt.covers(_timeout_s(stream), now):
            self.reply_error(key, CallFailure.UNKNOWN, self._doubt.reason, now)
            return None
        count(self._stats.received, stream.stream_id)
        request = RequestReceived(
            call=key, value=value, deadline_at=served.deadline_at, age_s=age_s
        )

        def kept(at: int) -> None:
            # Do not run a call that its client no longer waits for.
            if served.abandoned_at is not None or at >= served.deadline_at:
                return
            handler = self._handlers.get(key.stream_id)
            if handler is not None:
                handler(request, at)
                return
            self._emit(request)
            self._owe_confirm(served, at)

        self._calls.keep(served, (None,), kept, now)
        return None

    def confirmed(self, key: CallKey, now: int) -> None:
        """Stop repeating an answer that the client has confirmed."""
        served = self._calls.get(key)
        if served is None or served.answer is None:
            return
        self._stop_answer(served, now, answered=True)
        served.is_closed = True

    def peer_restarted(self, client: int, epoch: int, now: int) -> None:
        """CallAnswer only the calls of this boot epoch of a client.

        Calls of its other boot epochs stay known: the frame that announced this epoch may be a late
        duplicate.
        """
        for served in self._calls.of(client):
            if served.key.epoch != epoch and served.abandoned_at is None:
                served.abandoned_at = now
                self._stop_answer(served, now)
            elif served.key.epoch == epoch and served.abandoned_at is not None:
                served.abandoned_at = None
                if served.is_answerable:
                    self._send_answer(served, now)

    def peer_forgotten(self, client: int, now: int) -> None:
        """Forget a node and all of its calls."""
        for served in self._calls.of(client):
            self._calls.forget(served, now)

    # Below the methods above

    def _begin(self, served: Served, now: int) -> int:
        """Set the deadline of a call; return the instant at which it is forgotten."""
        timeout_ns = seconds_to_ns(_timeout_s(self._table.by_id(served.key.stream_id)))
        served.deadline_at = now + timeout_ns
        # The client repeats for `timeout_ns`; twice that, since a link may hold a frame back.
        return now + 2 * (timeout_ns + self._settling_ns)

    def _is_abandoned(self, served: Served, now: int) -> bool:
        """Return whether no frame of a call's boot epoch can still arrive."""
        since = served.abandoned_at
        return since is not None and since + 2 * self._settling_ns <= now

    def _receive_repetition(self, served: Served, now: int, *, introduced: bool) -> None:
        has_changed, served.is_named = served.is_named != introduced, introduced
        if served.is_answerable and served.repetition is not None:
            if has_changed:
                self._stop_answer(served, now)
                self._send_answer(served, now)
            else:
                self._repeater.again(served.repetition)
        elif served.answer is None and served.is_journalled and served.abandoned_at is None:
            self._owe_confirm(served, now)

    def _stop_answer(self, served: Served, now: int, *, answered: bool = False) -> None:
        if served.repetition is not None:
            self._repeater.stop(served.repetition, now, answered=answered)

    def _owe_confirm(self, served: Served, now: int) -> None:
        """Queue a CONFIRM that the request has arrived."""
        key = served.key
        head = self._head(CallKind.CONFIRM, served)
        record = confirm(key.stream_id, key.client, head, now)
        self._queue.replace(_confirm_lane(key), record, once_qos(self._linger_s))

    def _error(self, failure: CallFailure, text: str) -> bytes:
        largest_bytes = self._queue.largest_bytes
        if largest_bytes is None:
            return encode_error(failure, text)
        return encode_error(failure, text, largest_bytes - _HEADER_BYTES - 1)

    def _answer(self, call: CallKey, kind: CallKind, payload: bytes, now: int) -> bool:
        served = self._calls.get(call)
        if served is None or served.answer is not None or served.deadline_at <= now:
            return False
        served.answer = answer = CallAnswer(kind, payload)
        served.answered_at = now
        # The answer also confirms the request.
        self._queue.drop_lane(_confirm_lane(call))
        count(self._stats.published, call.stream_id)

        def kept(at: int) -> None:
            if served.is_answerable:
                self._send_answer(served, at)

        self._calls.keep(served, (answer,), kept, now)
        return served.abandoned_at is None

    def _send_answer(self, served: Served, now: int) -> None:
        call, answer = served.key, served.answer
        stream = self._table.by_id(call.stream_id)
        assert answer is not None
        is_response = answer.kind is CallKind.RESPONSE
        record = QueuedRecord(
            stream_id=call.stream_id,
            destination=call.client,
            head=self._head(answer.kind, served),
            payload=answer.payload,
            stamped=is_response and stream.qos.stamp is Stamp.AGE,
            delimits_itself=is_response and stream.response_codec.delimits_itself,
            for_one_node=True,
            is_reply=True,
            queued_at=now,
            made_at=served.answered_at,
        )
        key = (call.stream_id, ANSWER_LANE, call.client)
        qos = repeated_qos(stream.qos)
        served.repetition = self._repeater.start(
            key, record, qos, until=served.deadline_at, introduces=stream.is_built_in
        )

    def _head(self, kind: CallKind, served: Served) -> bytes:
        key = served.key
        head = server_bytes(self._table.by_id(key.stream_id), self._address)
        if served.is_named:
            named = bytes((encode_call_byte(NAMED, key.number),)) + encode_name(kind, key.epoch)
            return head + named
        return head + bytes((encode_call_byte(kind, key.number),))


def _keeps(stream: Stream) -> bool:
    """Return whether a request must not run twice across restarts; built-in commands may."""
    return stream.spec.journal and not stream.is_built_in


def _timeout_s(stream: Stream) -> float:
    assert isinstance(stream.spec, ServiceSpec)
    return stream.spec.timeout_s


def _confirm_lane(key: CallKey) -> LaneKey:
    return (key.stream_id, CONFIRM_LANE, key.client, key.number)
