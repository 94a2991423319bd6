"""An open Zenoh session: opened off the loop, with errors of one line, and closed completely.

Every put has the destination REMOTE: this session does not receive it. Nothing blocks the loop: a
put on a full connection is dropped, and the `Worker` does everything else.
"""

import json
import logging
import re
import threading
import time
from collections.abc import Callable, Sequence
from typing import Final, TypeVar

import zenoh

from zacoustic.core.base.qos import Priority
from zacoustic.errors import ConfigError, SessionError
from zacoustic.zenoh.session.worker import Worker

T = TypeVar("T")

CLOSE_LIMIT_S: Final = 10.0
"""Time limit of closing, s; a session on a healthy network needs some milliseconds."""
CALLBACKS_LIMIT_S: Final = 2.0
"""Time for the threads of callbacks to end after the session, s."""

WORDS: Final = {
    False: "the Zenoh router is gone; nothing comes or goes until it is back",
    True: "the Zenoh router is back",
}
"""Log messages when the connection is lost, and when it is back."""

HERE: Final = {"router": ("tcp/127.0.0.1:7447",), "peer": ("tcp/127.0.0.1:0",)}
"""Default endpoints at which a session listens, by mode."""
_ZENOH_LISTENS: Final = {"router": ["tcp/[::]:7447"], "peer": ["tcp/[::]:0"]}

_ENDPOINT: Final = re.compile(r"bound to (\S+): ")
_ENDPOINTS: Final = re.compile(r"Single\(([^)]*)\)")
_PROTOCOL: Final = re.compile(r"not supported for (\S+) protocol")
_NOISE: Final = re.compile(r" at \S+\.rs:\d+\.?| \(os error \d+\)")

_logger = logging.getLogger(__name__)


class ZenohSession:
    """An open session and its worker; created by `open`.

    Args:
        session: The session.
        worker: Runs calls that may block; ends with the session.
        mode: router, peer or client.
    """

    def __init__(self, session: zenoh.Session, worker: Worker, mode: str) -> None:
        self.session = session
        self.worker = worker
        self.mode = mode
        self.lost = 0
        """Puts that the session refused."""
        self._callbacks = 0
        self._ending: list[threading.Thread] = []
        self._changed = threading.Condition()
        self._transports = 0

    @classmethod
    async def open(cls, config: zenoh.Config) -> "ZenohSession":
        """Open a session in the mode of the config.

        Raises:
            SessionError: A port is in use, no router can be reached, or Zenoh reports another
                error.
        """
        worker = Worker("zenoh")

        def begin() -> ZenohSession:
            zenoh_session = cls(zenoh.open(config), worker, mode_of(config))
            worker.end_with(zenoh_session._close)
            return zenoh_session

        try:
            return await worker.run(begin)
        except zenoh.ZError as error:
            await worker.close(limit_s=CLOSE_LIMIT_S)
            raise explain(error, endpoints_of(config, "connect")) from error
        except BaseException:
            # Opening goes on in its thread and cannot be stopped; the worker then closes a session
            # that it opens.
            worker.end()
            raise

    def callback(
        self, function: Callable[[T], None], end: Callable[[], None] | None = None
    ) -> "zenoh.handlers.Callback[T]":
        """Make a callback for Zenoh; `close` waits for its end.

        Zenoh calls it on a thread that ends some time after the session. If that thread returns to
        an ending interpreter, the process aborts and loses its own exit code.

        Pass it to Zenoh at once, together with a key that is already a `zenoh.KeyExpr`: with
        another key Zenoh may raise before it takes the callback, and would then never drop it.

        Args:
            function: Receives arrivals, on a thread of Zenoh.
            end: Called there after the last arrival.
        """

        def drop() -> None:
            if end is not None:
                end()
            with self._changed:
                self._callbacks -= 1
                self._ending = [thread for thread in self._ending if thread.is_alive()]
                self._ending.append(threading.current_thread())
                self._changed.notify_all()

        with self._changed:
            self._callbacks += 1
        return zenoh.handlers.Callback(function, drop)

    def watch(self, tell: Callable[[bool], None]) -> None:
        """Watch the connection.

        Args:
            tell: Called on a thread of Zenoh when the connection is lost or back, first when it is
                established.
        """

        def note(event: zenoh.TransportEvent) -> None:
            before = self._transports
            self._transports += 1 if event.kind == zenoh.SampleKind.PUT else -1
            if bool(before) != bool(self._transports):
                tell(bool(self._transports))

        self.session.info.declare_transport_events_listener(self.callback(note), history=True)

    def put(
        self,
        key: str,
        payload: bytes,
        *,
        encoding: str,
        priority: Priority,
        attachment: bytes | None = None,
    ) -> None:
        """Put a sample; on the loop."""
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
        """Delete a key; on the loop."""
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
        """Close the session after all steps, off the loop; give up after `CLOSE_LIMIT_S`."""
        if not await self.worker.close(limit_s=CLOSE_LIMIT_S):
            _logger.warning("the Zenoh session does not close within %g s", CLOSE_LIMIT_S)

    def _close(self) -> None:
        """Close the session and wait for its threads; in the worker, unless that has ended."""
        self.session.close()  # type: ignore[no-untyped-call]
        until_s = time.monotonic() + CALLBACKS_LIMIT_S
        with self._changed:
            self._changed.wait_for(lambda: self._callbacks == 0, CALLBACKS_LIMIT_S)
            ending = self._ending
        # They have dropped their callbacks and will end soon.
        for thread in ending:
            thread.join(max(until_s - time.monotonic(), 0))

    def _lose(self, key: str, error: zenoh.ZError) -> None:
        self.lost += 1
        _logger.debug("%s: not put: %s", key, error)


