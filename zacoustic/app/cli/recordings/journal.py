"""The verb `zacoustic journal`."""

from pathlib import Path
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.rows import OBJECT_PER_LINE, flag, whole, word
from zacoustic.app.cli.support.verb import Verb
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.run.journal.backup import JournalReport


class Journal(Verb):
    """Copy a journal while its node runs, or check one.

    Examples:
      zacoustic journal check journal/node-2.sqlite              in order? exit code 1: in doubt
      zacoustic journal backup journal/node-2.sqlite copy.sqlite   also while its node runs
      zacoustic journal check copy.sqlite --json

    To put a copy back: stop the node, delete node-2.sqlite and node-2.sqlite-wal, put the copy in the
    place of the first, start the node. Its health messages report what was found.
    """  # noqa: E501 (wide on a terminal)

    task: str = word(None, "what to do", choices=("backup", "check"))
    journal: Path = word("FILE", "file of the journal", type=Path)
    copy: Path | None = word("COPY", "of backup: the file to make", "?", type=Path)
    address: int | None = whole("N", "of check: the node that it is to be of")
    json: bool = flag(OBJECT_PER_LINE)

    def work(self) -> int:
        """Run the operation and print the contents; exit code 1 if the journal is in doubt.

        Raises:
            ConfigError: An argument is wrong, or the file does not exist.
            BackupError: No copy could be made.
        """
        from zacoustic.run.journal.backup import backup, check

        if (self.task == "backup") != (self.copy is not None):
            raise ConfigError("COPY; allowed: with backup, and needed there")
        report: JournalReport
        if self.copy is None:
            report = check(self.journal, self.address)
        elif self.address is not None:
            raise ConfigError("--address; allowed: with check")
        else:
            report = backup(self.journal, self.copy)
        self.show(report, _as_text)
        return EXIT_FAILED if report.doubt else EXIT_OK


def _as_text(report: "JournalReport") -> str:
    return "\n".join(one_line(line) for line in report.lines())
