"""Files that only their owner may read, because they hold all that crossed the channel.

Journals and recordings contain positions, commands and photos. To share a recording, change its
mode with ``chmod``; a journal becomes private again at each start.
"""

import contextlib
import os
from pathlib import Path
from typing import IO, Final

MODE: Final = 0o600
"""Read and write, for the owner."""


def create_private(path: Path) -> IO[bytes]:
    """Create a file that must not exist yet, and open it for writing.

    Raises:
        OSError: It exists, or cannot be made.
    """
    return open(path, "xb", opener=lambda name, flags: os.open(name, flags, MODE))


def keep_private(path: Path) -> None:
    """Create an empty private file if it is missing; otherwise make it private.

    Ignores errors: the caller opens the file next and reports them.
    """
    with contextlib.suppress(OSError):
        os.close(os.open(path, os.O_RDWR | os.O_CREAT, MODE))
        path.chmod(MODE)
