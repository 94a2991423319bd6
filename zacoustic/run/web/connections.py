"""Limits for visitors: how many connections they hold, how long, and how much they send.

uvicorn has no limit for connections that never complete a request, nor for those of one peer. A
thousand of them take all descriptors of the process, those of its modem included. So where there
are too many, the one that has kept the server waiting longest is dropped for the newcomer: the
visitor who sends a request is served, even if he shares his address with those who do not.
"""

import asyncio
import functools
import socket
from collections.abc import Iterable
from typing import Any, Final

import h11
import msgspec
from uvicorn.protocols.http.h11_impl import H11Protocol

WATCH_S: Final = 2.0
"""How often a connection is looked at, s."""


QUEUE: Final = 1024
"""Connections that the system holds until the loop takes them."""

_LOOKS: Final = 5
"""How often a connection is looked at, in the time for a request."""


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """What visitors may take, of one server."""

    connections: int = 256
    """Connections in all."""
    per_peer: int = 128
    """Connections from one address."""
    header_bytes: int = 16 * 1024
    """Size of a request without its body, bytes; in one piece of the network more."""
    request_s: float = 10.0
    """Time to complete a request, body included, s; also to begin one."""
    stall_s: float = 20.0
    """Time in which a visitor must read something of what waits for him, s."""
    message_bytes: int = 2**20
    """Size of a message on a WebSocket, bytes."""


class Connections:
    """The connections of one server.

    Args:
        limits: What visitors may take.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._by_peer: dict[str, dict[Connection, None]] = {}
        self._count = 0

    def admit(self, connection: "Connection") -> None:
        """Count a new connection; drop one if there are too many now, perhaps this one."""
        self._by_peer.setdefault(connection.peer, {})[connection] = None
        self._count += 1
        of_peer = self._by_peer[connection.peer]
        if len(of_peer) > self.limits.per_peer:
            self._drop_one([of_peer], connection)
        elif self._count > self.limits.connections:
            self._drop_one(sorted(self._by_peer.values(), key=len)[::-1], connection)

    def leave(self, connection: "Connection") -> None:
        """Forget a connection that has ended; may be called again."""
        of_peer = self._by_peer.get(connection.peer, {})
        if connection in of_peer:
            del of_peer[connection]
            self._count -= 1
            if not of_peer:
                del self._by_peer[connection.peer]

    def _drop_one(self, peers: Iterable[dict["Connection", None]], newest: "Connection") -> None:
        """Drop the oldest one that waits for its visitor; the newest if there is none."""
        waiting = (each for peer in peers for each in peer if each.is_waiting)
        next((each for each in waiting if not each.has_request), newest).drop()


class Connection(H11Protocol):
    """A connection of uvicorn that keeps to limits.

    Args:
        connections: Those of its server.
        arguments: Of uvicorn.
    """

    def __init__(self, connections: Connections, **arguments: Any) -> None:  # noqa: ANN401
        super().__init__(**arguments)
        self._connections = connections
        self._limits = connections.limits
        self._waiting_since: float | None = None
        self._unread = 0
        self._unread_since = 0.0
        self._watching: asyncio.TimerHandle | None = None
        self.peer = ""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin; there may be too many."""
        super().connection_made(transport)
        address = transport.get_extra_info("peername")
        self.peer = str(address[0]) if address else ""
        self._look()
        self._connections.admit(self)

    def data_received(self, data: bytes) -> None:
        """Take a part of a request."""
        super().data_received(data)
        self._note_waiting()

    def connection_lost(self, exc: Exception | None) -> None:
        """End."""
        self._end()
        super().connection_lost(exc)

    @property
    def is_waiting(self) -> bool:
        """Whether the visitor has to ask: he has read all, and no request of his is complete."""
        is_asked = self._is_upgraded or self.conn.their_state not in (h11.IDLE, h11.SEND_BODY)
        return not is_asked and not self.transport.get_write_buffer_size()

    @property
    def has_request(self) -> bool:
        """Whether a request has come that nobody has read yet: the loop may be busy."""
        try:
            with self.transport.get_extra_info("socket").dup() as copy:
                begun: bytes = copy.recv(self._limits.header_bytes, socket.MSG_PEEK)
        except OSError:  # nothing has come, or it has ended
            return False
        return b"\r\n\r\n" in begun

    def drop(self) -> None:
        """End the connection at once."""
        self._end()
        self.transport.abort()

    @property
    def _is_upgraded(self) -> bool:
        # Uvicorn exchanges the protocol for that of WebSockets, and this one hears nothing more.
        return self.transport.get_protocol() is not self

    def _note_waiting(self) -> None:
        if not self.is_waiting:
            self._waiting_since = None
        elif self._waiting_since is None:
            self._waiting_since = self.loop.time()

    def _look(self) -> None:
        """Look whether the visitor goes on."""
        now = self.loop.time()
        self._note_waiting()
        unread = self.transport.get_write_buffer_size()
        if unread == 0 or unread != self._unread:
            self._unread, self._unread_since = unread, now
        waited_s = 0.0 if self._waiting_since is None else now - self._waiting_since
        if waited_s >= self._limits.request_s or now - self._unread_since >= self._limits.stall_s:
            self.drop()
        elif self._is_upgraded and self.transport.is_closing() and not unread:
            self._end()
        else:
            self._watching = self.loop.call_later(self._limits.request_s / _LOOKS, self._look)

    def _end(self) -> None:
        self._connections.leave(self)
        if self._watching is not None:
            self._watching.cancel()
            self._watching = None


def uvicorn_options(limits: Limits | None = None) -> dict[str, Any]:
    """Return the arguments of uvicorn for a server with these limits."""
    limits = limits or Limits()
    return {
        "http": functools.partial(Connection, Connections(limits)),
        "h11_max_incomplete_event_size": limits.header_bytes,
        "ws_max_size": limits.message_bytes,
        # So many come in one turn of the loop, and have descriptors before they are counted.
        "backlog": limits.connections,
        "proxy_headers": False,
        "access_log": False,
    }


def lengthen_queue(server: asyncio.AbstractServer) -> None:
    """Let the system hold more connections than the loop takes in one turn.

    Where it holds too few, visitors try again after a second.
    """
    for each in server.sockets:  # type: ignore[attr-defined]
        with each.dup() as copy:
            copy.listen(QUEUE)
