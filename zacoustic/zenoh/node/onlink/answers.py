"""Awaited answers: to calls, to commands, and ranges."""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Generic, TypeVar

from zacoustic.core.engine.engine import Engine
from zacoustic.errors import LinkClosedError
from zacoustic.run.runner import LinkRunner

T = TypeVar("T")


class Answers(Generic[T]):
    """Awaited answers of one kind, by the engine's id; for the loop.

    Args:
        runner: Drives the engine that asks.
    """

    def __init__(self, runner: LinkRunner) -> None:
        self._runner = runner
        self._awaited: dict[int, asyncio.Future[T]] = {}

    async def ask(
        self, begin: Callable[[Engine, int], int], cancel: Callable[[Engine, int, int], object]
    ) -> T:
        """Ask and wait for the answer; cancelling gives up.

        Args:
            begin: Asks, and returns the id of the answer.
            cancel: Gives up the id in its second argument.
        """
        answer: asyncio.Future[T] = asyncio.get_running_loop().create_future()

        def ask(engine: Engine, now: int) -> int:
            number = begin(engine, now)
            self._awaited[number] = answer  # before the events of the engine are polled
            return number

        number = self._runner.apply(ask)
        try:
            return await answer
        finally:
            if self._awaited.pop(number, None) is not None:
                with contextlib.suppress(LinkClosedError):
                    self._runner.apply(lambda engine, now: cancel(engine, number, now))

    def take(self, number: int | None, outcome: T | Exception) -> bool:
        """Pass an answer, or an error instead, to its caller; False: nobody waits for it."""
        answer = None if number is None else self._awaited.pop(number, None)
        if answer is None:
            return False
        _settle(answer, outcome)
        return True

    def awaits(self, number: int) -> bool:
        """Return whether a caller waits for this id."""
        return number in self._awaited

    def end_all(self, error: Exception) -> None:
        """Inform the waiting callers that no answer will come."""
        awaited, self._awaited = self._awaited, {}
        for answer in awaited.values():
            _settle(answer, error)


def _settle(answer: asyncio.Future[T], outcome: T | Exception) -> None:
    if answer.done():
        return
    if isinstance(outcome, Exception):
        answer.set_exception(outcome)
    else:
        answer.set_result(outcome)
