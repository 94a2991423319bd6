"""Which numbers of a client's exchanges are free: the window that moves over them.

Numbers are few and reused, so both ends must agree when one is free. The client keeps rules 1 and
3, the server rule 2:

1. An exchange begins only after the one `window` numbers earlier has ended and nothing that the
   client sent of it can arrive any more. So all requests under way have numbers within a window.
2. A request closes at its server all exchanges that are `window` to `count - window` numbers
   earlier. By rule 1 they have ended at their client, so the server forgets them.
3. A number is reused only when an answer has proved, a settling time ago, that the server closed
   its last use: by then no answer of that use is under way. If no such answer comes, or an exchange
   goes on while a window of others has come and gone, the client begins a new boot epoch.

Each boot epoch begins with a number far from those of the epochs before, so that a late answer of
an earlier one rarely has a number that is in use.
"""

from collections import deque
from collections.abc import Iterable

from zacoustic.core.base.sizes import Numbering
from zacoustic.core.transport.exchanges.repeating import Repetition


class NumberWindow:
    """The numbers of a client on one stream in one boot epoch; an *index* counts exchanges from 0.

    Args:
        numbering: How they are numbered.
        epoch: The client's boot epoch.
        taken: Numbers of exchanges from earlier epochs, which are not used.
    """

    def __init__(
        self, numbering: Numbering, epoch: int, taken: frozenset[int] = frozenset()
    ) -> None:
        self._count = numbering.count
        self._window = numbering.window
        self._first_number = numbering.first(epoch)
        self._taken = taken
        self._next = 0
        self._closed_below = 0
        self._proofs: deque[tuple[int, int]] = deque()
        self._open: set[int] = set()
        self._ended: dict[int, tuple[Repetition, ...]] = {}
        self._rests_until: dict[int, int] = {}

    def take(self) -> tuple[int, int]:
        """Return index and number of the next exchange."""
        index = self._next
        self._next += 1
        self._open.add(index)
        return index, self._number(index)

    def may_begin(self, now: int, settling_ns: int) -> bool:
        """Return whether rules 1 and 3 allow the next exchange.

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
        """Whether the next exchange may not begin, and waiting will not change that."""
        oldest = min(self._open, default=self._next)
        return self._next - oldest >= self._window or self._next - self._count >= self._proved_below

    def proved(self, index: int, settled_at: int) -> None:
        """Note that the server has this request, and so has closed those far behind it.

        Args:
            index: The exchange's index.
            settled_at: Instant at which every earlier frame has arrived, ns.
        """
        below = index - self._window + 1
        if index - (self._count - self._window) <= self._proved_below < below:
            self._proofs.append((settled_at, below))

    def ended(self, index: int, sent: Iterable[Repetition]) -> None:
        """Note that an exchange has ended; frames of it may still be under way."""
        self._open.discard(index)
        self._ended[index] = tuple(sent)

    def rest(self, number: int, until: int) -> None:
        """Keep a number unused until an instant, ns: frames of its last use are under way."""
        self._rests_until[number] = until

    # Below the methods above

    @property
    def _has_room(self) -> bool:
        oldest = min((*self._open, *self._ended), default=self._next)
        is_proved = self._next - self._count < self._closed_below
        return self._next - oldest < self._window and is_proved

    @property
    def _proved_below(self) -> int:
        """The index below which all are closed, or will be when the last proof has settled."""
        return self._proofs[-1][1] if self._proofs else self._closed_below

    def _settle(self, now: int, settling_ns: int) -> None:
        for index, sent in list(self._ended.items()):
            if all(each.is_settled(now, settling_ns) for each in sent):
                del self._ended[index]
        while self._proofs and self._proofs[0][0] <= now:
            self._closed_below = self._proofs.popleft()[1]

    def _number(self, index: int) -> int:
        return (self._first_number + index) % self._count
