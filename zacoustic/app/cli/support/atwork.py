"""A line on the terminal that shows a verb's running time, from its third second to its output."""

import sys
import threading
import time
from types import TracebackType
from typing import Final, Self

_SILENT_S: Final = 2.0
_EVERY_S: Final = 0.5
_ERASE: Final = "\r\x1b[K"


class AtWork:
    """Shows the running time of a verb; a context manager, active only on a terminal.

    All printing calls `end` first, which removes the line for good.
    """

    def __init__(self) -> None:
        self._program = ""
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self, program: str) -> Self:
        """Begin to show the running time of a program."""
        self._program = program
        return self

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            self._over.clear()
            self._thread = threading.Thread(target=self._run, name="at work", daemon=True)
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.end()

    def end(self) -> None:
        """Remove the line. May be called again."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self._over.set()
            thread.join()

    def _run(self) -> None:
        began_s = time.monotonic()
        pause_s, shown = _SILENT_S, False
        while not self._over.wait(pause_s):
            worked_s = time.monotonic() - began_s
            self._write(f"{_ERASE}{self._program}: at work for {worked_s:.0f} s")
            pause_s, shown = _EVERY_S, True
        if shown:
            self._write(_ERASE)

    def _write(self, text: str) -> None:
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except (OSError, ValueError):  # the terminal has gone
            self._over.set()


AT_WORK: Final = AtWork()
"""The instance of the process."""
