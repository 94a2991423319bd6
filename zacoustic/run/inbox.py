"""`Inbox`: commands from other threads for the loop that owns an engine.

It is bounded, and only one wake-up of the loop is pending at a time: one for each command would be
an unbounded queue inside the loop.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

SUBMIT_LIMIT: Final = 1024
"""Most commands that wait for the loop."""

T = TypeVar("T")


class Inbox(Generic[T]):
    """A queue of commands to the loop.

    Args:
        wake: Called on the loop when commands wait.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting: deque[T] = deque()
        self._guard = threading.Lock()
        self._is_woken = False

    def open(self, loop: asyncio.AbstractEventLoop) -> None:
        """Accept commands from now on, for this loop."""
        self._loop = loop

    def put(self, command: T) -> bool:
        """Hand a command over, from any thread; False: the inbox is full or closed."""
        with self._guard:
            loop = self._loop
            if loop is None or len(self._waiting) >= SUBMIT_LIMIT:
                return False
            self._waiting.append(command)
            wake = not self._is_woken
            self._is_woken = True
        if wake:
            try:
                loop.call_soon_threadsafe(self._wake)
            except RuntimeError:  # the loop was closed before
                return False
        return True

    def take(self) -> tuple[T, ...]:
        """Take all waiting commands; on the loop."""
        with self._guard:
            commands = tuple(self._waiting)
            self._waiting.clear()
            self._is_woken = False
        return commands

    def close(self) -> None:
        """Accept no more commands."""
        with self._guard:
            self._loop = None
