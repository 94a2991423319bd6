"""`Agenda`: pending actions, in order of time, and in order of requests at equal instants.

Its time is virtual, or follows a clock. In virtual time, `run` jumps from one action to the next.
With a clock, the caller waits until `next_at` and then runs the agenda up to the present instant.
Each action still sees its own due instant, so a busy machine delays results and changes none.
"""

from collections.abc import Callable
from heapq import heapify, heappop, heappush
from typing import Any, Final, TypeAlias

MOST_AT_ONCE: Final = 1_000_000
"""Actions at one instant that indicate a timer re-armed for now for ever. 254 nodes that transmit
at once, each heard by all, cause a tenth of that."""

Entry: TypeAlias = list[Any]
"""An entry of an agenda, for `Agenda.cancel`: instant, number, action or None, arguments."""

_TIDY_ABOVE: Final = 64
_NS_PER_S: Final = 1_000_000_000


class Agenda:
    """A heap of actions.

    It is the hot path of every simulation, so an entry is a function with its arguments, not a
    closure.
    """

    def __init__(self) -> None:
        self.now = 0
        """The instant, ns since the beginning; during an action, its due instant."""
        self._heap: list[Entry] = []
        self._order = 0
        self._cancelled = 0

    def __len__(self) -> int:
        return len(self._heap) - self._cancelled

    def push(self, at: int, action: Callable[..., object], *arguments: object) -> Entry:
        """Schedule an action at an instant, ns, not before now; its result is ignored."""
        self._order += 1
        entry = [at, self._order, action, arguments]
        heappush(self._heap, entry)
        return entry

    def cancel(self, entry: Entry) -> None:
        """Cancel an entry; no effect if it has run or is cancelled already."""
        if entry[2] is None:
            return
        entry[2] = None
        self._cancelled += 1
        if self._cancelled > _TIDY_ABOVE + len(self):
            self._heap[:] = [each for each in self._heap if each[2] is not None]
            heapify(self._heap)
            self._cancelled = 0

    def clear(self) -> None:
        """Cancel all entries."""
        for entry in self._heap:
            entry[2] = None
        self._heap.clear()
        self._cancelled = 0

    def at(self, instant_s: float, action: Callable[[], object]) -> None:
        """Schedule an action at an instant, s since the beginning; at once if it is past."""
        self.push(max(self.now, round(instant_s * _NS_PER_S)), action)

    def every(self, period_s: float, action: Callable[[], object], *, first_s: float = 0.0) -> None:
        """Repeat an action.

        Raises:
            ValueError: The period is not above 0.
        """
        period_ns = round(period_s * _NS_PER_S)
        if period_ns <= 0:
            raise ValueError(f"period_s is {period_s}; allowed: above 0")

        def act() -> None:
            action()
            self.push(self.now + period_ns, act)

        self.push(max(self.now, round(first_s * _NS_PER_S)), act)

    def next_at(self) -> int | None:
        """Return the instant of the first action, ns; None: none is pending."""
        heap = self._heap
        while heap and heap[0][2] is None:
            heappop(heap)
            self._cancelled -= 1
        return heap[0][0] if heap else None

    def run(self, until: int | None = None) -> None:
        """Run the actions up to an instant, ns, and set `now` to it; None: until none is left.

        Raises:
            RuntimeError: Time makes no progress.
        """
        heap = self._heap
        since = self._order
        while heap and (until is None or heap[0][0] <= until):
            entry = heappop(heap)
            at, _, action, arguments = entry
            if action is None:
                self._cancelled -= 1
                continue
            entry[2] = None
            if at > self.now:
                self.now, since = at, self._order
            elif self._order - since > MOST_AT_ONCE:
                raise RuntimeError(f"time stands still at {at} ns: {action} {arguments}")
            action(*arguments)
        if until is not None and until > self.now:
            self.now = until
