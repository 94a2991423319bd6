"""A stream of bytes to a device, TCP or a serial port, which reconnects by itself.

::

    open ──► CONNECTING ──► OPEN ──lost──► WAITING ──┐        close, from any state ──► CLOSED
                 │  ▲                        ▲  │    │
                 │  └────── back-off over ───┼──┘    │
                 └────────── failed ─────────┘       │

Everything is called on the loop, and calls back on the loop. TCP is asyncio's. A serial port has
two threads: one reads, stamps the instant and hands over, the other writes, since a write to a port
whose other side does not read blocks. Threads, because asyncio can wait for a serial port on some
operating systems only. The hand-over is bounded and wakes the loop once, not once for each piece.
"""

import asyncio
import enum
import logging
import time
from typing import Final, Protocol

from zacoustic.core.base.clock import Clock
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link.bytestream.connection import Connection, reason_of, settle, to_the_end
from zacoustic.link.bytestream.serialport import SerialConnection
from zacoustic.link.bytestream.tcp import TcpConnection

FIRST_DELAY_S: Final = 0.2
"""Pause after the first failure, s: a server that restarts is back in about this time."""
LAST_DELAY_S: Final = 5.0
"""Longest pause between two attempts, s: the pause doubles until here."""

_logger = logging.getLogger(__name__)


class ByteStreamState(enum.Enum):
    """Where a stream is."""

    CLOSED = "closed"
    """Not opened, or closed."""
    CONNECTING = "connecting"
    """An attempt is under way."""
    OPEN = "open"
    """Bytes flow."""
    WAITING = "waiting"
    """An attempt failed or the connection was lost; the next attempt follows by itself."""


class ByteStreamReceiver(Protocol):
    """Who hears from a stream; called on the loop only, never from within a call to the stream."""

    def stream_opened(self) -> None:
        """A connection is there; a partial reception before it is void."""
        ...

    def bytes_received(self, data: bytes, received_at: int) -> None:
        """Bytes arrived; where one piece ends and the next begins means nothing.

        Args:
            data: 1 byte or more.
            received_at: Instant at which they had been read, ns; never decreases.
        """
        ...

    def stream_lost(self, reason: str) -> None:
        """The connection is gone, or an attempt to connect failed; the stream keeps trying.

        Args:
            reason: One line with the address and the operating system's message.
        """
        ...


