"""`Replacement`: the next engine of a node, in place of one that has raised.

It is made as after a crash of the process: from the committed entries of the journal, in a new boot
epoch. Uncommitted writes are forgotten with their engine; committed ones are known here, so the
store is not read again. An entry that makes the next engine raise, too, is left out (`intact`); if
none can be made, that is tried again until one can.
"""

import asyncio
from collections.abc import Callable, Iterator

from zacoustic.core.base.clock import Clock
from zacoustic.core.base.journal import JournalWrite
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import EngineRestarted, Event
from zacoustic.run.journal import EPOCHS
from zacoustic.run.journal.thread import JournalThread
from zacoustic.run.replacement.faults import FIRST_PAUSE_S, Faults
from zacoustic.run.replacement.intact import Intact, Trial
from zacoustic.run.replacement.outstanding import Outstanding


class Replacement:
    """Knows what the next engine of a node needs.

    Args:
        first: The first engine, and what it was made of.
    """

    def __init__(self, first: Intact) -> None:
        self.faults = Faults(first.engine.address)
        self._renew = first.renew
        self._entries = dict(first.engine.stored)
        self._outstanding = Outstanding()
        self._outstanding.watch(first.engine)
        self._task: asyncio.Task[None] | None = None

    @property
    def is_under_way(self) -> bool:
        """The former engine is lost, and the next one is not there yet."""
        return self._task is not None

    def hand_on(self, deliver: Callable[[Event], None], instant: Clock, event: Event) -> None:
        """Hand an event on, unless the application has it; an error there is a fault."""
        if self._outstanding.passes(event):
            try:
                deliver(event)
            except Exception as error:  # the application's, or a bug: the engine is whole
                self.faults.note(error, instant(), event=event)

    def committed(self, write: JournalWrite) -> None:
        """Take note of a write that is safe."""
        if write.value is None:
            self._entries.pop(write.key, None)
        else:
            self._entries[write.key] = write.value

    def begin(
        self,
        lost: Engine,
        pause_s: float,
        journal: JournalThread | None,
        trial: Trial | None,
        instant: Clock,
        ready: Callable[[Intact], None],
    ) -> None:
        """Make the next engine; on the loop.

        Args:
            lost: The engine that has raised.
            pause_s: Time to wait before, s.
            journal: Whose commits are waited for.
            trial: The first step, to test that it does not raise; None: no test.
            instant: Tells the instant.
            ready: Takes the engine, not yet polled.
        """

        async def replace() -> None:
            if journal is not None:
                await journal.settle()
            await asyncio.sleep(pause_s)
            epoch = (lost.epoch + 1) % EPOCHS
            while True:
                try:
                    intact = Intact(self._renew, epoch, self._entries, trial)
                    break
                except Exception as error:  # such as no memory: tried again until one is made
                    await asyncio.sleep(max(self.faults.note(error, instant()), FIRST_PAUSE_S))
            intact.engine.stats.dropped["internal_error"] = self.faults.count
            self._entries = intact.entries
            self._task = None
            ready(intact)

        self._task = asyncio.get_running_loop().create_task(replace(), name="next engine")

    def news(self, engine: Engine, error: Exception, now: int) -> Iterator[Event]:
        """Report the replacement, and the outcomes of all that was under way."""
        yield EngineRestarted(
            faults=self.faults.count, cause=str(error) or repr(error), changed_at=now
        )
        yield from self._outstanding.renew(engine, now)

    async def stop(self) -> None:
        """Make no engine any more."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
