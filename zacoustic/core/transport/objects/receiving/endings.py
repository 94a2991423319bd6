"""Objects of others that have ended at this node: delivered, refused, or not subscribed to.

They are remembered while their numbers may be used again: later fragments are not taken for a new
object, and are answered in the same way.
"""

from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.transport.objects.admission import AdmissionControl
from zacoustic.core.transport.objects.receiving.replies import TransferKey
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
        admission: Knows the admitted objects.
        journal: Keeps delivered objects.
    """

    def __init__(self, admission: AdmissionControl, journal: JournalPort) -> None:
        self._admission = admission
        self._journal = journal
        self._ended: dict[TransferKey, StoredEnd] = {}
        self._former: dict[TransferKey, StoredEnd] = {}
        self._refused: dict[TransferKey, Refusal] = {}

    def restore(self, key: TransferKey, end: StoredEnd) -> None:
        """Restore the end of an object that a former boot epoch delivered."""
        self._ended[key] = end

    def handed_on(self, key: TransferKey, end: StoredEnd) -> bool:
        """An object has ended; returns whether the same was handed on before."""
        self._ended[key] = end
        former = self._former.pop(key, None)
        while len(self._ended) > _MOST_FORMER:
            oldest = next(iter(self._ended))
            del self._ended[oldest]
            self._journal.write(done_key(*oldest), None)
        while len(self._former) > _MOST_FORMER:
            del self._former[next(iter(self._former))]
        return former is not None and former.digest == end.digest

    def refuse(self, key: TransferKey, refusal: Refusal) -> None:
        """An object is not taken."""
        self._refused[key] = refusal
        while len(self._refused) > _MOST_FORMER:
            del self._refused[next(iter(self._refused))]

    def forget(self, source: int) -> None:
        """Forget what has ended of a source."""
        for key in [key for key in self._ended if key[0] == source]:
            del self._ended[key]
            self._journal.write(done_key(*key), None)
        for known in (self._former, self._refused):
            for key in [key for key in known if key[0] == source]:
                del known[key]

    def end(self, key: TransferKey) -> StoredEnd | None:
        """Return how the last object from a source with a number was handed on, or None."""
        return self._ended.get(key)

    def __contains__(self, key: TransferKey) -> bool:
        """Tell whether the last object from a source with a number was handed on."""
        return key in self._ended

    def refusal(self, key: TransferKey) -> Refusal | None:
        """Return why the last object from a source with a number is not taken, or None."""
        return self._refused.get(key)

    def is_of_ended(self, key: TransferKey, fragment: Fragment) -> bool:
        """Tell whether a fragment is of an object that has ended; else that is forgotten."""
        return self._is_of_handed_on(key, fragment) or self._is_of_refused(key, fragment)

    def feedback(self, key: TransferKey) -> Complete | Refused | None:
        """Return the feedback for an object that has ended, or None."""
        transfer = key[1]
        end = self._ended.get(key)
        if end is not None:
            return Complete(transfer, end.digest[:CHECK_BYTES])
        refusal = self._refused.get(key)
        return Refused(transfer, refusal.reason) if refusal is not None else None

    # Below the methods above

    def _is_of_handed_on(self, key: TransferKey, fragment: Fragment) -> bool:
        end = self._ended.get(key)
        if end is None:
            return False
        head = end.head
        if len(fragment.data) == len(head[0]) and (
            fragment.index >= len(head) or head[fragment.index] == fragment.data
        ):
            return True
        # The number stands for another object now, or a frame was altered.
        self._former[key] = self._ended.pop(key)
        return False

    def _is_of_refused(self, key: TransferKey, fragment: Fragment) -> bool:
        refusal = self._refused.get(key)
        if refusal is None:
            return False
        known = refusal.head.get(fragment.index)
        is_same = known == fragment.data if known is not None else fragment.index != 0
        unwanted_of = refusal.unwanted_of
        if is_same and not (unwanted_of and self._admission.admit(key[0], unwanted_of).is_wanted):
            return True
        # The number stands for another object now, or this one is wanted now.
        del self._refused[key]
        return False
