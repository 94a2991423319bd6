"""A store in a file: its entries survive ``kill -9`` and a power cut.

A commit is one transaction and on the disk when it returns (`file` tells how). The file has a size
limit: the space of deleted entries is used again, and a commit that needs more is refused as a
whole until entries have been deleted.

The node starts whatever the state of its files: a vehicle that does not start because of a bad bit
on its disk is lost. Damaged files are renamed, never deleted, and a new journal begins with their
valid entries. If the disk cannot be written at the start, each commit tries again. Only a file in
use by another process is refused.
"""

import contextlib
import errno
import os
import re
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from zacoustic.core.base.journal import EPOCH_KEY, JournalWrite
from zacoustic.errors import ConfigError
from zacoustic.run.journal.file import LIMIT_BYTES, JournalFile, make_folder, sync_folder
from zacoustic.run.journal.inspection import Found, commits_of, inspect, log_path, one_line
from zacoustic.run.journal.mark import Mark, Marked, mark_path
from zacoustic.run.journal.port import JournalState, begin_life

_MOST_ASIDE: Final = 3
"""Most damaged journals that are left for inspection."""
_MAY_PASS: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG)
"""Errors of a full or faulty disk: the node goes on without it meanwhile."""


class SqliteJournal:
    """A journal in one file for one node.

    Args:
        path: The file; `recover` makes it, with its folder, if it is missing.
        address: Acoustic address of the node; the file of another node is not used.
        limit_bytes: Largest size of the file.
    """

    def __init__(self, path: str | Path, address: int, *, limit_bytes: int = LIMIT_BYTES) -> None:
        # SQLite puts its log beside the target of a symbolic link, not beside the link.
        self.path = Path(os.path.realpath(path))
        """The file."""
        self._address = address
        self._limit_bytes = limit_bytes
        self._mark: Mark | None = None
        self._found: Found | None = None
        self._begun: dict[str, bytes | None] = {}
        self._file: JournalFile | None = None
        self._identities: dict[Path, tuple[int, int]] = {}

    def recover(self) -> JournalState:
        """Begin a boot epoch, write its number to the disk, and return it with the entries.

        Raises:
            ConfigError: The file is in use, or its folder cannot be made.
        """
        self.close()
        failure = self._lock()
        try:
            self._found = found = self._inspect()
            doubt = found.doubt and f"journal {self.path}: {found.doubt}"
            life = begin_life(found.entries, doubt)
            is_new = found.node is None or bool(found.fault)
            self._begun = {
                key: value
                for key, value in life.entries.items()
                if is_new or found.entries.get(key) != value
            }
            if not failure:
                try:
                    self._open()
                except OSError as error:
                    failure = str(error)
        except BaseException:
            self.close()
            raise
        return JournalState(
            boot_epoch=int.from_bytes(life.entries[EPOCH_KEY], "big"),
            entries=life.entries,
            is_restart=bool(found.entries),
            doubt=doubt,
            failure=failure,
        )

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Store these writes, all or none; on return they are on the disk.

        Raises:
            OSError: Nothing was stored: the disk or the file is full, or cannot be written.
        """
        if self._found is None:
            raise OSError(f"journal {self.path} is not open")
        if self._file is None:
            if self._mark is None and (failure := self._lock()):
                raise OSError(failure)
            self._open()
        self._check_presence()
        self._commit({write.key: write.value for write in writes})

    def close(self) -> None:
        """Release the file. May be called again."""
        file, self._file = self._file, None
        self._found = None
        if file is not None:
            file.close()
        mark, self._mark = self._mark, None
        if mark is not None:
            mark.close()

    def _lock(self) -> str:
        """Lock the mark; return why that is not possible now, or an empty text.

        Raises:
            ConfigError: Another node holds it, or the path cannot be a file.
        """
        try:
            make_folder(self.path.parent)
        except OSError as error:
            if error.errno in _MAY_PASS:
                return f"journal {self.path}: {error.strerror or error}"
            raise ConfigError(
                f"journal: the folder {self.path.parent} cannot be made: {error.strerror or error}",
                hint="name another folder, or make it for this user",
            ) from error
        try:
            self._mark = Mark(self.path)
        except BlockingIOError as error:
            raise self._in_use() from error
        except OSError as error:
            if error.errno in _MAY_PASS:
                return f"journal {self.path}: {error.strerror or error}"
            raise ConfigError(
                f"journal {self.path}: {mark_path(self.path)} cannot be opened: "
                f"{error.strerror or error}",
                hint="may this user read and write it?",
            ) from error
        return ""

    def _inspect(self) -> Found:
        marked = None if self._mark is None else self._mark.read()
        try:
            return inspect(self.path, self._address, marked)
        except OSError as error:
            why = f"it cannot be read: {error.strerror or error}"
            return Found(fault=why, doubt=why)

    def _open(self) -> None:
        """Open or make the file, and write the new boot epoch.

        Raises:
            OSError: It cannot be opened, made or written now.
            ConfigError: Another process uses it.
        """
        found, mark = self._found, self._mark
        assert found is not None
        assert mark is not None
        node = found.node if found.has_file and not found.fault else None
        try:
            if found.fault:
                self._set_aside()
            elif not found.has_file:
                _delete(log_path(self.path))
            self._file = JournalFile(
                self.path,
                node,
                self._address,
                commits=commits_of(found, mark.read()),
                limit_bytes=self._limit_bytes,
            )
        except sqlite3.Error as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY:
                raise self._in_use() from error
            raise OSError(f"journal {self.path}: {one_line(error)}") from error
        found.has_file, found.fault = False, ""
        try:
            if node is None and not found.doubt:
                self._begin_mark(self._file, mark)
            self._commit(self._begun)
        except BaseException:
            self._file.close()
            self._file = None
            found.has_file, found.node = node is not None, node
            raise
        self._identities = {each: _identity(each) for each in self._files()}

    def _begin_mark(self, file: JournalFile, mark: Mark) -> None:
        """Write the mark of a new journal, before its first commit.

        Raises:
            OSError: It cannot be written now.
        """
        mark.write(Marked(self._address, file.node.identity, file.node.commits))
        mark.sync()
        sync_folder(self.path.parent)

    def _commit(self, values: dict[str, bytes | None]) -> None:
        file, mark = self._file, self._mark
        assert file is not None
        assert mark is not None
        try:
            file.commit(values)
        except (sqlite3.Error, UnicodeError) as error:
            raise OSError(f"journal {self.path}: {self._reason(file, error)}") from error
        # Not synced: no promise depends on it, and the commit itself is safe.
        with contextlib.suppress(OSError):
            mark.write(Marked(self._address, file.node.identity, file.node.commits))

    def _set_aside(self) -> None:
        """Rename damaged files."""
        pattern = re.compile(re.escape(self.path.name) + r"\.damaged-(\d+)")
        numbers = sorted(
            int(found[1])
            for each in self.path.parent.iterdir()
            if (found := pattern.fullmatch(each.name)) is not None
        )
        aside = self.path.with_name(f"{self.path.name}.damaged-{numbers[-1] + 1 if numbers else 1}")
        for path in (self.path, log_path(self.path)):
            with contextlib.suppress(FileNotFoundError):
                path.rename(aside if path == self.path else log_path(aside))
        for number in numbers[: 1 - _MOST_ASIDE]:
            old = self.path.with_name(f"{self.path.name}.damaged-{number}")
            for path in (old, log_path(old)):
                _delete(path)
        sync_folder(self.path.parent)

    def _files(self) -> tuple[Path, ...]:
        return self.path, log_path(self.path), mark_path(self.path)

    def _check_presence(self) -> None:
        """Check that the files still exist: SQLite would go on writing to deleted ones.

        Raises:
            OSError: They do not.
        """
        for path, identity in self._identities.items():
            try:
                is_there = _identity(path) == identity
            except FileNotFoundError:
                is_there = False
            if not is_there:
                raise OSError(f"journal {path}: deleted or replaced while it was in use")

    def _in_use(self) -> ConfigError:
        return ConfigError(
            f"journal {self.path}: is in use by another node or process",
            hint="stop that one, or give each node an address of its own",
        )

    def _reason(self, file: JournalFile, error: Exception) -> str:
        if getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_FULL:
            used_bytes, most_bytes = file.room()
            return f"{one_line(error)} ({used_bytes} bytes in use of {most_bytes})"
        return one_line(error)


def journal_in(folder: str | Path, address: int) -> SqliteJournal:
    """Return the journal of a node in a folder: the file ``node-ADDRESS.sqlite``."""
    return SqliteJournal(Path(folder) / f"node-{address}.sqlite", address)


def _identity(path: Path) -> tuple[int, int]:
    found = os.stat(path)
    return found.st_dev, found.st_ino


def _delete(path: Path) -> None:
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
