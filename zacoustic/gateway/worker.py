"""The one thread in which a gateway makes calls of Zenoh that may block.

A reply to somebody who does not read, a declaration on a full connection, opening and closing can
each block for seconds; the loop, which owns the engine, must not. The order of the steps is kept.
"""

import asyncio
import contextlib
import logging
import queue
import threading
from collections.abc import Callable
from typing import Final, TypeVar

import zenoh

T = TypeVar("T")

_END: Final = None

_logger = logging.getLogger(__name__)


class Worker:
    """A thread that takes steps one after the other; it starts when it is made.

    What is handed over is bounded by who hands it over: queries by `QueryDesk`, calls by the
    engine's call numbers, declarations by the stream table.
    """

    def __init__(self, name: str) -> None:
        self._steps: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        # A daemon: a call that never returns does not keep the process.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, step: Callable[[], object]) -> None:
        """Take a step soon; from any thread. What Zenoh raises is logged."""
        self._steps.put(step)

    async def run(self, step: Callable[[], T], *, limit_s: float | None = None) -> T:
        """Take a step and wait for it.

        Args:
            step: What to do.
            limit_s: How long to wait, s; None: for ever. The step itself cannot be stopped.

        Raises:
            TimeoutError: It is not done in time.
            Exception: What the step raises.
        """
        loop = asyncio.get_running_loop()
        done: asyncio.Future[T] = loop.create_future()

        def tell(report: Callable[[], None]) -> None:
            # The waiting one may be gone, and so may the loop.
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(lambda: None if done.done() else report())

        def take() -> None:
            try:
                result = step()
            except Exception as error:  # handed on to whoever waits
                failure = error
                tell(lambda: done.set_exception(failure))
            else:
                tell(lambda: done.set_result(result))

        self._steps.put(take)
        async with asyncio.timeout(limit_s):
            return await done

    def end(self) -> None:
        """Take the steps that are there, then end; does not wait."""
        self._steps.put(_END)

    async def close(self, *, limit_s: float) -> None:
        """Take the steps that are there, then end; gives up to wait after `limit_s`, s."""
        self.end()
        await asyncio.to_thread(self._thread.join, limit_s)

    def _run(self) -> None:
        while (step := self._steps.get()) is not _END:
            try:
                step()
            except zenoh.ZError as error:
                _logger.debug("zenoh: %s", error)
            except Exception:
                _logger.exception("a step of the thread %s failed", self._thread.name)
