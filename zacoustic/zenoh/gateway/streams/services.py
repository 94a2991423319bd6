"""Services: local calls to remote servers, and received calls.

A local call is a `Query` that is held until the engine has the answer or gives up at the stream's
deadline; then it is answered or refused, never left without a reply. Zenoh does not tell how long
the caller waits: 10 s by default, which is short for sound.

A received call becomes a local `get`. The first good reply is the answer; without one, the first
error. Without any reply there is no server; but if a server was there when it was asked, it has
ended without an answer, and the outcome is unknown.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import zenoh

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    CallKey,
    RequestReceived,
)
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import PayloadInvalidError, PayloadTooLargeError, ZacousticError
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.zenoh.gateway.dialect.dialects import Dialects, ServiceDialect
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery
from zacoustic.zenoh.session.asking.question import Question
from zacoustic.zenoh.session.session import ZenohSession

# Zenoh refuses a limit of 0.
_LEAST_LIMIT_S: Final = 0.001

# Failures that a local server can name; anything else is text of its handler.
_SAID_BY_SERVERS: Final = (
    CallFailure.NO_SERVER,
    CallFailure.BAD_REQUEST,
    CallFailure.UNKNOWN,
)


class Services:
    """The services of one gateway; for the loop.

    Args:
        table: All streams.
        zenoh_session: The session of the servers.
        input_errors: Takes the errors of local answers.
        dialects: Their local forms.
        ends: The calls of the gateway.
        clock: Source of instants.
        ring: Wakes the loop, which then calls `drain`.
    """

    def __init__(
        self,
        table: StreamTable,
        zenoh_session: ZenohSession,
        input_errors: InputErrors,
        dialects: Dialects,
        ends: Pending[CallEnd],
        *,
        clock: Clock,
        ring: Callable[[], None],
    ) -> None:
        self._table = table
        self._ends = ends
        self._zenoh_session = zenoh_session
        self._input_errors = input_errors
        self._clock = clock
        self._ring = ring
        self.dialects = {
            stream.stream_id: dialects.service(stream)
            for stream in table
            if isinstance(stream.spec, ServiceSpec)
        }
        """The local form of each service, by stream id."""
        # Calls to local servers: the caller, and whether a server was there.
        self._asked: dict[Question, tuple[CallKey, bool]] = {}
        self._watched: dict[int, Any] = {}
        self._settled: deque[Question] = deque()

    def watch(self, address: int) -> None:
        """Watch for local servers of this node's services; in the worker."""
        for stream in self._table:
            if isinstance(stream.spec, ServiceSpec) and stream.spec.server == address:
                self._watched[stream.stream_id] = self._zenoh_session.session.declare_querier(
                    zenoh.KeyExpr(self.dialects[stream.stream_id].key),
                    allowed_destination=zenoh.Locality.REMOTE,
                )

    def call(self, held: HeldQuery, stream_id: int, engine: Engine, now: int) -> None:
        """Send a local call to its remote server."""
        stream = self._table.by_id(stream_id)
        dialect = self.dialects[stream_id]
        query = held.query
        if str(query.key_expr) != dialect.key:
            # A program that browses with a wildcard does not mean to call a service on a vehicle.
            text = f"a wildcard calls no service, only {dialect.key} itself does"
            held.refuse(CallFailure.BAD_REQUEST, text)
            return
        if query.attachment is not None and dialect.is_marked(query.attachment.to_bytes()):
            text = "the call came off the channel, it does not go back"
            held.refuse(CallFailure.NO_SERVER, text)
            return
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            value, encoding = dialect.read_request(payload, query.encoding)
            call_id = engine.call(stream_id, value, now)
        except ZacousticError as error:
            is_wrong = isinstance(error, PayloadInvalidError | PayloadTooLargeError)
            failure = CallFailure.BAD_REQUEST if is_wrong else CallFailure.NO_SERVER
            self._input_errors.add(stream.name, "request", str(error))
            held.refuse(failure, str(error))
            return
        self._ends.add(call_id, partial(_answer, dialect, held, encoding))

    def serve(self, event: RequestReceived) -> None:
        """Ask the local server for the answer to a received call."""
        stream = self._table.by_id(event.call.stream_id)
        dialect = self.dialects[stream.stream_id]
        payload, encoding = dialect.write_request(event.value)
        left_s = ns_to_seconds(event.deadline_at - self._clock())
        question = Question(dialect.key, self._settle)
        watched = self._watched.get(stream.stream_id)
        is_there = watched is not None and bool(watched.matching_status.matching)
        self._asked[question] = event.call, is_there
        self._zenoh_session.worker.submit(
            partial(
                question.ask,
                self._zenoh_session,
                payload,
                encoding=encoding,
                priority=stream.qos.priority,
                timeout_s=max(left_s, _LEAST_LIMIT_S),
                attachment=dialect.question_mark(event.call),
            )
        )

    def drain(self, engine: Engine, now: int) -> None:
        """Give the engine the local answers."""
        while self._settled:
            question = self._settled.popleft()
            asked = self._asked.pop(question, None)
            if asked is not None:
                call, was_there = asked
                self._answer(engine, call, question, now, was_there=was_there)

    def close(self) -> None:
        """Stop asking the local network."""
        questions = list(self._asked)
        self._asked.clear()
        for question in questions:
            self._zenoh_session.worker.submit(question.cancel)

    def _settle(self, question: Question) -> None:
        self._settled.append(question)
        self._ring()

    def _answer(
        self, engine: Engine, call: CallKey, question: Question, now: int, *, was_there: bool
    ) -> None:
        stream = self._table.by_id(call.stream_id)
        if question.good is None:
            ended = CallFailure.UNKNOWN if was_there else CallFailure.NO_SERVER
            failure, text = question.error or (ended, "")
            said = failure if failure in _SAID_BY_SERVERS else CallFailure.HANDLER
            engine.reply_error(call, said, text, now)
            return
        payload, encoding = question.good
        try:
            value = self.dialects[call.stream_id].read_response(payload, encoding)
        except PayloadInvalidError as error:
            self._input_errors.add(stream.name, "response", str(error))
            engine.reply_error(call, CallFailure.HANDLER, f"bad response: {error}", now)
            return
        try:
            engine.reply(call, value, now)
        except ZacousticError as error:  # the engine has informed the caller
            self._input_errors.add(stream.name, "response", str(error))


def _answer(dialect: ServiceDialect, held: HeldQuery, encoding: str, end: CallEnd) -> None:
    """Answer or refuse a local call."""
    if isinstance(end, CallFailed):
        held.refuse(end.failure, end.text)
        return
    try:
        payload, encoding = dialect.write_response(end.value, encoding)
    except PayloadInvalidError as error:
        held.refuse(CallFailure.BAD_RESPONSE, str(error))
        return
    asked = held.query.attachment
    mark = dialect.answer_mark(asked.to_bytes() if asked is not None else None)
    held.answer([Answer(key=dialect.key, payload=payload, encoding=encoding, attachment=mark)])
