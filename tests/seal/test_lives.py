"""No two starts of a node have one life, whatever happens to its three files."""

import os
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from zacoustic.seal.keys import new_key
from zacoustic.seal.lives import LifeError, Lives

KEY = new_key("test")


class PowerCutError(Exception):
    """The power is gone."""


def test_starts_count_and_a_new_key_begins_again(tmp_path: Path) -> None:
    node = Lives(tmp_path / "lives", KEY, 3)
    with pytest.raises(LifeError, match="no record of the lives of node 3"):
        node.begin()
    node.join()
    assert [node.begin() for _ in range(3)] == [1, 2, 3]
    rotated = Lives(tmp_path / "lives", KEY.rotated(), 3)
    assert [rotated.begin(), rotated.begin()] == [0, 1]
    with pytest.raises(LifeError, match="the last start had generation 1"):
        node.begin()


def test_who_has_started_with_the_next_key_cannot_rejoin_with_the_former_one(
    tmp_path: Path,
) -> None:
    rotated = Lives(tmp_path, KEY.rotated(), 3)
    rotated.join()
    used = rotated.begin()
    for after in (None, 7):
        with pytest.raises(LifeError, match="has started with generation 1"):
            Lives(tmp_path, KEY, 3).join(after)
    assert rotated.begin() > used


def test_a_record_of_somebody_else_is_none(tmp_path: Path) -> None:
    Lives(tmp_path, KEY, 3).join()
    for path in tmp_path.glob("life-3.*"):
        path.rename(tmp_path / path.name.replace("life-3", "life-4"))
    with pytest.raises(LifeError, match="of another node or network"):
        Lives(tmp_path, KEY, 4).begin()


def test_who_has_lost_all_copies_goes_on_behind_what_others_heard(tmp_path: Path) -> None:
    node = Lives(tmp_path, KEY, 3)
    node.join()
    used = [node.begin() for _ in range(5)]
    for path in node.paths:
        path.unlink()
    node.join(after=used[-1])
    assert node.begin() > used[-1]
    with pytest.raises(LifeError, match="has a record"):
        node.join(after=used[-1])


def test_a_later_life_that_could_not_be_written_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the journal does with all that it could not write: else the node is mute till its end."""
    node = Lives(tmp_path, KEY, 3)
    node.join()
    life = node.begin() + 1
    real_replace, replaced = Path.replace, 0

    def replace(self: Path, target: Path) -> Path:
        nonlocal replaced
        replaced += 1
        if replaced == 2:
            raise OSError(28, "No space left on device")
        return real_replace(self, target)

    with monkeypatch.context() as full:
        full.setattr(Path, "replace", replace)
        with pytest.raises(LifeError, match="No space left"):
            node.reach(life)
        node.reach(life)
    with pytest.raises(LifeError, match=f"in life {life}, and cannot go on in life {life}"):
        Lives(tmp_path, KEY, 3).reach(life)
    assert node.begin() == life + 1


def test_no_life_is_used_twice_whenever_the_power_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: Callable[[int], int]
) -> None:
    """Cut at any step of a start; between starts one copy at most is damaged, lost or old."""
    rng = random.Random(3)
    node = Lives(tmp_path, KEY, 3)
    node.join()
    steps_left = 0

    def may_be_cut() -> None:
        nonlocal steps_left
        steps_left -= 1
        if steps_left < 0:
            raise PowerCutError

    real_fsync, real_replace = os.fsync, Path.replace

    def fsync(descriptor: int) -> None:
        may_be_cut()
        real_fsync(descriptor)

    def replace(self: Path, target: Path) -> Path:
        may_be_cut()
        return real_replace(self, target)

    monkeypatch.setattr(os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replace)
    used: list[int] = []
    before = [path.read_bytes() for path in node.paths]
    for _ in range(count(10_000)):
        steps_left = rng.randrange(12)
        try:
            used.append(node.begin())
        except PowerCutError:
            continue  # the same disk, as it was left
        finally:
            now = [path.read_bytes() if path.exists() else b"" for path in node.paths]
            if len(set(now)) == 1:
                copy = rng.randrange(6)
                if copy < len(now):
                    worse = rng.choice((b"", rng.randbytes(24), now[copy][:-1], before[copy]))
                    node.paths[copy].write_bytes(worse)
                before = now
    assert len(set(used)) == len(used) > 0.2 * count(10_000)
    assert used == sorted(used)
