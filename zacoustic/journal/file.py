"""The file of a journal: how it is opened, known as ours, and refused.

An SQLite database with two tables: `entry`, with a check of its own in each row, since SQLite has
none on its pages; and `node`, one row with the acoustic address. `application_id` says that it is a
journal, `user_version` in which format.

How it is written, and why:

- `journal_mode` WAL. A commit appends to one file and waits for the disk once; the rollback journal
  needs three or four waits, each tens of milliseconds on the cards of small computers. Each frame
  of the log carries a running check, so a log that was cut short or torn by a loss of power ends
  with its last whole commit.
- `synchronous` FULL: the wait is at the end of each commit, not at the next checkpoint. On macOS
  also the disk's own cache is flushed.
- ``psow=0``: each commit is filled up to the end of a disk sector. So no later write touches a
  sector that holds an earlier commit: a loss of power may damage a sector that is being written.
- `locking_mode` EXCLUSIVE: a second process is refused, the kernel takes the lock away with the
  process, and no memory is shared, which file systems of networks cannot.

Nothing is changed in a file before it is known as ours.
"""

import contextlib
import os
import sqlite3
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NoReturn

from zacoustic.errors import ConfigError
from zacoustic.privatefile import keep_private

APPLICATION_ID: Final = 0x7A61636A  # "zacj"
"""Says in the file's header that it is a journal of zacoustic."""
FORMAT: Final = 1
"""Version of the tables."""
PAGE_BYTES: Final = 4096
"""Page size of the file."""

_BEGIN_ANEW: Final = (
    "move it away and the node begins anew, without what it has accepted and executed"
)
_SHOWN_CHARACTERS: Final = 120
_SCHEMA: Final = (
    "CREATE TABLE node (address INTEGER NOT NULL)",
    "CREATE TABLE entry (key TEXT PRIMARY KEY, value BLOB NOT NULL, crc INTEGER NOT NULL)"
    " WITHOUT ROWID",
    f"PRAGMA application_id = {APPLICATION_ID}",
    f"PRAGMA user_version = {FORMAT}",
)


def open_file(path: Path, address: int, *, limit_bytes: int) -> sqlite3.Connection:
    """Open the file of a node's journal, or make it.

    Args:
        path: The file; folders that are missing are made.
        address: The node.
        limit_bytes: Size beyond which it does not grow.

    Raises:
        ConfigError: It cannot be used; names file and remedy. Nothing was changed in it.
    """
    _make_folder(path)
    keep_private(path)  # SQLite gives its log the mode of the file
    with complaining(path), contextlib.ExitStack() as unless_ready:
        uri = f"{path.absolute().as_uri()}?psow=0"
        # Transactions are begun by hand; each call may be on another thread, one at a time.
        store = sqlite3.connect(
            uri, uri=True, timeout=0.0, isolation_level=None, check_same_thread=False
        )
        unless_ready.callback(store.close)
        store.execute("PRAGMA locking_mode = EXCLUSIVE")
        # Takes the lock at once: of two that start together one has to have it.
        store.execute("BEGIN EXCLUSIVE")
        store.execute("ROLLBACK")
        is_new = _is_new(store, path)
        if not is_new:
            _check(store, path, address)
        store.execute("PRAGMA journal_mode = WAL")
        store.execute("PRAGMA synchronous = FULL")
        store.execute("PRAGMA fullfsync = ON")
        store.execute("PRAGMA checkpoint_fullfsync = ON")
        store.execute(f"PRAGMA max_page_count = {max(1, limit_bytes // PAGE_BYTES)}")
        if is_new:
            with transaction(store):
                for statement in _SCHEMA:
                    store.execute(statement)
                store.execute("INSERT INTO node VALUES (?)", (address,))
        unless_ready.pop_all()
        return store


def read_entries(store: sqlite3.Connection, path: Path) -> dict[str, bytes]:
    """Return all entries.

    Raises:
        ConfigError: One of them is damaged.
    """
    entries: dict[str, bytes] = {}
    with complaining(path):
        for key, value, crc in store.execute("SELECT key, value, crc FROM entry"):
            if not isinstance(value, bytes) or crc != crc_of(key, value):
                _refuse(path, "is damaged: an entry is not what was written", _BEGIN_ANEW)
            entries[key] = value
    return entries


