"""Ends a session whose script ends without closing it, so that the process keeps its exit code.

The threads of a Zenoh session return to Python for each sample. Before it runs any exit hook, the
interpreter waits for threads that are not daemons, and these wait for a session that nobody closes.
It does not wait for daemon threads (a declaration made in a daemon makes them daemons), and the
first one that returns later aborts the process. So a guard waits in a thread for which the
interpreter waits: when the main thread has ended, it closes the session while everything still
works.
"""

import threading
from collections.abc import Callable
from typing import Final

# Longest time between the end of the script and the end of the process, s. The thread polls, since
# no event covers both the main thread's end and `dismiss`.
_LOOK_EVERY_S: Final = 0.5


class ExitGuard:
    """Watches the main thread from construction until `dismiss`.

    Args:
        close: Called once, in the guard's thread, when the main thread has ended.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close = close
        self._dismissed = threading.Event()
        # By default a thread is a daemon if its creator is one.
        threading.Thread(target=self._watch, name="exit guard", daemon=False).start()

    def dismiss(self) -> None:
        """Stop watching, without waiting. May be called again."""
        self._dismissed.set()

    def _watch(self) -> None:
        main = threading.main_thread()
        while not self._dismissed.wait(_LOOK_EVERY_S):
            if not main.is_alive():
                self._close()
                return
