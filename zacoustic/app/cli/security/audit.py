"""The verb `zacoustic audit`: who commanded what, when, and with what outcome."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.arguments import OBJECT_PER_LINE, add_json
from zacoustic.app.cli.support.printing import print_line, print_note
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command

if TYPE_CHECKING:
    from zacoustic.run.audit import AuditEntry


class AuditCommand(Command):
    """Prints the audit log of a node."""

    name = "audit"
    summary = "who commanded, called or refused what, when, and what came of it"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the log, and which lines."""
        parser.add_argument("log", metavar="FILE", type=Path, help="node-N.audit, by the journal")
        parser.add_argument(
            "--by", type=int, metavar="N", help="only what node N wanted; 0: this side"
        )
        parser.add_argument(
            "--refused", action="store_true", help="only what was refused, or has failed"
        )
        add_json(parser, OBJECT_PER_LINE)
        parser.epilog = (
            "a gateway or node with a journal keeps it beside that, for its owner alone. Values\n"
            "are not in it. Without a seal an address is what a frame claims\n\n"
            "example:\n  zacoustic audit journal/node-2.audit --by 1"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the lines; fails if there are none.

        Raises:
            ConfigError: There is no such log.
        """
        import msgspec

        from zacoustic.run.audit import read_audit

        number = 0
        try:
            for entry in read_audit(arguments.log):
                is_wanted = arguments.by in (None, entry.by)
                if is_wanted and (not arguments.refused or _is_refused(entry)):
                    print_line(msgspec.to_builtins(entry), _text(entry), as_json=arguments.json)
                    number += 1
        except OSError as error:
            raise ConfigError(
                f"{arguments.log}: {error.strerror}",
                hint="it lies beside the journal, node-N.sqlite",
            ) from error
        if not number:
            print_note(f"zacoustic audit: {arguments.log}: no such lines")
        return EXIT_OK if number else EXIT_FAILED


def _is_refused(entry: "AuditEntry") -> bool:
    return entry.what == "seal" or entry.outcome in ("refused", "failed", "aborted", "unknown")


def _text(entry: "AuditEntry") -> str:
    who = f"node {entry.by}" if entry.by else "here"
    doubt = "" if entry.sealed or not entry.by else " (claimed)"
    to = f" to node {entry.to}" if entry.to else ""
    about = f" {entry.about}" if entry.about else ""
    text = f": {entry.text}" if entry.text else ""
    return f"{entry.utc}  {who}{doubt}{to}  {entry.what}{about}  {entry.outcome}{text}"
