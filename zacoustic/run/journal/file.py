"""The file of a journal: how it is made, opened and written.

It is an SQLite database with two tables. `entry` has a check in each row, since SQLite has none on
its pages. `node` has one row: address, number of commits, and the sum of the checks of all entries,
which reveals a missing or outdated part (`inspection`). `application_id` marks the file as a
journal, `user_version` is its format.

The settings of SQLite, and why:

- `journal_mode` WAL. A commit appends to one file and waits for the disk once; the rollback journal
  waits three or four times, each tens of milliseconds on the cards of small computers. Each frame
  of the log has a running check, so a log that a power cut has truncated or torn ends with its last
  whole commit.
- `synchronous` FULL: wait at the end of each commit, not at the next checkpoint. On macOS also
  flush the disk's own cache.
- ``psow=0``: pad each commit to the end of a disk sector, because a power cut may damage the sector
  that is being written; no later write then touches a sector of an earlier commit.
- `locking_mode` EXCLUSIVE: refuse a second process. The kernel releases the lock when the process
  ends, and no shared memory is needed, which network file systems lack.
"""

import contextlib
import os
import secrets
import sqlite3
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.run.journal.image import PAGE_BYTES
from zacoustic.run.journal.inspection import APPLICATION_ID, FORMAT, Node, added, check_of
from zacoustic.run.privatefile import keep_private

LIMIT_BYTES: Final = 64 * 1024 * 1024
"""Largest size of a file; its log may need as much again during a commit of that size."""

_SCHEMA: Final = (
    "CREATE TABLE node (address INTEGER NOT NULL, identity BLOB NOT NULL,"
    " commits INTEGER NOT NULL, entries_sum INTEGER NOT NULL, is_backup INTEGER NOT NULL,"
    " checksum INTEGER NOT NULL)",
    "CREATE TABLE entry (key TEXT PRIMARY KEY, value BLOB NOT NULL, checksum INTEGER NOT NULL)"
    " WITHOUT ROWID",
    f"PRAGMA application_id = {APPLICATION_ID}",
    f"PRAGMA user_version = {FORMAT}",
)
_PUT: Final = (
    "INSERT INTO entry VALUES (?, ?, ?) ON CONFLICT (key)"
    " DO UPDATE SET value = excluded.value, checksum = excluded.checksum"
)
_SET_NODE: Final = "UPDATE node SET commits = ?, entries_sum = ?, is_backup = ?, checksum = ?"
_IDENTITY_BYTES: Final = 8


class JournalFile:
    """The file of a journal, open and locked.

    Args:
        path: The file; made if it is missing, empty until the first commit.
        node: Its description of itself; None: it is new.
        address: The node.
        commits: Least number of commits, known from any file.
        limit_bytes: Largest size.

    Raises:
        sqlite3.Error: The file cannot be opened, or is in use.
    """

    def __init__(
        self,
        path: Path,
        node: Node | None,
        address: int,
        *,
        commits: int = 0,
        limit_bytes: int = LIMIT_BYTES,
    ) -> None:
        self.path = path
        node = node or Node(address, secrets.token_bytes(_IDENTITY_BYTES), 0, 0, False)
        self.node = msgspec.structs.replace(node, commits=max(node.commits, commits))
        """The file's description of itself."""
        keep_private(path)  # SQLite copies the mode of the file to its log
        with contextlib.ExitStack() as unless_ready:
            # Transactions begin explicitly; calls come from any thread, one at a time.
            self._store = store = sqlite3.connect(
                f"{path.absolute().as_uri()}?psow=0",
                uri=True,
                timeout=0.0,
                isolation_level=None,
                check_same_thread=False,
            )
            unless_ready.callback(store.close)
            store.execute("PRAGMA locking_mode = EXCLUSIVE")
            # Takes the lock at once, so that one of two processes started together gets it.
            store.execute("BEGIN EXCLUSIVE")
            store.execute("ROLLBACK")
            store.execute(f"PRAGMA page_size = {PAGE_BYTES}")
            store.execute("PRAGMA journal_mode = WAL")
            store.execute("PRAGMA synchronous = FULL")
            store.execute("PRAGMA fullfsync = ON")
            store.execute("PRAGMA checkpoint_fullfsync = ON")
            store.execute(f"PRAGMA max_page_count = {max(1, limit_bytes // PAGE_BYTES)}")
            unless_ready.pop_all()

    def commit(self, values: Mapping[str, bytes | None], *, is_backup: bool = False) -> None:
        """Write these entries, all or none; None deletes an entry.

        Raises:
            sqlite3.Error, UnicodeError: Nothing was written.
        """
        with self._transaction():
            stored = self._stored() or self._make()
            entries_sum = stored.entries_sum
            for key, value in values.items():
                before = self._store.execute("SELECT checksum FROM entry WHERE key = ?", (key,))
                for (checksum,) in before.fetchall():
                    entries_sum = added(entries_sum, -checksum)
                if value is None:
                    self._store.execute("DELETE FROM entry WHERE key = ?", (key,))
                else:
                    checksum = check_of(key, value)
                    entries_sum = added(entries_sum, checksum)
                    self._store.execute(_PUT, (key, value, checksum))
            node = msgspec.structs.replace(
                stored,
                commits=max(stored.commits, self.node.commits) + 1,
                entries_sum=entries_sum,
                is_backup=is_backup,
            )
            self._store.execute(
                _SET_NODE, (node.commits, node.entries_sum, node.is_backup, node.check)
            )
        self.node = node

    def into_one_file(self) -> None:
        """Merge the log into the file and delete it."""
        self._store.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self._store.execute("PRAGMA journal_mode = DELETE")

    def room(self) -> tuple[int, int]:
        """Return the bytes in use and the limit."""
        (pages,) = self._store.execute("PRAGMA page_count").fetchone()
        (page_bytes,) = self._store.execute("PRAGMA page_size").fetchone()
        (most,) = self._store.execute("PRAGMA max_page_count").fetchone()
        (free,) = self._store.execute("PRAGMA freelist_count").fetchone()
        return (pages - free) * page_bytes, most * page_bytes

    def close(self) -> None:
        """Release the file."""
        self._store.close()

    def _stored(self) -> Node | None:
        """Return the file's description of itself; None: it is not made yet.

        A commit that failed on a faulty disk may be in the file all the same, so what this object
        wrote last does not count.
        """
        named = "SELECT count(*) FROM sqlite_master WHERE name = 'node'"
        if not self._store.execute(named).fetchone()[0]:
            return None
        row = self._store.execute(
            "SELECT address, identity, commits, entries_sum, is_backup FROM node"
        ).fetchone()
        return self.node if row is None else Node(*row)

    def _make(self) -> Node:
        for statement in _SCHEMA:
            self._store.execute(statement)
        node = self.node
        self._store.execute(
            "INSERT INTO node VALUES (?, ?, ?, ?, ?, ?)",
            (node.address, node.identity, 0, 0, False, node.check),
        )
        return node

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        """Commit the enclosed writes, all or none."""
        self._store.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._store.execute("COMMIT")
        except BaseException:
            # After some errors SQLite has rolled back already.
            with contextlib.suppress(sqlite3.Error):
                self._store.execute("ROLLBACK")
            raise


def make_folder(folder: Path) -> None:
    """Make a folder and sync it, so that it survives a power cut.

    Raises:
        OSError: It cannot be made.
    """
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for made in missing:
        sync_folder(made.parent)


def sync_folder(folder: Path) -> None:
    """Sync the directory entries of a folder to the disk."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows cannot open or sync folders
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
