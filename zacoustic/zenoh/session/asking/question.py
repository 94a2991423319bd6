"""A call to a local service: a `get`.

The first good reply is the answer; without one, the first error; without any reply there is no
server. Replies arrive on Zenoh's threads.
"""

import threading
from collections.abc import Callable

import zenoh

from zacoustic.core.base.qos import Priority
from zacoustic.core.engine.events import CallFailure
from zacoustic.zenoh.session.asking.replies import read_error
from zacoustic.zenoh.session.session import ZenohSession, zenoh_priority


class Question:
    """One call; sent once, in the worker.

    Args:
        key: The service.
        settle: Called once with this object, on a thread of Zenoh's or in the worker, when `good`
            or `error` holds the result.
    """

    def __init__(self, key: str, settle: Callable[["Question"], None]) -> None:
        self.key = key
        self.good: tuple[bytes, str] | None = None
        """The answer and its encoding."""
        self.error: tuple[CallFailure, str] | None = None
        """Without an answer: how far the call got, and a text."""
        self._settle = settle
        self._cancellation = zenoh.CancellationToken()
        self._is_asked = False
        self._guard = threading.Lock()
        self._is_settled = False

    def ask(
        self,
        zenoh_session: ZenohSession,
        payload: bytes | None,
        *,
        encoding: str | None = None,
        parameters: str = "",
        priority: Priority,
        timeout_s: float,
        attachment: bytes | None = None,
    ) -> None:
        """Send it; in the worker.

        Raises:
            ZError: It cannot be sent; it is settled then.
            RuntimeError: The same, because the interpreter ends: it starts no thread for replies.
        """
        try:
            zenoh_session.session.get(
                zenoh.Selector(zenoh.KeyExpr(self.key), parameters or None),
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
            self._is_asked = True
        finally:
            if not self._is_asked:
                self._end()

    def cancel(self) -> None:
        """Stop to wait for replies; in the worker, because it waits for a running callback.

        It would wait for ever for the callback of a call that could not be sent.
        """
        if self._is_asked:
            self._cancellation.cancel()  # type: ignore[no-untyped-call]

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
        self._settle(self)
