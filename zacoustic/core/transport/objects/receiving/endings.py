"""Objects of others that have ended at this node: delivered, refused, or not subscribed to.

They are remembered while their numbers may be used again: later fragments are not taken for a new
object, and are answered in the same way.
"""

from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.transport.objects.gate import Gate
from zacoustic.core.transport.objects.receiving.replies import Place
from zacoustic.core.transport.objects.stored import StoredEnd, done_key
from zacoustic.core.wire.objects import (
    CHECK_BYTES,
    MOST_TRANSFERS,
    Complete,
    Fragment,
    Reason,
    Refused,
)

_MOST_FORMER: Final = 4 * MOST_TRANSFERS


class Refusal(msgspec.Struct, frozen=True):
    """An object that is not wanted."""

    reason: Reason
    head: dict[int, bytes]
    """Fragments with its manifest."""
    unwanted_of: int = 0
    """Its stream, if this node has not subscribed to that: it is silent, and may yet do so."""


class Endings:
    """What has ended at one node.

    Args:
        gate: Knows the admitted objects.
        journal: Keeps delivered objects.
    """

    def __init__(self, gate: Gate, journal: JournalPort) -> None:
        self._gate = gate
        self._journal = journal
        self._ended: dict[Place, StoredEnd] = {}
        self._former: dict[Place, StoredEnd] = {}
        self._refused: dict[Place, Refusal] = {}

    def restore(self, place: Place, end: StoredEnd) -> None:
        """Restore the end of an object that a former boot epoch delivered."""
        self._ended[place] = end

    def handed_on(self, place: Place, end: StoredEnd) -> bool:
        """An object has ended; returns whether the same was handed on before."""
        self._ended[place] = end
        former = self._former.pop(place, None)
        while len(self._ended) > _MOST_FORMER:
            oldest = next(iter(self._ended))
            del self._ended[oldest]
            self._journal.write(done_key(*oldest), None)
        while len(self._former) > _MOST_FORMER:
            del self._former[next(iter(self._former))]
        return former is not None and former.digest == end.digest

    def refuse(self, place: Place, refusal: Refusal) -> None:
        """An object is not taken."""
        self._refused[place] = refusal
        while len(self._refused) > _MOST_FORMER:
            del self._refused[next(iter(self._refused))]

    def forget(self, source: int) -> None:
        """Forget what has ended of a source."""
        for place in [place for place in self._ended if place[0] == source]:
            del self._ended[place]
            self._journal.write(done_key(*place), None)
        for known in (self._former, self._refused):
            for place in [place for place in known if place[0] == source]:
                del known[place]

    def end(self, place: Place) -> StoredEnd | None:
        """Return how the last object from a source with a number was handed on, or None."""
        return self._ended.get(place)

    def __contains__(self, place: Place) -> bool:
        """Tell whether the last object from a source with a number was handed on."""
        return place in self._ended

    def refusal(self, place: Place) -> Refusal | None:
        """Return why the last object from a source with a number is not taken, or None."""
        return self._refused.get(place)

    def is_of_ended(self, place: Place, fragment: Fragment) -> bool:
        """Tell whether a fragment is of an object that has ended; else that is forgotten."""
        return self._is_of_handed_on(place, fragment) or self._is_of_refused(place, fragment)

    def feedback(self, place: Place) -> Complete | Refused | None:
        """Return the feedback for an object that has ended, or None."""
        transfer = place[1]
        end = self._ended.get(place)
        if end is not None:
            return Complete(transfer, end.digest[:CHECK_BYTES])
        refusal = self._refused.get(place)
        return Refused(transfer, refusal.reason) if refusal is not None else None

    # Below the methods above

    def _is_of_handed_on(self, place: Place, fragment: Fragment) -> bool:
        end = self._ended.get(place)
        if end is None:
            return False
        head = end.head
        if len(fragment.data) == len(head[0]) and (
            fragment.index >= len(head) or head[fragment.index] == fragment.data
        ):
            return True
        # The number stands for another object now, or a frame was altered.
        self._former[place] = self._ended.pop(place)
        return False

    def _is_of_refused(self, place: Place, fragment: Fragment) -> bool:
        refusal = self._refused.get(place)
        if refusal is None:
            return False
        known = refusal.head.get(fragment.index)
        is_same = known == fragment.data if known is not None else fragment.index != 0
        unwanted_of = refusal.unwanted_of
        if is_same and not (unwanted_of and self._gate.admit(place[0], unwanted_of).is_wanted):
            return True
        # The number stands for another object now, or this one is wanted now.
        del self._refused[place]
        return False
