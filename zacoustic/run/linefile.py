"""`LineFile`: a file to which a thread of its own appends lines.

File operations may block, so a thread writes the lines in order and flushes each. A file that
cannot be opened is an error at the start. One that later cannot be written causes one warning, and
each new line repeats the attempt: a full disk must not silence a node at sea.
"""

import asyncio
import logging
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

_WAITING_LIMIT: Final = 10_000  # lines while the disk is full: hours of them

_logger = logging.getLogger(__name__)


class LineFile:
    """The file and its thread.

    Args:
        path: The file; made with its folder if it is missing.
        name: Its purpose, for the log.
        most_bytes: A longer file is renamed to ``PATH.1`` before the next line; None: no limit.

    Raises:
        OSError: It cannot be appended to.
    """

    def __init__(self, path: Path, name: str, *, most_bytes: int | None = None) -> None:
        self._path = path
        self._name = name
        self._most_bytes = most_bytes
        self._waiting: deque[bytes] = deque(maxlen=_WAITING_LIMIT)
        self._fails = False
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab"):
            pass
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)

    def append(self, line: bytes) -> None:
        """Append a line, given without its line end; does not block."""
        self._thread.submit(self._append, line + b"\n")

    async def close(self) -> None:
        """Write the waiting lines and end the thread."""
        await asyncio.wrap_future(self._thread.submit(lambda: None))  # runs after all others
        self._thread.shutdown()

    def _append(self, line: bytes) -> None:
        self._waiting.append(line)
        try:
            if self._most_bytes is not None and self._path.stat().st_size >= self._most_bytes:
                self._path.replace(self._path.with_name(f"{self._path.name}.1"))
            with self._path.open("ab") as file:
                file.write(b"".join(self._waiting))
        except OSError as error:
            if not self._fails:
                _logger.warning("%s %s: %s; trying again", self._name, self._path, error.strerror)
            self._fails = True
            return
        self._waiting.clear()
        self._fails = False
