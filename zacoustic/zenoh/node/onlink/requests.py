"""Requests of a node on a link: ranges, and what a gateway asks for its local network."""

import asyncio
import logging
from functools import partial
from typing import Final, TypeVar

import msgspec

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailure
from zacoustic.core.peers.measurements import Range
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.errors import CallTimeoutError, LocalError
from zacoustic.zenoh.node.carrier import range_error
from zacoustic.zenoh.node.waiters import Waiters, settle
from zacoustic.zenoh.requests.context import Asking, RequestContext, request_error
from zacoustic.zenoh.requests.request import Request

Q = TypeVar("Q")
A = TypeVar("A", bound=msgspec.Struct)

# The engine's own time limit is below ours, because its error says more.
_BEHIND_S: Final = 1.0

_logger = logging.getLogger(__name__)


class LinkRequests:
    """The requests of one node; for the loop.

    Args:
        context: The node.
        waiters: The callers that wait.
    """

    def __init__(self, context: RequestContext, waiters: Waiters) -> None:
        self._context = context
        self._waiters = waiters

    async def ask(self, request: Request[Q, A], node: int, question: Q, within_s: float) -> A:
        """Make a request of this node, as a gateway does for its local network."""
        answer: asyncio.Future[A] = asyncio.get_running_loop().create_future()
        asking: Asking[Q, A] = Asking(
            self._context,
            node,
            question,
            within_s,
            answer=partial(settle, answer),
            refuse=lambda failure, text: settle(answer, request_error(node, failure, text)),
        )
        try:
            self._context.runner.apply(partial(request.begin, asking))
            async with asyncio.timeout(within_s + _BEHIND_S):
                return await self._waiters.wait(answer, asking.give_up)
        except (LocalError, CallTimeoutError):
            raise
        except ValueError as error:
            raise LocalError(str(error)) from None
        except TimeoutError:  # of a command to this node: its journal is slow
            text = f"node {node} has not answered in time"
            raise request_error(node, CallFailure.TIMED_OUT, text) from None

    async def range(self, address: int, timeout_s: float) -> Range:
        """Measure the range of another node; cancelling gives up."""
        outcome: asyncio.Future[Range] = asyncio.get_running_loop().create_future()

        def take(event: RangeMeasured | RangeFailed) -> None:
            settle(outcome, range_error(event) if isinstance(event, RangeFailed) else event.range)

        def ask(engine: Engine, now: int) -> int:
            range_id = engine.ranging.request(address, now, timeout_s=timeout_s)
            self._context.ranges.add(range_id, take)
            return range_id  # before the events of the engine are polled

        range_id = self._context.runner.apply(ask)
        return await self._waiters.wait(outcome, partial(self._cancel_range, range_id))

    def take_range(self, event: RangeMeasured | RangeFailed) -> None:
        """Take a range, or the failure of one; no caller waits for periodic ones."""
        if isinstance(event, RangeFailed) and event.range_id is None:
            node = self._context.engine.address
            _logger.warning("node %d: ranging is not possible: %s", node, range_error(event))
        self._context.ranges.take(event.range_id, event)

    def _cancel_range(self, range_id: int) -> None:
        if self._context.ranges.drop(range_id):
            self._context.runner.try_apply(lambda engine, now: engine.ranging.cancel(range_id))
