"""`Replacement`: the next engine of a node, in place of one that has raised.

It is made as after a crash of the process: from the committed entries of the journal, in a new boot
epoch. Uncommitted writes are lost with their engine. This module knows the committed ones, so it
does not read the store again. An entry that makes the next engine raise is left out (`intact`). If
no engine can be made, the attempt is repeated until one can.
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
    """Makes the next engine of a node.

    Args:
        first: The first engine, and what it was made from.
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
        """The former engine is lost, and the next one is not ready."""
        return self._task is not None

    def hand_on(self, deliver: Callable[[Event], None], instant: Clock, event: Event) -> None:
        """Pass an event on, unless the application has it; an error there is a fault."""
        if self._outstanding.passes(event):
            try:
                deliver(event)
            except Exception as error:  # of the application, or a bug: the engine is whole
                self.faults.note(error, instant(), event=event)

    def committed(self, write: JournalWrite) -> None:
        """Note a committed write."""
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
            pause_s: Pause before, s.
            journal: Its running commit is awaited.
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
                except Exception as error:  # for example no memory: repeat until it succeeds
                    await asyncio.sleep(max(self.faults.note(error, instant()), FIRST_PAUSE_S))
            intact.engine.stats.dropped["internal_error"] = self.faults.count
            self._entries = intact.entries
            self._task = None
            ready(intact)

        self._task = asyncio.get_running_loop().create_task(replace(), name="next engine")

    def news(self, engine: Engine, error: Exception, now: int) -> Iterator[Event]:
        """Yield the event of the replacement, and the outcomes of lost requests."""
        yield EngineRestarted(
            faults=self.faults.count, cause=str(error) or repr(error), changed_at=now
        )
        yield from self._outstanding.renew(engine, now)

    async def stop(self) -> None:
        """Make no more engines."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
