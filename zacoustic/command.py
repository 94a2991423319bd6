"""Public names for programs and for links with verbs of their own: `zacoustic.link.command`.

What runs until Ctrl-C is imported on first use, since it needs asyncio.
"""

from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from zacoustic.link.serving import run_until_stopped, stopped_by_signals, until_stopped

__all__ = [
    "EXIT_FAILED",
    "EXIT_INTERRUPTED",
    "EXIT_OK",
    "EXIT_TIMED_OUT",
    "EXIT_USAGE",
    "Command",
    "CommandGroup",
    "add_command",
    "run_until_stopped",
    "stopped_by_signals",
    "until_stopped",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    if name in __all__:
        from zacoustic.link import serving

        return getattr(serving, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
