"""Public names for links with verbs of their own: `zacoustic.link.command`."""

from zacoustic.link.command import (
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    EXIT_OK,
    EXIT_TIMED_OUT,
    EXIT_USAGE,
    Command,
    CommandGroup,
    add_command,
)

__all__ = [
    "EXIT_FAILED",
    "EXIT_INTERRUPTED",
    "EXIT_OK",
    "EXIT_TIMED_OUT",
    "EXIT_USAGE",
    "Command",
    "CommandGroup",
    "add_command",
]
