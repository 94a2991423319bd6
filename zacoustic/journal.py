"""The journal: what a node still has to know in its next life.

The port between the runtime, which commits in a thread of its own, and a store. Today the only
store is memory, which keeps
nothing: then the boot epoch, which must differ from the one before, is drawn at random.
"""

import random
from collections.abc import Sequence
from typing import Final, Protocol

import msgspec

from zacoustic.core.journal import JournalWrite

EPOCHS: Final = 1 << 16
"""Number of boot epochs: two bytes on the wire."""


class JournalState(msgspec.Struct, frozen=True, kw_only=True):
    """What a journal has kept."""

    boot_epoch: int
    """Epoch for this life, 0…65535: not the one of the life before."""
    entries: dict[str, bytes] = {}
    """Key → last committed value."""


class Journal(Protocol):
    """A store. Its methods block; the runtime calls `commit` and `close` in one worker thread."""

    def recover(self) -> JournalState:
        """Return what was kept; called once, before an engine is built, by whoever builds it.

        Raises:
            ConfigError: The store cannot be opened or read.
        """
        ...

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Keep these writes, all or none, before returning; a later one of a key replaces it.

        Raises:
            OSError: They could not be kept; the node fails, since it has promised nothing yet.
        """
        ...

    def close(self) -> None:
        """Release the store. May be called again."""
        ...


class MemoryJournal:
    """Keeps nothing beyond this life.

    Two lives in a row draw the same epoch once in 65 536 starts; peers then take the second for the
    first.
    """

    def __init__(self) -> None:
        self._epoch = random.SystemRandom().randrange(EPOCHS)
        self._entries: dict[str, bytes] = {}

    def recover(self) -> JournalState:
        """Return the epoch that was drawn, and what was committed since."""
        return JournalState(boot_epoch=self._epoch, entries=dict(self._entries))

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Keep the writes for as long as this object lives."""
        self._entries.update((write.key, write.value) for write in writes)

    def close(self) -> None:
        """Do nothing."""
