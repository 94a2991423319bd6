"""Damaged, old and foreign files: the node lives on, and knows how much of it can be proved.

What is found without doubt is what was committed last, to the byte. What is found in doubt is
right, each entry of it; and a line says why it is in doubt.
"""

import json
import os
import random
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from zacoustic.app.cli import main
from zacoustic.core.base.journal import DOUBT_KEY, EPOCH_KEY, LIFE_KEY, JournalWrite
from zacoustic.run.journal import JournalState, SqliteJournal

ADDRESS: Final = 2
NAME: Final = "node-2.sqlite"
OWN: Final = (EPOCH_KEY, LIFE_KEY, DOUBT_KEY)


def write(key: str, value: bytes | None) -> JournalWrite:
    return JournalWrite(write_id=0, key=key, value=value)


def begun(path: Path, address: int = ADDRESS) -> JournalState:
    """One life on the files, in which a commit works."""
    journal = SqliteJournal(path, address)
    state = journal.recover()
    journal.commit([write("alive", b"1")])
    journal.commit([write("alive", None)])
    journal.close()
    for own in OWN:
        state.entries.pop(own, None)
    return state


class Made:
    """A journal with a history, as a killed process leaves it."""

    def __init__(self, folder: Path, *, steps: int, seed: int, address: int = ADDRESS) -> None:
        rng = random.Random(seed)
        self.folder = folder
        self.states: list[dict[str, bytes]] = [{}]
        """The entries after each step."""
        self.copies: list[Path] = []
        """The folder after each step."""
        journal = SqliteJournal(folder / NAME, address)
        journal.recover()
        for step in range(steps):
            entries = dict(self.states[-1])
            keys = [f"key-{rng.randrange(30)}" for _ in range(3)]
            values = [
                rng.randbytes(rng.randrange(1200)) if rng.random() < 0.8 else None for _ in keys
            ]
            journal.commit([write(key, value) for key, value in zip(keys, values, strict=True)])
            for key, value in zip(keys, values, strict=True):
                entries[key] = value or b""
                if value is None:
                    del entries[key]
            self.states.append(entries)
            self.copies.append(folder.with_name(f"{folder.name}-{step}"))
            shutil.copytree(folder, self.copies[-1])
        journal.close()

    def was(self, key: str, value: bytes) -> bool:
        """Tell whether an entry was ever written."""
        return any(state.get(key) == value for state in self.states)


def judge(made: Made, state: JournalState, what: str) -> bool:
    """Check what a life was told; returns whether it was in doubt."""
    assert not state.failure, f"{what}: {state.failure}"
    for key, value in state.entries.items():
        assert made.was(key, value), f"{what}: {key} was never so"
    if not state.doubt:
        assert state.entries == made.states[-1], f"{what}: opened in silence"
        return False
    assert "\n" not in state.doubt
    assert state.doubt.isprintable()
    return True


