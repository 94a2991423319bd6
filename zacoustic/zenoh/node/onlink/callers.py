"""Callers that wait for the engine of a node on a link: for calls, ranges, requests."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any, Final, TypeVar

import msgspec

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import CallTimeoutError, LocalError
from zacoustic.run.pending import Pending
from zacoustic.zenoh.requests.context import Asking, RequestContext, request_error
from zacoustic.zenoh.requests.request import Request

T = TypeVar("T")
Q = TypeVar("Q")
A = TypeVar("A", bound=msgspec.Struct)

# The engine's own time limit is below ours, because its error says more.
_BEHIND_S: Final = 1.0


class Callers:
    """The callers of one node; for the loop.

    Args:
        context: The node.
    """

    def __init__(self, context: RequestContext) -> None:
        self.context = context
        self._waiting: set[asyncio.Future[Any]] = set()

    async def outcome(
        self,
        pending: Pending[T],
        begin: Callable[[Engine, int], int],
        cancel: Callable[[Engine, int, int], object],
    ) -> T:
        """Begin something and wait for its outcome; cancelling gives up.

        Args:
            pending: Gets the outcome.
            begin: Begins it, and returns its id.
            cancel: Gives up the id in its second argument.
        """
        outcome: asyncio.Future[T] = asyncio.get_running_loop().create_future()

        def begin_and_wait(engine: Engine, now: int) -> int:
            number = begin(engine, now)
            pending.add(number, partial(_settle, outcome))
            return number  # before the events of the engine are polled

        number = self.context.runner.apply(begin_and_wait)
        try:
            return await self._wait(outcome)
        finally:
            if pending.drop(number):
                self.context.runner.try_apply(lambda engine, now: cancel(engine, number, now))

    async def ask(self, request: Request[Q, A], node: int, question: Q, within_s: float) -> A:
        """Make a request of this node, as a gateway does for its local network."""
        answer: asyncio.Future[A] = asyncio.get_running_loop().create_future()
        asking: Asking[Q, A] = Asking(
            self.context,
            node,
            question,
            within_s,
            answer=partial(_settle, answer),
            refuse=lambda failure, text: _settle(answer, request_error(node, failure, text)),
        )
        try:
            self.context.runner.apply(partial(request.begin, asking))
            async with asyncio.timeout(within_s + _BEHIND_S):
                return await self._wait(answer)
        except (LocalError, CallTimeoutError):
            raise
        except ValueError as error:
            raise LocalError(str(error)) from None
        except TimeoutError:  # of a command to this node: its journal is slow
            text = f"node {node} has not answered in time"
            raise request_error(node, CallFailure.TIMED_OUT, text) from None
        finally:
            asking.give_up()

    def end_all(self, error: Exception) -> None:
        """Raise an error at all who wait."""
        for each in tuple(self._waiting):
            _settle(each, error)

    async def _wait(self, future: asyncio.Future[T]) -> T:
        self._waiting.add(future)
        try:
            return await future
        finally:
            self._waiting.discard(future)


def _settle(future: asyncio.Future[T], outcome: T | Exception) -> None:
    if future.done():
        return
    if isinstance(outcome, Exception):
        future.set_exception(outcome)
    else:
        future.set_result(outcome)
