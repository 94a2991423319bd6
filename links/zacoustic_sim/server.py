"""A medium for modems in other processes: TCP, one connection for each modem.

Clients are not trusted: an unreadable message, or a first one other than `Hello`, ends its
connection and nothing else. A client that does not read is dropped at `BACKLOG_LIMIT_BYTES`.
Connections before `Hello` are limited in number and in time.
"""

import asyncio
import logging
import socket
from typing import Final, cast

from zacoustic.errors import LinkOpenError
from zacoustic.link.serving import cannot_listen, place_name
from zacoustic_sim.medium import SimMedium
from zacoustic_sim.messages import (
    VERSION,
    ClientMessage,
    Hello,
    MalformedMessageError,
    MessageDecoder,
    Refused,
    ServerMessage,
    Transmit,
    encode_message,
)

BACKLOG_LIMIT_BYTES: Final = 1_048_576
"""Bytes that may wait for a client: hours of sound of any modem."""
STRANGERS_LIMIT: Final = 32
"""Most connections that have not sent `Hello`."""
HELLO_LIMIT_S: Final = 5.0
"""Time for a connection to send it, s."""

_logger = logging.getLogger(__name__)


class MediumServer:
    """Serves a medium on a TCP port.

    Args:
        medium: The medium; closed with the server.
        host: Address to listen at.
        port: Port; 0 for any free one.
    """

    def __init__(self, medium: SimMedium, host: str = "127.0.0.1", port: int = 0) -> None:
        self.medium = medium
        self.host = host
        self.port = port
        self._server: asyncio.Server | None = None
        self._clients: set[_Client] = set()

    @property
    def address(self) -> str:
        """`HOST:PORT` as in the locator of modems."""
        return place_name(self.host, self.port)

    async def open(self) -> None:
        """Listen; `port` is the actual one afterwards.

        Raises:
            LinkOpenError: The address cannot be used, for example a port in use.
        """
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(
                lambda: _Client(self.medium, self._clients), self.host, self.port
            )
        except OSError as error:
            refused = cannot_listen(self.host, self.port, error, rival="another medium")
            raise refused from error
        self.port = self._server.sockets[0].getsockname()[1]

    async def close(self) -> None:
        """Close all connections and stop the medium; may be repeated."""
        server, self._server = self._server, None
        if server is not None:
            server.close()
        clients = tuple(self._clients)
        for client in clients:
            client.hang_up()
        self.medium.close()
        for client in clients:
            await client.gone.wait()
        if server is not None:
            await server.wait_closed()


class _Client(asyncio.Protocol):
    """One connection."""

    def __init__(self, medium: SimMedium, clients: "set[_Client]") -> None:
        self.address = 0
        self.gone = asyncio.Event()
        self._medium = medium
        self._clients = clients
        self._decoder = MessageDecoder[ClientMessage](ClientMessage)
        self._transport: asyncio.Transport | None = None
        self._patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        transport = cast("asyncio.Transport", transport)  # that of uvloop is no subclass
        self._transport = transport
        self._clients.add(self)
        connected: socket.socket = transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if sum(not client.address for client in self._clients) > STRANGERS_LIMIT:
            self.hang_up()
            return
        loop = asyncio.get_running_loop()
        self._patience = loop.call_later(HELLO_LIMIT_S, self.hang_up)

    def data_received(self, data: bytes) -> None:
        try:
            for message in self._decoder.feed(data):
                self._answer(message)
        except MalformedMessageError as error:
            _logger.warning("node %d: dropped, it sent no message: %s", self.address, error)
            self.hang_up()

    def connection_lost(self, exc: Exception | None) -> None:
        if self._patience is not None:
            self._patience.cancel()
        self._clients.discard(self)
        if self.address:
            self._medium.detach(self.address)
        self.gone.set()

    def hang_up(self) -> None:
        """End the connection; unread bytes are lost."""
        if self.address:
            # Detach at once, so that the modem can return before the operating system reports.
            self._medium.detach(self.address)
            self.address = 0
        if self._transport is not None:
            self._transport.abort()

    def _answer(self, message: ClientMessage) -> None:
        match message:
            case Transmit() if self.address:
                self._medium.transmit(self.address, message)
            case Hello() if not self.address:
                self._place(message)
            case _:
                raise MalformedMessageError(f"{type(message).__name__} at the wrong time")

    def _place(self, hello: Hello) -> None:
        if self._patience is not None:
            self._patience.cancel()
        try:
            if hello.version != VERSION:
                raise LinkOpenError(f"version {hello.version} of the modem; allowed: {VERSION}")
            welcome = self._medium.attach(hello.address, self._tell)
        except LinkOpenError as error:
            self._tell(Refused(str(error)))
            if self._transport is not None:
                self._transport.close()
            return
        self.address = hello.address
        self._tell(welcome)

    def _tell(self, message: ServerMessage) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > BACKLOG_LIMIT_BYTES:
            _logger.warning("node %d: dropped, it does not read", self.address)
            self.hang_up()
            return
        self._transport.write(encode_message(message))
