"""A loop in a thread of its own, and blocking calls into it."""

import asyncio
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Final, Generic, TypeVar

from zacoustic.errors import LocalError
from zacoustic.run.inbox import tell_loop
from zacoustic.zenoh.session.exitguard import ExitGuard

T = TypeVar("T")
Endpoint = TypeVar("Endpoint")

PARK_LIMIT_S: Final = 2.0
"""How long the end of a process waits for a running callback, s."""


class LoopThread:
    """Runs a loop from construction until `stop`.

    A script may end without `stop`: the thread is a daemon and has stopped by then. If it were in
    foreign code, such as a put of Zenoh, its return to an ending interpreter would abort the
    process.

    Args:
        name: Name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()
        self._parked = threading.Event()
        self._guard = ExitGuard(self._park)

    @property
    def is_current(self) -> bool:
        """Whether the caller is on the loop, in a callback or a handler."""
        return threading.current_thread() is self._thread

    def wait(self, begin: Callable[[], Awaitable[T]], *, timeout_s: float | None = None) -> T:
        """Begin something on the loop and wait for it; an interrupt cancels it.

        Raises:
            LocalError: On the loop itself, which cannot wait for itself, or after `stop`.
            TimeoutError: It takes longer than `timeout_s`, s, and is cancelled.
            Exception: Whatever it raises.
        """
        self._check()

        async def pursue() -> T:
            async with asyncio.timeout(timeout_s):
                return await begin()

        future = asyncio.run_coroutine_threadsafe(pursue(), self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def apply(self, function: Callable[[], T]) -> T:
        """Call a function on the loop and wait for it; on the loop itself, call it directly.

        Raises:
            LocalError: After `stop`.
            Exception: Whatever the function raises.
        """
        return function() if self.is_current else self.make(function)

    def make(self, function: Callable[[], T]) -> T:
        """Call a function on the loop and wait for it; as `wait`, not on the loop itself."""

        async def call() -> T:
            return function()

        return self.wait(call)

    def next_of(self, items: AsyncIterator[T]) -> T:
        """Wait for the next item; no item is None.

        Raises:
            StopIteration: There is none any more.
        """
        item = self.wait(lambda: anext(items, None))
        if item is None:
            raise StopIteration
        return item

    def each(self, items: AsyncIterator[T]) -> Iterator[T]:
        """Return an iterator that waits for each item; no item is None."""
        return iter(lambda: self.wait(lambda: anext(items, None)), None)

    def stop(self) -> None:
        """End the loop and the thread. May be called again.

        Raises:
            LocalError: On the loop itself.
        """
        if self._loop.is_closed():
            return
        self._check()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._guard.dismiss()

    def _check(self) -> None:
        if self.is_current:
            raise LocalError(
                "a blocking call inside a callback would wait for itself",
                hint="hand the work to another thread, or use the asyncio Node",
            )
        if self._loop.is_closed():
            raise LocalError("the node is closed")

    def _park(self) -> None:
        """Stop the thread for ever."""

        def stand_still() -> None:
            self._parked.set()
            threading.Event().wait()

        tell_loop(self._loop, stand_still)
        self._parked.wait(PARK_LIMIT_S)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
        finally:
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
            self._loop.run_until_complete(self._loop.shutdown_default_executor())
            self._loop.close()


class OnLoop(Generic[Endpoint]):
    """An asyncio endpoint, for other threads.

    Args:
        endpoint: The endpoint.
        thread: Runs its loop.
    """

    def __init__(self, endpoint: Endpoint, thread: LoopThread) -> None:
        self._endpoint = endpoint
        self._thread = thread
