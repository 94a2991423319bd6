"""One TCP connection of a stream."""

import asyncio
import socket
from typing import Final, cast

from zacoustic.core.base.clock import Clock
from zacoustic.link.bytestream.connection import (
    FLUSH_LIMIT_S,
    WRITE_LIMIT_BYTES,
    Receive,
    reason_of,
    settle,
)

CONNECT_LIMIT_S: Final = 5.0
"""Time limit of one attempt to connect, s; the system's own is minutes."""


class TcpConnection(asyncio.Protocol):
    """One TCP connection."""

    def __init__(self, receive: Receive, clock: Clock) -> None:
        self._receive = receive
        self._clock = clock
        self._transport: asyncio.Transport | None = None
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._gone = asyncio.Event()

    @classmethod
    async def connect(
        cls, target: tuple[str, int], receive: Receive, clock: Clock
    ) -> "TcpConnection":
        """Connect within `CONNECT_LIMIT_S`."""
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(CONNECT_LIMIT_S):
                _, connection = await loop.create_connection(lambda: cls(receive, clock), *target)
        except TimeoutError as error:
            if error.errno is None:  # ours, not the operating system's
                raise TimeoutError(f"no answer within {CONNECT_LIMIT_S:g} s") from None
            raise
        return connection

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Set the socket up; called by asyncio."""
        transport = cast("asyncio.Transport", transport)  # that of uvloop is no subclass
        self._transport = transport
        connected: socket.socket = transport.get_extra_info("socket")
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # Otherwise an unplugged device would stay connected for ever.
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def data_received(self, data: bytes) -> None:
        """Stamp the bytes read and pass them on; called by asyncio."""
        self._receive(data, self._clock())

    def connection_lost(self, exc: Exception | None) -> None:
        """Report why the connection ended; called by asyncio, last of all."""
        settle(self.lost, reason_of(exc) if exc else "closed by the other side")
        self._gone.set()

    def write(self, data: bytes) -> bool:
        """Take all of these bytes or none; return whether it took them."""
        assert self._transport is not None
        if self._transport.is_closing():
            return False
        if self._transport.get_write_buffer_size() + len(data) > WRITE_LIMIT_BYTES:
            return False
        self._transport.write(data)
        return True

    async def close(self) -> None:
        """Close; abort bytes that cannot be written in time."""
        assert self._transport is not None
        self._transport.close()
        try:
            async with asyncio.timeout(FLUSH_LIMIT_S):
                await self._gone.wait()
        except TimeoutError:
            self._transport.abort()
            await self._gone.wait()
