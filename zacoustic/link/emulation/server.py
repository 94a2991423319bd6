"""Emulated modems for other programs: TCP ports and pseudo-terminals.

A TCP port accepts several clients; each is a port of the modem with its own options. During a
restart of the modem nobody listens there. A pseudo-terminal is one serial line, and is silent
meanwhile; it accepts any baud rate of the client, unless one is given, and is not slowed by it.

A client that does not read loses its TCP connection at `BACKLOG_LIMIT_BYTES`; a line without
handshake loses unread bytes.
"""

import asyncio
import contextlib
import logging
import os
import socket
import sys
from typing import Final, cast

import msgspec

from zacoustic.errors import LinkOpenError
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.serving import cannot_listen, place_name

BACKLOG_LIMIT_BYTES: Final = 1_048_576
"""Bytes that may wait for a TCP client."""

_READ_BYTES: Final = 65_536
_LISTEN_AGAIN_S: Final = 0.2
_OUTPUT_SPEED: Final = 5
"""Index of the output speed in the result of `tcgetattr`."""

_logger = logging.getLogger(__name__)


class Place(msgspec.Struct, frozen=True):
    """The place of a modem."""

    address: int
    """Address of the modem."""
    locator: str
    """`tcp:HOST:PORT` or `serial:PATH`, as for a byte stream."""


class EmulationServer:
    """Serves the modems of an emulation.

    Args:
        running: The emulation; closed with the server.
    """

    def __init__(self, running: RunningEmulation) -> None:
        self.running = running
        self._listeners: dict[int, list[_Listener]] = {}
        self._terminals: list[_Terminal] = []
        running.changed = self._change

    async def listen(self, address: int, host: str, port: int) -> Place:
        """Serve a modem on a TCP port; 0 takes any free one.

        Raises:
            LinkOpenError: The address cannot be used.
        """
        listener = _Listener(self.running, address, host, port)
        await listener.open()
        self._listeners.setdefault(address, []).append(listener)
        return Place(address, f"tcp:{listener.name}")

    def open_terminal(self, address: int, *, baudrate: int | None = None) -> Place:
        """Serve a modem on a new pseudo-terminal.

        Args:
            address: Address of the modem.
            baudrate: Its rate; with another one both ends read nonsense. None: any.

        Raises:
            LinkOpenError: This system has no pseudo-terminals.
        """
        terminal = _Terminal(self.running, address, baudrate)
        self._terminals.append(terminal)
        return Place(address, f"serial:{terminal.path}")

    async def close(self) -> None:
        """Close all connections and stop the emulation; may be repeated."""
        self.running.changed = None
        listeners = [each for several in self._listeners.values() for each in several]
        self._listeners.clear()
        for listener in listeners:
            await listener.close()
        for terminal in self._terminals:
            terminal.close()
        self._terminals.clear()
        self.running.close()

    def _change(self, address: int, is_up: bool) -> None:
        for listener in self._listeners.get(address, []):
            if is_up:
                listener.resume()
            else:
                listener.pause()


class _Listener:
    """One TCP port of one modem."""

    def __init__(self, running: RunningEmulation, address: int, host: str, port: int) -> None:
        self._running = running
        self._address = address
        self._host = host
        self._port = port
        self._server: asyncio.Server | None = None
        self._resuming: asyncio.Task[None] | None = None
        self._clients: set[_Client] = set()

    @property
    def name(self) -> str:
        """`HOST:PORT` as clients write it."""
        return place_name(self._host, self._port)

    async def open(self) -> None:
        """Listen."""
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(
                lambda: _Client(self._running, self._address, self._clients),
                self._host,
                self._port,
                reuse_address=True,
            )
        except OSError as error:
            refused = cannot_listen(self._host, self._port, error, rival="another emulator")
            raise refused from error
        self._port = self._server.sockets[0].getsockname()[1]

    def pause(self) -> None:
        """Stop listening."""
        if self._server is not None:
            self._server.close()
            self._server = None

    def resume(self) -> None:
        """Listen again, soon."""
        if self._server is None and self._resuming is None:
            self._resuming = asyncio.get_running_loop().create_task(self._resume())

    async def close(self) -> None:
        """Close the connections of all clients."""
        if self._resuming is not None:
            self._resuming.cancel()
            await asyncio.wait([self._resuming])
        server = self._server
        self.pause()
        clients = tuple(self._clients)
        for client in clients:
            client.hang_up()
        for client in clients:
            await client.gone.wait()
        if server is not None:
            await server.wait_closed()

    async def _resume(self) -> None:
        while self._server is None:
            try:
                await self.open()
            except LinkOpenError as error:
                _logger.warning("modem %d: %s", self._address, error)
                await asyncio.sleep(_LISTEN_AGAIN_S)
        self._resuming = None


