"""Journal and life records are witnesses of each other: an old copy of either is told."""

import shutil
from pathlib import Path
from typing import Final

import msgspec
import pytest

from zacoustic.core.base.journal import DOUBT_KEY, EPOCH_KEY, JournalWrite
from zacoustic.run.journal import JournalState, journal_in
from zacoustic.run.journal.lives import LifeJournal
from zacoustic.run.sealing import open_seal
from zacoustic.seal.keys import FleetKey, new_key, write_key
from zacoustic.seal.lives import LifeError, Lives
from zacoustic.seal.spec import SecuritySpec

KEY: Final = new_key("test")


class Started(msgspec.Struct, frozen=True):
    """What a start has found."""

    life: int | None
    age: str
    state: JournalState


def lives_in(folder: Path, key: FleetKey = KEY) -> Lives:
    return Lives(folder / "lives", key, 3)


def start(folder: Path, key: FleetKey = KEY, *, also: int = 0) -> Started:
    """Start a node; it begins so many more lives in the same process, and ends."""
    journal = LifeJournal(journal_in(folder / "journal", 3), lives_in(folder, key))
    state = journal.recover()
    first = journal.life
    if first is not None:
        for life in range(first, first + also + 1):
            value = life.to_bytes(2, "big")
            journal.commit([JournalWrite(write_id=1, key=EPOCH_KEY, value=value)])
    journal.close()
    return Started(first, journal.age, state)


@pytest.fixture
def node(tmp_path: Path) -> Path:
    lives_in(tmp_path).join()
    return tmp_path


def test_starts_of_a_node_in_order_say_nothing(node: Path) -> None:
    for life, also in ((1, 0), (2, 3), (6, 0), (7, 0)):
        started = start(node, also=also)
        assert (started.life, started.age, started.state.doubt) == (life, "", "")
        assert started.state.boot_epoch == life
    rotated = KEY.rotated()
    assert [start(node, rotated).life for _ in range(3)] == [0, 1, 2]
    assert start(node, rotated).age == ""


def test_an_old_journal_is_told_and_doubted_once(node: Path) -> None:
    start(node)
    shutil.copytree(node / "journal", node / "copy")
    start(node, also=2)
    shutil.rmtree(node / "journal")
    shutil.copytree(node / "copy", node / "journal")
    started = start(node)
    assert started.life == 5
    assert "the journal is of life 1, and the last start was life 4" in started.age
    assert started.state.doubt == started.age
    assert started.state.entries[DOUBT_KEY].decode() == started.age
    following = start(node)
    assert (following.life, following.age) == (6, "")
    assert following.state.entries[DOUBT_KEY].decode() == started.age, "till the engine has done"


def test_a_deleted_journal_is_told(node: Path) -> None:
    start(node)
    shutil.rmtree(node / "journal")
    started = start(node)
    assert (started.life, "the journal knows of no start" in started.age) == (2, True)
    assert start(node).age == ""


def test_old_life_records_use_no_life_that_the_journal_knows(node: Path) -> None:
    start(node)
    shutil.copytree(node / "lives", node / "copy")
    start(node, also=4)
    shutil.rmtree(node / "lives")
    shutil.copytree(node / "copy", node / "lives")
    started = start(node)
    assert (started.life, started.age) == (7, "")
    assert start(node).life == 8


def test_a_journal_of_another_network_says_nothing_of_this_one(node: Path) -> None:
    for _ in range(3):
        start(node)
    other = new_key("other")
    shutil.rmtree(node / "lives")
    lives_in(node, other).join()
    started = start(node, other)
    assert (started.life, started.age) == (1, "")


def test_a_start_that_ends_before_its_life_is_written_leaves_no_old_journal(
    node: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    start(node)
    with monkeypatch.context() as full:

        def fail(self: Lives, life: int) -> None:
            raise LifeError("No space left on device")

        full.setattr(Lives, "_write", fail)
        for _ in range(3):
            assert start(node).life is None
    started = start(node)
    assert (started.life, started.age) == (5, ""), "an attempt may cost a life"


def test_an_engine_that_seals_nothing_never_comes_to_an_epoch_that_can(tmp_path: Path) -> None:
    """Epochs of replaced engines go round after 2048 of them."""
    write_key(tmp_path / "fleet.key", KEY)
    spec = SecuritySpec(source="test", key=tmp_path / "fleet.key", lives=tmp_path / "lives")
    seal = open_seal(spec, 3)
    lives = seal.keep_lives(journal_in(tmp_path / "journal", 3))
    lives.recover()
    lives.close()
    assert "no record of the lives of node 3" in seal.failure
    assert {seal.epoch(epoch) for epoch in (0, 5, 0xF7FF, 0xF800, 0xFFFF)} == {0xF800}
