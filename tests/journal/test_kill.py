"""Killed at any instant: what was reported as committed is there, and no step by half."""

import os
import random
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import pytest

from tests.journal.counting import number_in
from zacoustic.run.journal import SqliteJournal
from zacoustic.run.journal.file import JournalFile

ROOT: Final = Path(__file__).parents[2]
LONGEST_LIFE_S: Final = 0.06
"""How long a process lives at most after it has begun, s: some tens of commits."""
ADDRESS: Final = 2


def life(path: Path, after_s: float) -> list[str]:
    """Let a process count, kill it some time after it has begun; returns what it has printed."""
    command = [sys.executable, "-m", "tests.journal.counting", str(path), str(ADDRESS)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "links")])}
    with subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"begins\n"
        killer = threading.Timer(after_s, process.kill)
        killer.start()
        *lines, cut = process.stdout.read().decode().split("\n")
        killer.join()
        assert cut == ""
        assert process.wait() < 0, "it was to be killed"
    return lines


class Killed(BaseException):
    """Stands for the end of a process at one instant."""


@pytest.mark.parametrize("is_committed", [False, True])
def test_killed_around_its_first_commit_a_journal_has_lost_nothing(
    is_committed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, commit = tmp_path / "node-2.sqlite", JournalFile.commit

    def die(file: JournalFile, values: Mapping[str, bytes | None]) -> None:
        if is_committed:
            commit(file, values)
        raise Killed

    with monkeypatch.context() as dying:
        dying.setattr(JournalFile, "commit", die)
        with pytest.raises(Killed):
            SqliteJournal(path, ADDRESS).recover()
    journal = SqliteJournal(path, ADDRESS)
    assert journal.recover().doubt == ""
    journal.close()


@pytest.mark.skipif(os.name != "posix", reason="a process is killed without a word on POSIX only")
def test_whatever_was_committed_is_there_after_kill_9(
    tmp_path: Path, count: Callable[[int], int]
) -> None:
    path, rng = tmp_path / "node-2.sqlite", random.Random(4)
    number, epoch, cut_short = 0, None, 0
    for _ in range(count(2000)):
        lines = life(path, rng.uniform(0, LONGEST_LIFE_S))
        if lines:
            began = int(lines[0].removeprefix("epoch "))
            assert epoch is None or 1 <= (began - epoch) % 64 <= 2
            epoch = began
            printed = [int(line) for line in lines[1:]]
            assert printed == list(range(number + 1, number + 1 + len(printed)))
            number += len(printed)
        journal = SqliteJournal(path, ADDRESS)
        state = journal.recover()
        journal.close()
        # One life whose epoch was on the disk and not yet printed may lie between.
        assert not state.doubt, state.doubt
        assert epoch is None or 1 <= (state.boot_epoch - epoch) % 64 <= 2
        epoch = state.boot_epoch
        found = number_in(state.entries)
        assert found in (number, number + 1), "at most one step was under way"
        cut_short += found - number
        number = found
    assert number > 0
    print(f"{number} steps, {cut_short} of them committed and not printed")
