"""Ranges that a program on a link measures."""

import asyncio
import contextlib
import logging

from zacoustic.core.engine.engine import Engine
from zacoustic.core.peers.measurements import Range
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.errors import LinkClosedError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import range_error

_logger = logging.getLogger(__name__)


class LinkRanges:
    """The ranges that one node waits for.

    Args:
        runner: Whose engine measures them.
    """

    def __init__(self, runner: LinkRunner) -> None:
        self._runner = runner
        self._awaited: dict[int, asyncio.Future[Range]] = {}

    async def measure(self, address: int, timeout_s: float) -> Range:
        """Measure the range of another node; cancelling gives it up."""
        answer: asyncio.Future[Range] = asyncio.get_running_loop().create_future()

        def begin(engine: Engine, now: int) -> int:
            range_id = engine.ranging.request(address, now, timeout_s=timeout_s)
            self._awaited[range_id] = answer  # before the events of the engine are polled
            return range_id

        range_id = self._runner.apply(begin)
        try:
            return await answer
        finally:
            if self._awaited.pop(range_id, None) is not None:
                with contextlib.suppress(LinkClosedError):
                    self._runner.apply(lambda engine, now: engine.ranging.cancel(range_id))

    def measured(self, event: RangeMeasured) -> None:
        """One is there; periodic ones nobody waits for."""
        if event.range_id is None:
            return
        answer = self._awaited.pop(event.range_id, None)
        if answer is not None and not answer.done():
            answer.set_result(event.range)

    def failed(self, event: RangeFailed) -> None:
        """One will not come."""
        error = range_error(event)
        if event.range_id is None:
            node = self._runner.engine.address
            _logger.warning("node %d: ranging is not possible: %s", node, error)
            return
        answer = self._awaited.pop(event.range_id, None)
        if answer is not None and not answer.done():
            answer.set_exception(error)

    def end_all(self, error: Exception) -> None:
        """Inform the waiting callers that none will come."""
        for answer in self._awaited.values():
            if not answer.done():
                answer.set_exception(error)
        self._awaited.clear()
