"""From other threads to the loop: bounded, and with one wake-up for many.

One call of the loop for each item would be an unbounded queue inside the loop. So a thread puts its
items into something of limited size, and wakes the loop unless a wake-up is pending.
"""

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

CROSSING_LIMIT: Final = 256
"""Items of one `crossing` that may wait for the loop; as many as Zenoh's own channels hold."""

T = TypeVar("T")


def tell_loop(loop: asyncio.AbstractEventLoop, callback: Callable[[], object]) -> None:
    """Call back on the loop if it still runs; from any thread."""
    with contextlib.suppress(RuntimeError):  # it has ended
        loop.call_soon_threadsafe(callback)


class WakeUp:
    """Wakes the loop from any thread, once until the loop has answered.

    Args:
        loop: The loop to wake.
        answer: Called on the loop; None: the function that `open` gets later.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, answer: Callable[[], None] | None = None
    ) -> None:
        self._loop = loop
        self._answer = answer
        self._guard = threading.Lock()
        self._has_rung = False

    def open(self, answer: Callable[[], None]) -> None:
        """Answer from now on, at once if `ring` was called before; on the loop."""
        self._answer = answer
        if self._has_rung:
            self._take()

    @property
    def has_ended(self) -> bool:
        """Whether the loop will never answer."""
        return self._loop.is_closed()

    def ring(self) -> None:
        """Schedule `answer`; it sees everything handed over before this call."""
        with self._guard:
            if self._has_rung:
                return
            self._has_rung = True
        tell_loop(self._loop, self._take)

    def _take(self) -> None:
        if self._answer is None:
            return
        with self._guard:
            self._has_rung = False
        self._answer()


class Inbox(Generic[T]):
    """Items for the loop, in order; `put` from any thread, `take` on the loop.

    Args:
        wake_up: Wakes the loop, which then calls `take`.
        limit: Items that may wait.
        keeps_newest: Beyond the limit the oldest item makes room; otherwise `put` refuses.
    """

    def __init__(self, wake_up: WakeUp, *, limit: int, keeps_newest: bool = False) -> None:
        self._wake_up = wake_up
        self._limit = limit
        self._items: deque[T] = deque(maxlen=limit)
        self._keeps_newest = keeps_newest
        self._guard = threading.Lock()

    def put(self, item: T) -> bool:
        """Hand an item over; False: refused, or the loop has ended."""
        with self._guard:
            is_full = len(self._items) == self._limit and not self._keeps_newest
            if is_full or self._wake_up.has_ended:
                return False
            self._items.append(item)
        self._wake_up.ring()
        return True

    def take(self) -> tuple[T, ...]:
        """Take all waiting items."""
        with self._guard:
            items = tuple(self._items)
            self._items.clear()
        return items


def crossing(take: Callable[[T], None], *, limit: int = CROSSING_LIMIT) -> Callable[[T], None]:
    """Return a function that brings items from any thread to `take`; called on the loop.

    Args:
        take: Takes each item, on the loop.
        limit: Items that may wait; beyond it, the oldest is dropped.
    """

    def drain() -> None:
        for item in inbox.take():
            take(item)

    wake_up = WakeUp(asyncio.get_running_loop(), drain)
    inbox: Inbox[T] = Inbox(wake_up, limit=limit, keeps_newest=True)

    def put(item: T) -> None:
        inbox.put(item)

    return put
