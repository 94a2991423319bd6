"""The single thread for calls of Zenoh that may block.

A reply to a client that does not read, a declaration on a full connection, opening and closing can
each block for seconds; the loop, which owns the engine, must not block. The worker keeps the order
of the steps.
"""

import asyncio
import logging
import queue
import threading
from collections.abc import Callable
from functools import partial
from typing import Final, TypeVar

import zenoh

from zacoustic.run.inbox import tell_loop
from zacoustic.zenoh.session.exitguard import ExitGuard

T = TypeVar("T")

# Longer than the attempt of a node to reach its router, which cannot be interrupted.
EXIT_LIMIT_S: Final = 4.0
"""How long the end of the process waits for the last steps, s."""

_END: Final = None

_logger = logging.getLogger(__name__)


class Worker:
    """A thread that runs steps one after the other; it starts on construction.

    It ends with `end` or `close`, or with the main thread. The callers bound the number of steps:
    queries by `QueryHandler`, calls by the call numbers, declarations by the stream table.

    Args:
        name: Of the thread.
    """

    def __init__(self, name: str) -> None:
        self._steps: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        self._farewell: Callable[[], object] = _do_nothing
        # A daemon: a call that never returns does not keep the process alive.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._guard = ExitGuard(self._exit)
        self._thread.start()

    def submit(self, step: Callable[[], object]) -> None:
        """Run a step soon, from any thread; errors of Zenoh are logged."""
        self._steps.put(step)

    async def run(self, step: Callable[[], T], *, limit_s: float | None = None) -> T:
        """Run a step and wait for it.

        Args:
            step: The step.
            limit_s: Time limit, s; None: none. The step itself cannot be stopped.

        Raises:
            TimeoutError: The step is not done in time.
            Exception: Whatever the step raises.
        """
        loop = asyncio.get_running_loop()
        done: asyncio.Future[T] = loop.create_future()

        def tell(report: Callable[[], None]) -> None:
            tell_loop(loop, lambda: None if done.done() else report())  # the caller may be gone

        def take() -> None:
            try:
                result = step()
            except Exception as error:  # passed on to the waiting caller
                # Nothing here keeps it: its frames may hold a callback for which Zenoh waits.
                tell(partial(done.set_exception, error))
            else:
                tell(lambda: done.set_result(result))

        self._steps.put(take)
        async with asyncio.timeout(limit_s):
            return await done

    def end_with(self, farewell: Callable[[], object]) -> None:
        """Set the last step, for any caller that ends the thread; called in a step."""
        self._farewell = farewell

    def end(self) -> None:
        """Run the pending steps and end, without waiting. May be called again."""
        self._steps.put(_END)

    async def close(self, *, limit_s: float) -> bool:
        """Run the pending steps and end; False: that takes longer than `limit_s`."""
        self.end()
        await asyncio.to_thread(self._thread.join, limit_s)
        return not self._thread.is_alive()

    def _exit(self) -> None:
        self.end()
        self._thread.join(EXIT_LIMIT_S)

    def _run(self) -> None:
        while (step := self._steps.get()) is not _END:
            self._take(step)
        self._take(self._farewell)
        self._guard.dismiss()

    def _take(self, step: Callable[[], object]) -> None:
        try:
            step()
        except zenoh.ZError as error:
            _logger.debug("zenoh: %s", error)
        except Exception:  # a bug in one step; later steps belong to others
            _logger.exception("a step of the thread %s failed", self._thread.name)


def _do_nothing() -> None:
    pass
