"""Files that verbs make: new ones only, so that nothing is lost that a user has."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from zacoustic.errors import ConfigError


@contextlib.contextmanager
def new_file(option: str, path: Path | None) -> Iterator[IO[bytes] | None]:
    """Make a file, before the work whose result it takes; after an error it is not there.

    What is no file (a pipe, the null device) is written as it is.

    Args:
        option: As the user has written it.
        path: The file; None: none is wanted, and none is given.

    Raises:
        ConfigError: It is there already, or cannot be made.
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
        # What an interrupt leaves may be of use: the trace of hours.
        is_of_use = isinstance(error, KeyboardInterrupt) and path.stat().st_size > 0
        if not (is_device or is_of_use):
            path.unlink(missing_ok=True)
        raise
