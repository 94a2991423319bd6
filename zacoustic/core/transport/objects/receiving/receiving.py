"""The objects that a node receives: their fragments and the feedback.

The first fragments of an object carry its manifest. Until the manifest is complete, a bounded
number of fragments are kept, unless no large sample can be for this node. From then on, an object
that is not for this node, or that belongs to an on-demand topic without its subscription, takes no
memory; neither does an object under way when the node unsubscribes. Fragments from before a restart
are kept: the node may not have subscribed again yet.
"""

import random
from collections.abc import Callable, Set
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.base.moments import Moments
from zacoustic.core.transport.objects.admission import AdmissionControl, ObjectReceived
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.transport.objects.manifest import Manifest
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.transport.objects.receiving.endings import Endings, RefusedObject
from zacoustic.core.transport.objects.receiving.replies import Replies, TransferKey
from zacoustic.core.transport.objects.receiving.transfers import Transfer, Transfers
from zacoustic.core.transport.objects.stored import (
    StoredAge,
    StoredEnd,
    age_key,
    done_key,
    encode_group,
    group_key,
)
from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.transport.reliable.receiving.receiving import Claim
from zacoustic.core.values.age import NO_AGE, Age
from zacoustic.core.wire.objects import (
    CHECK_BYTES,
    NO_FRAGMENT,
    WITHDRAWN,
    Feedback,
    Fragment,
    ListenHint,
    Reason,
)

_GROUP_DIVISOR: Final = 40
_LARGEST_GROUP: Final = 64
_FIRST_GROUP: Final = 4


