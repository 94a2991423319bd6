"""Calls on a Zenoh session: queries of others that are answered once, and replies to own ones."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any, Final

import zenoh

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.events import CallFailure
from zacoustic.errors import PayloadInvalidError
from zacoustic.node.carrier import CLOSED_TEXT, IncomingCall, call_error
from zacoustic.node.crossing import Crossing, tell_loop
from zacoustic.node.island import (
    ERROR_ENCODING,
    decode_value,
    encode_value,
    error_text,
    read_error,
    read_marker,
    said_encoding,
)
from zacoustic.node.routes import ServiceRoute

CALLS_LIMIT: Final = 64
"""Calls of one service that can be under way: as many as a client has on the water."""

Submit = Callable[[Callable[[], object]], None]
"""Has something done by the worker thread, which may block."""


class QueryDesk:
    """The queries of one service, from Zenoh's thread to the handler; each gets its one answer.

    Args:
        route: The service.
        handle: Takes the calls, on the loop.
        submit: Sends replies.
    """

    def __init__(
        self,
        route: ServiceRoute[Any, Any],
        handle: Callable[[IncomingCall], None],
        submit: Submit,
    ) -> None:
        self.route = route
        self.submit = submit
        self.held: set[ZenohCall] = set()
        self._handle = handle
        self._crossing: Crossing[zenoh.Query] = Crossing(self._take)
        self._is_closed = False

    def bring(self, query: zenoh.Query) -> None:
        """Take a query; on Zenoh's thread."""
        if not self._crossing.put(query, push_out=False):
            self._refuse(query, "too many calls at once")

    def close(self) -> None:
        """Refuse what is held, and what still comes."""
        self._is_closed = True
        for call in tuple(self.held):
            call.fail(CallFailure.NO_SERVER, CLOSED_TEXT)

    def _take(self, query: zenoh.Query) -> None:
        if self._is_closed:
            self.submit(lambda: self._refuse(query, CLOSED_TEXT))
        elif len(self.held) >= CALLS_LIMIT:
            reason = f"{CALLS_LIMIT} calls are under way already"
            self.submit(lambda: self._refuse(query, reason))
        else:
            call = ZenohCall(query, self)
            if call.read():
                self._handle(call)

    def _refuse(self, query: zenoh.Query, reason: str) -> None:
        text = error_text(self.route.name, CallFailure.NO_SERVER, reason)
        with contextlib.suppress(zenoh.ZError), query:
            query.reply_err(text.encode(), encoding=ERROR_ENCODING)


class ZenohCall:
    """A query that waits for its answer; the first one counts."""

    def __init__(self, query: zenoh.Query, desk: QueryDesk) -> None:
        self.value: Any = None
        self.client = read_marker(query.attachment).acoustic
        self.deadline_at = time.monotonic_ns() + seconds_to_ns(desk.route.timeout_s)
        self._query = query
        self._desk = desk
        desk.held.add(self)

    def read(self) -> bool:
        """Read the request; False, with an error to the caller, when it is none."""
        query, route = self._query, self._desk.route
        encoding = said_encoding(query.encoding, route.encoding)
        payload = query.payload.to_bytes() if query.payload is not None else b""
        spec = route.request.spec
        try:
            if payload or spec is None:
                self.value = decode_value(payload, spec, encoding)
            else:
                self.value = spec.validate({})  # a `get` without payload is an empty request
        except PayloadInvalidError as error:
            self.fail(CallFailure.BAD_REQUEST, str(error))
            return False
        return True

    def reply(self, value: object) -> bool:
        """Answer; see `IncomingCall`."""
        route = self._desk.route
        try:
            payload = encode_value(value, route.response.spec, route.encoding)
        except PayloadInvalidError as error:
            self.fail(CallFailure.HANDLER, str(error))
            raise
        return self._end(lambda query: query.reply(route.name, payload, encoding=route.encoding))

    def fail(self, failure: CallFailure, text: str) -> bool:
        """Answer with an error; see `IncomingCall`."""
        said = error_text(self._desk.route.name, failure, text).encode()
        return self._end(lambda query: query.reply_err(said, encoding=ERROR_ENCODING))

    def _end(self, reply: Callable[[zenoh.Query], None]) -> bool:
        if self not in self._desk.held:
            return False
        self._desk.held.discard(self)

        def send() -> None:
            with contextlib.suppress(zenoh.ZError), self._query:
                reply(self._query)

        self._desk.submit(send)
        return time.monotonic_ns() < self.deadline_at


class FirstReply:
    """The replies to one own call, from Zenoh's thread to the loop: the first one counts.

    Args:
        route: The service.
        answer: Gets a value, or the error of the call.
    """

    def __init__(self, route: ServiceRoute[Any, Any], answer: "asyncio.Future[object]") -> None:
        self._route = route
        self._answer = answer
        self._loop = answer.get_loop()
        self._is_told = False

    def take(self, reply: zenoh.Reply) -> None:
        """Take a reply; on Zenoh's thread."""
        if not self._is_told:
            self._tell(self._read(reply))

    def end(self) -> None:
        """No more replies come; on Zenoh's thread."""
        if not self._is_told:
            text = "nobody serves it on this Zenoh network"
            self._tell(call_error(self._route.name, CallFailure.NO_SERVER, text))

    def _read(self, reply: zenoh.Reply) -> object:
        route = self._route
        if reply.ok is None:
            assert reply.err is not None
            return read_error(route.name, reply.err)
        encoding = said_encoding(reply.ok.encoding, route.encoding)
        try:
            return decode_value(reply.ok.payload.to_bytes(), route.response.spec, encoding)
        except PayloadInvalidError as error:
            return call_error(route.name, CallFailure.BAD_RESPONSE, str(error))

    def _tell(self, outcome: object) -> None:
        self._is_told = True
        tell_loop(self._loop, lambda: self._set(outcome))

    def _set(self, outcome: object) -> None:
        if self._answer.done():
            return
        if isinstance(outcome, Exception):
            self._answer.set_exception(outcome)
        else:
            self._answer.set_result(outcome)
