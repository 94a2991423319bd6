"""Output files of verbs: only new ones, so that no file of the user is lost."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from zacoustic.errors import ConfigError


@contextlib.contextmanager
def new_file(option: str, path: Path | None) -> Iterator[IO[bytes] | None]:
    """Make a file before the work whose result it takes; delete it after an error.

    What is not a regular file (a pipe, the null device) is written directly.

    Args:
        option: The option as the user has written it.
        path: The file; None: none is wanted, and the result is None.

    Raises:
        ConfigError: It exists, or cannot be made.
    """
    if path is None:
        yield None
        return
    is_device = path.exists() and not (path.is_file() or path.is_dir())
    try:
        file = path.open("wb" if is_device else "xb")
    except FileExistsError as error:
        hint = "give another name, or move that away"
        raise ConfigError(f"{option} {path} exists; allowed: a new file", hint=hint) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"{option} {path}: {reason}") from error
    try:
        with file:
            yield file
    except BaseException as error:
        # Keep the file of an interrupted run: the trace of hours may be useful.
        is_of_use = isinstance(error, KeyboardInterrupt) and path.stat().st_size > 0
        if not (is_device or is_of_use):
            path.unlink(missing_ok=True)
        raise
