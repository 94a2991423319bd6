"""A store that lives as long as its object."""

from collections.abc import Sequence

from zacoustic.core.base.journal import EPOCH_KEY, VOLATILE_KEY, JournalWrite
from zacoustic.run.journal.port import JournalState, begin_life


class MemoryJournal:
    """Stores entries for the life of the process.

    Boot epochs of one object differ. Two processes in a row draw the same epoch once in 65 536
    starts; peers then take the second for the first.
    """

    def __init__(self) -> None:
        self._entries: dict[str, bytes] = {}

    def recover(self) -> JournalState:
        """Begin the next boot epoch; return it with the committed entries."""
        is_restart = bool(self._entries)
        self._entries = begin_life(self._entries).entries
        epoch = int.from_bytes(self._entries[EPOCH_KEY], "big")
        entries = {**self._entries, VOLATILE_KEY: b""}
        return JournalState(boot_epoch=epoch, entries=entries, is_restart=is_restart)

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Store the writes while this object exists."""
        for write in writes:
            if write.value is None:
                self._entries.pop(write.key, None)
            else:
                self._entries[write.key] = write.value

    def close(self) -> None:
        """Do nothing."""
