"""Awaited answers: to calls and commands, and ranges."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Generic, TypeVar

from zacoustic.core.engine.engine import Engine
from zacoustic.run.pending import Pending
from zacoustic.run.runner import LinkRunner

T = TypeVar("T")


class Answers(Generic[T]):
    """Awaited answers of one kind, by the engine's id; for the loop.

    Args:
        runner: Drives the engine that asks.
    """

    def __init__(self, runner: LinkRunner) -> None:
        self._runner = runner
        self._pending: Pending[T | Exception] = Pending()
        self.take = self._pending.take
        self.end_all = self._pending.take_all

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
            self._pending.add(number, partial(_settle, answer))
            return number

        number = self._runner.apply(ask)
        try:
            return await answer
        finally:
            if self._pending.drop(number):
                self._runner.try_apply(lambda engine, now: cancel(engine, number, now))


async def execute_here(
    runner: LinkRunner,
    execute: Callable[[Engine, int, Callable[[T], None]], object],
    timeout_s: float,
) -> T:
    """Let this node's own engine execute a command, and wait for its answer.

    Args:
        runner: Drives the engine.
        execute: Executes it, and gives its third argument the answer.
        timeout_s: Time limit, s.
    """
    answer: asyncio.Future[T] = asyncio.get_running_loop().create_future()
    runner.apply(lambda engine, now: execute(engine, now, partial(_settle, answer)))
    async with asyncio.timeout(timeout_s):
        return await answer


def _settle(answer: asyncio.Future[T], outcome: T | Exception) -> None:
    if answer.done():
        return
    if isinstance(outcome, Exception):
        answer.set_exception(outcome)
    else:
        answer.set_result(outcome)
