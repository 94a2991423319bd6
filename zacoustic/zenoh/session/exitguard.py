"""A script that ends without closing what it has opened must still end, with its own exit code.

The threads of a Zenoh session come back to Python for each sample. Before it runs any exit hook,
the interpreter waits for those that are no daemons, and they wait for a session that is never
closed. It does not wait for those that are daemons (because a daemon has declared something); then
the first of them that comes back aborts the process. So a guard waits beside them, in a thread that
the interpreter does wait for: it sees that the main thread is over and closes the session while
everything still works.
"""

import threading
from collections.abc import Callable
from typing import Final

# Between the end of the script and the end of the process, s, at most. There is no event to wait
# for that a thread which also waits for its dismissal could use.
_LOOK_EVERY_S: Final = 0.5


class ExitGuard:
    """Watches the main thread from the moment it is made until `dismiss`.

    Args:
        close: Called once, in the guard's thread, when the main thread has ended.
    """

    def __init__(self, close: Callable[[], None]) -> None:
        self._close = close
        self._dismissed = threading.Event()
        # A thread is a daemon if its maker is one, unless set otherwise.
        threading.Thread(target=self._watch, name="exit guard", daemon=False).start()

    def dismiss(self) -> None:
        """Watch no more, since it is closed; does not wait. May be called again."""
        self._dismissed.set()

    def _watch(self) -> None:
        main = threading.main_thread()
        while not self._dismissed.wait(_LOOK_EVERY_S):
            if not main.is_alive():
                self._close()
                return
