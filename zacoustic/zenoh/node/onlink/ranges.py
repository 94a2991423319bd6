"""Ranges that a program measures on a link."""

import logging

from zacoustic.core.peers.measurements import Range
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import range_error
from zacoustic.zenoh.node.onlink.answers import Answers

_logger = logging.getLogger(__name__)


class LinkRanges:
    """The ranges for which one node waits.

    Args:
        runner: Drives the engine that measures them.
    """

    def __init__(self, runner: LinkRunner) -> None:
        self._runner = runner
        self._answers: Answers[Range] = Answers(runner)
        self.end_all = self._answers.end_all

    async def measure(self, address: int, timeout_s: float) -> Range:
        """Measure the range of another node; cancelling gives up."""
        return await self._answers.ask(
            lambda engine, now: engine.ranging.request(address, now, timeout_s=timeout_s),
            lambda engine, range_id, now: engine.ranging.cancel(range_id),
        )

    def measured(self, event: RangeMeasured) -> None:
        """Take a range; no caller waits for periodic ones."""
        self._answers.take(event.range_id, event.range)

    def failed(self, event: RangeFailed) -> None:
        """Take the failure of a range."""
        error = range_error(event)
        if event.range_id is None:
            node = self._runner.engine.address
            _logger.warning("node %d: ranging is not possible: %s", node, error)
        self._answers.take(event.range_id, error)
