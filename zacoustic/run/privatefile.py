"""Files that only their owner may read: they hold all that crossed the channel.

Journals and recordings hold positions, commands and photos. To share one, use
``chmod``, of a recording; a journal is made private again at each start.
"""

import contextlib
import os
from pathlib import Path
from typing import IO, Final

MODE: Final = 0o600
"""Read and write, for the owner."""


def create_private(path: Path) -> IO[bytes]:
    """Make a file that must not be there yet, and open it for writing.

    Raises:
        OSError: It is there, or cannot be made.
    """
    return open(path, "xb", opener=lambda name, flags: os.open(name, flags, MODE))


def keep_private(path: Path) -> None:
    """Make a file empty and private where it is missing; take it away from others where it is not.

    Errors are left to the caller that opens the file, which reports them.
    """
    with contextlib.suppress(OSError):
        os.close(os.open(path, os.O_RDWR | os.O_CREAT, MODE))
        path.chmod(MODE)
