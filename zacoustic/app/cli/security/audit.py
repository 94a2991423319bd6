"""The verb `zacoustic audit`."""

from pathlib import Path
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.rows import OBJECT_PER_LINE, flag, whole, word
from zacoustic.app.cli.support.verb import Verb
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK

if TYPE_CHECKING:
    from zacoustic.run.audit import AuditEntry


class Audit(Verb):
    """Who commanded, called or refused what, when, and what came of it.

    a gateway or node with a journal keeps it beside that, for its owner alone. Values
    are not in it. Without a seal an address is what a frame claims

    Example:
      zacoustic audit journal/node-2.audit --by 1
    """

    log: Path = word("FILE", "node-N.audit, by the journal", type=Path)
    by: int | None = whole("N", "only what node N wanted; 0: this side")
    refused: bool = flag("only what was refused, or has failed")
    json: bool = flag(OBJECT_PER_LINE)

    def work(self) -> int:
        """Print the lines; fails if there are none.

        Raises:
            ConfigError: There is no such log.
        """
        import msgspec

        from zacoustic.run.audit import read_audit

        number = 0
        try:
            for entry in read_audit(self.log):
                is_wanted = self.by in (None, entry.by)
                if is_wanted and (not self.refused or _is_refused(entry)):
                    self.line(msgspec.to_builtins(entry), _text(entry))
                    number += 1
        except OSError as error:
            raise ConfigError(
                f"{self.log}: {error.strerror}", hint="it lies beside the journal, node-N.sqlite"
            ) from error
        if not number:
            self.note(f"{self.log}: no such lines")
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
