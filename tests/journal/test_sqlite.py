"""The journal in a file: what it keeps, what it refuses, and what it says."""

import os
import random
import sqlite3
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.journal import EPOCH_KEY, JournalWrite
from zacoustic.errors import ConfigError
from zacoustic.journal import EPOCHS, MemoryJournal, SqliteJournal, journal_in
from zacoustic.journal.file import APPLICATION_ID, complaining

ADDRESS: Final = 2


def write(key: str, value: bytes | None) -> JournalWrite:
    return JournalWrite(write_id=0, key=key, value=value)


def entries_of(path: Path) -> dict[str, bytes]:
    """What the next life finds, without the epoch."""
    journal = SqliteJournal(path, ADDRESS)
    entries = journal.recover().entries
    journal.close()
    del entries[EPOCH_KEY]
    return entries


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
        del expected[EPOCH_KEY]
        assert entries_of(path) == expected


def test_each_life_has_the_next_epoch_and_the_first_one_is_drawn(tmp_path: Path) -> None:
    firsts = set()
    for number in range(20):
        journal = journal_in(tmp_path / str(number), ADDRESS)
        epochs = [journal.recover().boot_epoch for _ in range(3)]
        journal.close()
        firsts.add(epochs[0])
        assert epochs == [(epochs[0] + more) % EPOCHS for more in range(3)]
    assert len(firsts) > 1


def test_epoch_follows_the_one_that_the_engine_wrote_last_and_wraps(path: Path) -> None:
    journal = SqliteJournal(path, ADDRESS)
    journal.recover()
    journal.commit([write(EPOCH_KEY, (EPOCHS - 1).to_bytes(2, "big"))])
    state = journal.recover()
    assert state.boot_epoch == 0
    assert state.entries == {EPOCH_KEY: bytes(2)}
    journal.close()


def test_epoch_is_on_the_disk_before_it_is_told(path: Path) -> None:
    journal = SqliteJournal(path, ADDRESS)
    epoch = journal.recover().boot_epoch
    copy = path.with_name("copy.sqlite")  # the power fails now
    copy.write_bytes(path.read_bytes())
    copy.with_name("copy.sqlite-wal").write_bytes(path.with_name(f"{path.name}-wal").read_bytes())
    journal.close()
    later = SqliteJournal(copy, ADDRESS)
    assert later.recover().boot_epoch == (epoch + 1) % EPOCHS
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


def test_file_of_another_node_is_refused(path: Path) -> None:
    assert refusal(made(path), address=3) == (
        f"journal {path}: is the journal of node 2; this is node 3 "
        "(give each node a file of its own)"
    )


def test_file_of_a_later_version_is_refused(path: Path) -> None:
    with sqlite3.connect(made(path), isolation_level=None) as store:
        store.execute("PRAGMA user_version = 2")
    store.close()
    assert "has format 2; allowed: 1 (use the version of zacoustic that wrote it" in refusal(path)


def test_file_that_is_no_database_is_refused(path: Path) -> None:
    path.write_bytes(b"dear diary, " * 400)
    assert refusal(path) == (
        f"journal {path}: is no journal of zacoustic (move it away, or name another folder)"
    )


def test_database_of_another_program_is_refused(path: Path) -> None:
    with sqlite3.connect(path) as store:
        store.execute("CREATE TABLE diary (day TEXT)")
    store.close()
    assert "is no journal of zacoustic" in refusal(path)


def test_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file")
    for folder in (tmp_path / "taken", tmp_path / "taken" / "below"):
        assert f"journal: the folder {folder} cannot be made" in refusal(folder / "node-2.sqlite")


def test_file_that_cannot_be_opened_is_named(path: Path) -> None:
    path.mkdir()
    assert f"journal {path}: cannot be opened" in refusal(path)


def test_file_that_cannot_be_written_is_named(path: Path) -> None:
    made(path)
    store = sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)
    refused = pytest.raises(ConfigError, match=r"sqlite: cannot be written: .* \(may this user")
    with refused, complaining(path):
        store.execute("DELETE FROM entry")
    store.close()


def test_empty_file_and_one_that_was_killed_while_it_was_made_are_new(path: Path) -> None:
    path.write_bytes(b"")
    assert entries_of(path) == {}
    path.unlink()
    store = sqlite3.connect(path, isolation_level=None)
    store.execute("PRAGMA journal_mode = WAL")
    store.execute("BEGIN")
    store.execute("CREATE TABLE node (address INTEGER NOT NULL)")
    store.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    store.close()
    assert entries_of(path) == {}


def test_damaged_file_is_refused_or_what_it_held_is_right(
    path: Path, tmp_path: Path, count: Callable[[int], int]
) -> None:
    texts = {f"key-{number}": random.Random(number).randbytes(300) for number in range(60)}
    whole = made(path, [write(key, value) for key, value in texts.items()]).read_bytes()
    refused = 0
    for seed in range(count(50_000)):
        rng, damaged = random.Random(seed), bytearray(whole)
        for _ in range(rng.choice((1, 1, 2, 30))):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        if rng.randrange(4) == 0:
            del damaged[rng.randrange(len(damaged)) :]
        if not damaged:
            continue
        other = tmp_path / "damaged.sqlite"
        other.write_bytes(damaged)
        journal = SqliteJournal(other, ADDRESS)
        found, line = texts, ""
        try:
            found = journal.recover().entries
            del found[EPOCH_KEY]
        except ConfigError as error:
            line = str(error)
        journal.close()
        assert found == texts, f"seed {seed}"
        if line:
            refused += 1
            assert "\n" not in line, f"seed {seed}"
            assert line.startswith(f"journal {other}: "), f"seed {seed}"
            assert other.read_bytes() == damaged, f"seed {seed}: changed"
        for left in tmp_path.glob("damaged.sqlite*"):
            left.unlink()
    assert refused