class _Client(asyncio.Protocol):
    """One connection."""

    def __init__(self, running: RunningEmulation, address: int, clients: "set[_Client]") -> None:
        self.gone = asyncio.Event()
        self._running = running
        self._address = address
        self._clients = clients
        self._port_id: int | None = None
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport = cast("asyncio.Transport", transport)  # that of uvloop is no subclass
        self._transport = transport
        self._clients.add(self)
        connected: socket.socket = transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            self._port_id = self._running.open_port(self._address, self)
        except ConnectionRefusedError:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        if self._port_id is not None:
            self._running.handle_bytes(self._port_id, data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._clients.discard(self)
        port_id, self._port_id = self._port_id, None
        if port_id is not None:
            self._running.close_port(port_id)
        self.gone.set()

    def bytes_said(self, content: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > BACKLOG_LIMIT_BYTES:
            _logger.warning("modem %d: a client is dropped, it does not read", self._address)
            self._transport.abort()
            return
        self._transport.write(content)

    def port_closed(self) -> None:
        if self._transport is not None:
            self._transport.close()

    def hang_up(self) -> None:
        """End the connection; unread bytes are lost."""
        if self._transport is not None:
            self._transport.abort()


class _Terminal:
    """One pseudo-terminal of one modem."""

    def __init__(self, running: RunningEmulation, address: int, baudrate: int | None) -> None:
        if sys.platform == "win32":
            raise LinkOpenError("there are no pseudo-terminals on Windows", hint="use TCP ports")
        import tty

        self._running = running
        self._loop = asyncio.get_running_loop()
        self._baudrate = baudrate
        # The client's side stays open here, so that clients may come and go.
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.path = os.ttyname(self._theirs)
        self._port_id = running.open_port(address, self, is_serial=True)
        self._loop.add_reader(self._ours, self._read)

    def bytes_said(self, content: bytes) -> None:
        content = self._on_the_line(content)
        with contextlib.suppress(BlockingIOError):
            written = os.write(self._ours, content)
            if written < len(content):
                _logger.debug("%s: nobody reads, bytes are lost", self.path)

    def port_closed(self) -> None:
        """Do nothing: a modem cannot close a serial line."""

    def close(self) -> None:
        self._loop.remove_reader(self._ours)
        self._running.close_port(self._port_id)
        os.close(self._ours)
        os.close(self._theirs)

    def _read(self) -> None:
        try:
            data = os.read(self._ours, _READ_BYTES)
        except OSError:
            return
        if data:
            self._running.handle_bytes(self._port_id, self._on_the_line(data))

    def _on_the_line(self, content: bytes) -> bytes:
        """Return the bytes that the other end reads: nonsense if the rates differ."""
        import termios

        if self._baudrate is None:
            return content
        speed = getattr(termios, f"B{self._baudrate}", None)
        if termios.tcgetattr(self._ours)[_OUTPUT_SPEED] == speed:
            return content
        # Wrong bits: no byte with a meaning here may come out.
        return bytes(0x80 | byte >> 1 for byte in content)
