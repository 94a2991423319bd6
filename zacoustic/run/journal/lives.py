"""`LifeJournal`: a journal whose boot epochs are lives of the seal, kept apart from it.

A boot epoch that comes twice costs a handshake. A life that comes twice costs the key: two frames
under one nonce. So where frames are sealed, the number of the life is on the disk in the files of
`zacoustic.seal.lives` before the journal says that the epoch is, and a journal that was lost, or
put back from an old copy, changes nothing about it.

Each is the witness of the other. The journal is told first which life is going to begin, so it is
never behind the files. One that is, is *old*: it does not know which frames were opened, and what
was executed, in the lives since then; that is told, and doubted like a damaged journal. Files that
are behind the journal are old themselves, and the next life begins behind that of the journal.
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
"""Key of the last start that the journal knows of: network, generation and life."""
_STARTED = msgspec.msgpack.Decoder(tuple[str, int, int])


class LifeJournal:
    """A journal that writes down lives first.

    Args:
        journal: Takes everything.
        lives: Takes the lives.
    """

    def __init__(self, journal: Journal, lives: Lives) -> None:
        self.life: int | None = None
        """The life that has begun; None: none has, and none of this process is written."""
        self.failure = ""
        """Why none has begun, one line."""
        self.age = ""
        """Why the journal is an old one, one line; empty: it is not."""
        self._journal = journal
        self._lives = lives

    def recover(self) -> JournalState:
        """Begin a life, which is the boot epoch if one begins; see `Journal.recover`."""
        state = self._journal.recover()
        journalled = start_in(state.entries, self._lives)
        self.age = age_of(journalled, self._lives)
        doubt = state.doubt or self.age
        entries = {**state.entries, DOUBT_KEY: doubt.encode()} if self.age else state.entries
        try:
            values = {START_KEY: self._encoded(self._lives.upcoming(journalled).life)}
            if self.age:
                values[DOUBT_KEY] = entries[DOUBT_KEY]
            # One that cannot be written says so by itself, and no engine speaks before it can be.
            with contextlib.suppress(OSError):
                self._journal.commit([_write(key, value) for key, value in values.items()])
            self.life = self._lives.begin(journalled)
        except LifeError as error:
            self.failure = str(error)
        epoch = state.boot_epoch if self.life is None else self.life
        return msgspec.structs.replace(state, boot_epoch=epoch, doubt=doubt, entries=entries)

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Keep these writes; see `Journal.commit`."""
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
        """Have a later life of this process written down.

        Raises:
            OSError: It cannot be.
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
    """Return the last start that a journal knows of; None: it knows of none with this network.

    Args:
        entries: Of the journal.
        lives: The records.
    """
    try:
        network, generation, life = _STARTED.decode(entries.get(START_KEY, b""))
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None
    return Start(generation, life) if network == lives.network else None


def age_of(journalled: Start | None, lives: Lives) -> str:
    """Return why a journal is older than the life records, one line; empty: it is not.

    Args:
        journalled: The last start that it knows of.
        lives: The records.
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
