"""The Zenoh session of a gateway: opened off the loop, its errors in one line, closed in time.

Everything that is put here has the destination REMOTE: the own session does not hear it. From the
loop nothing ever blocks: puts are dropped on a full connection, everything else is done by the
`Worker`.
"""

import asyncio
import json
import logging
import re
import threading
from collections.abc import Callable
from typing import Final, Self, TypeVar

import zenoh

from zacoustic.core.qos import Priority
from zacoustic.errors import SessionError
from zacoustic.gateway.worker import Worker

T = TypeVar("T")

CLOSE_LIMIT_S: Final = 10.0
"""How long closing may take, s; a session on a healthy network needs some milliseconds."""
CALLBACKS_LIMIT_S: Final = 2.0
"""How long the threads of callbacks may take to end behind the session, s."""

_ENDPOINT: Final = re.compile(r"bound to (\S+): ")
_ENDPOINTS: Final = re.compile(r"Single\(([^)]*)\)")
_PROTOCOL: Final = re.compile(r"not supported for (\S+) protocol")
_NOISE: Final = re.compile(r" at \S+\.rs:\d+\.?| \(os error \d+\)")

_logger = logging.getLogger(__name__)


class Island:
    """An open session and its worker; made by `open`.

    Args:
        session: The session.
        worker: Where what may block is done.
    """

    def __init__(self, session: zenoh.Session, worker: Worker) -> None:
        self.session = session
        self.worker = worker
        self.lost = 0
        """Puts that the session refused."""
        self._callbacks = 0
        self._callbacks_changed = threading.Condition()

    @classmethod
    async def open(cls, config: zenoh.Config) -> Self:
        """Open a session in the mode of the config.

        Raises:
            SessionError: A port is in use, no router is reached, or anything else that Zenoh says.
        """
        worker = Worker("zenoh")
        opened: list[zenoh.Session] = []
        try:
            await worker.run(lambda: opened.append(zenoh.open(config)))
        except zenoh.ZError as error:
            await worker.close(limit_s=CLOSE_LIMIT_S)
            raise explain(error) from error
        except asyncio.CancelledError:
            # Opening goes on in its thread and cannot be stopped: the session is closed when it is
            # there.
            worker.submit(lambda: _close(opened[0]) if opened else None)
            worker.end()
            raise
        return cls(opened[0], worker)

    def callback(
        self, function: Callable[[T], None], end: Callable[[], None] | None = None
    ) -> "zenoh.handlers.Callback[T]":
        """Make a callback for Zenoh, which `close` waits for.

        Zenoh calls it on a thread that ends some time after the session. A thread that comes back
        to an interpreter which is ending kills the process, with an abort instead of its exit code.

        Args:
            function: Takes what arrives, on a thread of Zenoh's.
            end: Called there when nothing arrives any more.
        """

        def drop() -> None:
            if end is not None:
                end()
            with self._callbacks_changed:
                self._callbacks -= 1
                self._callbacks_changed.notify_all()

        with self._callbacks_changed:
            self._callbacks += 1
        return zenoh.handlers.Callback(function, drop)

    def put(
        self,
        key: str,
        payload: bytes,
        *,
        encoding: str,
        priority: Priority,
        attachment: bytes | None = None,
    ) -> None:
        """Put a sample on the island; on the loop."""
        try:
            self.session.put(
                key,
                payload,
                encoding=encoding,
                priority=zenoh_priority(priority),
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
                attachment=attachment,
            )
        except zenoh.ZError as error:
            self._lose(key, error)

    def delete(self, key: str, *, priority: Priority, attachment: bytes) -> None:
        """Delete a key on the island; on the loop."""
        try:
            self.session.delete(
                key,
                priority=zenoh_priority(priority),
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
                attachment=attachment,
            )
        except zenoh.ZError as error:
            self._lose(key, error)

    async def close(self) -> None:
        """Close the session, off the loop; gives up after `CLOSE_LIMIT_S`."""
        try:
            await self.worker.run(self._close, limit_s=CLOSE_LIMIT_S)
        except TimeoutError:
            _logger.warning("the Zenoh session does not close within %g s", CLOSE_LIMIT_S)
        await self.worker.close(limit_s=CLOSE_LIMIT_S)

    def _close(self) -> None:
        _close(self.session)
        with self._callbacks_changed:
            self._callbacks_changed.wait_for(lambda: self._callbacks == 0, CALLBACKS_LIMIT_S)

    def _lose(self, key: str, error: zenoh.ZError) -> None:
        self.lost += 1
        _logger.debug("%s: not put: %s", key, error)


