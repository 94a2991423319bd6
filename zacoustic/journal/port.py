"""The contract between the runtime, which commits in a thread of its own, and a store.

A node may promise only what its next life still knows, and peers must be able to tell its lives
apart. So a store keeps entries, each under a key, and counts the lives: the boot epoch of a life is
that of the life before plus one. No store looks at a wall clock: one that jumps by years does no
harm.
"""

import random
from collections.abc import Mapping, Sequence
from typing import Final, Protocol

import msgspec

from zacoustic.core.journal import EPOCH_KEY, JournalWrite

EPOCHS: Final = 1 << 16
"""Number of boot epochs: two bytes on the wire."""


class JournalState(msgspec.Struct, frozen=True, kw_only=True):
    """What a journal has kept."""

    boot_epoch: int
    """Epoch for this life, 0…65535: not the one of the life before."""
    entries: dict[str, bytes] = {}
    """Key → last committed value."""


class Journal(Protocol):
    """A store. Its methods block; none is called while another runs, each may be on any thread."""

    def recover(self) -> JournalState:
        """Begin a life and return what was kept; called once, before an engine is built.

        The epoch is safe when this returns: no later life gets it again.

        Raises:
            ConfigError: The store cannot be opened, read or written.
        """
        ...

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Keep these writes, all or none, before returning; a later one of a key replaces it.

        Raises:
            OSError: None of them could be kept; one line says why. The same writes, and later
                ones, may be tried again.
        """
        ...

    def close(self) -> None:
        """Release the store. May be called again."""
        ...


def next_epoch(entries: Mapping[str, bytes]) -> int:
    """Return the epoch that follows the kept one; without one, any.

    A store without an epoch is new, the node need not be: peers may remember lives of which the
    store was lost. So the first epoch is drawn, and is theirs in one of 65 536 cases only.
    """
    kept = entries.get(EPOCH_KEY)
    if kept is None:
        return random.SystemRandom().randrange(EPOCHS)
    return (int.from_bytes(kept, "big") + 1) % EPOCHS
