"""A script that ends without closing its session must still end, with its own exit code.

The threads of a Zenoh session return to Python for each sample. Before it runs any exit hook, the
interpreter waits for those that are not daemons, and they wait for a session that is never closed.
It does not wait for daemons (threads are daemons if a daemon has declared something); then the
first one that returns aborts the process. So a guard waits in a thread for which the interpreter
waits: when the main thread has ended, it closes the session while everything still works.
"""

import threading
from collections.abc import Callable
from typing import Final

# Longest time between the end of the script and the end of the process, s. A thread that also waits
# for its dismissal has no event to wait for.
_LOOK_EVERY_S: Final = 0.5


class ExitGuard:
    """Watches the main thread from construction until `dismiss`.

    Args:
        close: Called once, in the guard's thread, when the main thread has ended.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close = close
        self._dismissed = threading.Event()
        # A thread is a daemon if its maker is one, unless set otherwise.
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
