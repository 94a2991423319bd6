"""The contract of a verb of the command line, for our own and for those of link packages.

A package registers a verb in the entry-point group `zacoustic.commands`, name → class; the command
line finds it through `zacoustic.registry.commands` and knows nothing else about it.
"""

import argparse
from abc import ABC, abstractmethod
from typing import ClassVar, Final

EXIT_OK: Final = 0
"""The verb did what it was asked."""
EXIT_FAILED: Final = 1
"""It tried, and it did not work; the reason is on standard error."""
EXIT_USAGE: Final = 2
"""The arguments or a file that they name are wrong; nothing was tried."""
EXIT_TIMED_OUT: Final = 3
"""No answer within the time that the user gave."""


class Command(ABC):
    """One verb of the command line; built without arguments.

    Must define: `name`, `summary`, `add_arguments`, `run`. Heavy imports belong into `run`: every
    start of the command line builds every verb.
    """

    name: ClassVar[str]
    """What the user types."""
    summary: ClassVar[str]
    """One line for the list of verbs, without a full stop."""

    @abstractmethod
    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments of this verb on its own parser."""

    @abstractmethod
    def run(self, arguments: argparse.Namespace) -> int:
        """Do it, and return the exit code; called once, on the main thread.

        Raises:
            ZacousticError: The command line prints it, with its hint, and exits with 1, or with 2
                for a `ConfigError`.
        """
