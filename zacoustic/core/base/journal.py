"""The journal port: what an engine must have written down before it promises anything.

The core has no files. It hands out `JournalWrite`s by `poll_journal`, and waits for
`handle_journal_committed` before it does what depends on them. The shell commits them in groups in
its own thread: a group all or none, in order. The commits of former boot epochs come back as
`stored` when an engine is built. One promise depends on it in every engine: a boot epoch is
committed before the first HELLO that carries it, so no two starts of a node share an epoch.

While the shell cannot commit, `handle_journal_state` gives the reason. Nothing that waits is lost
then: the shell tries again, and `handle_journal_committed` comes when it has succeeded.
"""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Final

import msgspec


class JournalWrite(msgspec.Struct, frozen=True, kw_only=True):
    """One entry; replaces or deletes a former one with the same key."""

    write_id: int
    """Counted by the engine; `handle_journal_committed` names it."""
    key: str
    """What it is about, such as ``epoch``."""
    value: bytes | None
    """The content; None: the key is deleted."""


EPOCH_KEY = "epoch"
"""Key of the boot epoch: two bytes, big-endian."""
LIFE_KEY = "life"
"""Key of the number of this life, eight bytes, big-endian: written by the store, before an engine
is built."""
DOUBT_KEY = "doubt"
"""Key of why the journal may not be what was written last, a line of UTF-8: written by the store,
deleted by the engine when it does not matter any more."""
BOOT_KEY = "boot"
"""Key that the shell adds to what was stored, and keeps nowhere: it names the run of the monotonic
clock. Instants of two lives with the same name can be compared; without a name none can."""
VOLATILE_KEY = "volatile"
"""Key that a store adds to what was stored if it keeps nothing beyond the process."""
_APART: Final = "@"
"""What the keys of owners apart begin with."""


def stored_apart(stored: Mapping[str, bytes], owner: str | None) -> dict[str, bytes]:
    """Return what was stored by an owner, by its own keys.

    Args:
        stored: Everything.
        owner: As for `JournalPort.apart`; None: what was stored by nobody apart.
    """
    if owner is None:
        return {key: each for key, each in stored.items() if not key.startswith(_APART)}
    prefix = _key_of(owner)
    return {key[len(prefix) :]: each for key, each in stored.items() if key.startswith(prefix)}


class JournalPort:
    """What an engine has to write down, and what it does when that is safe."""

    failure: str
    """Why the journal cannot be written now; empty: it can."""

    def __init__(self) -> None:
        self.failure = ""
        self._writes: deque[JournalWrite] = deque()
        self._then: dict[int, Callable[[int], None]] = {}
        self._next_write_id = 1

    def write(
        self, key: str, value: bytes | None, then: Callable[[int], None] | None = None
    ) -> None:
        """Hand out a write; `then` is called with the instant at which it is safe."""
        write_id = self._next_write_id
        self._next_write_id += 1
        if then is not None:
            self._then[write_id] = then
        self._writes.append(JournalWrite(write_id=write_id, key=key, value=value))

    def apart(self, owner: str) -> "JournalPort":
        """Return this port for an owner whose keys are no one else's; see `stored_apart`."""
        return _JournalPortOf(self, owner)

    def poll(self) -> JournalWrite | None:
        """Return the next write."""
        return self._writes.popleft() if self._writes else None

    def committed(self, write_id: int, now: int) -> None:
        """A write is safe; one that is not known does nothing."""
        then = self._then.pop(write_id, None)
        if then is not None:
            then(now)


class _JournalPortOf(JournalPort):
    """The journal of one owner, in that of all."""

    def __init__(self, journal: JournalPort, owner: str) -> None:
        self._journal = journal
        self._prefix = _key_of(owner)

    @property
    def failure(self) -> str:  # type: ignore[override]
        return self._journal.failure

    def write(
        self, key: str, value: bytes | None, then: Callable[[int], None] | None = None
    ) -> None:
        self._journal.write(self._prefix + key, value, then)


def _key_of(owner: str) -> str:
    return f"{_APART}{owner}/"
