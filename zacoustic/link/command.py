"""The contract of a verb of the command line, for our own verbs and those of link packages.

A package registers a verb in the entry-point group `zacoustic.commands`, name → class. The command
line finds it through `zacoustic.link.registry.commands` and knows nothing else about it.

Packages that do not know each other may share a verb: names with the same part before a dot become
one verb with sub-verbs. `zacoustic run modems desert` runs `emulate.desert`: modems of all packages
are one group.
"""

import argparse
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from zacoustic.text.helptext import HelpFormatter

EXIT_OK: Final = 0
"""The verb has done its work."""
EXIT_FAILED: Final = 1
"""The verb tried and failed; the reason is on standard error."""
EXIT_USAGE: Final = 2
"""The arguments, or a file that they name, are wrong; the verb tried nothing."""
EXIT_TIMED_OUT: Final = 3
"""No answer came within the time that the user gave."""
EXIT_INTERRUPTED: Final = 130
"""Ctrl-C ended the verb: 128 plus the number of SIGINT, as in shells."""


class Command(ABC):
    """One verb of the command line; built without arguments.

    Must define: `name`, `summary`, `add_arguments`, `run`. Heavy imports belong in `run`: every
    start of the command line builds every verb.
    """

    name: ClassVar[str]
    """The word that the user types; for a sub-verb the last one."""
    summary: ClassVar[str]
    """One line for the list of verbs, without a full stop."""

    prints_late: ClassVar[bool] = False
    """Whether it may take its time before it prints; until it does, the terminal shows its running
    time."""

    @abstractmethod
    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments of this verb on its own parser."""

    @abstractmethod
    def run(self, arguments: argparse.Namespace) -> int:
        """Run the verb and return the exit code; called once, on the main thread.

        Raises:
            ZacousticError: The command line prints it, with its hint, and exits with 1, or with 2
                for a `ConfigError`.
        """


class CommandGroup(Command):
    """A verb with sub-verbs, each of which may come from another package.

    Args:
        name: The word that the user types.
        members: Sub-verbs by name: all of them for a list, otherwise the one that is called.
        known: Names of all sub-verbs.
        summary: One line for the list of verbs; None: the names of the sub-verbs.
    """

    def __init__(
        self,
        name: str,
        members: Mapping[str, Command],
        known: tuple[str, ...],
        summary: str | None = None,
    ) -> None:
        # Set on the instance, not on the class: each group is another verb.
        self.name = name  # type: ignore[misc]
        if summary is None:
            summary = f"{', '.join(known)}: see zacoustic {name} --help"
        self.summary = summary  # type: ignore[misc]
        self._members = members
        self._chosen = f"{name} verb"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the sub-verbs, with their arguments."""
        parser.description = "Sub-verbs, each with its own --help."
        choices = parser.add_subparsers(dest=self._chosen, metavar="VERB", required=True)
        for name, member in self._members.items():
            add_command(choices, name, member)
        if self._members:
            parser.epilog = f"example:\n  {parser.prog} {next(iter(self._members))} --help"

    def run(self, arguments: argparse.Namespace) -> int:
        """Run the sub-verb that was called."""
        return self.chosen(arguments).run(arguments)

    def chosen(self, arguments: argparse.Namespace) -> Command:
        """Return the sub-verb that was called."""
        return self._members[getattr(arguments, self._chosen)]


def add_command(choices: "argparse._SubParsersAction[Any]", name: str, command: Command) -> None:
    """Add a verb to a parser, under a name."""
    summary = command.summary
    parser: argparse.ArgumentParser = choices.add_parser(
        name,
        help=summary.replace("%", "%%"),
        description=f"{summary[:1].upper()}{summary[1:]}.",
        formatter_class=HelpFormatter,
        allow_abbrev=False,
    )
    command.add_arguments(parser)
