"""The way from Zenoh's threads to the loop: bounded, with one wake-up for many arrivals.

`call_soon_threadsafe` for each arrival would be a queue without bound inside a stalled loop. Here
arrivals go into a deque of fixed length, and the loop is woken once until it has emptied it.
"""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

CROSSING_LIMIT: Final = 256
"""Arrivals of one endpoint that wait for the loop; as many as Zenoh's own channels hold."""

T = TypeVar("T")


class Crossing(Generic[T]):
    """Made on the loop, for one endpoint.

    Args:
        take: Takes each arrival, on the loop.
        limit: Arrivals that can wait.
    """

    def __init__(self, take: Callable[[T], None], *, limit: int = CROSSING_LIMIT) -> None:
        self._take = take
        self._limit = limit
        self._loop = asyncio.get_running_loop()
        self._items: deque[T] = deque()
        self._guard = threading.Lock()
        self._is_woken = False

    def put(self, item: T, *, push_out: bool = True) -> bool:
        """Bring an arrival; from any thread.

        Args:
            item: The arrival.
            push_out: When there are too many: let the oldest go, else refuse this one.

        Returns:
            False when it is refused, or the loop has ended.
        """
        with self._guard:
            if len(self._items) >= self._limit:
                if not push_out:
                    return False
                self._items.popleft()
            self._items.append(item)
            wake, self._is_woken = not self._is_woken, True
        if wake:
            try:
                self._loop.call_soon_threadsafe(self._drain)
            except RuntimeError:
                return False
        return True

    def _drain(self) -> None:
        with self._guard:
            items = tuple(self._items)
            self._items.clear()
            self._is_woken = False
        for item in items:
            self._take(item)


def tell_loop(loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> None:
    """Call back on the loop, if it still runs; from any thread."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(callback)
