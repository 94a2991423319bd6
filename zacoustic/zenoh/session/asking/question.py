"""A call to a local service: a `get`.

The first good reply is the answer; without one, the first error; without any reply there is no
server. Replies arrive on Zenoh's threads.
"""

import asyncio
import logging
import threading
from collections.abc import Callable
from functools import partial

import zenoh

from zacoustic.core.base.qos import Priority
from zacoustic.core.engine.events import CallFailure
from zacoustic.run.inbox import tell_loop
from zacoustic.zenoh.session.asking.replies import read_error
from zacoustic.zenoh.session.session import ZenohSession, zenoh_priority

_logger = logging.getLogger(__name__)


class Question:
    """One call, sent in the worker as soon as it is made; on the loop.

    Args:
        zenoh_session: The session.
        key: The service.
        take: Called once with this object, on the loop, when `good` or `error` holds the result.
        payload: The request.
        encoding: Its encoding.
        priority: Priority of the query.
        timeout_s: Time limit of Zenoh's, s.
        attachment: See `zacoustic.zenoh.session.marker`.
    """

    def __init__(
        self,
        zenoh_session: ZenohSession,
        key: str,
        take: Callable[["Question"], object],
        payload: bytes | None,
        *,
        encoding: str | None = None,
        priority: Priority,
        timeout_s: float,
        attachment: bytes | None = None,
    ) -> None:
        self.key = key
        self.good: tuple[bytes, str] | None = None
        """The answer and its encoding."""
        self.error: tuple[CallFailure, str] | None = None
        """Without an answer: how far the call got, and a text."""
        self._zenoh_session = zenoh_session
        self._take_on_loop = partial(tell_loop, asyncio.get_running_loop(), partial(take, self))
        self._cancellation = zenoh.CancellationToken()
        self._is_asked = False
        self._guard = threading.Lock()
        self._is_settled = False

        def ask() -> None:
            zenoh_session.session.get(
                zenoh.KeyExpr(key),
                zenoh_session.callback(self._take, self._end),
                payload=payload,
                encoding=encoding,
                attachment=attachment,
                timeout=timeout_s,
                # Deliver each reply at once: by default only the newest comes, at the end.
                consolidation=zenoh.ConsolidationMode.NONE,
                priority=zenoh_priority(priority),
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
                cancellation_token=self._cancellation,
            )

        zenoh_session.worker.submit(partial(self._ask, ask))

    def cancel(self) -> None:
        """Wait for replies no longer."""
        self._zenoh_session.worker.submit(self._cancel)

    # In the worker

    def _ask(self, ask: Callable[[], None]) -> None:
        """Send it; if that fails, settle it."""
        try:
            ask()
            self._is_asked = True
        except RuntimeError as error:  # the interpreter ends: Zenoh starts no thread for replies
            _logger.debug("%s is not called: %s", self.key, error)
        finally:
            if not self._is_asked:
                self._end()

    def _cancel(self) -> None:
        """Wait for a running callback; it would be for ever if the call could not be sent."""
        if self._is_asked:
            self._cancellation.cancel()  # type: ignore[no-untyped-call]

    # On Zenoh's threads

    def _take(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._finish((reply.ok.payload.to_bytes(), str(reply.ok.encoding)))
        elif reply.err is not None and self.error is None:
            payload, encoding = reply.err.payload.to_bytes(), str(reply.err.encoding)
            self.error = read_error(self.key, payload, encoding)

    def _end(self) -> None:
        self._finish(None)

    def _finish(self, good: tuple[bytes, str] | None) -> None:
        with self._guard:
            if self._is_settled:
                return
            self._is_settled = True
            self.good = good
        self._take_on_loop()
