"""Parts shared by verbs that serve until they are interrupted: place, time scale, stop, lines."""

import asyncio
import contextlib
import os
import queue
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from typing import Any, Final, Self, TypeVar

from zacoustic.core.base.clock import Clock
from zacoustic.errors import ConfigError, LinkOpenError

T = TypeVar("T")

LINES_LIMIT: Final = 10_000
"""Most lines that wait for a reader."""

_LAST_PORT: Final = 65_535
_MOST_SCALED: Final = 1e6
# Time for the last lines when the verb ends, s.
_LAST_LINES_S: Final = 1.0


def parse_place(place: str) -> tuple[str, int]:
    """Return host and port of ``HOST:PORT``; remove the brackets of an IPv6 host.

    Raises:
        ConfigError: The text is not a place. Port 0 is allowed: any free port.
    """
    host, colon, port = place.rpartition(":")
    if not (colon and host and port.isascii() and port.isdigit() and int(port) <= _LAST_PORT):
        raise ConfigError(f"--listen {place!r}; allowed: HOST:PORT, port 0..{_LAST_PORT}")
    return host.removeprefix("[").removesuffix("]"), int(port)


def place_name(host: str, port: int) -> str:
    """Return `HOST:PORT` as clients write it."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def cannot_listen(host: str, port: int, error: OSError, *, rival: str) -> LinkOpenError:
    """Return the error for a place at which the program cannot listen.

    Args:
        host: As given.
        port: As given.
        error: The operating system's error.
        rival: Program that may have the port.
    """
    is_name = isinstance(error, socket.gaierror)
    reason = error.strerror if is_name else os.strerror(error.errno or 0)
    return LinkOpenError(
        f"cannot listen at {place_name(host, port)}: {reason}",
        hint=f"{rival} may be running; port 0 takes any that is free",
    )


class ScaledClock:
    """The time of an emulation, ns: starts at 0 on construction, and may run faster.

    Args:
        time_scale: How many times faster than real time, > 0.
        clock: Source of instants.

    Raises:
        ConfigError: The time scale is not above 0.
    """

    def __init__(self, time_scale: float = 1.0, clock: Clock = time.monotonic_ns) -> None:
        if not 1 / _MOST_SCALED <= time_scale <= _MOST_SCALED:
            raise ConfigError(
                f"time scale is {time_scale:g}; allowed: above 0, "
                f"{1 / _MOST_SCALED:g}..{_MOST_SCALED:g}"
            )
        self.time_scale = time_scale
        self._clock = clock
        self._origin_at = clock()

    def now(self) -> int:
        """Return the present instant of the emulation."""
        return round((self._clock() - self._origin_at) * self.time_scale)


@contextlib.contextmanager
def stopped_by_signals(stop: asyncio.Event) -> Iterator[None]:
    """Set `stop` on SIGINT and SIGTERM, even if the loop does not support signals; on the loop.

    Only the main thread receives signals: in another thread nothing sets `stop`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    loop = asyncio.get_running_loop()
    numbers = (signal.SIGINT, signal.SIGTERM)
    if sys.platform == "win32":
        # There, a handler runs between two turns of the loop and must wake the loop itself.
        previous = {
            number: signal.signal(number, lambda *_: loop.call_soon_threadsafe(stop.set))
            for number in numbers
        }
    else:
        for number in numbers:
            loop.add_signal_handler(number, stop.set)
    try:
        yield
    finally:
        if sys.platform == "win32":
            for number, handler in previous.items():
                signal.signal(number, handler)
        else:
            for number in numbers:
                loop.remove_signal_handler(number)


async def until_stopped(stop: asyncio.Event, work: Coroutine[Any, Any, T]) -> T | None:
    """Wait for the end of some work; `stop` cancels the work and waits until it has ended.

    Returns:
        The result; None: it was stopped.
    """
    task, stopped = asyncio.ensure_future(work), asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait((task, stopped), return_when=asyncio.FIRST_COMPLETED)
        return task.result() if task.done() else None
    finally:
        for each in (task, stopped):
            each.cancel()
        await asyncio.gather(task, stopped, return_exceptions=True)


def run_until_stopped(work: Callable[[asyncio.Event], Coroutine[Any, Any, T]]) -> T | None:
    """Run some work on a new loop, until it ends or SIGINT or SIGTERM stops it.

    The signals stop it even if a shell had this process ignore them, as for a background job of a
    script: there is no other way to stop it.

    Args:
        work: Takes the event that stops it, which it may set itself; it is then cancelled.

    Returns:
        The result; None: it was stopped.
    """

    async def run() -> T | None:
        stop = asyncio.Event()
        with stopped_by_signals(stop):
            return await until_stopped(stop, work(stop))

    with contextlib.suppress(KeyboardInterrupt):  # before the loop takes the signals
        return asyncio.run(run())
    return None


class LineWriter:
    """Writes lines to standard output from a thread: a reader that stops does not stop the verb.

    Args:
        name: The verb, for messages.
        stop: Set when the reader has gone.
    """

    def __init__(self, name: str, stop: asyncio.Event) -> None:
        self._name = name
        self._stop = stop
        self._loop = asyncio.get_running_loop()
        self._lines: queue.Queue[str | None] = queue.Queue(LINES_LIMIT)
        self._dropped = 0
        # A daemon, because nothing can interrupt a write that the reader blocks.
        self._thread = threading.Thread(target=self._run, name="output", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        with contextlib.suppress(queue.Full):
            self._lines.put_nowait(None)
        self._thread.join(_LAST_LINES_S)

    def write(self, line: str) -> None:
        """Write a line soon; if too many wait, drop it with one note on standard error."""
        try:
            self._lines.put_nowait(line)
        except queue.Full:
            if not self._dropped:
                print(f"{self._name}: nobody reads the output; lines are dropped", file=sys.stderr)
            self._dropped += 1

    def _run(self) -> None:
        try:
            while (line := self._lines.get()) is not None:
                sys.stdout.write(line + "\n")
                sys.stdout.flush()  # a reader of a pipe wants each line at once
        except BrokenPipeError:
            # The interpreter flushes again at its end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            self._loop.call_soon_threadsafe(self._stop.set)