@pytest.fixture(scope="module", params=["in the log", "in the file", "in both"])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Journals of which all, nothing, or a part has been written back from the log."""
    folder = tmp_path_factory.mktemp("made") / "journal"
    found = Made(folder, steps=12, seed=7)
    last = found.copies[-1]
    if request.param == "in the file":
        shutil.copytree(folder, last, dirs_exist_ok=True)
        (last / f"{NAME}-wal").unlink()
    if request.param == "in both":
        journal = SqliteJournal(last / NAME, ADDRESS)  # its end writes back what there is
        journal.recover()
        journal.close()
        journal.recover()
        journal.commit([write("late", b"1")])
        found.states.append({**found.states[-1], "late": b"1"})
        after = last.with_name("killed")
        shutil.copytree(last, after)
        journal.close()
        found.copies.append(after)
    return found


def test_each_flipped_bit_and_each_cut_is_found_or_harms_nothing(
    made: Made, tmp_path: Path, count: Callable[[int], int]
) -> None:
    whole = made.copies[-1]
    files = [each.name for each in whole.iterdir() if each.stat().st_size]
    doubted = 0
    for seed in range(count(10_000)):
        rng = random.Random(seed)
        folder = tmp_path / "damaged"
        shutil.copytree(whole, folder)
        name = rng.choice(files)
        content = bytearray((folder / name).read_bytes())
        for _ in range(rng.choice((1, 1, 1, 2, 30))):
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        if rng.randrange(4) == 0:
            del content[rng.randrange(len(content)) :]
        (folder / name).write_bytes(content)
        doubted += judge(made, begun(folder / NAME), f"seed {seed}, {name}")
        assert not begun(folder / NAME).doubt, f"seed {seed}, {name}: the life after"
        shutil.rmtree(folder)
    assert doubted


@pytest.mark.parametrize("name", [NAME, f"{NAME}-wal", f"{NAME}-mark"])
def test_missing_file_is_missed(made: Made, tmp_path: Path, name: str) -> None:
    folder = tmp_path / "missing"
    shutil.copytree(made.copies[-1], folder)
    if not (folder / name).exists():
        pytest.skip("there is no log")
    (folder / name).unlink()
    assert judge(made, begun(folder / NAME), name)


def test_file_or_log_of_another_instant_is_found(
    made: Made, tmp_path: Path, count: Callable[[int], int]
) -> None:
    doubted = 0
    for seed in range(count(2000)):
        rng = random.Random(seed)
        folder = tmp_path / "mixed"
        shutil.copytree(made.copies[-1], folder)
        old = rng.choice(made.copies[:-1])
        names = rng.choice(([NAME], [f"{NAME}-wal"], [f"{NAME}-mark"], [NAME, f"{NAME}-wal"]))
        for name in names:
            (folder / name).unlink(missing_ok=True)
            if (old / name).exists():
                shutil.copy(old / name, folder / name)
        doubted += judge(made, begun(folder / NAME), f"seed {seed}, {names} of {old.name}")
        shutil.rmtree(folder)
    assert doubted


def test_log_of_another_journal_is_found(made: Made, tmp_path: Path) -> None:
    other = Made(tmp_path / "other", steps=5, seed=8)
    folder = tmp_path / "mixed"
    shutil.copytree(made.copies[-1], folder)
    shutil.copy(other.copies[-1] / f"{NAME}-wal", folder / f"{NAME}-wal")
    state = begun(folder / NAME)
    if not state.doubt:
        assert state.entries == made.states[-1], "all of it is in the file"
    for key, value in state.entries.items():
        assert made.was(key, value) or other.was(key, value)


def test_nothing_of_the_journal_of_another_node_is_used_and_it_is_set_aside(
    tmp_path: Path,
) -> None:
    made = Made(tmp_path / "journal", steps=3, seed=9, address=3)
    folder = made.copies[-1]
    whole = (folder / f"{NAME}-wal").read_bytes()
    state = begun(folder / NAME)
    assert state.entries == {}
    assert "it is the journal of node 3; this is node 2" in state.doubt
    assert (folder / f"{NAME}.damaged-1-wal").read_bytes() == whole


@pytest.mark.parametrize("content", [b"dear diary, " * 400, "another database", "a later format"])
def test_what_is_no_journal_is_set_aside_and_not_changed(
    tmp_path: Path, content: bytes | str
) -> None:
    path = tmp_path / NAME
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        if content == "a later format":
            begun(path)
        with sqlite3.connect(path) as store:
            store.execute("PRAGMA user_version = 9" if "format" in content else "CREATE TABLE d(a)")
        store.close()
    before = path.read_bytes()
    state = begun(path)
    assert state.doubt
    assert (tmp_path / f"{NAME}.damaged-1").read_bytes() == before
    assert not begun(path).doubt


def test_only_the_last_damaged_journals_are_left(tmp_path: Path) -> None:
    path = tmp_path / NAME
    for number in range(6):
        path.write_bytes(f"damage {number}".encode())
        begun(path)
    left = {each.name: each.read_bytes() for each in tmp_path.glob("*.damaged-?")}
    assert left == {f"{NAME}.damaged-{n + 1}": f"damage {n}".encode() for n in (3, 4, 5)}


def test_doubt_is_told_to_each_life_until_it_is_deleted(tmp_path: Path) -> None:
    begun(tmp_path / NAME)
    (tmp_path / f"{NAME}-mark").unlink()
    journal = SqliteJournal(tmp_path / NAME, ADDRESS)
    assert "its mark is missing" in journal.recover().doubt
    again = journal.recover()
    assert (again.doubt, b"its mark is missing" in again.entries[DOUBT_KEY]) == ("", True)
    journal.commit([write(DOUBT_KEY, None)])
    assert DOUBT_KEY not in journal.recover().entries
    journal.close()


# A disk that cannot be written


LIFE: Final = """
import resource, sys
from zacoustic.core.base.journal import JournalWrite
from zacoustic.run.journal import SqliteJournal
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
journal = SqliteJournal(sys.argv[1], 2)
state = journal.recover()
assert state.failure, state
assert ("kept" in state.entries) == (sys.argv[2] == "old"), state
write = JournalWrite(write_id=1, key="new", value=bytes(9000))
try:
    journal.commit([write])
