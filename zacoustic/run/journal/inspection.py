"""The contents of a journal, and whether they are proved; inspection changes nothing.

A journal is *whole* if each entry matches its check, and all checks add up to the sum that the last
commit has written beside its number: then all pages are of one instant. It is *current* if it has
all commits that its mark has counted and is not a restored backup. A whole and current journal is
the node's last state. Of any other journal the inspection returns the valid entries, with a line
that names the fault.
"""

import contextlib
import hashlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.run.journal.image import image_of
from zacoustic.run.journal.mark import Marked

APPLICATION_ID: Final = 0x7A61636A  # "zacj"
"""Marks the file, in its header, as a journal of zacoustic."""
FORMAT: Final = 2
"""Version of the tables."""

_SUMS: Final = 1 << 62
_SHOWN_CHARACTERS: Final = 120


class Node(msgspec.Struct, frozen=True):
    """The one row of the table `node`."""

    address: int
    """The node."""
    identity: bytes
    """Eight random bytes, drawn when the file was made."""
    commits: int
    """Number of commits."""
    entries_sum: int
    """Sum of the checks of all entries."""
    is_backup: bool
    """The file is a copy of a journal."""

    @property
    def check(self) -> int:
        """The check of the row."""
        return check_of(
            "node",
            repr(
                (self.address, self.identity, self.commits, self.entries_sum, self.is_backup)
            ).encode(),
        )


class Found(msgspec.Struct, kw_only=True):
    """What is in the files of a journal."""

    node: Node | None = None
    """The file's description of itself; None: nothing valid, or no file."""
    entries: dict[str, bytes] = {}
    """The valid entries."""
    fault: str = ""
    """Why it is not whole; empty: it is, or there is no file."""
    doubt: str = ""
    """Why it is not the node's last state: the fault, or that it is an older copy; empty: it is."""
    has_file: bool = True
    """A file exists and is not empty."""
    is_whole: bool = False
    """All checks are right, each and in sum."""


def check_of(key: str, value: bytes) -> int:
    """Return the check of an entry, 0…2^62 - 1."""
    name = key.encode()
    digest = hashlib.blake2b(len(name).to_bytes(4, "big") + name, digest_size=8)
    digest.update(value)
    return int.from_bytes(digest.digest(), "big") % _SUMS


def added(entries_sum: int, *checks: int) -> int:
    """Return the sum with further checks; those of removed entries are negative."""
    return (entries_sum + sum(checks)) % _SUMS


def inspect(path: Path, address: int | None, marked: Marked | None) -> Found:
    """Inspect the files of a journal.

    Args:
        path: The file.
        address: The expected node; None: any.
        marked: Its mark.

    Raises:
        OSError: A file exists and cannot be read.
    """
    main, log = read_file(path), read_file(log_path(path))
    found = _look(image_of(main, log))
    found.doubt = _age(found, marked)
    if found.doubt and log:
        # Entries that their own checks prove, with a lenient reading of the log or without the log.
        others = [_look(image_of(main, log, strict=False)), _look(image_of(main, b""))]
        best = max(found, *others, key=_rank)
        if best is not found:
            best.fault = best.fault or "its log is damaged"
            best.doubt = _age(best, marked) if best.is_whole else best.fault
            found = best
    if not main and log and found.has_file:
        found.fault = found.fault or "its main file is missing"
        found.doubt = found.doubt or found.fault
    if found.node is not None and address not in (None, found.node.address):
        fault = f"it is the journal of node {found.node.address}; this is node {address}"
        return Found(fault=fault, doubt=fault)
    return found


def commits_of(found: Found, marked: Marked | None) -> int:
    """Return the least number of commits that the parts of a journal prove."""
    of_file = 0 if found.node is None else found.node.commits
    return max(of_file, 0 if marked is None else marked.commits)


def read_file(path: Path) -> bytes:
    """Return the bytes of a file; empty if it does not exist."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return b""


def log_path(path: Path) -> Path:
    """Return the log file of a journal."""
    return path.with_name(f"{path.name}-wal")


def one_line(text: object) -> str:
    """Return SQLite's message as a short line; it may quote bytes of a damaged file."""
    shown = "".join(
        each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in str(text)
    )
    return shown if len(shown) <= _SHOWN_CHARACTERS else f"{shown[: _SHOWN_CHARACTERS - 1]}…"