class ByteStream:
    """A TCP client or a serial port that reconnects by itself.

    Args:
        address: `tcp:HOST:PORT` or `serial:PORT`, such as `serial:/dev/ttyUSB0`, `serial:COM3`,
            `tcp:[::1]:9200`.
        baudrate: Of a serial port, baud; TCP ignores it.
        clock: Where instants come from.
        first_delay_s: Pause after the first failure, s; doubles up to `last_delay_s`.
        last_delay_s: Longest pause, s.

    Raises:
        ConfigError: The address is neither.
    """

    def __init__(
        self,
        address: str,
        *,
        baudrate: int = 19_200,
        clock: Clock = time.monotonic_ns,
        first_delay_s: float = FIRST_DELAY_S,
        last_delay_s: float = LAST_DELAY_S,
    ) -> None:
        self.address = address
        self.state = ByteStreamState.CLOSED
        self.bytes_read = 0
        self.bytes_written = 0
        self.connections = 0
        self._target = parse_address(address)
        self._baudrate = baudrate
        self._clock = clock
        self._delays_s = (first_delay_s, last_delay_s)
        self._receiver: ByteStreamReceiver | None = None
        self._connection: Connection | None = None
        self._task: asyncio.Task[None] | None = None
        self._last_at = 0
        # What arrives between the connection and `stream_opened`: one turn of the loop at most.
        self._early: list[tuple[bytes, int]] = []

    def open(self, receiver: ByteStreamReceiver) -> None:
        """Start to connect, and keep connected until `close`; returns at once.

        Raises:
            LinkOpenError: It is open already.
        """
        if self._task is not None:
            raise LinkOpenError(f"{self.address} is open already")
        self._receiver = receiver
        self._task = asyncio.get_running_loop().create_task(
            self._keep_connected(receiver), name=f"byte stream {self.address}"
        )

    def write(self, data: bytes) -> bool:
        """Hand bytes over to the device; does not block.

        Returns:
            Whether they were taken, all of them or none: not when the stream is not OPEN, nor when
            `connection.WRITE_LIMIT_BYTES` would be exceeded.
        """
        if self._connection is None or not self._connection.write(data):
            return False
        self.bytes_written += len(data)
        return True

    def reset(self, reason: str) -> None:
        """Give up the present connection, for a peer that talks nonsense or not at all.

        `stream_lost` follows with this reason, and a new attempt as after any loss. Without a
        connection it does nothing.
        """
        if self._connection is not None:
            settle(self._connection.lost, reason)

    async def close(self) -> None:
        """Close, after a second at most for written bytes; no callback comes after it."""
        self._receiver = None
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.wait([task])
            if not task.cancelled():
                task.exception()  # logged where it was raised
        self.state = ByteStreamState.CLOSED

    async def _keep_connected(self, receiver: ByteStreamReceiver) -> None:
        first_s, last_s = self._delays_s
        delay_s = first_s
        try:
            while True:
                self.state = ByteStreamState.CONNECTING
                self._early.clear()
                reason = await self._connect()
                if self._connection is not None:
                    delay_s = first_s
                    reason = await self._use(receiver, self._connection)
                self.state = ByteStreamState.WAITING
                _logger.debug("%s: %s, next attempt in %.1f s", self.address, reason, delay_s)
                receiver.stream_lost(f"{self.address}: {reason}")
                await asyncio.sleep(delay_s)
                delay_s = min(2 * delay_s, last_s)
        except Exception:  # a fault of the receiver or of ours; nobody awaits this task
            _logger.exception("%s: the stream has failed and stays closed", self.address)
            raise

    async def _connect(self) -> str:
        """Try once; returns why it failed, or nothing."""
        try:
            if isinstance(self._target, str):
                self._connection = await SerialConnection.connect(
                    self._target, self._baudrate, self._receive, self._clock
                )
            else:
                self._connection = await TcpConnection.connect(
                    self._target, self._receive, self._clock
                )
        except OSError as error:  # SerialException is one, and so is TimeoutError
            return reason_of(error)
        return ""

    async def _use(self, receiver: ByteStreamReceiver, connection: Connection) -> str:
        """Serve a connection until it is lost; returns the reason."""
        try:
            self.connections += 1
            self.state = ByteStreamState.OPEN
            receiver.stream_opened()
            early, self._early = self._early, []
            for data, read_at in early:
                self._receive(data, read_at)
            # Shielded: a cancelled wait would cancel what both sides of `close` look at.
            return await asyncio.shield(connection.lost)
        finally:
            self._connection = None
            self.state = ByteStreamState.WAITING
            await to_the_end(connection.close())

    def _receive(self, data: bytes, read_at: int) -> None:
        """Pass on the bytes of a connection; drop those after its loss."""
        if self._receiver is None:
            return
        if self.state is ByteStreamState.CONNECTING:
            self._early.append((data, read_at))
        elif self.state is ByteStreamState.OPEN:
            self._last_at = max(self._last_at, read_at)
            self.bytes_read += len(data)
            self._receiver.bytes_received(data, self._last_at)


def parse_address(address: str) -> tuple[str, int] | str:
    """Host and port of a TCP address, or the path of a serial port."""
    kind, _, rest = address.partition(":")
    if kind == "serial" and rest:
        return rest
    host, colon, port = rest.rpartition(":")
    if kind == "tcp" and colon and host and port.isascii() and port.isdigit():
        if 1 <= int(port) <= 65_535:
            return host.removeprefix("[").removesuffix("]"), int(port)
        raise ConfigError(f"address {address!r}: port {port}; allowed: 1..65535")
    raise ConfigError(f"address {address!r}; allowed: tcp:HOST:PORT or serial:PORT")
