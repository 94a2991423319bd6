"""The calls of one service on Zenoh: queries of other programs, each with one answer."""

import asyncio
import time
from collections.abc import Callable
from typing import Any, Final

import zenoh

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import PayloadInvalidError
from zacoustic.run.inbox import WakeUp
from zacoustic.zenoh.node.carrier import CLOSED_TEXT, IncomingCall
from zacoustic.zenoh.node.routes import ServiceRoute
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery, QueryHandler
from zacoustic.zenoh.session.marker import read_marker
from zacoustic.zenoh.session.values import said_encoding
from zacoustic.zenoh.session.worker import Worker

CALLS_LIMIT: Final = 64
"""Most calls of one service under way: as many as a client may have on the channel."""


class ServiceHandler:
    """Turns the queries of one service into calls; created on the loop.

    Args:
        route: The service.
        handle: Takes the calls, on the loop.
        worker: Sends replies.
    """

    def __init__(
        self,
        route: ServiceRoute[Any, Any],
        handle: Callable[[IncomingCall], None],
        worker: Worker,
    ) -> None:
        self._route = route
        self._handle = handle
        bell = WakeUp(asyncio.get_running_loop())
        self._handler = QueryHandler(worker, bell.ring, limit=CALLS_LIMIT, closed_text=CLOSED_TEXT)
        bell.open(self._handler.serve)

    def bring(self, query: zenoh.Query) -> None:
        """Take a query; on Zenoh's thread."""
        self._handler.admit(self._take, query)

    def close(self) -> None:
        """Refuse held queries, and later ones."""
        self._handler.close()

    def _take(self, held: HeldQuery) -> None:
        call = ZenohCall(held, self._route)
        if call.read():
            self._handle(call)


class ZenohCall:
    """A query that waits for its answer; the first answer counts."""

    def __init__(self, held: HeldQuery, route: ServiceRoute[Any, Any]) -> None:
        marker = read_marker(held.query.attachment)
        self.value: Any = None
        self.client = marker.acoustic if marker is not None else None
        self.call_id = marker.call if marker is not None else None
        self.deadline_at = time.monotonic_ns() + seconds_to_ns(route.timeout_s)
        self._held = held
        self._route = route

    def read(self) -> bool:
        """Read the request; if it cannot be read, send the caller an error and return False."""
        query, form = self._held.query, self._route.request
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            if payload or form.spec is None:
                self.value = form.read(payload, said_encoding(query.encoding, self._route.encoding))
            else:
                self.value = form.spec.validate({})  # a `get` without a payload is an empty request
        except PayloadInvalidError as error:
            self.fail(CallFailure.BAD_REQUEST, str(error))
            return False
        return True

    def reply(self, value: object) -> bool:
        """Answer; see `IncomingCall`."""
        route = self._route
        try:
            payload = route.response.write(value, route.encoding)
        except PayloadInvalidError as error:
            self.fail(CallFailure.HANDLER, str(error))
            raise
        answer = Answer(key=route.name, payload=payload, encoding=route.encoding)
        return self._held.answer([answer]) and self._is_in_time()

    def fail(self, failure: CallFailure, text: str) -> bool:
        """Answer with an error; see `IncomingCall`."""
        return self._held.refuse(failure, text) and self._is_in_time()

    def _is_in_time(self) -> bool:
        return time.monotonic_ns() < self.deadline_at
