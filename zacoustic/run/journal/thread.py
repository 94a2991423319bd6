"""The journal's thread: commits in groups, off the loop, repeated while they fail.

A commit waits for the disk, so it must not run on the loop. Writes during a commit collect and form
the next group: a slow disk makes larger groups, not a longer queue.

A commit may fail: the disk is full, or the system has made it read-only after a fault of the card.
To stop the node then would deprive a vehicle of telemetry and emergency commands, which need no
journal. So no waiting write is dropped or reported as committed: callers wait on, the operator is
informed, and the thread repeats the group together with later writes.
"""

import asyncio
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

from zacoustic.core.base.journal import JournalWrite
from zacoustic.run.journal.port import Journal, JournalState

FIRST_RETRY_S: Final = 1.0
"""Pause after a failed commit, s; doubles with each failure in a row."""
LONGEST_RETRY_S: Final = 60.0
"""Longest pause between two attempts, s: about how long an operator waits after making room."""

NO_WRITE: Final = 0
"""Id of a write that no engine waits for."""

_logger = logging.getLogger(__name__)

T = TypeVar("T")


async def recover(journal: Journal) -> JournalState:
    """Begin a boot epoch off the loop; see `Journal.recover`.

    Raises:
        ConfigError: The store cannot be opened, read or written.
    """
    return await _elsewhere(journal.recover)


async def release(journal: Journal) -> None:
    """Close a journal off the loop, if no `JournalThread` does it."""
    await _elsewhere(journal.close)


class JournalThread:
    """Commits the writes of one engine; used on the loop.

    Args:
        journal: The store; closed with this object.
        committed: Takes each committed group.
        state_changed: Takes the reason when the store cannot be written; empty when it can again.
        fail: Takes any other exception of the store or of the two callbacks; no commit follows it.
    """

    def __init__(
        self,
        journal: Journal,
        *,
        committed: Callable[[Sequence[JournalWrite]], None],
        state_changed: Callable[[str], None],
        fail: Callable[[Exception], None],
    ) -> None:
        self.failure = ""
        """Why the last commit failed; empty: it did not."""
        self._journal = journal
        self._committed = committed
        self._state_changed = state_changed
        self._fail = fail
        self._retry_s = FIRST_RETRY_S
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="journal")
        self._waiting: list[JournalWrite] = []
        self._under_way = 0
        self._task: asyncio.Task[None] | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._is_stopped = False

    def put(self, write: JournalWrite) -> None:
        """Commit a write soon, with others that wait."""
        self._waiting.append(write)
        if self._task is None and self._retry is None and not self._is_stopped:
            self._begin()

    async def settle(self) -> None:
        """Forget the waiting writes of a lost engine; on return no commit is under way.

        Commits meanwhile are reported as always. Writes of no engine (`NO_WRITE`) stay.
        """
        kept = self._waiting[self._under_way :]
        self._waiting[self._under_way :] = _of_no_engine(kept)
        if self._task is not None:
            await asyncio.wait([self._task])
        self._waiting = _of_no_engine(self._waiting)  # a commit may have failed

    async def close(self) -> None:
        """Commit the waiting writes as far as possible now, and close the store."""
        if self._retry is not None:
            self._retry.cancel()
            self._begin()
        self._is_stopped = True
        if self._task is not None:
            await asyncio.wait([self._task])
        if self._waiting:
            _logger.error("journal: %d writes were not kept: %s", len(self._waiting), self.failure)
        await asyncio.get_running_loop().run_in_executor(self._thread, self._journal.close)
        self._thread.shutdown()

    def _begin(self) -> None:
        self._retry = None
        self._task = asyncio.get_running_loop().create_task(self._run(), name="journal")

    async def _run(self) -> None:
        """Commit group after group until no write waits, or a commit fails."""
        try:
            while self._waiting and await self._commit():
                pass
        except Exception as error:  # of the store or its owner: the runner stops
            self._is_stopped = True
            self._fail(error)
        finally:
            self._task = None

    async def _commit(self) -> bool:
        """Commit all waiting writes as one group; False: it failed and will be repeated."""
        group, loop = tuple(self._waiting), asyncio.get_running_loop()
        self._under_way = len(group)
        try:
            await loop.run_in_executor(self._thread, self._journal.commit, group)
        except OSError as error:
            self._put_off(str(error))
            return False
        finally:
            self._under_way = 0
        del self._waiting[: len(group)]
        self._retry_s = FIRST_RETRY_S
        self._note("")
        self._committed(group)
        return True

    def _put_off(self, failure: str) -> None:
        # Of several waiting values of a key only the last will be read.
        last = {write.key: write.write_id for write in self._waiting}
        self._waiting = [
            write
            if write.value is None or last[write.key] == write.write_id
            else JournalWrite(write_id=write.write_id, key=write.key, value=None)
            for write in self._waiting
        ]
        if not self._is_stopped:
            loop = asyncio.get_running_loop()
            self._retry = loop.call_later(self._retry_s, self._begin)
            self._retry_s = min(2 * self._retry_s, LONGEST_RETRY_S)
        self._note(failure)

    def _note(self, failure: str) -> None:
        if failure != self.failure:
            self.failure = failure
            self._state_changed(failure)


def _of_no_engine(writes: Sequence[JournalWrite]) -> list[JournalWrite]:
    return [write for write in writes if write.write_id == NO_WRITE]


async def _elsewhere(step: Callable[[], T]) -> T:
    """Run one blocking step in a thread of its own."""
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="journal") as thread:
        return await asyncio.get_running_loop().run_in_executor(thread, step)
