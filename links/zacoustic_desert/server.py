"""The sockets of the stand-in: one port for each node, one client at a time on each.

`open` binds a port, so that it has its number, and the port refuses connections until `listen`, as
DESERT does at its start. While one client is served, only the kernel accepts others, as many as the
backlog holds, and they are deaf; the next is served when the first has left. `crash` ends all
connections and refuses again.

Everything runs on the loop. `time_scale` makes the whole of DESERT run faster.
"""

import asyncio
import logging
import os
import socket
import time
from collections.abc import Sequence
from typing import Final, cast

from zacoustic.core.clock import Clock
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link.alarm import Alarm
from zacoustic.link.serving import ScaledClock, cannot_listen, place_name
from zacoustic_desert.standin import StandIn

BACKLOG: Final = 1
"""DESERT's own; the kernel adds one."""
UNREAD_LIMIT_BYTES: Final = 1_048_576
"""Bytes that a client may leave unread before it is dropped: hours of sound."""

_logger = logging.getLogger(__name__)


class StandInServer:
    """Serves a stand-in on TCP ports.

    Args:
        standin: The stand-in behind the sockets; no other caller may step it from now on.
        host: Address to listen at; DESERT listens at all of them.
        ports: One for each node, 0 for any free one; None: any for all.
        time_scale: How many times faster than real time, > 0.
        clock: Source of instants.

    Raises:
        ConfigError: Not one port for each node, or the time scale is not above 0.
    """

    def __init__(
        self,
        standin: StandIn,
        *,
        host: str = "127.0.0.1",
        ports: Sequence[int] | None = None,
        time_scale: float = 1.0,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        wanted = tuple(ports) if ports is not None else (0,) * standin.nodes
        if len(wanted) != standin.nodes:
            raise ConfigError(f"{len(wanted)} ports for {standin.nodes} nodes")
        self.standin = standin
        self._host = host
        self._clock = ScaledClock(time_scale, clock)
        self._ports = [_Port(self, node, port) for node, port in enumerate(wanted)]
        self._alarm = Alarm(self._clock.now, self._expire, time_scale=time_scale)
        self._start: asyncio.TimerHandle | None = None

    @property
    def addresses(self) -> tuple[str, ...]:
        """`HOST:PORT` of each node, valid after `open`."""
        return tuple(place_name(self._host, port.number) for port in self._ports)

    async def open(self, *, start_delay_s: float | None = 0.0) -> None:
        """Bind the ports, and listen after a delay.

        Args:
            start_delay_s: Delay in the stand-in's time, s; None: the caller calls `listen`.

        Raises:
            LinkOpenError: A port cannot be bound, for example because it is in use.
        """
        try:
            for port in self._ports:
                port.bind(self._host)
        except LinkOpenError:
            await self.close()
            raise
        if start_delay_s == 0.0:
            self.listen()
        elif start_delay_s is not None:
            loop = asyncio.get_running_loop()
            self._start = loop.call_later(start_delay_s / self._clock.time_scale, self.listen)

    def listen(self) -> None:
        """Accept clients from now on."""
        for port in self._ports:
            port.listen()

    async def crash(self) -> None:
        """Crash as DESERT does under load: end connections, refuse new ones, forget everything."""
        await self._end()
        self.standin.handle_crash(self.now())
        self._serve()
        for port in self._ports:
            port.bind(self._host)

    async def close(self) -> None:
        """Release everything; may be called again."""
        if self._start is not None:
            self._start.cancel()
            self._start = None
        await self._end()
        self._alarm.stop()

    def now(self) -> int:
        """Instant of the stand-in, ns since the server was made."""
        return self._clock.now()

    def client_came(self, node: int) -> None:
        """Pass the event to the stand-in; called by a connection."""
        self.standin.handle_client(node, self.now())
        self._serve()

    def client_wrote(self, node: int, data: bytes) -> None:
        """Pass the bytes to the stand-in; called by a connection."""
        self.standin.handle_write(node, data, self.now())
        self._serve()

    def client_left(self, node: int) -> None:
        """Pass the event to the stand-in; called by a connection."""
        self.standin.handle_client_left(node, self.now())
        self._serve()

    async def _end(self) -> None:
        for port in self._ports:
            await port.close()

    def _expire(self, due_at: int) -> None:
        self.standin.handle_timeout(max(self.now(), due_at))
        self._serve()

    def _serve(self) -> None:
        """Write arrived bytes, then arm the timer."""
        while (delivery := self.standin.poll_delivery()) is not None:
            self._ports[delivery.node].write(delivery.payload)
        self._alarm.set(self.standin.poll_timeout())


class _Port:
    """The socket of one node."""

    def __init__(self, server: StandInServer, node: int, number: int) -> None:
        self.number = number
        self._server = server
        self._node = node
        self._listener: socket.socket | None = None
        self._task: asyncio.Task[None] | None = None
        self._client: _Client | None = None

    def bind(self, host: str) -> None:
        """Bind the port; it refuses connections until `listen`."""
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            listener.setblocking(False)
            if os.name == "posix":  # on Windows this would take a port of another program
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((host, self.number))
        except OSError as error:
            listener.close()
            rival = "DESERT or another stand-in"
            raise cannot_listen(host, self.number, error, rival=rival) from error
        self.number = listener.getsockname()[1]
        self._listener = listener

    def listen(self) -> None:
        assert self._listener is not None
        self._listener.listen(BACKLOG)
        self._task = asyncio.get_running_loop().create_task(
            self._accept(self._listener), name=f"stand-in port {self.number}"
        )

    def write(self, payload: bytes) -> None:
        if self._client is not None:
            self._client.write(payload)

    async def close(self) -> None:
        """End the connection and release the port."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.wait([task])
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    async def _accept(self, listener: socket.socket) -> None:
        """Serve one client after the other."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, _ = await loop.sock_accept(listener)
            except OSError as error:
                _logger.warning("port %d accepts nobody any more: %s", self.number, error)
                return
            client = _Client(self._server, self._node)
            try:
                await loop.connect_accepted_socket(client.itself, accepted)
                self._client = client
                await client.gone.wait()
            finally:
                self._client = None
                await client.end()


class _Client(asyncio.Protocol):
    """The client being served on a port."""

    def __init__(self, server: StandInServer, node: int) -> None:
        self.gone = asyncio.Event()
        self._server = server
        self._node = node
        self._transport: asyncio.Transport | None = None

    def itself(self) -> "_Client":
        """Return itself: the factory of one connection."""
        return self

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport = cast("asyncio.Transport", transport)  # that of uvloop is no subclass
        self._transport = transport
        self._server.client_came(self._node)

    def data_received(self, data: bytes) -> None:
        self._server.client_wrote(self._node, data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._server.client_left(self._node)
        self.gone.set()

    def write(self, payload: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > UNREAD_LIMIT_BYTES:
            _logger.warning("node %d: the client does not read; dropped", self._node)
            self._transport.abort()
            return
        self._transport.write(payload)

    async def end(self) -> None:
        """End the connection and drop its unwritten bytes."""
        if self._transport is not None:
            self._transport.abort()
            await self.gone.wait()
