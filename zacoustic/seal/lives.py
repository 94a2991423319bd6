"""The lives of a node: a number for each start, which no other start with the same key has.

Two frames under the same key and nonce reveal the contents of both. The nonce contains the life of
its sender, so one number must survive power cuts, damaged disks and a deleted journal. It is stored
in three files of 24 bytes, apart from the journal, each with a checksum:

    magic 4 | network and address, hashed 8 | generation 4 | life 4 | CRC-32 4

A start takes the highest number in any of the files plus one, and uses it once all three files hold
it. So a start repairs a lost or damaged file, and a crash between two writes wastes one life of
`LAST_LIFE`. A new generation of the key begins at life 0, since it has sealed no frame before.

If no copy can be read, the lives in use are unknown: the node opens frames but seals none until an
operator states the last life that the other nodes have heard of it (`zacoustic key rejoin`).
"""

import hashlib
import os
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Protocol

import msgspec

from zacoustic.core.wire.seal import LAST_LIFE
from zacoustic.errors import ZacousticError

COPIES: Final = 3
_MAGIC: Final = b"ZAL1"
_NAME_BYTES: Final = 8
_CHECK_BYTES: Final = 4
_SIZE_BYTES: Final = len(_MAGIC) + _NAME_BYTES + 4 + 4 + _CHECK_BYTES


class LifeError(ZacousticError):
    """The life that this start may use is unknown or cannot be written."""


class Generation(Protocol):
    """A generation of keys, in which lives are counted."""

    @property
    def network(self) -> str:
        """Name of the network."""

    @property
    def generation(self) -> int:
        """Generation of the keys."""


class Start(msgspec.Struct, frozen=True, order=True, array_like=True):
    """One start of a node; starts compare in order of time."""

    generation: int
    """Generation of the key."""
    life: int
    """Counted from 0 in each generation."""

    @property
    def next(self) -> "Start":
        """The start after this one, with the same key."""
        return Start(self.generation, self.life + 1)


NO_START: Final = Start(-1, -1)
"""Before all others."""


class Found(msgspec.Struct, frozen=True, kw_only=True):
    """The contents of the copies."""

    generation: int | None
    """Generation and life of the last start; None: no copy can be read."""
    life: int | None
    faults: tuple[str, ...]
    """Faults of single copies, one line each."""

    @property
    def last(self) -> Start | None:
        """The last start; None: no copy can be read."""
        if self.generation is None or self.life is None:
            return None
        return Start(self.generation, self.life)


