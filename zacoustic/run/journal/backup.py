"""Copies of a journal, even of one in use, and a report on a journal's files.

The files of a running node change while they are read. A copy is valid only if its own checks prove
it whole (`inspection`), so that all of it is of one instant; otherwise the copy is repeated. Copies
are marked as such: a node that finds one in the place of its journal begins its boot epoch with the
knowledge that commits are missing.
"""

import os
import sqlite3
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.core.transport.carry.custody import stored_samples
from zacoustic.core.transport.carry.status import CarriedStream, streams_of
from zacoustic.errors import ConfigError, ZacousticError
from zacoustic.run.journal.file import JournalFile
from zacoustic.run.journal.inspection import Found, inspect, log_path, one_line
from zacoustic.run.journal.mark import read_mark

_ATTEMPTS: Final = 50


class BackupError(ZacousticError):
    """No copy could be made."""


class JournalReport(msgspec.Struct, frozen=True, kw_only=True):
    """What is in the files of a journal."""

    path: str
    """The file."""
    address: int | None
    """Address of its node; None: unknown."""
    commits: int
    """Number of commits."""
    entries: dict[str, int]
    """Number of valid entries by the first part of their key."""
    carried: tuple[CarriedStream, ...]
    """What it keeps of carried topics; a journal does not tell how old it is."""
    is_backup: bool
    """The file is a copy made by `backup`."""
    doubt: str
    """Why it lacks the node's last commits; empty: it does not, or it is an intact copy."""

    def lines(self) -> list[str]:
        """Return the report as lines of text."""
        node = "a node that it does not name" if self.address is None else f"node {self.address}"
        kind = "copy of the journal" if self.is_backup else "journal"
        verdict = f"IN DOUBT: {self.doubt}" if self.doubt else "in order"
        parts = ", ".join(f"{count} {key}" for key, count in sorted(self.entries.items()))
        return [
            f"{self.path}: {kind} of {node}: {verdict}",
            f"commits {self.commits}, entries: {parts or 'none'}",
            *(_carried_line(each) for each in self.carried),
        ]


def check(path: Path, address: int | None = None) -> JournalReport:
    """Report on the files of a journal; changes nothing, even while a node uses it.

    Args:
        path: The file.
        address: The expected node; None: any.

    Raises:
        ConfigError: The file does not exist or cannot be read.
    """
    found = _look(path, address)
    is_backup = found.node is not None and found.node.is_backup
    return JournalReport(
        path=str(path),
        address=None if found.node is None else found.node.address,
        commits=0 if found.node is None else found.node.commits,
        entries=_counts(found),
        carried=_carried(found),
        is_backup=is_backup,
        doubt="" if is_backup and found.is_whole else found.doubt,
    )


def backup(path: Path, copy: Path) -> JournalReport:
    """Copy a journal into one file, even while its node runs; return the report on the copy.

    Args:
        path: File of the journal.
        copy: The copy; must not exist yet.

    Raises:
        ConfigError: The journal does not exist, or the copy does.
        BackupError: The journal is damaged or cannot be copied.
    """
    if copy.exists():
        raise ConfigError(f"{copy}: is there already", hint="name a file that is not")
    for _ in range(_ATTEMPTS):
        found = _look(path, None)
        if found.is_whole and not found.fault:
            break
    else:
        raise BackupError(f"journal {path}: {found.fault or 'no instant of it is whole'}")
    node = found.node
    assert node is not None
    coming = copy.with_name(f"{copy.name}.coming")
    try:
        coming.touch(mode=0o600, exist_ok=False)
        file = JournalFile(coming, None, node.address, commits=node.commits - 1)
        try:
            file.commit(dict(found.entries), is_backup=True)
            file.into_one_file()
        finally:
            file.close()
        os.link(coming, copy)
    except FileExistsError:
        raise ConfigError(f"{copy}: is there already", hint="name a file that is not") from None
    except (sqlite3.Error, OSError) as error:
        raise BackupError(f"{copy}: cannot be written: {one_line(error)}") from error
    finally:
        for left in (coming, log_path(coming)):
            left.unlink(missing_ok=True)
    return check(copy)


def _look(path: Path, address: int | None) -> Found:
    try:
        marked = read_mark(path)
        found = inspect(path, address, marked)
        if found.doubt and read_mark(path) != marked:  # a commit came between the two reads
            found = inspect(path, address, marked)
    except OSError as error:
        raise ConfigError(f"journal {path}: cannot be read: {error.strerror or error}") from error
    if not found.has_file and not found.doubt:
        raise ConfigError(
            f"journal {path}: there is none", hint="name the file, such as node-2.sqlite"
        )
    return found


def _counts(found: Found) -> dict[str, int]:
    counts: dict[str, int] = {}
    for key in found.entries:
        kind = key.split("/")[0]
        counts[kind] = counts.get(kind, 0) + 1
    return counts


def _carried(found: Found) -> tuple[CarriedStream, ...]:
    try:
        return tuple(streams_of(stored_samples(found.entries), is_dated=False))
    except msgspec.MsgspecError:
        return ()  # of another version, whose node can tell


def _carried_line(kept: CarriedStream) -> str:
    """Return what is kept of one carried topic: a journal has its number, and no name."""
    said = [f"{count} for {each}" for each, count in kept.own.items()]
    said += [f"{count} of them in custody of {each}" for each, count in kept.custodians.items()]
    said += [f"of others {count} for {each}" for each, count in kept.carried.items()]
    return f"carried, stream {kept.stream_id}: {', '.join(said)}"
