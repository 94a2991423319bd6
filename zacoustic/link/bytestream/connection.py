"""The contract of both kinds of connections, and what they share."""

import asyncio
import errno
import os
import socket
from collections.abc import Callable, Coroutine
from typing import Any, Final, Protocol, TypeAlias

WRITE_LIMIT_BYTES: Final = 65_536
"""Bytes that may wait for the device before `write` refuses more: a hundred frames of any modem."""
FLUSH_LIMIT_S: Final = 1.0
"""Time for unwritten bytes when a connection is closed, s."""

Receive: TypeAlias = Callable[[bytes, int], None]
"""Takes the bytes read and their instant, ns; called on the loop."""


class Connection(Protocol):
    """One connection, open until `lost` is done."""

    lost: asyncio.Future[str]
    """Why it has ended; set from outside, it closes the connection."""

    def write(self, data: bytes) -> bool:
        """Take all of these bytes or none; return whether it took them."""
        ...

    async def close(self) -> None:
        """Release everything, after at most `FLUSH_LIMIT_S` for written bytes."""
        ...


def settle(future: asyncio.Future[Any], outcome: object) -> None:
    """Give a future its result or exception, unless it has one."""
    if future.done():
        return
    if isinstance(outcome, BaseException):
        future.set_exception(outcome)
    else:
        future.set_result(outcome)


async def to_the_end(closing: Coroutine[Any, Any, None]) -> None:
    """Await something that cancellation must not cut short: the closing of a connection.

    A task cancelled meanwhile still waits; otherwise threads and sockets would outlive the stream.
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


_CURES: Final = {
    errno.EACCES: ": add this user to the group of the port (often dialout), and log in again",
    errno.ENOENT: ": is it connected, and is that its name?",
}
"""What a person does about an error, behind the system's message."""


def reason_of(error: BaseException) -> str:
    """Return the operating system's message in one line."""
    if isinstance(error, socket.gaierror):
        return str(error.strerror)
    if isinstance(error, OSError) and error.errno == errno.EAGAIN:  # the lock on a serial port
        return "in use by another program"
    if isinstance(error, OSError) and error.errno:
        reason = os.strerror(error.errno)
        return f"{reason}{_CURES.get(error.errno, '')}"
    return " ".join(str(error).split()) or type(error).__name__
