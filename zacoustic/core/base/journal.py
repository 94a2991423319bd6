"""The journal port: what an engine must have journalled before it promises anything.

The core has no files. It provides `JournalWrite`s by `poll_journal`, and waits for
`handle_journal_committed` before it does what depends on them. The shell commits them in groups in
its own thread: a group all or none, in order. The commits of earlier boot epochs come back as
`stored` when an engine is built. Every engine makes one promise that depends on it: a boot epoch is
committed before the first HELLO that carries it, so no two starts of a node share an epoch.

While the shell cannot commit, `handle_journal_state` gives the reason. Waiting writes are not lost:
the shell tries again, and `handle_journal_committed` comes when it has succeeded.
"""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Final

import msgspec


class JournalWrite(msgspec.Struct, frozen=True, kw_only=True):
    """One entry; it replaces or deletes an earlier one with the same key."""

    write_id: int
    """Counted by the engine; `handle_journal_committed` names it."""
    key: str
    """The key of the entry, such as ``epoch``."""
    value: bytes | None
    """The content; None: the key is deleted."""


EPOCH_KEY = "epoch"
"""Key of the boot epoch: two bytes, big-endian."""
LIFE_KEY = "life"
"""Key of the number of this start, eight bytes, big-endian; the store writes it before an engine is
built."""
DOUBT_KEY = "doubt"
"""Key of the reason why the journal may be outdated, a line of UTF-8; the store writes it, and the
engine deletes it when it no longer matters."""
BOOT_KEY = "boot"
"""Key that the shell adds to `stored` and does not store: it names the run of the monotonic clock.
Instants of two boot epochs can be compared only if both have the same name."""
VOLATILE_KEY = "volatile"
"""Key that a store adds to `stored` if it stores nothing beyond the process."""
_APART: Final = "@"
"""The first character of the keys of separate owners."""


def stored_apart(stored: Mapping[str, bytes], owner: str | None) -> dict[str, bytes]:
    """Return an owner's entries, by its own keys.

    Args:
        stored: All entries.
        owner: As for `JournalPort.apart`; None: entries without a separate owner.
    """
    if owner is None:
        return {key: each for key, each in stored.items() if not key.startswith(_APART)}
    prefix = _key_of(owner)
    return {key[len(prefix) :]: each for key, each in stored.items() if key.startswith(prefix)}


class JournalPort:
    """The writes of an engine, and the callbacks for when they are safe."""

    def __init__(self) -> None:
        self._failure = ""
        self._writes: deque[JournalWrite] = deque()
        self._then: dict[int, Callable[[int], None]] = {}
        self._next_write_id = 1

    @property
    def failure(self) -> str:
        """Why the journal cannot be written now; empty: it can."""
        return self._failure

    def fail(self, reason: str) -> None:
        """Take why it cannot be written; empty: it can again."""
        self._failure = reason

    def write(
        self, key: str, value: bytes | None, then: Callable[[int], None] | None = None
    ) -> None:
        """Queue a write; `then` is called with the instant at which it is safe."""
        write_id = self._next_write_id
        self._next_write_id += 1
        if then is not None:
            self._then[write_id] = then
        self._writes.append(JournalWrite(write_id=write_id, key=key, value=value))

    def apart(self, owner: str) -> "JournalPort":
        """Return this port for a separate owner with keys of its own; see `stored_apart`."""
        return _JournalPortOf(self, owner)

    def poll(self) -> JournalWrite | None:
        """Return the next write."""
        return self._writes.popleft() if self._writes else None

    def committed(self, write_id: int, now: int) -> None:
        """Record that a write is safe; an unknown one has no effect."""
        then = self._then.pop(write_id, None)
        if then is not None:
            then(now)


class _JournalPortOf(JournalPort):
    """The port of one owner, within the port of all."""

    def __init__(self, journal: JournalPort, owner: str) -> None:
        self._journal = journal
        self._prefix = _key_of(owner)

    @property
    def failure(self) -> str:
        """Why the journal cannot be written now; empty: it can."""
        return self._journal.failure

    def write(
        self, key: str, value: bytes | None, then: Callable[[int], None] | None = None
    ) -> None:
        self._journal.write(self._prefix + key, value, then)


def _key_of(owner: str) -> str:
    return f"{_APART}{owner}/"
