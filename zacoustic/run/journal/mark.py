"""The mark beside a journal: its number of commits, which reveals a missing part.

The log of a database has no end marker: if it is truncated, deleted or replaced by an older file,
the rest looks whole but is outdated. So the journal counts its commits, and after each one this
module writes the count here, alternating between two places, each with its own check. It does not
wait for the disk: whatever a power cut leaves, the journal is never behind its mark. Only the first
mark of a new journal waits, before the first commit: from then on a journal without a mark has lost
it.

A node locks the mark. A second node is refused, and the kernel releases the lock when the process
ends.
"""

import contextlib
import os
import struct
import zlib
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.run.filelock import lock_file

_PLACE: Final = struct.Struct(">4sB3x8sQ")
_CHECK: Final = struct.Struct(">I")
_MAGIC: Final = b"zacm"
_SECTOR_BYTES: Final = 512
_PLACES: Final = 2


class Marked(msgspec.Struct, frozen=True):
    """The contents of a mark."""

    address: int
    """The node."""
    identity: bytes
    """Eight random bytes, drawn when the journal was made."""
    commits: int
    """Number of commits at that time."""


class Mark:
    """The mark of one journal, locked while it is open.

    Args:
        path: File of the journal; the mark stands beside it under its own name.

    Raises:
        BlockingIOError: Another process holds the lock.
        OSError: It cannot be opened or made.
    """

    def __init__(self, path: Path) -> None:
        self.path = mark_path(path)
        """Its file."""
        self._descriptor = _open(self.path)
        try:
            lock_file(self._descriptor)  # on Windows only SQLite's own lock protects the journal
        except BaseException:
            os.close(self._descriptor)
            raise

    def read(self) -> Marked | None:
        """Return its contents; None: unreadable."""
        return _read(os.pread(self._descriptor, _PLACES * _SECTOR_BYTES, 0))

    def write(self, marked: Marked) -> None:
        """Write its new contents.

        Raises:
            OSError: It cannot be written.
        """
        place = _PLACE.pack(_MAGIC, marked.address, marked.identity, marked.commits)
        at = marked.commits % _PLACES * _SECTOR_BYTES
        os.pwrite(self._descriptor, place + _CHECK.pack(zlib.crc32(place)), at)

    def sync(self) -> None:
        """Sync the written contents to the disk.

        Raises:
            OSError: The disk refuses.
        """
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Unlock it."""
        os.close(self._descriptor)


def mark_path(path: Path) -> Path:
    """Return the mark file of a journal."""
    return path.with_name(f"{path.name}-mark")


def read_mark(path: Path) -> Marked | None:
    """Return the mark of a journal, without locking it; None: none."""
    try:
        return _read(mark_path(path).read_bytes())
    except OSError:
        return None


def _read(content: bytes) -> Marked | None:
    found = []
    for begin in range(0, _PLACES * _SECTOR_BYTES, _SECTOR_BYTES):
        place = content[begin : begin + _PLACE.size]
        check = content[begin + _PLACE.size : begin + _PLACE.size + _CHECK.size]
        if len(place) == _PLACE.size and check == _CHECK.pack(zlib.crc32(place)):
            magic, address, identity, commits = _PLACE.unpack(place)
            if magic == _MAGIC:
                found.append(Marked(address, identity, commits))
    return max(found, key=lambda each: each.commits, default=None)


def _open(path: Path) -> int:
    with contextlib.suppress(PermissionError):
        return os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    return os.open(path, os.O_RDONLY)