except OSError as error:
    assert str(error).count("\\n") == 0
else:
    raise AssertionError("nothing could be written")
resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
journal.commit([write])
journal.close()
print(state.boot_epoch)
"""


@pytest.mark.skipif(os.name != "posix", reason="a limit on the size of files is POSIX's")
@pytest.mark.parametrize("is_old", [False, True])
def test_node_begins_a_life_on_a_full_disk_and_writes_when_it_can(
    tmp_path: Path, is_old: bool
) -> None:
    path = tmp_path / NAME
    if is_old:
        journal = SqliteJournal(path, ADDRESS)
        journal.recover()
        journal.commit([write("kept", b"1")])
        journal.close()
    command = [sys.executable, "-c", LIFE, str(path), "old" if is_old else "new"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    journal = SqliteJournal(path, ADDRESS)
    state = journal.recover()
    journal.close()
    assert not state.doubt
    assert len(state.entries["new"]) == 9000
    assert state.boot_epoch % 64 == (int(done.stdout) + 1) % 64


def test_file_that_cannot_be_opened_does_not_stop_the_node(tmp_path: Path) -> None:
    path = tmp_path / NAME
    path.mkdir()
    journal = SqliteJournal(path, ADDRESS)
    state = journal.recover()
    assert "it cannot be read" in state.doubt
    journal.commit([write("a", b"1")])
    journal.close()
    assert (tmp_path / f"{NAME}.damaged-1").is_dir()


# Backups


def test_backup_of_a_journal_in_use_is_whole_and_says_what_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, copy = tmp_path / NAME, tmp_path / "copy.sqlite"
    journal = SqliteJournal(path, ADDRESS)
    journal.recover()
    for number in range(50):
        journal.commit([write(f"call/{number}", bytes(500))])
    assert main(["journal", "backup", str(path), str(copy)]) == 0
    journal.commit([write("call/0", None)])
    capsys.readouterr()
    assert main(["journal", "check", str(path)]) == 0
    verdict, contents = capsys.readouterr().out.splitlines()
    assert verdict.endswith(": in order")
    assert contents.startswith("commits ")
    journal.close()
    assert main(["journal", "check", str(copy), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["is_backup"] is True
    assert report["address"] == ADDRESS
    assert report["entries"] == {"call": 50, "epoch": 1, "life": 1}
    assert main(["journal", "backup", str(path), str(copy)]) == 2, "nothing is overwritten"
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        "copy.sqlite", NAME, f"{NAME}-mark",
    ]  # fmt: skip
    for left_log in (False, True):
        folder = tmp_path / f"back-{left_log}"
        folder.mkdir()
        shutil.copy(copy, folder / NAME)
        if left_log:
            shutil.copy(tmp_path / f"{NAME}-mark", folder / f"{NAME}-mark")
        state = begun(folder / NAME)
        assert "it was put back from a backup" in state.doubt
        assert len(state.entries) == 50
        assert not begun(folder / NAME).doubt


def test_check_tells_damage_and_what_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / NAME
    assert main(["journal", "check", str(path)]) == 2
    begun(path)
    assert main(["journal", "check", str(path), "--address", "3"]) == 1
    assert "this is node 3" in capsys.readouterr().out
    content = bytearray(path.read_bytes())
    content[content.index(b"life")] ^= 1
    path.write_bytes(content)
    assert main(["journal", "check", str(path)]) == 1
    assert "IN DOUBT: it is damaged" in capsys.readouterr().out
    assert path.read_bytes() == content
    assert main(["journal", "backup", str(path), str(tmp_path / "copy")]) == 1
    assert main(["journal", "backup", str(path)]) == 2
    assert not (tmp_path / "copy").exists()
