"""Later actions in order of time, and in order of requests at equal instants.

The clock is the caller's: `run` does what is due, each at its own instant, also when it is called
late. What was cancelled is dropped when its turn comes, or when it outnumbers the rest.
"""

import heapq
import itertools
from collections.abc import Callable
from typing import Final, TypeAlias

Action: TypeAlias = Callable[[int], None]
"""Called with the instant at which it was due."""

_TIDY_ABOVE: Final = 64


class Task:
    """Something on an agenda."""

    __slots__ = ("action", "at")

    def __init__(self, at: int, action: Action) -> None:
        self.at = at
        self.action: Action | None = action

    def cancel(self) -> None:
        """Take it off; may be repeated."""
        self.action = None


class Agenda:
    """Tasks by their instants, ns."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Task]] = []
        self._order = itertools.count()
        self._tidy_at = _TIDY_ABOVE

    def __len__(self) -> int:
        return len(self._heap)

    def add(self, at: int, action: Action) -> Task:
        """Have something done at an instant."""
        task = Task(at, action)
        heapq.heappush(self._heap, (at, next(self._order), task))
        if len(self._heap) > self._tidy_at:
            self._heap = [entry for entry in self._heap if entry[2].action is not None]
            heapq.heapify(self._heap)
            self._tidy_at = max(_TIDY_ABOVE, 2 * len(self._heap))
        return task

    def next_at(self) -> int | None:
        """Return the instant of the first task, None without any."""
        while self._heap and self._heap[0][2].action is None:
            heapq.heappop(self._heap)
        return self._heap[0][0] if self._heap else None

    def run_next(self) -> None:
        """Do the first task."""
        _, _, task = heapq.heappop(self._heap)
        action, task.action = task.action, None
        if action is not None:
            action(task.at)

    def run(self, until: int) -> None:
        """Do the actions due at an instant, also those that become due meanwhile."""
        while (due_at := self.next_at()) is not None and due_at <= until:
            self.run_next()

    def clear(self) -> None:
        """Forget everything."""
        self._heap.clear()
