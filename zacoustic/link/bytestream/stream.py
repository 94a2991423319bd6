"""A byte stream to a device, over TCP or a serial port, that reconnects by itself.

::

    open ──► CONNECTING ──► OPEN ──lost──► WAITING ──┐        close, from any state ──► CLOSED
                 │  ▲                        ▲  │    │
                 │  └────── back-off over ───┼──┘    │
                 └────────── failed ─────────┘       │

All calls and callbacks are on the loop. TCP is asyncio's. A serial port has two threads, because
asyncio can wait for a serial port only on some operating systems: one reads, stamps the instant and
hands over; the other writes, because a write blocks if the other side does not read. The hand-over
is bounded and wakes the loop once, not once for each piece.
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
"""Pause after the first failure, s: about the time in which a server restarts."""
LAST_DELAY_S: Final = 5.0
"""Longest pause between two attempts, s: the pause doubles up to this."""

_logger = logging.getLogger(__name__)


class ByteStreamState(enum.Enum):
    """State of a stream."""

    CLOSED = "closed"
    """Not opened, or closed."""
    CONNECTING = "connecting"
    """An attempt to connect is under way."""
    OPEN = "open"
    """Bytes flow."""
    WAITING = "waiting"
    """An attempt failed, or the connection was lost; the next attempt follows by itself."""


class ByteStreamReceiver(Protocol):
    """Receives the events of a stream: only on the loop, never from within a call to the stream."""

    def stream_opened(self) -> None:
        """Note a new connection, which voids a partial reception before it."""
        ...

    def bytes_received(self, data: bytes, received_at: int) -> None:
        """Take received bytes; the borders between pieces mean nothing.

        Args:
            data: 1 byte or more.
            received_at: Instant after they were read, ns; never decreases.
        """
        ...

    def stream_lost(self, reason: str) -> None:
        """Note that the connection is lost, or an attempt failed; the stream keeps trying.

        Args:
            reason: The address and the operating system's message, one line.
        """
        ...


class ByteStream:
    """A TCP client or a serial port that reconnects by itself.

    Args:
        address: `tcp:HOST:PORT` or `serial:PORT`, such as `serial:/dev/ttyUSB0`, `serial:COM3`,
            `tcp:[::1]:9200`.
        baudrate: Of a serial port, baud; TCP ignores it.
        clock: Source of instants.
        first_delay_s: Pause after the first failure, s; doubles up to `last_delay_s`.
        last_delay_s: Longest pause, s.

    Raises:
        ConfigError: The address is neither of the two.
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
        # Bytes that arrive between the connection and `stream_opened`: one turn of the loop at
        # most.
        self._early: list[tuple[bytes, int]] = []

    def open(self, receiver: ByteStreamReceiver) -> None:
        """Start to connect, and stay connected until `close`; return at once.

        Raises:
            LinkOpenError: The stream is already open.
        """
        if self._task is not None:
            raise LinkOpenError(f"{self.address} is open already")
        self._receiver = receiver
        self._task = asyncio.get_running_loop().create_task(
            self._keep_connected(receiver), name=f"byte stream {self.address}"
        )

    def write(self, data: bytes) -> bool:
        """Hand bytes over to the device without blocking.

        Returns:
            Whether the stream took them, all or none. It takes none unless it is OPEN, or if that
            would exceed `connection.WRITE_LIMIT_BYTES`.
        """
        if self._connection is None or not self._connection.write(data):
            return False
        self.bytes_written += len(data)
        return True

    def reset(self, reason: str) -> None:
        """Drop the present connection, because the other side talks nonsense or not at all.

        `stream_lost` follows with this reason, then a new attempt as after any loss. Without a
        connection, `reset` does nothing.
        """
        if self._connection is not None:
            settle(self._connection.lost, reason)

    async def close(self) -> None:
        """Close, after at most a second for written bytes; no callback follows."""
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
        """Try once; return why it failed, or nothing."""
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
        """Serve a connection until it is lost; return the reason."""
        try:
            self.connections += 1
            self.state = ByteStreamState.OPEN
            receiver.stream_opened()
            early, self._early = self._early, []
            for data, read_at in early:
                self._receive(data, read_at)
            # Shielded: a cancelled wait would cancel the future that both sides of `close` watch.
            return await asyncio.shield(connection.lost)
        finally:
            self._connection = None
            self.state = ByteStreamState.WAITING
            await to_the_end(connection.close())

    def _receive(self, data: bytes, read_at: int) -> None:
        """Pass on the bytes of a connection; drop bytes that come after its loss."""
        if self._receiver is None:
            return
        if self.state is ByteStreamState.CONNECTING:
            self._early.append((data, read_at))
        elif self.state is ByteStreamState.OPEN:
            self._last_at = max(self._last_at, read_at)
            self.bytes_read += len(data)
            self._receiver.bytes_received(data, self._last_at)


def parse_address(address: str) -> tuple[str, int] | str:
    """Return host and port of a TCP address, or the path of a serial port."""
    kind, _, rest = address.partition(":")
    if kind == "serial" and rest:
        return rest
    host, colon, port = rest.rpartition(":")
    if kind == "tcp" and colon and host and port.isascii() and port.isdigit():
        if 1 <= int(port) <= 65_535:
            return host.removeprefix("[").removesuffix("]"), int(port)
        raise ConfigError(f"address {address!r}: port {port}; allowed: 1..65535")
    raise ConfigError(f"address {address!r}; allowed: tcp:HOST:PORT or serial:PORT")
