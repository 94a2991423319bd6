"""In which lineage a number of a key is said: that of the life in which the sample was published.

A life goes on with what former ones have left, in their lineages and with their numbers, so that
receivers know again what they have. What it publishes itself stands in a lineage of its own, though
the numbers go on: so no number is used twice in one lineage, also not by a life that began on an
old copy of the journal and has forgotten how far a former one went.

A receiver gets nothing of a later span as long as it lacks something of an earlier one: a new
lineage ends the old one at once. And a receiver that does not take a lineage for a new one, since
it knows it, gets a lineage of its own from there on.
"""

from collections.abc import Iterable

import msgspec


class Span(msgspec.Struct, frozen=True, array_like=True):
    """Numbers of one lineage, up to the next span."""

    first: int
    """The first of them."""
    lineage: int
    """The lineage."""


class Spans:
    """The spans of one key.

    Args:
        spans: In the order of their numbers, at least one.
        own: Those of single receivers, by address.
    """

    def __init__(self, spans: Iterable[Span], own: dict[int, Span] | None = None) -> None:
        self.all = list(spans)
        """In the order of their numbers."""
        self.own = dict(own or {})
        """From where on a receiver has a lineage of its own, up to the next span, by address."""
        self._over: set[int] = set()

    @property
    def newest(self) -> Span:
        """The last one."""
        return self.all[-1]

    def begin(self, number: int, lineage: int) -> None:
        """From a number on, which was never said, another lineage counts."""
        self.all.append(Span(number, lineage))

    def of(self, address: int, number: int) -> Span:
        """Return the span of a number, as one receiver is told."""
        span = max(
            (each for each in self.all if each.first <= number),
            key=lambda each: each.first,
            default=self.all[0],
        )
        own = self.own.get(address)
        return own if own is not None and span.first <= own.first <= number else span

    def heard_of(self, address: int, number: int, lineage: int) -> int | None:
        """Return a number of the span that a receiver speaks of; None: that cannot be.

        It is that of the oldest number which it lacks, or a later one: then a former life of this
        node has known that it lacks nothing of those before.
        """
        present = self.of(address, number)
        if lineage == present.lineage:
            return number
        later = (each.first for each in self.all if each.first > number)
        return next((each for each in later if self.of(address, each).lineage == lineage), None)

    def first_of(self, number: int) -> int:
        """Return the first number of the span of a number; 0: there is no span before it."""
        if len(self.all) == 1:
            return 0
        return max((each.first for each in self.all if each.first <= number), default=0)

    def end_of(self, number: int, newest: int) -> int:
        """Return the end of the span of a number.

        Args:
            number: The number.
            newest: The next number to be given away.
        """
        return min((each.first for each in self.all if each.first > number), default=newest)

    def forget_before(self, floor: int) -> None:
        """Nothing before a number is said any more."""
        while len(self.all) > 1 and self.all[1].first <= floor:
            self._over.add(self.all.pop(0).lineage)
        for address, own in list(self.own.items()):
            if own.first < self.all[0].first:
                self._over.add(self.own.pop(address).lineage)

    def knows(self, lineage: int) -> bool:
        """Tell whether a lineage is, or was in this life, one of this key."""
        return (
            lineage in self._over
            or any(each.lineage == lineage for each in self.all)
            or any(each.lineage == lineage for each in self.own.values())
        )