class Lives:
    """The copies of one node's life.

    Args:
        folder: Folder of the copies; made if it is missing.
        key: The key of the fleet, or its list of members.
        address: The node.
    """

    def __init__(self, folder: Path, key: Generation, address: int) -> None:
        self._folder = folder
        self._key = key
        self._address = address
        self._reached: int | None = None
        named = f"{key.network}\0{address}".encode()
        self._name = hashlib.sha256(named).digest()[:_NAME_BYTES]

    @property
    def network(self) -> str:
        """Name of the network."""
        return self._key.network

    @property
    def generation(self) -> int:
        """Generation of the key."""
        return self._key.generation

    @property
    def paths(self) -> Sequence[Path]:
        """The files of the copies."""
        return [self._folder / f"life-{self._address}.{copy}" for copy in range(1, COPIES + 1)]

    def find(self) -> Found:
        """Read the copies; changes nothing."""
        faults: list[str] = []
        known: list[tuple[int, int]] = []
        for path in self.paths:
            try:
                content = path.read_bytes()
            except OSError as error:
                faults.append(f"{path}: {error.strerror}")
                continue
            said = self._read(content)
            if isinstance(said, str):
                faults.append(f"{path}: {said}")
            else:
                known.append(said)
        generation, life = max(known, default=(None, None))
        return Found(generation=generation, life=life, faults=tuple(faults))

    def begin(self, journalled: Start | None = None) -> int:
        """Begin a life; on return all three files on the disk hold its number.

        Args:
            journalled: The last start in the journal; None: the journal has none.

        Raises:
            LifeError: No copy can be read, or one cannot be written, or all lives are used up.
        """
        start = self.upcoming(journalled)
        self._write(start.life)
        return start.life

    def upcoming(self, journalled: Start | None = None) -> Start:
        """Return the start that `begin` would make; changes nothing.

        Args:
            journalled: As for `begin`.

        Raises:
            LifeError: No copy can be read, or all lives are used up.
        """
        found = self.find()
        if found.generation is None or found.life is None:
            raise LifeError(
                f"{self._folder}: no record of the lives of node {self._address}: "
                + "; ".join(found.faults),
                hint=f"zacoustic key rejoin {self._address}; until then it seals no frame",
            )
        # The files can be behind the journal only if old copies of all of them were restored.
        last = max(Start(found.generation, found.life), journalled or NO_START)
        if last.generation > self._key.generation:
            raise LifeError(
                f"{self._folder}: the last start had generation {last.generation} of the key, "
                f"and the key file has {self._key.generation}",
                hint="put the present key file on this computer",
            )
        is_new_key = last.generation < self._key.generation
        life = 0 if is_new_key else last.life + 1
        if life > LAST_LIFE:
            raise LifeError(
                f"{self._folder}: all {LAST_LIFE + 1} lives of this generation are used up",
                hint="zacoustic key rotate",
            )
        return Start(self._key.generation, life)

    def reach(self, life: int) -> None:
        """Write down a later life, in a process that has begun one already.

        A failed write may be tried again.

        Raises:
            LifeError: `life` is not a later one, or cannot be written.
        """
        found = self.find()
        is_later = (
            found.generation == self._key.generation
            and found.life is not None
            # A failed attempt of this process may have written some of the copies.
            and (found.life < life or found.life == life == self._reached)
            and life <= LAST_LIFE
        )
        if not is_later:
            raise LifeError(
                f"{self._folder}: node {self._address} is in life {found.life}, and cannot go on "
                f"in life {life}",
                hint="restart the node; behind life "
                f"{LAST_LIFE} the key is to be rotated: zacoustic key rotate",
            )
        self._reached = life
        self._write(life)

    def join(self, after: int | None = None) -> int:
        """Make the record of a node that has none, or none that can be read.

        Args:
            after: The last life that the others have heard; None: the node was never in the fleet
                with this generation of the key.

        Returns:
            A life before the one of the next start.

        Raises:
            LifeError: A record exists and is not behind `after`; or it cannot be written.
        """
        found = self.find()
        if found.generation is not None and found.generation > self._key.generation:
            # That generation would start again at life 0 when its key returns.
            raise LifeError(
                f"{self._folder}: node {self._address} has started with generation "
                f"{found.generation} of the key, and the key file has {self._key.generation}",
                hint="put the present key file on this computer, or make a key with another "
                "network name",
            )
        last = -1 if after is None else after
        same = found.generation == self._key.generation
        if same and found.life is not None and found.life >= last:
            raise LifeError(
                f"{self._folder}: node {self._address} has a record, life {found.life}",
                hint="start the node: nothing has to be done",
            )
        if not -1 <= last <= LAST_LIFE:
            raise LifeError(f"life {last}; allowed: 0…{LAST_LIFE}")
        # Life 0 is never used again: the next start begins the life after the written one.
        self._write(last + 1 if after is not None else 0)
        return max(last, 0)

    # Below the methods above

    def _read(self, content: bytes) -> tuple[int, int] | str:
        if len(content) != _SIZE_BYTES or not content.startswith(_MAGIC):
            return f"{len(content)} bytes that are no record"
        body, check = content[:-_CHECK_BYTES], content[-_CHECK_BYTES:]
        if zlib.crc32(body).to_bytes(_CHECK_BYTES, "big") != check:
            return "damaged"
        name, numbers = body[len(_MAGIC) :][:_NAME_BYTES], body[-8:]
        if name != self._name:
            return "of another node or network"
        return int.from_bytes(numbers[:4], "big"), int.from_bytes(numbers[4:], "big")

    def _write(self, life: int) -> None:
        body = _MAGIC + self._name + self._key.generation.to_bytes(4, "big")
        body += life.to_bytes(4, "big")
        content = body + zlib.crc32(body).to_bytes(_CHECK_BYTES, "big")
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            for path in self.paths:
                _replace(path, content)
        except OSError as error:
            raise LifeError(
                f"{self._folder}: {error.strerror}",
                hint="a node that cannot write down its life seals no frame",
            ) from error


def _replace(path: Path, content: bytes) -> None:
    """Write a file atomically; on return it is on the disk."""
    beside = path.with_name(path.name + ".new")
    with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
