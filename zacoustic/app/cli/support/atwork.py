"""A line on the terminal that shows how far a verb is, from its third second to its output."""

import contextlib
import sys
import threading
import time
from collections.abc import Iterator
from typing import Final, Self

_SILENT_S: Final = 2.0
_EVERY_S: Final = 0.5
_BAR: Final = 20
"""Width of the bar, characters."""
_ERASE: Final = "\r\x1b[K"


class AtWork:
    """Shows how far a verb is, and its running time, on a terminal.

    All printing calls `end` first, which removes the line for good.
    """

    def __init__(self) -> None:
        self._program = ""
        self._share: float | None = None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    @contextlib.contextmanager
    def begin(self, program: str) -> Iterator[Self]:
        """Show the running time of a program, until the first output or the end of the block."""
        self._program, self._share = program, None
        if sys.stderr.isatty():
            self._over.clear()
            self._thread = threading.Thread(target=self._run, name="at work", daemon=True)
            self._thread.start()
        try:
            yield self
        finally:
            self.end()

    def show(self, share: float) -> None:
        """Show from now on which share of the work is done, 0…1."""
        self._share = share

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
            share = "" if self._share is None else f"{_bar(self._share)} {self._share:4.0%}, "
            self._write(f"{_ERASE}{self._program}: {share}at work for {worked_s:.0f} s")
            pause_s, shown = _EVERY_S, True
        if shown:
            self._write(_ERASE)

    def _write(self, text: str) -> None:
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except (OSError, ValueError):  # the terminal has gone
            self._over.set()


def _bar(share: float) -> str:
    done = round(share * _BAR)
    return f"[{'=' * done}{' ' * (_BAR - done)}]"


AT_WORK: Final = AtWork()
"""The instance of the process."""
