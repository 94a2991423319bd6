"""The contract between the runtime, which commits in its own thread, and a store.

A node may promise only what it still knows after a restart, and peers must be able to distinguish
its boot epochs. So a store holds entries by key, and each start begins another boot epoch and
increments the count of starts. No store reads a wall clock, so a clock that jumps by years does no
harm.
"""

import random
from collections.abc import Mapping, Sequence
from typing import Final, Protocol

import msgspec

from zacoustic.core.base.journal import DOUBT_KEY, EPOCH_KEY, LIFE_KEY, JournalWrite

EPOCHS: Final = 1 << 16
"""Number of boot epochs: two bytes on the wire."""

_ROUNDS: Final = 1 << 10
_LIVES_IN_ROUND: Final = 64
_SKIPPED_LIVES: Final = 1 << 10, 1 << 20


class JournalState(msgspec.Struct, frozen=True, kw_only=True):
    """The contents of a journal at the start."""

    boot_epoch: int
    """The boot epoch, 0…65535, different from the former one."""
    entries: dict[str, bytes] = {}
    """Key → last committed value."""
    is_restart: bool = False
    """Whether it has begun a boot epoch before."""
    doubt: str = ""
    """Why the last commits may be missing, one line; empty: they are not."""
    failure: str = ""
    """Why it cannot be written now, one line; empty: it can."""


class Journal(Protocol):
    """A store. Its methods block; they are called one at a time, each on any thread."""

    def recover(self) -> JournalState:
        """Begin a boot epoch and return the entries; called once, before an engine is built.

        On return the epoch is safe, unless `failure` says that the store cannot be written.

        Raises:
            ConfigError: The store is in use or cannot be made.
        """
        ...

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Store these writes, all or none, before returning; the last write of a key wins.

        Raises:
            OSError: Nothing was stored; one line why. The caller may try the same writes, and
                later ones, again.
        """
        ...

    def close(self) -> None:
        """Release the store. May be called again."""
        ...


class Life(msgspec.Struct, frozen=True):
    """The beginning of a boot epoch."""

    entries: dict[str, bytes]
    """Known entries of former epochs, and those of the new one."""


def begin_life(entries: Mapping[str, bytes], doubt: str = "") -> Life:
    """Begin a boot epoch after those that have left these entries.

    Peers remember epochs, and confuse two boot epochs with the same number. If the store has lost
    nothing, the next epoch is the last one plus one plus 64 times a random number. So 64 epochs in
    a row differ in the lower six bits, by which answers name them, and a store that was restored
    unnoticed repeats an epoch only once in 1024 times. If the store is new or in doubt, the epoch
    is random.

    Args:
        entries: The stored entries.
        doubt: Why some may be missing; empty: none is.
    """
    rng = random.SystemRandom()
    kept = entries.get(EPOCH_KEY)
    doubted = doubt.encode() or entries.get(DOUBT_KEY, b"")
    if kept is None or doubt:
        epoch = rng.randrange(EPOCHS)
    else:
        more = 1 + _LIVES_IN_ROUND * rng.randrange(_ROUNDS)
        epoch = (int.from_bytes(kept, "big") + more) % EPOCHS
    life = int.from_bytes(entries.get(LIFE_KEY, b""), "big") + 1
    if doubt:
        life += rng.randrange(*_SKIPPED_LIVES)
    begun = {EPOCH_KEY: epoch.to_bytes(2, "big"), LIFE_KEY: life.to_bytes(8, "big")}
    if doubted:
        begun[DOUBT_KEY] = doubted
    return Life({**entries, **begun})
