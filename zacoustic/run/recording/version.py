"""The version of the program that made a recording, beside that of the one that reads it."""

from importlib import metadata
from typing import Final

from zacoustic.errors import ConfigError

_LIBRARY: Final = "zacoustic "
"""Before the version, in the head of a file."""


def program() -> str:
    """Return the version of this program."""
    return metadata.version("zacoustic")


def library() -> str:
    """Return what the head of a file says of its maker."""
    return f"{_LIBRARY}{program()}"


def version_in(head: str) -> str:
    """Return the version in the head of a file; empty: another program made it."""
    return head.removeprefix(_LIBRARY) if head.startswith(_LIBRARY) else ""


def of_another_version(recorded_by: str, what: str) -> ConfigError:
    """Return the error for a part of a recording that this program cannot read.

    Args:
        recorded_by: Version of the program that made it; empty: unknown.
        what: What cannot be done, and why.
    """
    maker = f"zacoustic {recorded_by}" if recorded_by else "an unknown version"
    return ConfigError(
        f"recorded by {maker}, read by zacoustic {program()}: {what}",
        hint=f"replay it with {maker}; zacoustic report and decode need no engine",
    )
