"""Ranges that a program measures on a link."""

import logging

from zacoustic.core.peers.measurements import Range
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.zenoh.node.carrier import range_error
from zacoustic.zenoh.node.onlink.callers import Callers

_logger = logging.getLogger(__name__)


class LinkRanges:
    """The ranges of one node.

    Args:
        callers: Those who wait for them.
    """

    def __init__(self, callers: Callers) -> None:
        self._callers = callers
        self._context = callers.context

    async def measure(self, address: int, timeout_s: float) -> Range:
        """Measure the range of another node; cancelling gives up."""
        found = await self._callers.outcome(
            self._context.ranges,
            lambda engine, now: engine.ranging.request(address, now, timeout_s=timeout_s),
            lambda engine, range_id, now: engine.ranging.cancel(range_id),
        )
        if isinstance(found, RangeFailed):
            raise range_error(found)
        return found.range

    def take(self, event: RangeMeasured | RangeFailed) -> None:
        """Take a range, or the failure of one; no caller waits for periodic ones."""
        if isinstance(event, RangeFailed) and event.range_id is None:
            node = self._context.engine.address
            _logger.warning("node %d: ranging is not possible: %s", node, range_error(event))
        self._context.ranges.take(event.range_id, event)
