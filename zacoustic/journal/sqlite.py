"""A store in a file: what it has kept survives ``kill -9`` and the loss of power.

A commit is one transaction, on the disk when it returns (see `file` for how). The file does not
grow beyond a limit: pages of deleted entries are used again, and a commit that would need more is
refused, all of it, until something has been deleted.
"""

import os
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from zacoustic.core.journal import EPOCH_KEY, JournalWrite
from zacoustic.journal.file import (
    complaining,
    crc_of,
    one_line,
    open_file,
    read_entries,
    transaction,
)
from zacoustic.journal.port import JournalState, next_epoch

LIMIT_BYTES: Final = 64 * 1024 * 1024
"""Size that the file may have; its log may have as much again while a commit that large runs."""

_PUT: Final = (
    "INSERT INTO entry VALUES (?, ?, ?)"
    " ON CONFLICT (key) DO UPDATE SET value = excluded.value, crc = excluded.crc"
)
_DELETE: Final = "DELETE FROM entry WHERE key = ?"


class SqliteJournal:
    """A journal in one file for one node.

    Args:
        path: The file; made by `recover` if it is missing, with its folder.
        address: Acoustic address of the node. The file of another one is refused.
        limit_bytes: Size that the file may have.
    """

    def __init__(self, path: str | Path, address: int, *, limit_bytes: int = LIMIT_BYTES) -> None:
        # SQLite keeps its log beside the file itself, not beside a link to it.
        self.path = Path(os.path.realpath(path))
        """The file."""
        self._address = address
        self._limit_bytes = limit_bytes
        self._store: sqlite3.Connection | None = None
        self._identities: dict[Path, tuple[int, int]] = {}

    def recover(self) -> JournalState:
        """Open the file and begin a life: the next epoch, safe on the disk, and what was kept.

        Raises:
            ConfigError: The file is in use, damaged, somebody else's, or cannot be written; nothing
                in it was changed.
        """
        self.close()
        store = open_file(self.path, self._address, limit_bytes=self._limit_bytes)
        try:
            entries = read_entries(store, self.path)
            epoch = next_epoch(entries)
            entries[EPOCH_KEY] = epoch.to_bytes(2, "big")
            with complaining(self.path), transaction(store):
                _put(store, EPOCH_KEY, entries[EPOCH_KEY])
            self._identities = {path: _identity(path) for path in self._files()}
        except BaseException:
            store.close()
            raise
        self._store = store
        return JournalState(boot_epoch=epoch, entries=entries)

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Keep these writes, all or none; they are on the disk when this returns.

        Raises:
            OSError: None of them could be kept: the disk or the file is full, or cannot be written.
        """
        store = self._store
        if store is None:
            raise OSError(f"journal {self.path} is not open")
        self._check_presence()
        try:
            with transaction(store):
                for key, value in {write.key: write.value for write in writes}.items():
                    if value is None:
                        store.execute(_DELETE, (key,))
                    else:
                        _put(store, key, value)
        except (sqlite3.Error, UnicodeError) as error:
            raise OSError(f"journal {self.path}: {self._reason(store, error)}") from error

    def close(self) -> None:
        """Release the file. May be called again."""
        store, self._store = self._store, None
        if store is not None:
            store.close()

    def _files(self) -> tuple[Path, Path]:
        return self.path, self.path.with_name(f"{self.path.name}-wal")

    def _check_presence(self) -> None:
        """See that the files are still there: SQLite goes on writing to deleted ones.

        Raises:
            OSError: They are not.
        """
        for path, identity in self._identities.items():
            try:
                is_there = _identity(path) == identity
            except FileNotFoundError:
                is_there = False
            if not is_there:
                raise OSError(f"journal {path}: deleted or replaced while it was in use")

    def _reason(self, store: sqlite3.Connection, error: Exception) -> str:
        if getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_FULL:
            (pages,) = store.execute("PRAGMA page_count").fetchone()
            (page_bytes,) = store.execute("PRAGMA page_size").fetchone()
            (most,) = store.execute("PRAGMA max_page_count").fetchone()
            (free,) = store.execute("PRAGMA freelist_count").fetchone()
            used_bytes, most_bytes = (pages - free) * page_bytes, most * page_bytes
            return f"{one_line(error)} ({used_bytes} bytes in use of {most_bytes})"
        return one_line(error)


def journal_in(folder: str | Path, address: int) -> SqliteJournal:
    """Return the journal of a node in a folder: its file is ``node-ADDRESS.sqlite``."""
    return SqliteJournal(Path(folder) / f"node-{address}.sqlite", address)


def _put(store: sqlite3.Connection, key: str, value: bytes) -> None:
    store.execute(_PUT, (key, value, crc_of(key, value)))


def _identity(path: Path) -> tuple[int, int]:
    found = os.stat(path)
    return found.st_dev, found.st_ino
