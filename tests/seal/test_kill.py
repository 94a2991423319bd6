"""Killed at any instant, on any disk: no key and nonce of a node are used twice."""

import os
import random
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import msgspec
import pytest

from tests.seal.lifetimes import ADDRESS, KEY_BYTES, PAIR_BYTES, Ended, Life
from zacoustic.seal.keys import new_key, write_key
from zacoustic.seal.lives import Lives

ROOT: Final = Path(__file__).parents[2]
_START_S: Final = 0.04
"""About how long a start takes: half of the lives end in it, s."""
_WORK_S: Final = 0.02
"""How long the others go on behind it at most, s."""
_PATIENCE_S: Final = 0.2
"""What they have for their start at least, s: that of a node which may not transmit never ends."""
_MOST_PATIENCE_S: Final = 5.0
"""What they have on a busy computer, s."""
_KILLED: Final = 9
_OLD_RECORDS: Final = 30
_LIFE: Final = slice(KEY_BYTES + 3, KEY_BYTES + 5)
"""Where the life stands in a pair."""


class Node:
    """The files of a node, what happens to them between its lives, and all that it has used.

    Args:
        folder: An empty one.
        rng: Draws what happens.
    """

    def __init__(self, folder: Path, rng: random.Random) -> None:
        self.used: set[bytes] = set()
        """Every pair of key and nonce."""
        self.happened: Counter[str] = Counter()
        self._rng = rng
        self._live, self._aside = folder / "node", folder / "aside"
        self._key = new_key("kills")
        self._last_life = -1
        self._patience_s = _PATIENCE_S
        """What the next start has, s: more, the longer none has come to its end."""
        self._has_records = True
        """The last life that was used is in one of its records;"""
        self._has_journal = False
        """and in the journal."""
        self._copies: list[Path] = []
        self._old_records: list[bytes] = []
        self._live.mkdir()
        self._aside.mkdir()
        write_key(self._live / "fleet.key", self._key)
        self._lives.join()

    @property
    def _lives(self) -> Lives:
        return Lives(self._live / "lives", self._key, ADDRESS)

    def next_life(self) -> Life:
        """Return the next one."""
        is_short = self._rng.random() < 0.5
        return Life(
            folder=str(self._live),
            seed=self._rng.getrandbits(32),
            lasts_s=self._rng.uniform(0, _START_S) if is_short else self._patience_s,
            after_s=None if is_short else self._rng.uniform(0, _WORK_S),
            is_faulty=self._rng.random() < 0.2,
        )

    def took(self, life: Life, ended: Ended) -> None:
        """See that a life has used nothing that was used before."""
        if ended.pairs:
            self._patience_s = max(_PATIENCE_S, 0.8 * self._patience_s)
        elif life.after_s is not None:
            self._patience_s = min(_MOST_PATIENCE_S, 1.5 * self._patience_s)
        assert ended.status == _KILLED, "it was to be killed"
        assert len(ended.pairs) % PAIR_BYTES == 0
        for place in range(0, len(ended.pairs), PAIR_BYTES):
            pair = ended.pairs[place : place + PAIR_BYTES]
            assert pair not in self.used, f"{pair.hex()} is used twice, after {self.happened}"
            self.used.add(pair)
            self._last_life = max(self._last_life, int.from_bytes(pair[_LIFE], "big"))
        if ended.pairs:
            self.happened["lives that transmitted"] += 1
            self._has_records = self._has_journal = True

    def suffer(self) -> None:
        """Let something happen to the files, or nothing.

        Of the witnesses of the last life one is left: a life record, or the journal.
        """
        records = [path.read_bytes() if path.exists() else b"" for path in self._lives.paths]
        self._old_records = [*self._old_records, *records][-_OLD_RECORDS:]
        chance = self._rng.random()
        if chance < 0.26:
            if self._has_records:
                self._suffer_in_journal()
        elif chance < 0.4:
            if self._has_records and len(set(records)) == 1:  # the last fault was mended
                self._note("one or two life records damaged or old")
                for path in self._rng.sample(list(self._lives.paths), self._rng.choice((1, 2))):
                    self._damage(path)
        elif chance < 0.5:
            if self._has_journal:
                self._note("all life records put back from old copies")
                self._has_records = False
                for path in self._lives.paths:
                    path.write_bytes(self._rng.choice(self._old_records))
        elif chance < 0.53:
            self._note("key rotated")
            self._key, self._last_life = self._key.rotated(), -1
            write_key(self._live / "fleet.key", self._key, replace=True)

    def _suffer_in_journal(self) -> None:
        journal = self._live / "journal"
        files = sorted(journal.glob("node-*"))
        match self._rng.randrange(4):
            case 0:
                self._note("journal deleted")
                shutil.rmtree(journal, ignore_errors=True)
            case 1 if files:
                self._note("journal damaged")
                self._damage(self._rng.choice(files))
            case 2 if self._copies:
                self._note("journal put back from an old copy")
                shutil.rmtree(journal, ignore_errors=True)
                shutil.copytree(self._rng.choice(self._copies[-50:]), journal)
            case _ if files:
                self._note("journal copied")
                self._copies.append(self._aside / str(len(self._copies)))
                shutil.copytree(journal, self._copies[-1])
                return
        self._has_journal = False

    def lose_lives(self) -> None:
        """Delete all records of lives."""
        self._note("all life records deleted")
        self._has_records = True  # as soon as it has rejoined
        shutil.rmtree(self._live / "lives")

    def rejoin(self) -> None:
        """Make the records anew, from the last life that others can have heard."""
        self._lives.join(None if self._last_life < 0 else self._last_life)

    def _note(self, what: str) -> None:
        self.happened[what] += 1

    def _damage(self, path: Path) -> None:
        content = path.read_bytes() if path.exists() else b""
        match self._rng.randrange(5):
            case 0:
                path.unlink(missing_ok=True)
            case 1:
                path.write_bytes(content[: self._rng.randrange(len(content) + 1)])
            case 2:
                path.write_bytes(self._rng.randbytes(len(content)))
            case 3 if path in self._lives.paths:
                path.write_bytes(self._rng.choice(self._old_records))
            case _ if content:
                place = self._rng.randrange(len(content))
                path.write_bytes(content[:place] + b"\xff" + content[place + 1 :])


