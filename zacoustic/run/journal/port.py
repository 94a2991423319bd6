"""The contract between the runtime, which commits in its own thread, and a store.

A node may promise only what it still knows after a restart, and peers must be able to distinguish
its boot epochs. So a store keeps entries, each under a key, and decides how an epoch begins: with
another boot epoch, and another count of starts. No store looks at a wall clock: one that jumps by
years does no harm.
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
    """What a journal has kept."""

    boot_epoch: int
    """The boot epoch, 0…65535: not the former one."""
    entries: dict[str, bytes] = {}
    """Key → last committed value."""
    doubt: str = ""
    """Why that may lack the last commits, one line; empty: it does not."""
    failure: str = ""
    """Why it cannot be written now, one line; empty: it can."""


class Journal(Protocol):
    """A store. Its methods block; none is called while another runs, each may be on any thread."""

    def recover(self) -> JournalState:
        """Begin a boot epoch and return the kept entries; called once, before an engine is built.

        The epoch is safe when this returns, unless the store says that it cannot be written.

        Raises:
            ConfigError: The store is in use, or there can be none.
        """
        ...

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Keep these writes, all or none, before returning; a later one of a key replaces it.

        Raises:
            OSError: None of them could be kept; one line why. The same writes, and later
                ones, may be tried again.
        """
        ...

    def close(self) -> None:
        """Release the store. May be called again."""
        ...


class Life(msgspec.Struct, frozen=True):
    """How a boot epoch begins."""

    entries: dict[str, bytes]
    """What it knows of those before, and how it begins itself."""


def begin_life(entries: Mapping[str, bytes], doubt: str = "") -> Life:
    """Begin a boot epoch after those that have left these entries.

    Peers remember epochs, and take a life with one that they know for that one. Where the store
    has lost nothing, the next epoch is the last one and one more, and sixty-four times a number
    that is drawn: so that 64 lives in a row differ in the lower six bits, by which answers name
    them, and a store that was put back unseen repeats an epoch once in 1024 times only. Of a store
    that is new, or in doubt, nothing is known: its epoch is drawn.

    Args:
        entries: What was kept.
        doubt: Why that may not be all; empty: it is.
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
