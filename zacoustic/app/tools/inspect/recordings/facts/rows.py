"""Rows of numbers: the newest in memory, older ones in an unnamed temporary file.

A recording of a gigabyte has millions of frames and samples, and a report needs each of them more
than once: for its publication, for a median, for a plot. As objects they would take as much memory
as the recording has bytes. So each is packed into a row of fixed size. Another order comes from
sorted runs that are merged while they are read. Memory is the same for a minute and for a month.

Contents of frames and samples are in rows as digests, which is enough to find equal ones.
"""

import contextlib
import heapq
import io
import itertools
import os
import struct
import tempfile
import weakref
from collections.abc import Iterable, Iterator
from typing import IO, Any, ClassVar, Final, Generic, TypeVar

import msgspec

from zacoustic.errors import ConfigError

BLOCK_BYTES: Final = 1 << 16
"""Rows of one kind stay in memory up to this size, and come back in blocks of it, bytes."""
RUN_ROWS: Final = 1 << 12
"""Number of rows sorted at once."""
MERGED_BYTES: Final = 1 << 12
"""Size of a block of each run while runs are merged, bytes."""

_DISK: Final = "/var/tmp"


class Row(msgspec.Struct, frozen=True):
    """A row; rows are ordered by their fields."""

    layout: ClassVar[struct.Struct]
    """Format of the fields."""


RowT = TypeVar("RowT", bound=Row)


class Rows(Generic[RowT]):
    """Rows of one kind in the order of their arrival.

    Args:
        kind: The kind.
    """

    def __init__(self, kind: type[RowT]) -> None:
        self._kind = kind
        self._count = 0
        self._file = tempfile.SpooledTemporaryFile(BLOCK_BYTES, dir=_folder())  # noqa: SIM115
        self._is_at_end = True
        weakref.finalize(self, _close, self._file)

    def __len__(self) -> int:
        """Return the number of rows."""
        return self._count

    def __iter__(self) -> Iterator[RowT]:
        """Yield the rows; may be repeated."""
        return itertools.starmap(self._kind, self.between(0, self._count, BLOCK_BYTES))

    def append(self, row: RowT) -> None:
        """Take a row.

        Raises:
            ConfigError: A number is out of the range of its field, or the file cannot be written.
        """
        self.extend((msgspec.structs.astuple(row),))

    def extend(self, rows: Iterable[tuple[Any, ...]]) -> None:
        """Take rows as tuples; errors as `append`."""
        try:
            if not self._is_at_end:
                self._file.seek(0, io.SEEK_END)
                self._is_at_end = True
            for row in rows:
                self._file.write(self._kind.layout.pack(*row))
                self._count += 1
        except (struct.error, OSError) as error:
            raise _clear(error) from error

    def between(self, begin: int, end: int, block_bytes: int) -> Iterator[tuple[Any, ...]]:
        """Yield rows from one number to another as tuples, read block by block."""
        layout = self._kind.layout
        step = max(1, block_bytes // layout.size)
        for first in range(begin, end, step):
            try:
                self._is_at_end = False
                self._file.seek(first * layout.size)
                block = self._file.read((min(first + step, end) - first) * layout.size)
            except OSError as error:
                raise _clear(error) from error
            yield from layout.iter_unpack(block)


def in_order(kind: type[RowT], rows: Iterable[RowT]) -> Iterator[RowT]:
    """Yield rows of one kind in the order of their fields."""
    unsorted = map(msgspec.structs.astuple, rows)
    runs = Rows(kind)
    while run := sorted(itertools.islice(unsorted, RUN_ROWS)):
        runs.extend(run)
    begins = range(0, len(runs), RUN_ROWS)
    ends = (min(begin + RUN_ROWS, len(runs)) for begin in begins)
    parts = (runs.between(*each, MERGED_BYTES) for each in zip(begins, ends, strict=True))
    return itertools.starmap(kind, heapq.merge(*parts))


def _folder() -> str | None:
    """Return the folder of temporary files; None: the usual one."""
    # The usual one, /tmp, is memory on many computers.
    return _DISK if "TMPDIR" not in os.environ and os.access(_DISK, os.W_OK) else None


def _close(file: IO[bytes]) -> None:
    with contextlib.suppress(OSError):  # the disk is full, and it was said
        file.close()


def _clear(error: struct.error | OSError) -> ConfigError:
    if isinstance(error, OSError):
        return ConfigError(
            f"temporary file of a recording's events: {error.strerror}",
            hint="set TMPDIR to a folder with as much room as the recording takes",
        )
    return ConfigError(
        f"a recording has a number out of range: {error}",
        hint="it is damaged, or another program has made it",
    )
