"""Incoming objects that have ended at this node: delivered, refused, or not subscribed to.

They are remembered while their numbers may be reused: so a late fragment is not taken for a new
object, and gets the same answer.
"""

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.transport.objects.admission import AdmissionControl
from zacoustic.core.transport.objects.receiving.replies import TransferKey
from zacoustic.core.transport.objects.stored import StoredEnd, done_key
from zacoustic.core.wire.objects import (
    CHECK_BYTES,
    Complete,
    Feedback,
    Fragment,
    Headless,
    Reason,
    Refused,
)


class RefusedObject:
    """An object that this node refuses.

    Its number may stand for a later object by now, of which the first fragments are lost. Until the
    source has been told of the refusal, its fragments are those of the refused object; after that,
    any but those with the manifest leave it in doubt, and the source is asked for the manifest.

    Args:
        reason: Why.
        head: The fragments with its manifest, by index.
        unwanted_of: Its stream, if this node has not subscribed to it: the node is silent, but may
            subscribe yet.
    """

    __slots__ = ("_is_told", "head", "is_in_doubt", "reason", "unwanted_of")

    def __init__(self, reason: Reason, head: dict[int, bytes], unwanted_of: int = 0) -> None:
        self.reason = reason
        self.head = head
        self.unwanted_of = unwanted_of
        self.is_in_doubt = False
        """Whether the last fragment may be one of a later object."""
        self._is_told = False

    def takes(self, fragment: Fragment) -> bool:
        """Return whether a fragment may be one of this object."""
        known = self.head.get(fragment.index)
        self.is_in_doubt = known is None and self._is_told
        return known == fragment.data if known is not None else fragment.index != 0

    def feedback(self, transfer: int) -> Refused | Headless:
        """Return the feedback about it."""
        return Headless(transfer, 0) if self.is_in_doubt else Refused(transfer, self.reason)

    def told(self) -> None:
        """Note that the feedback is transmitted."""
        self._is_told = self._is_told or not self.is_in_doubt


class Endings:
    """The incoming objects that have ended at one node.

    Args:
        admission: Decides which objects are admitted.
        journal: Holds the delivered objects.
        most: The most objects of each kind of end that are remembered.
    """

    def __init__(self, admission: AdmissionControl, journal: JournalPort, most: int) -> None:
        self._most = most
        self._admission = admission
        self._journal = journal
        self._ended: dict[TransferKey, StoredEnd] = {}
        self._former: dict[TransferKey, StoredEnd] = {}
        self._refused: dict[TransferKey, RefusedObject] = {}

    def restore(self, key: TransferKey, end: StoredEnd) -> None:
        """Restore the end of an object that an earlier boot epoch delivered."""
        self._ended[key] = end

    def handed_on(self, key: TransferKey, end: StoredEnd) -> bool:
        """Add a delivered object; return whether the same one was delivered before."""
        self._ended[key] = end
        former = self._former.pop(key, None)
        while len(self._ended) > self._most:
            oldest = next(iter(self._ended))
            del self._ended[oldest]
            self._journal.write(done_key(*oldest), None)
        while len(self._former) > self._most:
            del self._former[next(iter(self._former))]
        return former is not None and former.digest == end.digest

    def reuse(self, key: TransferKey) -> None:
        """Note that a number stands for another object now than the one that has ended."""
        self._former[key] = self._ended.pop(key)

    def refuse(self, key: TransferKey, refusal: RefusedObject) -> None:
        """Add a refused object."""
        self._refused[key] = refusal
        while len(self._refused) > self._most:
            del self._refused[next(iter(self._refused))]

    def forget(self, source: int) -> None:
        """Forget the ended objects of a source."""
        for key in [key for key in self._ended if key[0] == source]:
            del self._ended[key]
            self._journal.write(done_key(*key), None)
        for known in (self._former, self._refused):
            for key in [key for key in known if key[0] == source]:
                del known[key]

    def end(self, key: TransferKey) -> StoredEnd | None:
        """Return the end of the last delivered object with a source's number, or None."""
        return self._ended.get(key)

    def __contains__(self, key: TransferKey) -> bool:
        """Return whether the last object with a source's number was delivered."""
        return key in self._ended

    def refusal(self, key: TransferKey) -> RefusedObject | None:
        """Return why the last object with a source's number was refused, or None."""
        return self._refused.get(key)

    def is_of_ended(self, key: TransferKey, fragment: Fragment) -> bool:
        """Return whether a fragment belongs to an ended object; forget that one if not."""
        return self._is_of_handed_on(key, fragment) or self._is_of_refused(key, fragment)

    def feedback(self, key: TransferKey) -> Feedback | None:
        """Return the feedback about an object that has ended, or None."""
        transfer = key[1]
        end = self._ended.get(key)
        if end is not None:
            return Complete(transfer, end.digest[:CHECK_BYTES])
        refusal = self._refused.get(key)
        return refusal.feedback(transfer) if refusal is not None else None

    def told(self, key: TransferKey) -> None:
        """Note that the feedback about an object that has ended is transmitted."""
        refusal = self._refused.get(key)
        if refusal is not None and key not in self._ended:
            refusal.told()

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
        self.reuse(key)  # or a frame was altered
        return False

    def _is_of_refused(self, key: TransferKey, fragment: Fragment) -> bool:
        refusal = self._refused.get(key)
        if refusal is None:
            return False
        unwanted_of = refusal.unwanted_of
        if refusal.takes(fragment) and not (
            unwanted_of and self._admission.admit(key[0], unwanted_of).is_wanted
        ):
            return True
        # The number stands for another object now, or this one is wanted now.
        del self._refused[key]
        return False
