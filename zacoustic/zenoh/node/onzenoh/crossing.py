"""Brings samples from Zenoh's threads to the loop: bounded, with one wake-up for many."""

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

from zacoustic.zenoh.session.wake_up import WakeUp

CROSSING_LIMIT: Final = 256
"""Arrivals of one endpoint that may wait for the loop; as many as Zenoh's own channels hold."""

T = TypeVar("T")


class Crossing(Generic[T]):
    """The crossing of one endpoint; created on the loop.

    Args:
        take: Takes each arrival, on the loop.
        limit: Arrivals that may wait; beyond it, the oldest is dropped.
    """

    def __init__(self, take: Callable[[T], None], *, limit: int = CROSSING_LIMIT) -> None:
        self._take = take
        self._items: deque[T] = deque(maxlen=limit)
        self._guard = threading.Lock()
        self._bell = WakeUp(asyncio.get_running_loop(), self._drain)

    def put(self, item: T) -> None:
        """Bring an arrival, from any thread."""
        with self._guard:
            self._items.append(item)
        self._bell.ring()

    def _drain(self) -> None:
        with self._guard:
            items = tuple(self._items)
            self._items.clear()
        for item in items:
            self._take(item)