def _age(found: Found, marked: Marked | None) -> str:
    """Return why the last commits are missing; empty: they are not."""
    node = found.node
    if not found.has_file:
        # A new journal has its mark before its first commit, and may be killed between the two.
        return "it is missing" if marked is not None and marked.commits else ""
    if not found.is_whole or node is None:
        return found.fault
    if node.is_backup:
        return "it was put back from a backup"
    if marked is None:
        return "its mark is missing: it was copied, or put back"
    if (marked.address, marked.identity) != (node.address, node.identity):
        return "its mark is of another journal: it was copied, or put back"
    missing = marked.commits - node.commits
    if missing > 0:
        return f"the last {missing} of {marked.commits} commits are missing"
    return ""


def _rank(found: Found) -> tuple[bool, int, int]:
    """Sort key of readings: whole, then newest, then most entries."""
    commits = found.node.commits if found.is_whole and found.node is not None else 0
    return found.is_whole, commits, len(found.entries)


def _look(image: bytes) -> Found:
    """Read the tables of a database image."""
    if not image:
        return Found(has_file=False)
    found = Found()
    with contextlib.closing(sqlite3.connect(":memory:", isolation_level=None)) as store:
        try:
            store.deserialize(image)
            found.fault = _faults(store, found)
        except sqlite3.Error as error:
            found.fault = f"it is damaged: {one_line(error)}"
        except (UnicodeError, ValueError, TypeError, OverflowError):
            found.fault = "it is damaged: a value in it is none"
    found.is_whole = found.has_file and not found.fault
    return found


def _faults(store: sqlite3.Connection, found: Found) -> str:
    """Read valid entries into `found`; return the faults."""
    store.execute("PRAGMA cell_size_check = ON")
    (application_id,) = store.execute("PRAGMA application_id").fetchone()
    (version,) = store.execute("PRAGMA user_version").fetchone()
    (tables,) = store.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if (application_id, tables) == (0, 0):  # killed while the file was made
        found.has_file = False
        return ""
    if application_id != APPLICATION_ID:
        return "it is no journal of zacoustic"
    if version != FORMAT:
        return f"it has format {version}; known is {FORMAT}"
    faults = []
    try:
        found.node = _node(store)
    except sqlite3.Error as error:
        faults.append(f"it is damaged: {one_line(error)}")
    checks = []
    for order in ("", " ORDER BY key DESC"):  # from both ends, up to an unreadable part
        try:
            for key, value, check in _rows(store, order):
                if key in found.entries:
                    continue
                if check != check_of(key, value):
                    faults.append("it is damaged: an entry is not what was written")
                    continue
                found.entries[key] = value
                checks.append(check)
            break
        except sqlite3.Error as error:
            faults.append(f"it is damaged: {one_line(error)}")
    if found.node is None:
        faults.append("it is damaged: it does not say of which node it is")
    elif not faults and added(0, *checks) != found.node.entries_sum:
        faults.append("it is damaged: its pages are of different instants")
    if not faults:
        (verdict,) = store.execute("PRAGMA integrity_check(1)").fetchone()
        if verdict != "ok":
            faults.append(f"it is damaged: {one_line(verdict)}")
    return faults[0] if faults else ""


def _node(store: sqlite3.Connection) -> Node | None:
    rows = store.execute(
        "SELECT address, identity, commits, entries_sum, is_backup, checksum FROM node"
    ).fetchall()
    for address, identity, commits, entries_sum, is_backup, checksum in rows:
        node = Node(address, identity, commits, entries_sum, bool(is_backup))
        if len(rows) == 1 and node.check == checksum:
            return node
    return None


def _rows(store: sqlite3.Connection, order: str) -> Iterator[tuple[str, bytes, int]]:
    rows = store.execute(f"SELECT key, value, checksum FROM entry{order}")
    while (row := rows.fetchone()) is not None:
        key, value, checksum = row
        if isinstance(key, str) and isinstance(value, bytes):
            yield key, value, checksum
        else:
            yield "", b"", -1
