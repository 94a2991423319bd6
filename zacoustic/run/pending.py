"""`Pending`: who waits for what an engine reports later, by the id that the engine gave."""

from collections.abc import Callable
from typing import Generic, TypeAlias, TypeVar

from zacoustic.core.engine.events import CallFailed, ResponseReceived

T = TypeVar("T")

CallEnd: TypeAlias = ResponseReceived | CallFailed
"""The end of a call, of whatever kind: they share their ids."""


class Pending(Generic[T]):
    """The waiters for outcomes of one kind; for the loop.

    Add a waiter in the command that gets the id: the events of the engine are polled after it.
    """

    def __init__(self) -> None:
        self._waiters: dict[int, Callable[[T], object]] = {}

    def add(self, number: int, take: Callable[[T], object]) -> None:
        """Add a waiter; `take` gets the outcome, once."""
        self._waiters[number] = take

    def drop(self, number: int) -> bool:
        """Forget a waiter; False: it has its outcome."""
        return self._waiters.pop(number, None) is not None

    def take(self, number: int | None, outcome: T) -> bool:
        """Pass an outcome to its waiter; False: nobody waits for it."""
        waiter = None if number is None else self._waiters.pop(number, None)
        if waiter is None:
            return False
        waiter(outcome)
        return True

    def take_all(self, outcome: T) -> None:
        """Pass one outcome to all waiters."""
        waiters, self._waiters = self._waiters, {}
        for waiter in waiters.values():
            waiter(outcome)