class IncomingObjects:
    """The objects that one node receives.

    Args:
        limits: How much memory they may take.
        rng: Spreads the answers of several receivers.
        admission: Knows table and counts, and takes complete objects.
        emit: Takes progress events.
        journal: Holds what must survive a restart.
        moments: Find instants again after a restart.
        most_ended: The most ended objects that are remembered.
    """

    def __init__(
        self,
        *,
        limits: ObjectLimits,
        rng: random.Random,
        admission: AdmissionControl,
        emit: Callable[[ObjectProgress], None],
        journal: JournalPort,
        moments: Moments,
        most_ended: int,
    ) -> None:
        self._moments = moments
        self._admission = admission
        self._emit = emit
        self._journal = journal
        self._transfers = Transfers(limits)
        self._endings = Endings(admission, journal, most_ended)
        self._most_told = most_ended
        self._told: dict[TransferKey, Feedback] = {}
        self._losses: dict[int, float] = {}
        self._alone: set[TransferKey] = set()
        self.lacks: Callable[[int, int], None] | None = None
        """Told ``(source, now)`` of an answer that asks a source for more of an object; None: there
        is no link yet."""
        self.replies = Replies(rng, self._is_sayable)
        """The answers that wait for a frame; read-only."""

    def __len__(self) -> int:
        return len(self._transfers)

    @property
    def memory_bytes(self) -> int:
        """Bytes of all received fragments."""
        return self._transfers.memory_bytes

    def stream_of(self, source: int, transfer: int) -> int:
        """Return the stream of an object under way, 0 while unknown."""
        state = self._transfers.get((source, transfer))
        manifest = state.incoming.manifest if state else None
        return manifest.stream_id if manifest else 0

    # After a restart

    def restore_group(
        self, source: int, transfer: int, group: int, fragments: list[tuple[int, bytes]]
    ) -> None:
        """Restore fragments that arrived in an earlier boot epoch."""
        for index, data in fragments:
            state = self._transfers.get((source, transfer))
            if state is None:
                state = self._open((source, transfer), len(data))
            state.incoming.add(index, data)
            state.groups = group + 1

    def restore_age(self, source: int, transfer: int, kept: StoredAge) -> None:
        """Restore the age that an object had in an earlier boot epoch, behind its fragments."""
        state = self._transfers.get((source, transfer))
        if state is None:
            self._journal.write(age_key(source, transfer), None)
            return
        state.age = Age(kept.age_s, kept.error_s)
        state.aged_at = self._moments.restored(kept.received)

    def restore_end(self, source: int, transfer: int, end: StoredEnd) -> None:
        """Restore the end of an object that an earlier boot epoch delivered."""
        self._endings.restore((source, transfer), end)

    def restored(self) -> None:
        """Decide which object each number stands for, now that all entries are restored.

        The end of an object stays in the journal until another one with its number has ended. So
        fragments beside an end are either those of a later object, which has the number now, or
        those of the object that has ended, which a boot epoch was about to deliver or to delete.
        """
        for key, state in list(self._transfers):
            end, manifest = self._endings.end(key), state.incoming.manifest
            if end is None:
                continue
            if manifest is None or manifest.digest != end.digest:
                self._endings.reuse(key)
            elif state.incoming.lacking:
                self._drop(key)

    def link_up(self, now: int) -> None:
        """Deliver what an earlier boot epoch was about to deliver: the link is up."""
        for key, state in list(self._transfers):
            end, manifest = self._endings.end(key), state.incoming.manifest
            if end is None or manifest is None or state.is_ending:
                continue
            stream_digest = self._admission.admit(key[0], manifest.stream_id).stream_digest
            if end.stream_digest and end.stream_digest == stream_digest:
                state.heard_at = now
                self._hand_over(key, state, again=True)
            else:
                self._drop(key)

    # Inputs

    def fragment(
        self,
        source: int,
        fragment: Fragment,
        received: ReceivedFrame,
        timing: Timing,
        now: int,
        age: Age = NO_AGE,
    ) -> str | None:
        """Take a fragment; return why it is dropped, or None.

        Args:
            source: Its source.
            fragment: The fragment, without an age.
            received: Its frame.
            timing: The durations.
            now: The instant.
            age: The age in it, as the frame had arrived.
        """
        key = (source, fragment.transfer)
        if fragment.index == NO_FRAGMENT:
            if fragment.data == WITHDRAWN:
                self._withdrawn(key)
            else:
                self._has_turn(key, fragment.data)
        elif not self._endings.is_of_ended(key, fragment):
            if key not in self._transfers and _is_for_others(fragment, received):
                return None
            if key not in self._transfers and self._admission.admit(source, 0).reason is not None:
                return None  # it is not for this node
            reason = self._collect(key, fragment, received, age, now)
            if reason is not None:
                return reason
        self._schedule(key, fragment, received, timing)
        return None

    def cancel(self, source: int, transfer: int) -> bool:
        """Refuse the rest of an object; return False when it is not under way."""
        state = self._transfers.get((source, transfer))
        if state is None or state.is_ending:
            return False
        self._refuse((source, transfer), Reason.CANCELLED)
        return True

    def drop_unwanted(self, stream_id: int, sources: Set[int]) -> None:
        """Drop a stream's objects from these sources: this node has unsubscribed."""
        for key, state in list(self._transfers):
            manifest = state.incoming.manifest
            is_of_it = manifest is not None and manifest.stream_id == stream_id
            if is_of_it and key[0] in sources and not state.is_ending:
                self._report(key, state, ObjectState.CANCELLED, "not subscribed any more")
                self._ignore(key, stream_id)

    def peer_forgotten(self, source: int, now: int) -> None:
        """Forget a node and its objects."""
        for key in [key for key, state in self._transfers if key[0] == source]:
            self._drop(key)
        for key in [key for key in self._told if key[0] == source]:
            self._told.pop(key)
        self._alone -= {key for key in self._alone if key[0] == source}
        self.replies.forget(source)
        self._endings.forget(source)
        self._losses.pop(source, None)

    def look_again(self, source: int) -> None:
        """Check the complete objects of a source again after it delivered a sample."""
        for key, state in list(self._transfers):
            # A delivery may cause further deliveries, this one included.
            is_there = self._transfers.get(key) is state
            if is_there and key[0] == source and state.incoming.lacking == 0:
                self._finish(key, state, is_turn=False)

    # Answers

    def take(self, destination: int, now: int) -> tuple[Feedback, TransferKey] | None:
        """Take a due answer for a destination; return it with the object's key, or None."""
        for key in self.replies.due(now, destination):
            feedback = self._feedback(key)
            if feedback is None:
                self.replies.drop(key)
                continue
            self.replies.say(key)
            state = self._transfers.get(key)
            if state is None:
                self._endings.told(key)
            if self.lacks is not None and state is not None and state.incoming.lacking != 0:
                self.lacks(key[0], now)
            self._told[key] = feedback
            while len(self._told) > self._most_told:
                del self._told[next(iter(self._told))]
            return feedback, key
        return None

    def transmitted(self, key: TransferKey, finished_at: int, timing: Timing) -> None:
        """Record that the transmission of an answer has ended."""
        self.replies.transmitted(key, finished_at, timing)

    # Below the methods above

    def _is_sayable(self, key: TransferKey) -> bool:
        """Return whether an answer need not wait for the journal."""
        state = self._transfers.get(key)
        return state is None or not state.is_ending

    def _collect(
        self,
        key: TransferKey,
        fragment: Fragment,
        received: ReceivedFrame,
        age: Age,
        now: int,
    ) -> str | None:
        state = self._transfers.get(key)
        if state is not None and state.incoming.contradicts(fragment.index, fragment.data):
            self._drop(key)
            state = None
        if state is None:
            state = self._open(key, len(fragment.data))
        state.heard_at = now
        if state.is_ending:
            return None
        if age.seconds is not None and state.age.seconds is None:
            state.age, state.aged_at = age, received.received_at
            self._write_age(key, state)
        for given_up in self._transfers.make_room(key):
            self._drop(given_up)
        if key not in self._transfers:
            return "object_room"
        incoming = state.incoming
        knew = incoming.manifest
        if not incoming.add(fragment.index, fragment.data):
            self._judge(key, state, knew)
            return None
        state.received = received
        if knew is not None and incoming.manifest is None:
            self._forget_groups(key, state)
            return "object_digest"
        state.unwritten.append((fragment.index, fragment.data))
        self._judge(key, state, knew)
        fragments = incoming.fragments
        group = _FIRST_GROUP if fragments is None else fragments // _GROUP_DIVISOR
        is_journalled = key in self._transfers and not state.is_ending
        if is_journalled and len(state.unwritten) >= min(_LARGEST_GROUP, max(1, group)):
            self._write_group(key, state)
        return None

    def _judge(self, key: TransferKey, state: Transfer, knew: Manifest | None) -> None:
        """Check an object whose manifest has just become known, or that is complete."""
        incoming = state.incoming
        manifest = incoming.manifest
        if manifest is None:
            return
        if incoming.is_too_large:
            self._refuse(key, Reason.TOO_LARGE)
            return
        if knew is None:
            admission = self._admission.admit(key[0], manifest.stream_id)
            reason = admission.reason
            most_bytes = admission.largest_bytes
            if most_bytes is not None and manifest.payload_bytes > most_bytes:
                reason = Reason.TOO_LARGE
            if reason is not None:
                self._refuse(key, reason)
                return
            if not admission.is_wanted:
                self._ignore(key, manifest.stream_id)
                return
            if admission.is_open and self._admission.is_over(key[0], manifest):
                self._pass_over(key, state, manifest)
                return
        self._admission.expect(key[0], manifest)
        if incoming.lacking == 0:
            self._finish(key, state, is_turn=False)

    def _pass_over(self, key: TransferKey, state: Transfer, manifest: Manifest) -> None:
        """End an object that was delivered under another transfer number: the rest need not come.

        Its source has forgotten that, or takes this node for one that has forgotten it.
        """
        end = StoredEnd(manifest.digest, tuple(state.incoming.head().values()))
        self._journal.write(done_key(*key), msgspec.msgpack.encode(end))
        self._transfers.remove(key)
        self._forget_groups(key, state)
        self._endings.handed_on(key, end)

    def _has_turn(self, key: TransferKey, check: bytes) -> None:
        """Deliver an object whose source has sent its turn: nothing before it will come."""
        state = self._transfers.get(key)
        if state is None or state.incoming.lacking != 0:
            return
        manifest = state.incoming.manifest
        assert manifest is not None
        if manifest.digest[:CHECK_BYTES] == check:
            self._finish(key, state, is_turn=True)
        elif not state.is_ending:
            self._drop(key)  # the number stands for another object now

    def _finish(self, key: TransferKey, state: Transfer, *, is_turn: bool) -> None:
        """Journal that a complete object is delivered, then deliver it."""
        manifest = state.incoming.manifest
        assert manifest is not None
        if state.is_ending:
            return
        admission = self._admission.admit(key[0], manifest.stream_id)
        if not admission.is_open:
            return  # asked again with each further fragment
        if admission.reason is not None:
            # When its manifest came, it was not yet known whether the tables agree. They do, so the
            # object comes from another node with that address: of another fleet, or of an earlier
            # boot epoch.
            self._refuse(key, admission.reason)
            return
        claim = self._admission.claim(key[0], manifest, is_turn=is_turn)
        if claim is Claim.LATER:
            self._write_group(key, state)
            return
        if claim is Claim.FORMER:
            self._refuse(key, Reason.FORMER)
            return
        state.is_ending = True
        end = StoredEnd(manifest.digest, tuple(state.incoming.head().values()))
        is_over = claim is Claim.OVER
        if admission.keeps:
            if not is_over:
                self._write_group(key, state)
                end = msgspec.structs.replace(end, stream_digest=admission.stream_digest)
            self._journal.write(
                done_key(*key),
                msgspec.msgpack.encode(end),
                lambda at: self._hand_over(key, state, is_over=is_over),
            )
        else:
            self._journal.write(done_key(*key), msgspec.msgpack.encode(end))
            self._hand_over(key, state, is_over=is_over)

    def _hand_over(
        self, key: TransferKey, state: Transfer, *, is_over: bool = False, again: bool = False
    ) -> None:
        manifest, payload = state.incoming.manifest, state.incoming.payload()
        assert manifest is not None
        assert payload is not None
        self._transfers.remove(key)
        self._forget_groups(key, state)  # committed after the events of this delivery
        end = StoredEnd(manifest.digest, tuple(state.incoming.head().values()))
        if self._endings.handed_on(key, end) or is_over:
            return  # it was delivered before, or must not be any more
        received = state.received or ReceivedFrame(frame_bytes=b"", received_at=state.heard_at)
        self._report(key, state, ObjectState.DELIVERED, "")
        self._admission.deliver(
            ObjectReceived(
                source=key[0],
                manifest=manifest,
                payload=payload,
                received=received,
                age=state.age,
                aged_at=state.aged_at,
                again=again,
            )
        )
        self.look_again(key[0])

    def _withdrawn(self, key: TransferKey) -> None:
        state = self._transfers.get(key)
        if state is not None and not state.is_ending:
            self._report(key, state, ObjectState.CANCELLED, "withdrawn by its source")
            self._drop(key)
        if key not in self._endings and key not in self._transfers:
            head = dict(state.incoming.head()) if state is not None else {}
            self._endings.refuse(key, RefusedObject(Reason.CANCELLED, head))

    def _refuse(self, key: TransferKey, reason: Reason) -> None:
        state = self._transfers.get(key)
        assert state is not None
        cancelled = reason in (Reason.CANCELLED, Reason.FORMER)
        if reason is not Reason.NOT_SUBSCRIBED:
            outcome = ObjectState.CANCELLED if cancelled else ObjectState.REFUSED
            self._report(key, state, outcome, reason.name.lower())
        self._endings.refuse(key, RefusedObject(reason, self._drop(key)))

    def _ignore(self, key: TransferKey, stream_id: int) -> None:
        """Drop an object and ignore it until this node subscribes to its stream."""
        refusal = RefusedObject(Reason.NOT_SUBSCRIBED, self._drop(key), stream_id)
        self._endings.refuse(key, refusal)

    def _drop(self, key: TransferKey) -> dict[int, bytes]:
        """Remove an object under way; return its fragments with the manifest."""
        state = self._transfers.remove(key)
        self._forget_groups(key, state)
        return dict(state.incoming.head())

    def _forget_groups(self, key: TransferKey, state: Transfer) -> None:
        for group in range(state.groups):
            self._journal.write(group_key(*key, group), None)
        if state.age.seconds is not None:
            self._journal.write(age_key(*key), None)
        state.groups = 0
        state.unwritten.clear()

    def _write_age(self, key: TransferKey, state: Transfer) -> None:
        kept = StoredAge(state.age.seconds, state.age.error_s, self._moments.keep(state.aged_at))
        self._journal.write(age_key(*key), msgspec.msgpack.encode(kept))

    def _write_group(self, key: TransferKey, state: Transfer) -> None:
        if not state.unwritten:
            return
        self._journal.write(group_key(*key, state.groups), encode_group(state.unwritten))
        state.groups += 1
        state.unwritten.clear()
        if state.incoming.manifest is not None and not state.is_ending:
            self._report(key, state, ObjectState.UNDER_WAY, "")

    def _open(self, key: TransferKey, fragment_bytes: int) -> Transfer:
        self._told.pop(key, None)
        return self._transfers.open(key, fragment_bytes)

    def _feedback(self, key: TransferKey) -> Feedback | None:
        state = self._transfers.get(key)
        return self._endings.feedback(key) if state is None else state.incoming.feedback()

    def _schedule(
        self, key: TransferKey, fragment: Fragment, received: ReceivedFrame, timing: Timing
    ) -> None:
        """Schedule the feedback after a fragment."""
        heard_at = received.received_at
        source = key[0]
        state = self._transfers.get(key)
        refusal = self._endings.refusal(key)
        alone = self._is_alone(key, fragment, received)
        is_unwanted = refusal is not None and bool(refusal.unwanted_of)
        if refusal is not None and is_unwanted:
            self._admission.unwanted(source, refusal.unwanted_of, is_alone=alone)
        if state is not None:
            self._losses[source] = state.incoming.loss
        if fragment.call in (ListenHint.WINDOW, ListenHint.NONE):
            # Several receivers would destroy each other's frames in one window.
            tell = alone and (refusal is not None or state is None or state.is_ending)
            tell = tell and not is_unwanted
            window = fragment.call is ListenHint.WINDOW
            self.replies.goes_on(key, heard_at, timing, tell=tell, window=window)
        elif is_unwanted:
            self.replies.drop(key)
        elif alone:
            loss = self._losses.get(source, 0.0)
            self.replies.called(key, fragment.call, heard_at, timing, loss=loss)
        elif refusal is None or refusal.reason is not Reason.NOT_SUBSCRIBED:
            manifest = state.incoming.manifest if state else None
            admission = self._admission.admit(source, manifest.stream_id if manifest else 0)
            if manifest is None and not admission.is_wanted:
                return  # probably not for this node
            self.replies.called_among(
                key,
                fragment.call,
                heard_at,
                timing,
                rank=admission.rank,
                others=admission.others,
                repeats=self._told.get(key) == self._feedback(key),
            )

    def _is_alone(self, key: TransferKey, fragment: Fragment, received: ReceivedFrame) -> bool:
        """Return whether an object comes for this node alone; see `_is_for_others`."""
        if received.destination != BROADCAST:
            self._alone.add(key)
        elif fragment.call is not ListenHint.WINDOW:
            self._alone.discard(key)
        return key in self._alone

    def _report(self, key: TransferKey, state: Transfer, outcome: ObjectState, detail: str) -> None:
        incoming = state.incoming
        manifest = incoming.manifest
        total_bytes = manifest.payload_bytes if manifest else None
        done_bytes = incoming.held * incoming.fragment_bytes
        self._emit(
            ObjectProgress(
                stream_id=manifest.stream_id if manifest else 0,
                peer=key[0],
                transfer=key[1],
                state=outcome,
                done_bytes=done_bytes if total_bytes is None else min(done_bytes, total_bytes),
                total_bytes=total_bytes,
                detail=detail,
            )
        )


def _is_for_others(fragment: Fragment, received: ReceivedFrame) -> bool:
    """Return whether a fragment may be of another node's object, and so begins none here.

    The last fragment of a run is broadcast wherever there are other nodes, to tell them of the
    pause.
    """
    return fragment.call is ListenHint.WINDOW and received.destination == BROADCAST
