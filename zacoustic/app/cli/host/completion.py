"""The verb `zacoustic completion`: a script for completion in a shell."""

import argparse
from typing import Final

from zacoustic.app.cli.support.printing import print_text
from zacoustic.link.command import EXIT_OK, Command

SHELLS: Final = ("bash", "zsh", "fish")
"""Shells with a script."""

# Placeholders of files and folders in our parsers: the shell completes names there.
_FILES: Final = ("FILE", "RECORDING", "SCENARIO", "CONFIG", "MODEL", "PAGE", "HEX|FILE")
_FOLDERS: Final = ("FOLDER",)

_EXAMPLE: Final = """Make it anew after an update: it knows the verbs and options of this version,
and those of the link packages that are installed.

examples:
  zacoustic completion bash > ~/.local/share/bash-completion/completions/zacoustic
  zacoustic completion zsh > "${fpath[1]}/_zacoustic"
  zacoustic completion fish > ~/.config/fish/completions/zacoustic.fish
"""


class CompletionCommand(Command):
    """Prints a script for a shell."""

    name = "completion"
    summary = "print a script with which bash, zsh or fish completes the command line"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the shell."""
        parser.epilog = _EXAMPLE
        parser.add_argument("shell", choices=SHELLS, help="which shell")

    def run(self, arguments: argparse.Namespace) -> int:
        """Print it."""
        import shtab

        from zacoustic.app.cli import complete_parser

        parser = complete_parser()
        _name_files(parser)
        print_text(shtab.complete(parser, shell=arguments.shell))
        return EXIT_OK


def _name_files(parser: argparse.ArgumentParser) -> None:
    """Mark the arguments that are files, in a parser and those below it."""
    import shtab

    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                _name_files(below)
        elif action.metavar in _FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif action.metavar in _FOLDERS:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
