"""`Intact`: the engine of a new boot epoch, made from the usable entries of the journal.

The checks of a store prove that an entry is what was written. They do not prove that this program
can read it: another version may have written it, or it belongs to another table, or this version
has a bug. One such entry must not keep a node from starting. So if an engine raises while it is
made, or in its first step, this module bisects the entries until each part that raises is a single
entry. The engine gets all others, and a doubt about its memory, so that it refuses what it may have
executed before instead of executing it twice (`zacoustic.core.peers.doubt`).
"""

import logging
from collections.abc import Callable, Mapping, Set
from typing import Final, TypeAlias

from zacoustic.core.base.journal import (
    BOOT_KEY,
    DOUBT_KEY,
    EPOCH_KEY,
    LIFE_KEY,
    VOLATILE_KEY,
    JournalWrite,
)
from zacoustic.core.engine.engine import Engine
from zacoustic.run.journal.thread import NO_WRITE

Renew: TypeAlias = Callable[[int, Mapping[str, bytes]], Engine]
"""``(epoch, stored)``: makes an engine like the former one from the journal's entries."""
Trial: TypeAlias = Callable[[Engine], None]
"""Does the first step with a disposable engine."""

_OF_THE_LIFE: Final = frozenset({EPOCH_KEY, LIFE_KEY, DOUBT_KEY, BOOT_KEY, VOLATILE_KEY})
_LOGGED_BYTES: Final = 256
_logger = logging.getLogger(__name__)


class Intact:
    """A new engine, and the entries that it could not be made from.

    Args:
        renew: Makes an engine.
        epoch: The new boot epoch.
        entries: Entries of the journal.
        trial: The step in which an engine has raised, to test others; None: making one suffices.

    Raises:
        Exception: No engine can be made, whatever the entries.
    """

    def __init__(
        self, renew: Renew, epoch: int, entries: Mapping[str, bytes], trial: Trial | None = None
    ) -> None:
        self.renew = renew
        """Makes an engine."""
        self._epoch = epoch
        self._trial = trial
        self.writes: list[JournalWrite] = []
        """Writes that delete the refused entries from the journal."""
        self.entries = dict(entries)
        """The usable entries."""
        if trial is None or not self._raises(self.entries):
            try:
                self.engine = renew(epoch, self.entries)
                return
            except Exception as error:  # any exception of a bug or an entry
                self._sort(error)
        else:
            self._sort(None)
        self.engine = renew(epoch, self.entries)

    def _sort(self, error: Exception | None) -> None:
        """Remove the entries that raise.

        Raises:
            Exception: `error`, if the entries are not its cause.
        """
        known = _OF_THE_LIFE & self.entries.keys()
        if self._raises(self._only(known)):
            if error is not None:
                raise error
            return  # its first step raises without entries, too: they are not the cause
        refused: list[str] = []
        waiting = [[key for key in self.entries if key not in known]]
        while waiting:
            part = waiting.pop()
            more = known.union(part)
            if not self._raises(self._only(more)):
                known = more
            elif len(part) == 1:
                refused += part
            else:
                half = len(part) // 2
                waiting += [part[half:], part[:half]]
        for key in refused:
            value = self.entries[key]
            _logger.error(
                "journal: no engine can be made of entry %s, which is left out and deleted: %s%s",
                key,
                value[:_LOGGED_BYTES].hex(),
                f"… ({len(value)} bytes)" if len(value) > _LOGGED_BYTES else "",
            )
        if not refused:
            return
        kinds = ", ".join(sorted({key.split("/")[0] for key in refused}))
        reason = f"{len(refused)} entries of the journal cannot be used and were left out: {kinds}"
        self.entries = self._only(known) | {DOUBT_KEY: reason.encode()}
        changes = dict.fromkeys(refused) | {DOUBT_KEY: reason.encode()}
        self.writes = [
            JournalWrite(write_id=NO_WRITE, key=key, value=value) for key, value in changes.items()
        ]

    def _only(self, keys: Set[str]) -> dict[str, bytes]:
        """Return some of the entries, in order."""
        return {key: each for key, each in self.entries.items() if key in keys}

    def _raises(self, entries: Mapping[str, bytes]) -> bool:
        try:
            engine = self.renew(self._epoch, dict(entries))
            if self._trial is not None:
                self._trial(engine)
        except Exception:  # any exception is the answer
            return True
        return False
