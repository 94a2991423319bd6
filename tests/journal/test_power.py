"""Loss of power: the files as the disk may have them then. A group is there whole, or not at all.

What a disk has done when the power goes: everything that was waited for, and of what was written
after that any sectors, old, new or torn.
"""

import random
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from tests.journal.counting import number_in, step
from zacoustic.run.journal import SqliteJournal

ADDRESS: Final = 2
SECTOR_BYTES: Final = 512


class Disk:
    """A journal in use, and the bytes of its two files after each step, and of its mark first."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "node-2.sqlite"
        self.log = folder / "node-2.sqlite-wal"
        self.mark = folder / "node-2.sqlite-mark"
        self.journal = SqliteJournal(self.file, ADDRESS)
        self.journal.recover()
        self.number = 0
        self.states: list[tuple[bytes, bytes]] = [self.content()]
        self.marks = [self.mark.read_bytes()]
        """The mark after each step: the disk may have an older one, and never a newer one."""

    def content(self) -> tuple[bytes, bytes]:
        return self.file.read_bytes(), self.log.read_bytes()

    def step(self) -> tuple[bytes, bytes]:
        self.number += 1
        self.journal.commit(step(self.number))
        self.states.append(self.content())
        self.marks.append(self.mark.read_bytes())
        return self.states[-1]


def found_in(folder: Path, file: bytes, log: bytes, mark: bytes) -> int:
    """Start a node on such files; returns how many whole steps it finds."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / "node-2.sqlite").write_bytes(file)
    (folder / "node-2.sqlite-wal").write_bytes(log)
    (folder / "node-2.sqlite-mark").write_bytes(mark)
    journal = SqliteJournal(folder / "node-2.sqlite", ADDRESS)
    state = journal.recover()
    assert not state.doubt, "nothing of it was promised, so nothing is missing"
    journal.commit([])
    journal.close()
    return number_in(state.entries)


@pytest.fixture
def disk(tmp_path: Path) -> Disk:
    folder = tmp_path / "disk"
    folder.mkdir()
    return Disk(folder)


def test_log_cut_short_anywhere_ends_with_a_whole_group(
    disk: Disk, tmp_path: Path, count: Callable[[int], int]
) -> None:
    for _ in range(12):
        disk.step()
    disk.journal.close()
    file, log = disk.states[-1]
    # The log only grows here: with this much of it the step before was complete.
    ends = [len(state[1]) for state in disk.states]
    assert ends == sorted(ends)
    every = max(1, len(log) // count(10_000))
    for size in range(ends[0], len(log) + 1, every):
        whole = max(number for number, end in enumerate(ends) if end <= size)
        found = found_in(tmp_path / "after", file, log[:size], disk.marks[whole])
        # The end of a group is filled up to the sector: it may be whole before it is long enough.
        assert found in (whole, whole + 1), f"cut at byte {size}"


def test_group_that_was_being_written_is_there_whole_or_not_and_harms_none_before_it(
    disk: Disk, tmp_path: Path, count: Callable[[int], int]
) -> None:
    for seed in range(count(3000)):
        rng = random.Random(seed)
        file, before = disk.content()
        after_file, after = disk.step()
        if after_file != file:
            continue  # the log was written back: the test below
        torn = bytearray(after)
        # Sectors in which nothing was written stay as they are; any other may hold anything.
        for at in range(0, len(after), SECTOR_BYTES):
            end = min(at + SECTOR_BYTES, len(after))
            match rng.randrange(4) if after[at:end] != before[at:end] else None:
                case 0:
                    torn[at:end] = rng.randbytes(end - at)
                case 1:
                    torn[at:end] = bytes(end - at)
                case 2:
                    old = before[at:end]
                    torn[at : at + len(old)] = old
        found = found_in(tmp_path / "after", file, bytes(torn), disk.marks[-2])
        assert found in (disk.number - 1, disk.number), f"seed {seed}"
    disk.journal.close()


def test_power_lost_while_the_log_is_written_back_loses_nothing(
    disk: Disk, tmp_path: Path, count: Callable[[int], int]
) -> None:
    for _ in range(40):
        disk.step()
    disk.journal.close()
    old, log = disk.states[-1]
    new = written_back(tmp_path / "back", old, log)
    assert new != old
    for seed in range(count(2000)):
        rng = random.Random(seed)
        sectors = []
        for at in range(0, len(new), SECTOR_BYTES):
            piece = new[at : at + SECTOR_BYTES]
            choices = [piece, rng.randbytes(len(piece)), old[at : at + SECTOR_BYTES]]
            # The header is written like any page, but SQLite reads it before the log.
            sectors.append(piece if at == 0 else rng.choice(choices) or bytes(SECTOR_BYTES))
        assert found_in(tmp_path / "after", b"".join(sectors), log, disk.marks[-1]) == 40, (
            f"seed {seed}"
        )


def test_log_is_written_back_and_begun_anew_and_the_old_end_of_it_is_no_commit(
    disk: Disk, tmp_path: Path
) -> None:
    anew = 0
    for _ in range(700):
        before, after = disk.states[-1], disk.step()
        disk.states[:] = [after]
        if before[1][:32] != after[1][:32]:  # the header of the log
            anew += 1
            assert found_in(tmp_path / "after", *after, disk.marks[-1]) == disk.number
    disk.journal.close()
    assert anew >= 1


def written_back(folder: Path, file: bytes, log: bytes) -> bytes:
    """The file after a whole checkpoint, the log not yet begun anew."""
    folder.mkdir()
    (folder / "file").write_bytes(file)
    (folder / "file-wal").write_bytes(log)
    store = sqlite3.connect(folder / "file", isolation_level=None)
    try:
        store.execute("PRAGMA locking_mode = EXCLUSIVE")
        store.execute("PRAGMA wal_checkpoint(FULL)")
        return (folder / "file").read_bytes()
    finally:
        store.close()
