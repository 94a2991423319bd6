"""A script that ends without closing its node must still end.

The threads of a Zenoh session with live callbacks are no daemons: the interpreter waits for them
before it runs any exit hook, and they wait for a session that nobody closes any more. So a guard
waits beside them, a thread of its own which is no daemon either: it sees that the main thread is
over and closes the session while everything is still in working order.

Daemons are no way out: one that is inside Zenoh when the interpreter ends is unwound through
foreign code, and the process aborts.
"""

import threading
from collections.abc import Callable
from typing import Final

# Between the end of the script and the end of the process, s, at most. There is no event to wait
# for that a thread which also waits for its dismissal could use.
_LOOK_EVERY_S: Final = 0.5


class ExitGuard:
    """Watches the main thread from `start` to `dismiss`.

    Args:
        close: Called once, in the guard's thread, when the main thread has ended.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close = close
        self._dismissed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="exit guard")

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def dismiss(self) -> None:
        """Watch no more, since it is closed; returns when the thread has ended."""
        self._dismissed.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join()

    def _watch(self) -> None:
        main = threading.main_thread()
        while not self._dismissed.wait(_LOOK_EVERY_S):
            if not main.is_alive():
                self._close()
                return
