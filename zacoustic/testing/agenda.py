"""`Agenda`: virtual time. Future actions in order; time jumps from one to the next."""

import heapq
from collections.abc import Callable
from typing import Any, Final

from zacoustic.core.base.clock import seconds_to_ns

MOST_AT_ONCE: Final = 100_000
"""Actions at one instant that are taken for a timer that is armed for now again and again."""


class Agenda:
    """A heap of actions; those of one instant happen in the order of their insertion.

    It is the hot path of every simulation, so an entry is a function and its arguments, not a
    closure.
    """

    def __init__(self) -> None:
        self.now = 0
        """The instant, ns since the beginning."""
        self._heap: list[tuple[int, int, Callable[..., object], tuple[Any, ...]]] = []
        self._order = 0

    def __len__(self) -> int:
        return len(self._heap)

    def push(self, at: int, action: Callable[..., object], *arguments: object) -> None:
        """Do something at an instant, ns, not before now; its result is thrown away."""
        self._order += 1
        heapq.heappush(self._heap, (at, self._order, action, arguments))

    def at(self, instant_s: float, action: Callable[[], object]) -> None:
        """Do something at an instant, s since the beginning; at once if that is over."""
        self.push(max(self.now, seconds_to_ns(instant_s)), action)

    def every(self, period_s: float, action: Callable[[], object], *, first_s: float = 0.0) -> None:
        """Repeat an action.

        Raises:
            ValueError: The period is not above 0.
        """
        period_ns = seconds_to_ns(period_s)
        if period_ns <= 0:
            raise ValueError(f"period_s is {period_s}; allowed: above 0")

        def act() -> None:
            action()
            self.push(self.now + period_ns, act)

        self.push(max(self.now, seconds_to_ns(first_s)), act)

    def run(self, *, until_s: float | None = None) -> None:
        """Run the actions up to an instant, or until none is left.

        Raises:
            RuntimeError: Time does not go on.
        """
        heap, pop = self._heap, heapq.heappop
        until = None if until_s is None else seconds_to_ns(until_s)
        since = self._order
        while heap and (until is None or heap[0][0] <= until):
            at, _, action, arguments = pop(heap)
            if at > self.now:
                self.now, since = at, self._order
            elif self._order - since > MOST_AT_ONCE:
                raise RuntimeError(f"time stands still at {at} ns: {action} {arguments}")
            action(*arguments)
        if until is not None:
            self.now = max(self.now, until)
