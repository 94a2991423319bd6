"""`LifeJournal`: a journal whose boot epochs are lives of the seal, kept apart from it.

A boot epoch that comes twice costs a handshake. A life that comes twice costs the key: two frames
under one nonce. So where frames are sealed, the number of the life is on the disk in the files of
`zacoustic.seal.lives` before the journal says that the epoch is, and a journal that was lost, or
put back from an old copy, changes nothing about it.
"""

from collections.abc import Sequence

from zacoustic.core.base.journal import EPOCH_KEY, JournalWrite
from zacoustic.run.journal.port import Journal, JournalState
from zacoustic.seal.lives import LifeError, Lives


class LifeJournal:
    """A journal that writes down lives first.

    Args:
        journal: Takes everything.
        lives: Takes the lives.
        life: The one that has begun; None: none could, and none of this process is written.
    """

    def __init__(self, journal: Journal, lives: Lives, life: int | None) -> None:
        self._journal = journal
        self._lives = lives
        self._life = life

    def recover(self) -> JournalState:
        """Begin a boot epoch; see `Journal.recover`."""
        return self._journal.recover()

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        """Keep these writes; see `Journal.commit`."""
        for write in writes:
            if write.key == EPOCH_KEY and write.value is not None:
                self._begin(int.from_bytes(write.value, "big"))
        self._journal.commit(writes)

    def close(self) -> None:
        """Release the store."""
        self._journal.close()

    def _begin(self, life: int) -> None:
        if self._life is None or life == self._life:
            return
        try:
            self._lives.reach(life)
        except LifeError as error:
            raise OSError(str(error)) from error
        self._life = life
