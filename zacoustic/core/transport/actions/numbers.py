"""Which of the 32 numbers of a client's goals on one stream are free.

Numbers are reused, so both ends must agree when one is free. The rules are those of calls
(`zacoustic.core.transport.calls.calls`), with other figures:

1. A goal begins only after the one `WINDOW` numbers earlier has ended and nothing that was sent of
   it can arrive any more. So all GOALs under way have numbers within a window of `WINDOW`.
2. A GOAL closes at its server all goals that are `WINDOW` to 32 - `WINDOW` numbers earlier. By rule
   1 they have ended at their client, so the server forgets them.
3. A number is reused only when an answer has proved, a settling time ago, that the server closed
   its last use. If no such answer comes, or a goal runs on while `WINDOW` others have come and
   gone, the client begins a new boot epoch; the goals under way survive that.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

from zacoustic.core.transport.repeating import Repetition
from zacoustic.core.wire.goals import GOAL_NUMBERS

WINDOW: Final = 12
"""The most goals of one client on one stream that can be under way at once."""


def closes(number: int, other: int) -> bool:
    """Return whether a goal proves that another has ended at its client (rule 2)."""
    return WINDOW <= (number - other) % GOAL_NUMBERS <= GOAL_NUMBERS - WINDOW


class GoalNumbers:
    """The numbers of one stream in one epoch; an *index* counts goals from 0.

    Args:
        first_number: Number of the first goal, 0…31.
        taken: Numbers of goals from earlier epochs, which are not used.
    """

    def __init__(self, first_number: int, taken: frozenset[int] = frozenset()) -> None:
        self._first_number = first_number
        self._taken = taken
        self._next = 0
        self._closed_below = 0
        self._proofs: deque[tuple[int, int]] = deque()
        self._open: set[int] = set()
        self._ended: dict[int, tuple[Repetition, ...]] = {}
        self._rests_until: dict[int, int] = {}

    def take(self) -> tuple[int, int]:
        """Return index and number of the next goal."""
        index = self._next
        self._next += 1
        self._open.add(index)
        return index, self._number(index)

    def may_begin(self, now: int, settling_ns: int) -> bool:
        """Return whether the next goal may begin.

        Args:
            now: The instant.
            settling_ns: Time in which a transmission and its duplicates arrive, ns.
        """
        self._settle(now, settling_ns)
        while self._number(self._next) in self._taken and self._has_room:
            # Skip it as if it had begun and ended; rules 2 and 3 hold for it as for any other.
            self._next += 1
        rests = self._rests_until.get(self._number(self._next), now) > now
        return self._has_room and not rests

    @property
    def is_stuck(self) -> bool:
        """Whether the next goal may not begin, and waiting will not change that."""
        oldest = min(self._open, default=self._next)
        closed_below = self._proofs[-1][1] if self._proofs else self._closed_below
        return self._next - oldest >= WINDOW or self._next - GOAL_NUMBERS >= closed_below

    def proved(self, index: int, settled_at: int) -> None:
        """Note that the server has this goal, and so has closed those far behind it.

        Args:
            index: The goal's index.
            settled_at: Instant at which every earlier frame has arrived, ns.
        """
        last_below = self._proofs[-1][1] if self._proofs else self._closed_below
        below = index - WINDOW + 1
        if last_below >= index - (GOAL_NUMBERS - WINDOW) and below > last_below:
            self._proofs.append((settled_at, below))

    def ended(self, index: int, sent: Iterable[Repetition]) -> None:
        """Note that a goal has ended; frames of it may still be under way."""
        self._open.discard(index)
        self._ended[index] = tuple(sent)

    def rest(self, number: int, until: int) -> None:
        """Keep a number unused until an instant, ns: frames of its last goal are under way."""
        self._rests_until[number] = until

    # Below the methods above

    @property
    def _has_room(self) -> bool:
        oldest = min((*self._open, *self._ended), default=self._next)
        is_proved = self._next - GOAL_NUMBERS < self._closed_below
        return self._next - oldest < WINDOW and is_proved

    def _settle(self, now: int, settling_ns: int) -> None:
        for index, sent in list(self._ended.items()):
            if all(each.is_settled(now, settling_ns) for each in sent):
                del self._ended[index]
        while self._proofs and self._proofs[0][0] <= now:
            self._closed_below = self._proofs.popleft()[1]

    def _number(self, index: int) -> int:
        return (self._first_number + index) % GOAL_NUMBERS
