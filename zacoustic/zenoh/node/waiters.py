"""Callers that wait for an outcome, until the node closes or fails."""

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


class Waiters:
    """The callers of one node; for the loop."""

    def __init__(self) -> None:
        self._outcomes: set[asyncio.Future[Any]] = set()

    async def wait(self, outcome: asyncio.Future[T], give_up: Callable[[], object]) -> T:
        """Wait for an outcome; `give_up` is called after it as well, and does nothing then."""
        self._outcomes.add(outcome)
        try:
            return await outcome
        finally:
            self._outcomes.discard(outcome)
            give_up()

    def end_all(self, error: Exception) -> None:
        """Raise an error at all who wait."""
        for outcome in tuple(self._outcomes):
            settle(outcome, error)


def settle(future: asyncio.Future[T], outcome: T | Exception) -> None:
    """Set the outcome, if there is none yet; an exception is raised at the caller."""
    if future.done():
        return
    if isinstance(outcome, Exception):
        future.set_exception(outcome)
    else:
        future.set_result(outcome)
