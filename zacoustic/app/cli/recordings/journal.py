"""The verb `zacoustic journal`: copies or checks a journal."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Final

from zacoustic.app.cli.support.arguments import OBJECT_PER_LINE, add_json
from zacoustic.app.cli.support.printing import print_result
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.run.journal.backup import JournalReport

_EXAMPLE: Final = """examples:
  zacoustic journal check journal/node-2.sqlite              in order? exit code 1: in doubt
  zacoustic journal backup journal/node-2.sqlite copy.sqlite   also while its node runs
  zacoustic journal check copy.sqlite --json

To put a copy back: stop the node, delete node-2.sqlite and node-2.sqlite-wal, put the copy in the
place of the first, start the node. Its health messages report what was found.
"""


class JournalCommand(Command):
    """Copies or checks a journal."""

    name = "journal"
    summary = "copy a journal while its node runs, or check one"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare what to do, and the files."""
        parser.epilog = _EXAMPLE
        parser.add_argument("task", choices=("backup", "check"), help="what to do")
        parser.add_argument("journal", metavar="FILE", type=Path, help="file of the journal")
        parser.add_argument(
            "copy", metavar="COPY", type=Path, nargs="?", help="of backup: the file to make"
        )
        parser.add_argument(
            "--address", type=int, metavar="N", help="of check: the node that it is to be of"
        )
        add_json(parser, OBJECT_PER_LINE)

    def run(self, arguments: argparse.Namespace) -> int:
        """Run the operation and print the contents; exit code 1 if the journal is in doubt.

        Raises:
            ConfigError: An argument is wrong, or the file does not exist.
            BackupError: No copy could be made.
        """
        from zacoustic.run.journal.backup import backup, check

        if (arguments.task == "backup") != (arguments.copy is not None):
            raise ConfigError("COPY; allowed: with backup, and needed there")
        report: JournalReport
        if arguments.task == "backup":
            if arguments.address is not None:
                raise ConfigError("--address; allowed: with check")
            report = backup(arguments.journal, arguments.copy)
        else:
            report = check(arguments.journal, arguments.address)
        print_result(report, _as_text, as_json=arguments.json)
        return EXIT_FAILED if report.doubt else EXIT_OK


def _as_text(report: "JournalReport") -> str:
    return "\n".join(one_line(line) for line in report.lines())
