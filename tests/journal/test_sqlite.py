"""The journal in a file: what it keeps, what it refuses, and what it says."""

import itertools
import os
import random
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.base.journal import EPOCH_KEY, LIFE_KEY, VOLATILE_KEY, JournalWrite
from zacoustic.errors import ConfigError
from zacoustic.run.journal import EPOCHS, MemoryJournal, SqliteJournal, journal_in
from zacoustic.run.journal.file import JournalFile

ADDRESS: Final = 2


def write(key: str, value: bytes | None) -> JournalWrite:
    return JournalWrite(write_id=0, key=key, value=value)


def entries_of(path: Path) -> dict[str, bytes]:
    """What the next life finds, without what it says of itself."""
    journal = SqliteJournal(path, ADDRESS)
    state = journal.recover()
    journal.close()
    assert (state.doubt, state.failure) == ("", "")
    del state.entries[EPOCH_KEY], state.entries[LIFE_KEY]
    return state.entries


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "node-2.sqlite"


def test_entries_survive_and_the_last_write_of_a_key_counts(path: Path) -> None:
    journal = SqliteJournal(path, ADDRESS)
    journal.recover()
    journal.commit([write("a", b"1"), write("b", b""), write("a", b"2"), write("c", b"3")])
    journal.commit([write("c", None), write("never", None), write("ü\x00*", bytes(range(256)))])
    journal.close()
    journal.close()
    assert entries_of(path) == {"a": b"2", "b": b"", "ü\x00*": bytes(range(256))}


@given(
    st.lists(
        st.lists(st.tuples(st.sampled_from("abcd"), st.none() | st.binary(max_size=9)), max_size=6),
        max_size=6,
    )
)
def test_file_and_memory_keep_the_same(groups: list[list[tuple[str, bytes | None]]]) -> None:
    memory = MemoryJournal()
    memory.recover()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "node-2.sqlite"
        journal = SqliteJournal(path, ADDRESS)
        journal.recover()
        for group in groups:
            writes = [write(key, value) for key, value in group]
            memory.commit(writes)
            journal.commit(writes)
        journal.close()
        expected = memory.recover().entries
        del expected[EPOCH_KEY], expected[LIFE_KEY], expected[VOLATILE_KEY]
        assert entries_of(path) == expected


def test_each_life_has_another_epoch_and_the_next_name_of_64(tmp_path: Path) -> None:
    firsts, upper = set(), set()
    for number in range(20):
        journal = journal_in(tmp_path / str(number), ADDRESS)
        states = [journal.recover() for _ in range(3)]
        journal.close()
        epochs = [state.boot_epoch for state in states]
        firsts.add(epochs[0])
        assert [epoch % 64 for epoch in epochs] == [(epochs[0] + more) % 64 for more in range(3)]
        upper |= {(later - earlier) % EPOCHS // 64 for earlier, later in itertools.pairwise(epochs)}
        assert [int.from_bytes(state.entries[LIFE_KEY], "big") for state in states] == [1, 2, 3]
    assert len(firsts) > 1
    assert len(upper) > 20, "an old copy of the files does not lead to the same epochs"


def test_epoch_follows_the_one_that_the_engine_wrote_last_and_wraps(path: Path) -> None:
    journal = SqliteJournal(path, ADDRESS)
    journal.recover()
    journal.commit([write(EPOCH_KEY, (EPOCHS - 1).to_bytes(2, "big"))])
    state = journal.recover()
    assert state.boot_epoch % 64 == 0
    assert state.entries[EPOCH_KEY] == state.boot_epoch.to_bytes(2, "big")
    journal.close()


def test_epoch_is_on_the_disk_before_it_is_told(path: Path, tmp_path: Path) -> None:
    journal = SqliteJournal(path, ADDRESS)
    epoch = journal.recover().boot_epoch
    shutil.copytree(tmp_path, tmp_path / "after")  # the power fails now
    journal.close()
    later = SqliteJournal(tmp_path / "after" / path.name, ADDRESS)
    assert later.recover().boot_epoch % 64 == (epoch + 1) % 64
    later.close()


def test_missing_folders_are_made_and_the_file_is_named_for_the_node(tmp_path: Path) -> None:
    journal = journal_in(tmp_path / "a" / "b ?#%", 17)
    journal.recover()
    assert (tmp_path / "a" / "b ?#%" / "node-17.sqlite").is_file()
    journal.close()


def test_week_of_writes_does_not_make_the_file_grow(
    path: Path, count: Callable[[int], int]
) -> None:
    rng, journal = random.Random(1), SqliteJournal(path, ADDRESS)
    journal.recover()
    sizes = []
    for number in range(count(100_000)):
        group = [write(f"call-{number}-{each}", rng.randbytes(200)) for each in range(20)]
        group += [write(f"call-{number - 5}-{each}", None) for each in range(20)]
        journal.commit(group)
        sizes.append(sum(each.stat().st_size for each in path.parent.iterdir()))
    journal.close()
    assert max(sizes) < 8 * 1024 * 1024
    assert path.stat().st_size < 256 * 1024


def test_commit_beyond_the_limit_is_refused_whole_until_something_is_deleted(path: Path) -> None:
    journal = SqliteJournal(path, ADDRESS, limit_bytes=256 * 1024)
    journal.recover()
    journal.commit([write("small", b"kept"), write("large", bytes(150_000))])
    for _ in range(2):
        with pytest.raises(OSError, match=r"node-2.sqlite: .*full \(\d+ bytes in use of 262144\)"):
            journal.commit([write("small", b"lost"), write("other", bytes(150_000))])
    journal.commit([write("large", None), write("other", bytes(150_000))])
    journal.close()
    assert entries_of(path) == {"small": b"kept", "other": bytes(150_000)}


@pytest.mark.skipif(os.name != "posix", reason="a limit on the size of files is POSIX's")
def test_full_disk_is_an_error_in_one_line_and_what_was_kept_stays(path: Path) -> None:
    import resource

    journal = SqliteJournal(path, ADDRESS)
    journal.recover()
    journal.commit([write("kept", b"1")])
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64 * 1024, hard))
    try:
        with pytest.raises(OSError, match=r"journal .*node-2.sqlite: [^\n]*$"):
            journal.commit([write("kept", b"2"), write("large", bytes(100_000))])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    journal.commit([write("after", b"3")])
    journal.close()
    assert entries_of(path) == {"kept": b"1", "after": b"3"}


