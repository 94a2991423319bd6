"""The wake-up from Zenoh's threads to the loop: at most one is pending.

One call of the loop per sample would make an unbounded queue of calls. So the sender puts its items
into a bounded queue and wakes the loop unless a wake-up is pending.
"""

import asyncio
import contextlib
import threading
from collections.abc import Callable


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


def tell_loop(loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> None:
    """Call back on the loop if it still runs; from any thread."""
    with contextlib.suppress(RuntimeError):  # it has ended
        loop.call_soon_threadsafe(callback)
