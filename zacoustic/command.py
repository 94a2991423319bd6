"""A verb, as links that bring one see it: `zacoustic.link.command`."""

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