def crc_of(key: str, value: bytes) -> int:
    """Return the check of an entry."""
    return zlib.crc32(value, zlib.crc32(key.encode()))


def one_line(text: object) -> str:
    """Return what SQLite says as a short line; it may quote bytes of a damaged file."""
    shown = "".join(
        each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in str(text)
    )
    return shown if len(shown) <= _SHOWN_CHARACTERS else f"{shown[: _SHOWN_CHARACTERS - 1]}…"


@contextlib.contextmanager
def transaction(store: sqlite3.Connection) -> Iterator[None]:
    """Commit what is done inside, all or none."""
    store.execute("BEGIN IMMEDIATE")
    try:
        yield
        store.execute("COMMIT")
    except BaseException:
        # SQLite has rolled back by itself after some errors.
        with contextlib.suppress(sqlite3.Error):
            store.execute("ROLLBACK")
        raise


@contextlib.contextmanager
def complaining(path: Path) -> Iterator[None]:
    """Turn what SQLite raises into complaints about the file."""
    try:
        yield
    except UnicodeError:  # of a name in the file, or in what SQLite says of it
        _refuse(path, "is damaged: a text in it is none", _BEGIN_ANEW)
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF  # the low byte says the kind
        match code:
            case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
                _refuse(
                    path,
                    "is in use by another node or process",
                    "stop that one, or give each node an address of its own",
                )
            case sqlite3.SQLITE_NOTADB:
                _refuse(path, "is no journal of zacoustic", "move it away, or name another folder")
            case sqlite3.SQLITE_CORRUPT:
                _refuse(path, f"is damaged: {one_line(error)}", _BEGIN_ANEW)
            case sqlite3.SQLITE_CANTOPEN | sqlite3.SQLITE_PERM:
                _refuse(
                    path, f"cannot be opened: {one_line(error)}", "may this user read and write it?"
                )
            case sqlite3.SQLITE_READONLY:
                _refuse(path, f"cannot be written: {one_line(error)}", "may this user write it?")
            case sqlite3.SQLITE_FULL:
                _refuse(path, f"cannot be written: {one_line(error)}", "make room on the disk")
            case sqlite3.SQLITE_ERROR:  # what SQLite cannot make sense of
                _refuse(path, f"is damaged: {one_line(error)}", _BEGIN_ANEW)
        _refuse(path, f"cannot be used: {one_line(error)}", "is the disk in order?")


def _is_new(store: sqlite3.Connection, path: Path) -> bool:
    """Tell whether the file is empty; refuses one that is somebody else's."""
    (application_id,) = store.execute("PRAGMA application_id").fetchone()
    (tables,) = store.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if application_id == APPLICATION_ID:
        return False
    if application_id != 0 or tables != 0:  # both are 0 also if it was killed while making it
        _refuse(path, "is no journal of zacoustic", "move it away, or name another folder")
    return True


def _check(store: sqlite3.Connection, path: Path, address: int) -> None:
    """Refuse a file of another version or node, or with damage."""
    (version,) = store.execute("PRAGMA user_version").fetchone()
    if version != FORMAT:
        _refuse(
            path,
            f"has format {version}; allowed: {FORMAT}",
            "use the version of zacoustic that wrote it, or another folder",
        )
    (verdict,) = store.execute("PRAGMA integrity_check(1)").fetchone()
    if verdict != "ok":
        _refuse(path, f"is damaged: {one_line(verdict)}", _BEGIN_ANEW)
    nodes = [row[0] for row in store.execute("SELECT address FROM node")]
    if nodes != [address]:
        owner = ", ".join(map(str, nodes)) or "none"
        _refuse(
            path,
            f"is the journal of node {owner}; this is node {address}",
            "give each node a file of its own",
        )


def _refuse(path: Path, what: str, hint: str) -> NoReturn:
    raise ConfigError(f"journal {path}: {what}", hint=hint)


def _make_folder(path: Path) -> None:
    """Make the folder, so that a loss of power does not take it away again."""
    folder = path.parent
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f"journal: the folder {folder} cannot be made: {error.strerror or error}",
            hint="name another folder, or make it for this user",
        ) from error
    for made in missing:
        _sync_folder(made.parent)


def _sync_folder(folder: Path) -> None:
    if not hasattr(os, "O_DIRECTORY"):  # Windows: folders are not opened, nor synced
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