def zenoh_priority(priority: Priority) -> zenoh.Priority:
    """Return Zenoh's own constant: the numbers are the same."""
    return _PRIORITIES[priority]


def mode_of(config: zenoh.Config) -> str:
    """Return the mode: router, peer or client."""
    return str(_setting(config, "mode") or "peer")


def endpoints_of(config: zenoh.Config) -> tuple[str, ...]:
    """Return where a session of that config listens and what it connects to, for people."""
    mode = mode_of(config)
    found: list[str] = []
    for word in ("listen", "connect"):
        endpoints = _setting(config, f"{word}/endpoints")
        if isinstance(endpoints, dict):
            endpoints = endpoints.get(mode)
        if isinstance(endpoints, list):
            found += [f"{word} {endpoint}" for endpoint in endpoints]
    return tuple(found)


def explain(error: zenoh.ZError) -> SessionError:
    """Say in one line what an error of opening means, and what to do."""
    text = " ".join(_NOISE.sub("", str(error)).split())
    endpoint = found[1] if (found := _ENDPOINT.search(text)) else ""
    if endpoint:
        reason = text.rpartition(f"{endpoint}: ")[2].strip("[]. ").rpartition(": ")[2].strip("]. ")
        hint = _LISTEN_HINTS.get(reason, "correct listen.endpoints")
        return SessionError(f"cannot listen on {endpoint}: {reason}", hint=hint)
    if text.startswith("Unable to connect"):
        endpoints = ", ".join(_ENDPOINTS.findall(text)) or "the endpoints of the config"
        return SessionError(
            f"no Zenoh router at {endpoints}",
            hint="start it, or correct connect.endpoints; connect: { timeout_ms: -1 } waits for it",
        )
    if text.startswith("No peer specified"):
        return SessionError(
            "mode client without a router: connect.endpoints is empty and scouting is off",
            hint='set connect: { endpoints: ["tcp/HOST:7447"] }',
        )
    if found := _PROTOCOL.search(text):
        return SessionError(
            f"this build of Zenoh has no {found[1]} connections",
            hint="tcp, udp, tls, quic, ws and unixsock-stream are there",
        )
    return SessionError(f"Zenoh does not open a session: {text.strip('. ')}")


def _setting(config: zenoh.Config, key: str) -> object:
    try:
        return json.loads(config.get_json(key))
    except zenoh.ZError:  # not set
        return None


def _close(session: zenoh.Session) -> None:
    session.close()  # type: ignore[no-untyped-call]


_LISTEN_HINTS: Final = {
    "Address already in use": "another router runs there: stop it, connect to it in mode client, "
    "or change listen.endpoints",
    "Cannot assign requested address": "this computer has no such address: change listen.endpoints",
    "Permission denied": "ports below 1024 need privileges: change listen.endpoints",
}

_PRIORITIES: Final = {
    Priority.REAL_TIME: zenoh.Priority.REAL_TIME,
    Priority.INTERACTIVE_HIGH: zenoh.Priority.INTERACTIVE_HIGH,
    Priority.INTERACTIVE_LOW: zenoh.Priority.INTERACTIVE_LOW,
    Priority.DATA_HIGH: zenoh.Priority.DATA_HIGH,
    Priority.DATA: zenoh.Priority.DATA,
    Priority.DATA_LOW: zenoh.Priority.DATA_LOW,
    Priority.BACKGROUND: zenoh.Priority.BACKGROUND,
}
