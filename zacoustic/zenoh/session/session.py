"""An open Zenoh session: opened off the loop, its errors in one line, closed without remainder.

Everything that is put here has the destination REMOTE: the own session does not hear it. From the
loop nothing ever blocks: puts are dropped on a full connection, everything else is done by the
`Worker`.
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
"""How long closing may take, s; a session on a healthy network needs some milliseconds."""
CALLBACKS_LIMIT_S: Final = 2.0
"""How long the threads of callbacks may take to end behind the session, s."""

WORDS: Final = {
    False: "the Zenoh router is gone; nothing comes or goes until it is back",
    True: "the Zenoh router is back",
}
"""Messages for people when the connection goes, and when it comes again."""

HERE: Final = {"router": ("tcp/127.0.0.1:7447",), "peer": ("tcp/127.0.0.1:0",)}
"""Where a session listens by default, by its mode."""
_ZENOH_LISTENS: Final = {"router": ["tcp/[::]:7447"], "peer": ["tcp/[::]:0"]}

_ENDPOINT: Final = re.compile(r"bound to (\S+): ")
_ENDPOINTS: Final = re.compile(r"Single\(([^)]*)\)")
_PROTOCOL: Final = re.compile(r"not supported for (\S+) protocol")
_NOISE: Final = re.compile(r" at \S+\.rs:\d+\.?| \(os error \d+\)")

_logger = logging.getLogger(__name__)


class ZenohSession:
    """An open session and its worker; made by `open`.

    Args:
        session: The session.
        worker: Where what may block is done; ends with the session.
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
            SessionError: A port is in use, no router is reached, or another error of Zenoh.
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
            # Opening goes on in its thread and cannot be stopped: what it opens is closed there.
            worker.end()
            raise

    def callback(
        self, function: Callable[[T], None], end: Callable[[], None] | None = None
    ) -> "zenoh.handlers.Callback[T]":
        """Make a callback for Zenoh, which `close` waits for.

        Zenoh calls it on a thread that ends some time after the session. A thread that comes back
        to an interpreter which is ending kills the process, with an abort instead of its exit code.

        It must be given to Zenoh at once, together with a key that is a `zenoh.KeyExpr` already: of
        any other Zenoh may complain before it takes the callback, which it then never drops.

        Args:
            function: Takes what arrives, on a thread of Zenoh's.
            end: Called there when nothing arrives any more.
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
        """Have the connection watched.

        Args:
            tell: Told, on a thread of Zenoh's, whether there is any connection, when that changes;
                at first when there is one.
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
        """Close the session behind all steps, off the loop; gives up after `CLOSE_LIMIT_S`."""
        if not await self.worker.close(limit_s=CLOSE_LIMIT_S):
            _logger.warning("the Zenoh session does not close within %g s", CLOSE_LIMIT_S)

    def _close(self) -> None:
        """Close the session and see its threads off; in the worker, or where that is over."""
        self.session.close()  # type: ignore[no-untyped-call]
        until_s = time.monotonic() + CALLBACKS_LIMIT_S
        with self._changed:
            self._changed.wait_for(lambda: self._callbacks == 0, CALLBACKS_LIMIT_S)
            ending = self._ending
        # They have dropped their callbacks, and have a few steps to go.
        for thread in ending:
            thread.join(max(until_s - time.monotonic(), 0))

    def _lose(self, key: str, error: zenoh.ZError) -> None:
        self.lost += 1
        _logger.debug("%s: not put: %s", key, error)


def zenoh_priority(priority: Priority) -> zenoh.Priority:
    """Return Zenoh's own constant: the numbers are the same."""
    return _PRIORITIES[priority]


def mode_of(config: zenoh.Config) -> str:
    """Return the mode: router, peer or client."""
    return str(_setting(config, "mode") or "peer")


def endpoints_of(config: zenoh.Config, word: str) -> tuple[str, ...]:
    """Return where a session of that config listens or what it connects to.

    Args:
        config: The settings.
        word: ``listen`` or ``connect``.
    """
    endpoints = _setting(config, f"{word}/endpoints")
    if isinstance(endpoints, dict):
        endpoints = endpoints.get(mode_of(config))
    return tuple(endpoints) if isinstance(endpoints, list) else ()


def listen_at(config: zenoh.Config, endpoints: Sequence[str]) -> None:
    """Let a session of that config listen elsewhere.

    Args:
        config: The settings; changed.
        endpoints: Where, in place of those that are there.

    Raises:
        ConfigError: Zenoh knows no such endpoint.
    """
    try:
        config.insert_json5("listen/endpoints", json.dumps(list(endpoints)))
    except zenoh.ZError as error:
        raise ConfigError(
            f"listen: {', '.join(endpoints)}; allowed: Zenoh endpoints, such as tcp/127.0.0.1:7447"
        ) from error


def listen_here(config: zenoh.Config) -> bool:
    """Have a session without `listen` in its file listen on this computer only.

    Zenoh's own default is every network that the computer is in.

    Args:
        config: The settings; changed.

    Returns:
        Whether the file has no `listen`, and the session would listen.
    """
    if _setting(config, "listen/endpoints") != _ZENOH_LISTENS:
        return False
    endpoints = HERE.get(mode_of(config))
    if endpoints is None:
        return False
    listen_at(config, endpoints)
    return True


def explain(error: zenoh.ZError, endpoints: Sequence[str] = ()) -> SessionError:
    """Say in one line what an error of opening means, and what to do.

    Args:
        error: What Zenoh raised.
        endpoints: What the session was to connect to; not all errors name it.
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
    """Zenoh's message, without places in its source."""
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
