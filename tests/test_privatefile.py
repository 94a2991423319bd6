"""Journals and recordings are their owner's alone, whatever the umask says."""

import os
import stat
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from zacoustic.run.journal import SqliteJournal

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="modes are those of POSIX")


@pytest.fixture(autouse=True)
def _generous() -> Iterator[None]:
    before = os.umask(0)
    yield
    os.umask(before)


def modes(folder: Path) -> dict[str, int]:
    return {path.name: stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()}


def test_journal_and_its_log_are_private_also_where_they_were_not(tmp_path: Path) -> None:
    path = tmp_path / "node-1.sqlite"
    for _ in range(2):
        journal = SqliteJournal(path, 1)
        journal.recover()
        assert set(modes(tmp_path).values()) == {0o600}
        journal.close()
        path.chmod(0o644)


def test_recording_is_private(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    from zacoustic.run.recording.writing import RecordingFile

    RecordingFile(tmp_path / "trial.mcap").close()
    assert modes(tmp_path) == {"trial.mcap": 0o600}
