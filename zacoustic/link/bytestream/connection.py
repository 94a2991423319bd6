"""What both kinds of connections are and need."""

import asyncio
import errno
import os
import socket
from collections.abc import Callable, Coroutine
from typing import Any, Final, Protocol, TypeAlias

WRITE_LIMIT_BYTES: Final = 65_536
"""Bytes that may wait for the device before `write` refuses: a hundred frames of any modem."""
FLUSH_LIMIT_S: Final = 1.0
"""For unwritten bytes when a connection is closed, s."""

Receive: TypeAlias = Callable[[bytes, int], None]
"""Takes the bytes read, and the instant in ns; called on the loop."""


class Connection(Protocol):
    """One connection, open until `lost` is done."""

    lost: asyncio.Future[str]
    """Why it has ended; set from outside to close it."""

    def write(self, data: bytes) -> bool:
        """Take all of these bytes or none; returns whether."""
        ...

    async def close(self) -> None:
        """Release everything; written bytes have `FLUSH_LIMIT_S`."""
        ...


def settle(future: asyncio.Future[Any], outcome: object) -> None:
    """Give a future its result or its exception, unless it has one."""
    if future.done():
        return
    if isinstance(outcome, BaseException):
        future.set_exception(outcome)
    else:
        future.set_result(outcome)


async def to_the_end(closing: Coroutine[Any, Any, None]) -> None:
    """Await something that must not be cut short: a connection that is being closed.

    Who is cancelled meanwhile still waits; otherwise threads and sockets would outlive the stream.
    """
    task = asyncio.get_running_loop().create_task(closing)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError as error:
            cancelled = error
    task.result()
    if cancelled is not None:
        raise cancelled


def reason_of(error: BaseException) -> str:
    """The operating system's message in one line."""
    if isinstance(error, socket.gaierror):
        return str(error.strerror)
    if isinstance(error, OSError) and error.errno == errno.EAGAIN:  # the lock on a serial port
        return "in use by another program"
    if isinstance(error, OSError) and error.errno:
        return os.strerror(error.errno)
    return " ".join(str(error).split()) or type(error).__name__