def zenoh_priority(priority: Priority) -> zenoh.Priority:
    """Return Zenoh's constant with the same number."""
    return _PRIORITIES[priority]


def mode_of(config: zenoh.Config) -> str:
    """Return the mode: router, peer or client."""
    return str(_setting(config, "mode") or "peer")


def endpoints_of(config: zenoh.Config, word: str) -> tuple[str, ...]:
    """Return the endpoints that a session with this config listens at or connects to.

    Args:
        config: The settings.
        word: ``listen`` or ``connect``.
    """
    endpoints = _setting(config, f"{word}/endpoints")
    if isinstance(endpoints, dict):
        endpoints = endpoints.get(mode_of(config))
    return tuple(endpoints) if isinstance(endpoints, list) else ()


def listen_at(config: zenoh.Config, endpoints: Sequence[str]) -> None:
    """Make a session with this config listen at other endpoints.

    Args:
        config: The settings; changed.
        endpoints: Endpoints that replace those of the config.

    Raises:
            ConfigError: Zenoh does not accept such an endpoint.
    """
    try:
        config.insert_json5("listen/endpoints", json.dumps(list(endpoints)))
    except zenoh.ZError as error:
        raise ConfigError(
            f"listen: {', '.join(endpoints)}; allowed: Zenoh endpoints, such as tcp/127.0.0.1:7447"
        ) from error


def listen_here(config: zenoh.Config) -> bool:
    """If the file has no `listen`, make the session listen on this computer only.

    Zenoh's own default is all networks of the computer.

    Args:
        config: The settings; changed.

    Returns:
        Whether that applied: the file has no `listen`, and the session listens.
    """
    if _setting(config, "listen/endpoints") != _ZENOH_LISTENS:
        return False
    endpoints = HERE.get(mode_of(config))
    if endpoints is None:
        return False
    listen_at(config, endpoints)
    return True


def explain(error: zenoh.ZError, endpoints: Sequence[str] = ()) -> SessionError:
    """Return an error of opening as one line with its meaning and advice.

    Args:
        error: The error of Zenoh.
        endpoints: Endpoints to which the session should connect; not all errors name them.
    """
    text = one_line(error)
    endpoint = found[1] if (found := _ENDPOINT.search(text)) else ""
    if endpoint:
        reason = text.rpartition(f"{endpoint}: ")[2].strip("[]. ").rpartition(": ")[2].strip("]. ")
        hint = _LISTEN_HINTS.get(reason, "correct listen.endpoints")
        return SessionError(f"cannot listen on {endpoint}: {reason}", hint=hint)
    if text.startswith(("Unable to connect", "Timeout")):
        where = ", ".join(_ENDPOINTS.findall(text) or endpoints) or "the endpoints of the config"
        return SessionError(
            f"no Zenoh router at {where}",
            hint="start it, or correct the endpoint; connect: { timeout_ms: -1 } in the file waits",
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


def one_line(error: zenoh.ZError) -> str:
    """Return Zenoh's message, without locations in its source code."""
    return " ".join(_NOISE.sub("", str(error)).split())


def _setting(config: zenoh.Config, key: str) -> object:
    try:
        return json.loads(config.get_json(key))
    except zenoh.ZError:  # not set
        return None


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
