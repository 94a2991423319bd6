"""`LifeJournal`: a journal whose boot epochs are lives of the seal, recorded apart from it.

A repeated boot epoch costs a handshake. A repeated life costs the key: two frames under one nonce.
So a node that seals writes each life into the files of `zacoustic.seal.lives` before the journal
records the epoch, and a lost or restored journal cannot repeat a life.

Each record checks the other. The journal gets the next life first, so it is never behind the files.
If it is behind them, it is an *old* journal: it lacks the frames opened and the commands executed
in the lives since then. That is reported, and such a journal is doubted like a damaged one. If the
files are behind the journal, they are old, and the next life follows the journal's.
"""

import contextlib
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from zacoustic.core.base.journal import DOUBT_KEY, EPOCH_KEY, JournalWrite
from zacoustic.run.journal.port import Journal, JournalState
from zacoustic.run.journal.thread import NO_WRITE
from zacoustic.seal.lives import LifeError, Lives, Start

START_KEY: Final = "sealed"
"""Key of the journal's last start: network, generation and life."""
_STARTED = msgspec.msgpack.Decoder(tuple[str, int, int])


class LifeJournal:
    """A journal that records lives first.

    Args:
        journal: Stores all entries.
        lives: Stores the lives.
    """

    def __init__(self, journal: Journal, lives: Lives) -> None:
        self.life: int | None = None
        """The present life; None: none has begun, so this process records none."""
        self.failure = ""
        """Why no life has begun, one line."""
        self.age = ""
        """Why the journal is old, one line; empty: it is not."""
        self._journal = journal
        self._lives = lives

    def recover(self) -> JournalState:
        """Begin a life and use it as the boot epoch; see `Journal.recover`."""
        state = self._journal.recover()
        journalled = start_in(state.entries, self._lives)
        self.age = age_of(journalled, self._lives)
        doubt = state.doubt or self.age
        entries = {**state.entries, DOUBT_KEY: doubt.encode()} if self.age else state.entries
        try:
            values = {START_KEY: self._encoded(self._lives.upcoming(journalled).life)}
            if self.age:
                values[DOUBT_KEY] = entries[DOUBT_KEY]
            # A failing store reports itself, and no engine transmits before a commit succeeds.
            with contextlib.suppress(OSError):
                self._journal.commit([_write(key, value) for key, value in values.items()])
            self.life = self._lives.begin(journalled)
        except LifeError as error:
            self.failure = str(error)
        epoch = state.boot_epoch if self.life is None else self.life
        return msgspec.structs.replace(state, boot_epoch=epoch, doubt=doubt, entries=entries)

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Commit these writes; see `Journal.commit`."""
        started: list[JournalWrite] = []
        for write in writes:
            if write.key == EPOCH_KEY and write.value is not None and self.life is not None:
                life = int.from_bytes(write.value, "big")
                started = [_write(START_KEY, self._encoded(life))]
                if life != self.life:
                    self._reach(life, started)
        self._journal.commit([*writes, *started])

    def close(self) -> None:
        """Release the store."""
        self._journal.close()

    def _reach(self, life: int, started: Sequence[JournalWrite]) -> None:
        """Record a later life of this process.

        Raises:
            OSError: It cannot be written.
        """
        self._journal.commit(started)
        try:
            self._lives.reach(life)
        except LifeError as error:
            raise OSError(str(error)) from error
        self.life = life

    def _encoded(self, life: int) -> bytes:
        lives = self._lives
        return msgspec.msgpack.encode((lives.network, lives.generation, life))


def start_in(entries: Mapping[str, bytes], lives: Lives) -> Start | None:
    """Return the last start in a journal; None: it has none of this network.

    Args:
        entries: Entries of the journal.
        lives: The life records.
    """
    try:
        network, generation, life = _STARTED.decode(entries.get(START_KEY, b""))
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None
    return Start(generation, life) if network == lives.network else None


def age_of(journalled: Start | None, lives: Lives) -> str:
    """Return why a journal is older than the life records, one line; empty: it is not.

    Args:
        journalled: The last start in the journal.
        lives: The life records.
    """
    last = lives.find().last
    if last is None or not last.life or (journalled is not None and journalled >= last):
        return ""  # a node that has just joined has life 0
    if journalled is None:
        return f"the journal knows of no start, and the last one was life {last.life}: it was lost"
    return (
        f"the journal is of life {journalled.life}, and the last start was life {last.life}: an "
        "old copy was put back"
    )


def _write(key: str, value: bytes) -> JournalWrite:
    return JournalWrite(write_id=NO_WRITE, key=key, value=value)
