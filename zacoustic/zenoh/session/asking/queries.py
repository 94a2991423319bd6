"""Local queries: each gets exactly one answer in any case.

A `get` ends when its `Query` is dropped, and to its caller a query that is dropped without an
answer looks as if there were no server. So a `HeldQuery` holds every query from the moment Zenoh
hands it over, until it is answered with values, refused with a reason, or refused because its
holder stops. Queries beyond a limit are refused at once.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import cast

import msgspec
import zenoh

from zacoustic.core.engine.events import CallFailure
from zacoustic.core.values.encoding import JSON
from zacoustic.zenoh.session.asking.replies import ERROR_ENCODING, error_text
from zacoustic.zenoh.session.worker import Worker

_logger = logging.getLogger(__name__)


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """One value in the answer to a query."""

    key: str
    """The concrete key."""
    payload: bytes
    """The value."""
    encoding: str
    """Its Zenoh encoding."""
    attachment: bytes | None = None
    """See `zacoustic.zenoh.session.marker`."""


class HeldQuery:
    """One query that waits; `answer` or `refuse` ends it, from any thread; the first one counts."""

    def __init__(self, query: zenoh.Query, handler: "QueryHandler") -> None:
        self.query = query
        self._handler = handler

    @property
    def key(self) -> str:
        """The key expression asked for."""
        return str(self.query.key_expr)

    @property
    def parameters(self) -> dict[str, str]:
        """What stands after the ``?`` of the selector."""
        # Zenoh's stubs do not declare that parameters can be iterated over.
        return dict(cast("Iterable[tuple[str, str]]", self.query.parameters))

    def answer(self, answers: Sequence[Answer]) -> bool:
        """Reply with these values; none: the `get` ends without a reply. False: it had ended."""
        return self._handler.finish(self, lambda query: _reply(query, answers))

    def answer_json(self, key: str, document: object) -> bool:
        """Reply with one document as JSON. False: it had ended."""
        payload = msgspec.json.encode(document)
        return self.answer([Answer(key=key, payload=payload, encoding=JSON)])

    def refuse(self, failure: CallFailure, text: str) -> bool:
        """Reply with an error. False: it had ended."""
        return self._handler.finish(self, lambda query: _refuse(query, failure, text))


Serve = Callable[[HeldQuery], None]
"""Serves a query on the loop."""


class QueryHandler:
    """Brings queries from Zenoh's threads to the loop, and answers back.

    Args:
        worker: Sends the replies.
        ring: Wakes the loop, which then calls `serve`.
        limit: Most unanswered queries held at once.
        closed_text: Error text for callers whose queries `close` refuses.
    """

    def __init__(
        self, worker: Worker, ring: Callable[[], None], *, limit: int, closed_text: str
    ) -> None:
        self.refused = 0
        """Queries refused because too many were held."""
        self._worker = worker
        self._ring = ring
        self._limit = limit
        self._closed_text = closed_text
        self._guard = threading.Lock()
        self._held: set[HeldQuery] = set()
        self._sending = 0
        self._waiting: deque[tuple[HeldQuery, Serve]] = deque()
        self._is_closed = False

    def admit(self, serve: Serve, query: zenoh.Query) -> None:
        """Take a query; on Zenoh's thread.

        Args:
            serve: Serves the query on the loop.
            query: The query.
        """
        held = HeldQuery(query, self)
        with self._guard:
            is_full = len(self._held) + self._sending >= self._limit
            is_closed = self._is_closed
            if not is_full and not is_closed:
                self._held.add(held)
                self._waiting.append((held, serve))
            elif is_full:
                self.refused += 1
        if not is_full and not is_closed:
            self._ring()
            return
        text = self._closed_text if is_closed else f"{self._limit} queries are held already"
        _send(query, lambda query: _refuse(query, CallFailure.NO_SERVER, text))

    def serve(self) -> None:
        """Serve the queries that have arrived; on the loop."""
        with self._guard:
            taken = tuple(self._waiting)
            self._waiting.clear()
        for held, serve in taken:
            serve(held)

    def finish(self, held: HeldQuery, reply: Callable[[zenoh.Query], None]) -> bool:
        """Send the answer to a query, unless it has one; called by `HeldQuery`."""
        with self._guard:
            if held not in self._held:
                return False
            self._held.discard(held)
            self._sending += 1

        def send() -> None:
            try:
                _send(held.query, reply)
            finally:
                with self._guard:
                    self._sending -= 1

        self._worker.submit(send)
        return True

    def close(self) -> None:
        """Refuse held queries and all later ones."""
        with self._guard:
            self._is_closed = True
            held = list(self._held)
            waiting = {each for each, _ in self._waiting}
            self._waiting.clear()
        for each in held:
            # A service that has begun may have had its effect.
            failure = CallFailure.NO_SERVER if each in waiting else CallFailure.UNKNOWN
            each.refuse(failure, self._closed_text)

    def __len__(self) -> int:
        with self._guard:
            return len(self._held)


def _send(query: zenoh.Query, reply: Callable[[zenoh.Query], None]) -> None:
    try:
        with query:
            reply(query)
    except zenoh.ZError as error:
        _logger.debug("no reply to a query: %s", error)


def _reply(query: zenoh.Query, answers: Sequence[Answer]) -> None:
    for answer in answers:
        query.reply(
            answer.key, answer.payload, encoding=answer.encoding, attachment=answer.attachment
        )


def _refuse(query: zenoh.Query, failure: CallFailure, text: str) -> None:
    reason = error_text(str(query.key_expr), failure, text)
    query.reply_err(reason.encode(), encoding=ERROR_ENCODING)
