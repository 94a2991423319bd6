"""Which of the 32 numbers of a client's goals on one stream are free.

Numbers are used again, so both ends must agree when one is free. The rules are those of calls
(`zacoustic.core.transport.calls.calls`), with other figures:

1. No goal is begun before the one `WINDOW` numbers earlier has ended, and nothing that was sent of
   it can arrive any more: so all GOALs under way are of `WINDOW` successive numbers.
2. A GOAL closes at its server all goals `WINDOW` to 32 - `WINDOW` numbers earlier, since by rule 1
   they have ended at their client; they are forgotten there.
3. A number is used again only when an answer has proved, a settling time ago, that its last use was
   closed so. If none comes, or a goal runs on while `WINDOW` others have come and gone, the client
   begins a new boot epoch; what is under way survives that.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

from zacoustic.core.transport.repeating import Repetition
from zacoustic.core.wire.goals import GOAL_NUMBERS

WINDOW: Final = 12
"""Goals of one client on one stream that can be under way at once."""


def closes(number: int, other: int) -> bool:
    """Tell whether a goal shows that another one has ended at its client (rule 2)."""
    return WINDOW <= (number - other) % GOAL_NUMBERS <= GOAL_NUMBERS - WINDOW


class GoalNumbers:
    """The numbers of one stream in one epoch; an *index* counts goals from 0.

    Args:
        first_number: Number of the first goal, 0…31.
        taken: Numbers of goals of former epochs; while they are, they are not used.
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
        """Return index and number of a goal that begins."""
        index = self._next
        self._next += 1
        self._open.add(index)
        return index, self._number(index)

    def may_begin(self, now: int, settling_ns: int) -> bool:
        """Tell whether the next goal may begin.

        Args:
            now: The instant.
            settling_ns: Time after a transmission within which it arrives, repetitions included.
        """
        self._settle(now, settling_ns)
        while self._number(self._next) in self._taken and self._has_room:
            # As if it had begun and ended; rules 2 and 3 hold for it as for any other.
            self._next += 1
        rests = self._rests_until.get(self._number(self._next), now) > now
        return self._has_room and not rests

    @property
    def is_stuck(self) -> bool:
        """The next goal may not begin, and waiting will not change that."""
        oldest = min(self._open, default=self._next)
        closed_below = self._proofs[-1][1] if self._proofs else self._closed_below
        return self._next - oldest >= WINDOW or self._next - GOAL_NUMBERS >= closed_below

    def proved(self, index: int, settled_at: int) -> None:
        """The server has proved that it has the goal of this index, and closed those far behind it.

        Args:
            index: Of the goal.
            settled_at: Instant at which nothing from before is on its way any more, ns.
        """
        last_below = self._proofs[-1][1] if self._proofs else self._closed_below
        below = index - WINDOW + 1
        if last_below >= index - (GOAL_NUMBERS - WINDOW) and below > last_below:
            self._proofs.append((settled_at, below))

    def ended(self, index: int, sent: Iterable[Repetition]) -> None:
        """A goal has ended; if it was sent, frames of it may still be under way."""
        self._open.discard(index)
        self._ended[index] = tuple(sent)

    def rest(self, number: int, until: int) -> None:
        """Frames of the last goal of that number are under way until an instant, ns."""
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