@contextmanager
def fork_server() -> Iterator[Callable[[Life], Ended]]:
    """Start the process that makes lives."""
    command = [sys.executable, "-m", "tests.seal.lifetimes"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "links")])}
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=ROOT, env=environment, stdin=pipe, stdout=pipe
    ) as process:  # fmt: skip
        orders, answers = process.stdin, process.stdout
        assert orders is not None
        assert answers is not None

        def let_live(life: Life) -> Ended:
            orders.write(msgspec.json.encode(life) + b"\n")
            orders.flush()
            return msgspec.json.decode(answers.readline(), type=Ended)

        yield let_live
        orders.close()
        assert process.wait() == 0


@pytest.mark.skipif(os.name != "posix", reason="a process is killed without a word on POSIX only")
def test_no_key_and_nonce_are_used_twice_whatever_kill_9_and_the_disk_do(
    tmp_path: Path, count: Callable[[int], int]
) -> None:
    node, kills = Node(tmp_path, random.Random(9)), count(10_000)
    with fork_server() as let_live:
        for number in range(kills):
            is_silent = number % 50 == 49
            if is_silent:  # nobody knows which lives are used
                node.lose_lives()
            life = node.next_life()
            ended = let_live(life)
            assert not (is_silent and ended.pairs)
            node.took(life, ended)
            if is_silent:
                node.rejoin()
            else:
                node.suffer()
    assert node.happened["lives that transmitted"] > 0.25 * kills
    print(f"{kills} kills, {len(node.used)} nonces", *sorted(node.happened.items()), sep="\n")
