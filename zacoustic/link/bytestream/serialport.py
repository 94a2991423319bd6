"""One open serial port of a stream, and its two threads.

These traps shape it:

- Closing a port while another thread reads from it raises a `TypeError` there. So only the reading
  thread closes the port, after `cancel_read` has ended its read and the writing thread has ended.
- On Windows, `cancel_read` does nothing if no read is under way at that moment, so it is repeated
  until the thread ends.
- Opening a port can take seconds (Bluetooth, USB hubs), so the reading thread does that, too.
"""

import asyncio
import contextlib
import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from zacoustic.core.base.clock import Clock
from zacoustic.link.bytestream.connection import (
    FLUSH_LIMIT_S,
    WRITE_LIMIT_BYTES,
    Receive,
    reason_of,
    settle,
    to_the_end,
)

if TYPE_CHECKING:
    import serial

READ_LIMIT_BYTES: Final = 1_048_576
"""Most bytes read and not yet taken by the loop: 90 s at 115 200 baud."""

_PIECE_BYTES: Final = 256
# Beyond the time of a piece at its baud rate, s: a modem with flow control stops for less.
_WRITE_PATIENCE_S: Final = 2.0
# Between two attempts to cancel a thread's read or write, s; on POSIX the first one suffices.
_CANCEL_AGAIN_S: Final = 0.2

_logger = logging.getLogger(__name__)


class SerialConnection:
    """One open serial port and its two threads.

    `_run` is the reading thread, `_write_queued` the writing thread; `_guard` protects what both
    threads and the loop share.
    """

    def __init__(self, port: str, baudrate: int, receive: Receive, clock: Clock) -> None:
        self._path = port
        self._baudrate = baudrate
        self._receive = receive
        self._clock = clock
        self._loop = asyncio.get_running_loop()
        self._opened: asyncio.Future[None] = self._loop.create_future()
        self.lost: asyncio.Future[str] = self._loop.create_future()
        self._ended = asyncio.Event()
        self._guard = threading.Condition()
        self._closing = False
        self._port: serial.Serial | None = None
        self._read: deque[tuple[bytes, int]] = deque()
        self._read_bytes = 0
        self._wake_pending = False
        self._queued = bytearray()
        self._write_failure = ""
        self._reader = threading.Thread(target=self._run, name=f"read {port}", daemon=True)

    @classmethod
    async def connect(
        cls, port: str, baudrate: int, receive: Receive, clock: Clock
    ) -> "SerialConnection":
        """Open the port in the reading thread."""
        connection = cls(port, baudrate, receive, clock)
        connection._reader.start()
        try:
            await asyncio.shield(connection._opened)
        except BaseException:
            await to_the_end(connection.close())
            raise
        return connection

    def write(self, data: bytes) -> bool:
        """Take all of these bytes or none; return whether it took them."""
        with self._guard:
            if self._closing or len(self._queued) + len(data) > WRITE_LIMIT_BYTES:
                return False
            self._queued += data
            self._guard.notify_all()
        return True

    async def close(self) -> None:
        """End both threads; the reading one closes the port."""
        with self._guard:
            self._closing = True
            self._guard.notify_all()
        while not self._ended.is_set():
            with self._guard:
                if self._port is not None:
                    self._port.cancel_read()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_CANCEL_AGAIN_S):
                    await self._ended.wait()
        self._reader.join()

    def _run(self) -> None:
        """Open, read, end the writing thread, close; all of it in the reading thread."""
        reason = "failed"
        try:
            reason = self._serve()
        except (OSError, ValueError) as error:  # pyserial raises both for a port it cannot open
            failure = error if isinstance(error, OSError) else OSError(str(error))
            self._tell(settle, self._opened, failure)
        except Exception as error:  # a fault of ours: the waiting caller must learn that it ended
            _logger.exception("%s: the reading thread has failed", self._path)
            self._tell(settle, self._opened, OSError(str(error)))
        finally:
            self._tell(settle, self.lost, reason)
            self._tell(self._ended.set)

    def _serve(self) -> str:
        """Serve the port until it is lost or closed; return why it ended."""
        import serial

        patience_s = _WRITE_PATIENCE_S + _PIECE_BYTES * 10 / self._baudrate
        with serial.Serial(
            self._path, self._baudrate, write_timeout=patience_s, exclusive=True
        ) as port:
            with self._guard:
                self._port = port
            self._tell(settle, self._opened, None)
            writer = threading.Thread(
                target=self._write_queued, args=(port,), name=f"write {self._path}", daemon=True
            )
            writer.start()
            reason = self._read_until_lost(port)
            with self._guard:
                self._port = None
                self._closing = True
                self._guard.notify_all()
            writer.join(FLUSH_LIMIT_S)
            with self._guard:
                self._queued.clear()
            while writer.is_alive():
                port.cancel_write()
                writer.join(_CANCEL_AGAIN_S)
        return self._write_failure or reason

    def _read_until_lost(self, port: "serial.Serial") -> str:
        try:
            while not self._closing:
                data = port.read(1)
                if data:
                    data += port.read(port.in_waiting)
                    self._hand_over(data, self._clock())
        except OSError as error:
            return reason_of(error)
        return "closed"

    def _write_queued(self, port: "serial.Serial") -> None:
        try:
            while True:
                with self._guard:
                    self._guard.wait_for(lambda: self._queued or self._closing)
                    piece = bytes(self._queued[:_PIECE_BYTES])
                    del self._queued[:_PIECE_BYTES]
                if not piece:
                    return
                port.write(piece)
        except OSError as error:
            self._write_failure = reason_of(error)
            with self._guard:
                self._closing = True
                if self._port is not None:
                    self._port.cancel_read()

    def _hand_over(self, data: bytes, read_at: int) -> None:
        with self._guard:
            if self._read_bytes + len(data) > READ_LIMIT_BYTES:
                _logger.warning("%s: the loop is stuck, %d bytes dropped", self._path, len(data))
                return
            self._read.append((data, read_at))
            self._read_bytes += len(data)
            wake = not self._wake_pending
            self._wake_pending = True
        if wake:
            self._tell(self._drain)

    def _drain(self) -> None:
        with self._guard:
            pieces = list(self._read)
            self._read.clear()
            self._read_bytes = 0
            self._wake_pending = False
        for data, read_at in pieces:
            self._receive(data, read_at)

    def _tell(self, callback: Callable[..., object], *arguments: object) -> None:
        """Call on the loop, from a thread."""
        try:
            self._loop.call_soon_threadsafe(callback, *arguments)
        except RuntimeError:  # the loop was closed before the stream: no caller is left
            _logger.debug("%s: the loop is closed", self._path)