@pytest.mark.skipif(os.name != "posix", reason="an open file cannot be deleted elsewhere")
@pytest.mark.parametrize("suffix", ["", "-wal"])
def test_file_that_was_deleted_while_in_use_is_noticed(path: Path, suffix: str) -> None:
    journal = SqliteJournal(path, ADDRESS)
    journal.recover()
    gone = path.with_name(path.name + suffix)
    gone.unlink()
    with pytest.raises(OSError, match=f"{gone.name}: deleted or replaced while it was in use"):
        journal.commit([write("k", b"")])
    gone.write_bytes(b"")
    with pytest.raises(OSError, match="deleted or replaced"):
        journal.commit([write("k", b"")])
    journal.close()


def test_closed_journal_refuses_commits(path: Path) -> None:
    journal = SqliteJournal(path, ADDRESS)
    with pytest.raises(OSError, match="is not open"):
        journal.commit([])


# What is refused, and left as it was


def refusal(path: Path, address: int = ADDRESS) -> str:
    """Start a node on the file; returns the line. Nothing may have changed in it."""
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(ConfigError) as caught:
        SqliteJournal(path, address).recover()
    assert before == (path.read_bytes() if path.is_file() else None)
    line = str(caught.value)
    assert "\n" not in line
    return line


def made(path: Path, *groups: list[JournalWrite]) -> Path:
    journal = SqliteJournal(path, ADDRESS)
    journal.recover()
    for group in groups:
        journal.commit(group)
    journal.close()
    return path


def test_second_node_on_a_file_in_use_is_refused(path: Path) -> None:
    first = SqliteJournal(path, ADDRESS)
    first.recover()
    with pytest.raises(ConfigError, match="is in use by another node or process"):
        SqliteJournal(path, ADDRESS).recover()
    first.commit([write("k", b"1")])
    first.close()
    assert entries_of(path) == {"k": b"1"}


def test_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    for folder in (tmp_path / "taken", tmp_path / "taken" / "below"):
        assert f"journal: the folder {folder} cannot be made" in refusal(folder / "node-2.sqlite")


def test_file_that_was_killed_while_it_was_made_is_new(path: Path) -> None:
    path.write_bytes(b"")
    assert entries_of(path) == {}
    path.unlink()
    path.with_name(f"{path.name}-mark").unlink()
    store = sqlite3.connect(path, isolation_level=None)
    store.execute("PRAGMA journal_mode = WAL")
    store.execute("BEGIN")
    store.execute("CREATE TABLE node (address INTEGER NOT NULL)")
    store.execute("PRAGMA application_id = 5")
    store.close()
    assert entries_of(path) == {}


@pytest.mark.parametrize("is_new", [True, False])
@pytest.mark.parametrize("is_done", [True, False])
def test_commit_that_failed_at_the_start_may_be_in_the_file_all_the_same(
    path: Path, monkeypatch: pytest.MonkeyPatch, is_new: bool, is_done: bool
) -> None:
    if not is_new:
        journal = SqliteJournal(path, ADDRESS)
        journal.recover()
        journal.commit([write("a", b"1")])
        journal.close()
    real = JournalFile.commit

    def failing(file: JournalFile, values: dict[str, bytes | None]) -> None:
        if is_done:
            real(file, values)
        raise sqlite3.OperationalError("disk I/O error")

    journal = SqliteJournal(path, ADDRESS)
    with monkeypatch.context() as patch:
        patch.setattr(JournalFile, "commit", failing)
        assert "disk I/O error" in journal.recover().failure
    journal.commit([write("b", b"2")])
    journal.commit([write("c", b"3")])
    journal.close()
    kept = {} if is_new else {"a": b"1"}
    assert entries_of(path) == {**kept, "b": b"2", "c": b"3"}
