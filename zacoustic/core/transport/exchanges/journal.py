"""The journal of exchanges: the state of each, under its key.

An exchange is journalled if its stream says so. An entry has the digest of the stream, since after
a restart its bytes mean nothing to another definition of it: such an entry is deleted.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.streams.table import StreamTable


class ExchangeJournal:
    """The exchanges of one kind in the journal of one node.

    Args:
        prefix: First part of the names of its entries; the key of the exchange follows.
        table: The streams.
        journal: Holds the entries.
    """

    def __init__(self, prefix: str, table: StreamTable, journal: JournalPort) -> None:
        self._prefix = f"{prefix}/"
        self._table = table
        self._journal = journal

    @property
    def failure(self) -> str:
        """The reason why the journal cannot be written; empty: it can."""
        return self._journal.failure

    def recover(self, stored: Mapping[str, bytes]) -> Iterator[tuple[list[int], list[Any]]]:
        """Yield the key, in its parts, and the state of each exchange from before the restart."""
        for name, value in stored.items():
            if not name.startswith(self._prefix):
                continue
            parts = [*map(int, name[len(self._prefix) :].split("/"))]
            digest, *state = msgspec.msgpack.decode(value)
            stream = self._table.get(parts[-2])
            if stream is None or stream.digest != digest:
                self._journal.write(name, None)
            else:
                yield parts, state

    def write(
        self,
        parts: tuple[int, ...],
        state: tuple[object, ...] | None,
        then: Callable[[int], None] | None,
        now: int,
    ) -> None:
        """Journal the state of an exchange, or delete its entry; then continue.

        Args:
            parts: The parts of its key; the last ones are stream and number.
            state: What `recover` is to yield; None: the exchange is forgotten.
            then: Called once that is safe; None: nothing waits for it.
            now: The instant.
        """
        stream = self._table.by_id(parts[-2])
        if not stream.spec.journal:
            if then is not None:
                then(now)
            return
        value = None if state is None else msgspec.msgpack.encode((stream.digest, *state))
        self._journal.write(self._prefix + "/".join(map(str, parts)), value, then)
