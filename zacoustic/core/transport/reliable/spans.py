"""The lineage of each number of a key: the boot epoch in which the sample was published.

After a restart a publisher continues the samples that the journal has, in their lineages and with
their numbers, so that receivers recognise what they have. New samples stand in a lineage of their
own, while the numbers continue. So no lineage uses a number twice, not even when a node restarted
with an old copy of its journal and has forgotten how far it had counted.

A receiver gets nothing of a later span while it lacks something of an earlier one, since a new
lineage ends the old one at once. A receiver that knows a lineage already, and so does not accept it
as new, gets a lineage of its own from that number on.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

import msgspec

LINEAGES: Final = 1 << 16
_MOST_OVER: Final = 1024
"""So many lineages that are over are remembered: forged frames can end them."""


class Span(msgspec.Struct, frozen=True, array_like=True):
    """The numbers of one lineage, up to the next span."""

    first: int
    """The first number of the span."""
    lineage: int
    """The lineage."""


class Spans:
    """The spans of one key.

    Args:
        spans: Ordered by number, at least one.
        own: The spans of single receivers, by address.
    """

    def __init__(self, spans: Iterable[Span], own: dict[int, Span] | None = None) -> None:
        self.all = list(spans)
        """All spans, ordered by number."""
        self.own = dict(own or {})
        """The first number of a receiver's own lineage, which ends at the next span; by address."""
        self._over: deque[int] = deque(maxlen=_MOST_OVER)

    @property
    def newest(self) -> Span:
        """The last span."""
        return self.all[-1]

    def begin(self, number: int, lineage: int) -> None:
        """Begin another lineage at a number that was never sent."""
        if self.newest.first == number:  # nothing was sent in that one
            self._over.append(self.all.pop().lineage)
        self.all.append(Span(number, lineage))

    def at(self, number: int) -> Span:
        """Return the span of a number for receivers without a lineage of their own."""
        return max(
            (each for each in self.all if each.first <= number),
            key=lambda each: each.first,
            default=self.all[0],
        )

    def of(self, address: int, number: int) -> Span:
        """Return the span of a number for one receiver."""
        span = self.at(number)
        own = self.own.get(address)
        return own if own is not None and span.first <= own.first <= number else span

    def heard_of(self, address: int, number: int, lineage: int) -> int | None:
        """Return a number in the span that a receiver refers to; None: impossible.

        This is the oldest number that the receiver lacks. It is the first number of a later span if
        the receiver names that lineage: then this node knew, in an earlier boot epoch, that the
        receiver lacked nothing before it.
        """
        present = self.of(address, number)
        if lineage == present.lineage:
            return number
        later = (each.first for each in self.all if each.first > number)
        return next((each for each in later if self.of(address, each).lineage == lineage), None)

    def first_of(self, number: int) -> int:
        """Return the first number of a number's span; 0: there is only one span."""
        if len(self.all) == 1:
            return 0
        return max((each.first for each in self.all if each.first <= number), default=0)

    def end_of(self, number: int, newest: int) -> int:
        """Return the end of a number's span.

        Args:
            number: The number.
            newest: The next number to be assigned.
        """
        return min((each.first for each in self.all if each.first > number), default=newest)

    def forget_before(self, floor: int) -> None:
        """Forget the spans that end at or below a number."""
        while len(self.all) > 1 and self.all[1].first <= floor:
            self._over.append(self.all.pop(0).lineage)
        for address, own in list(self.own.items()):
            if own.first < self.all[0].first:
                self._over.append(self.own.pop(address).lineage)

    def knows(self, lineage: int) -> bool:
        """Return whether a lineage belongs to this key, or has belonged to it since the restart."""
        return (
            lineage in self._over
            or any(each.lineage == lineage for each in self.all)
            or any(each.lineage == lineage for each in self.own.values())
        )
