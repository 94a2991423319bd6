"""The objects that a node receives: their fragments, and the feedback.

The first fragments of an object carry its manifest. Until then fragments are kept, a bounded
number, unless no large sample can be for this node. An object that is not for it, or of an
on-demand topic that it has not subscribed to, takes no memory from then on; neither does an object
under way when the node unsubscribes. Fragments of a former boot epoch are kept: the node may not
have subscribed again yet.
"""

import random
from collections.abc import Callable, Set
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.transport.objects.gate import Gate, ObjectReceived
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.transport.objects.manifest import Manifest
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.transport.objects.receiving.endings import Endings, Refusal
from zacoustic.core.transport.objects.receiving.replies import Place, Replies
from zacoustic.core.transport.objects.receiving.transfers import Transfer, Transfers
from zacoustic.core.transport.objects.stored import StoredEnd, done_key, encode_group, group_key
from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.transport.reliable.receiving.receiving import Claim
from zacoustic.core.wire.objects import (
    CHECK_BYTES,
    MOST_TRANSFERS,
    NO_FRAGMENT,
    WITHDRAWN,
    Call,
    Feedback,
    Fragment,
    Reason,
)

_GROUP_DIVISOR: Final = 40
_LARGEST_GROUP: Final = 64
_FIRST_GROUP: Final = 4
_MOST_TOLD: Final = 4 * MOST_TRANSFERS


class IncomingObjects:
    """All objects that one node receives.

    Args:
        limits: How much memory they may take.
        rng: Spreads the answers of several receivers.
        gate: Knows table and counts, and takes complete objects.
        emit: Takes progress.
        journal: Keeps what must survive a restart.
    """

    def __init__(
        self,
        *,
        limits: ObjectLimits,
        rng: random.Random,
        gate: Gate,
        emit: Callable[[ObjectProgress], None],
        journal: JournalPort,
    ) -> None:
        self._gate = gate
        self._emit = emit
        self._journal = journal
        self._transfers = Transfers(limits)
        self._endings = Endings(gate, journal)
        self._told: dict[Place, Feedback] = {}
        self._losses: dict[int, float] = {}
        self._alone: set[Place] = set()
        self._replies = Replies(rng, self._is_sayable)

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
        """Restore fragments that arrived in a former boot epoch."""
        for index, data in fragments:
            state = self._transfers.get((source, transfer))
            if state is None:
                state = self._open((source, transfer), len(data))
            state.incoming.add(index, data)
            state.groups = group + 1

    def restore_end(self, source: int, transfer: int, end: StoredEnd) -> None:
        """Restore the end of an object that a former boot epoch delivered."""
        self._endings.restore((source, transfer), end)

    def link_up(self, now: int) -> None:
        """The link is up: deliver what a former boot epoch was about to deliver."""
        for place, state in list(self._transfers):
            end, manifest = self._endings.end(place), state.incoming.manifest
            if end is None or state.is_ending or manifest is None or state.incoming.lacking:
                continue
            if manifest.digest != end.digest:
                continue  # the number stands for another object now
            stream_digest = self._gate.admit(place[0], manifest.stream_id).stream_digest
            if end.stream_digest and end.stream_digest == stream_digest:
                state.heard_at = now
                self._hand_over(place, state, again=True)
            else:
                self._drop(place)

    # Inputs

    def fragment(
        self, source: int, fragment: Fragment, received: ReceivedFrame, timing: Timing, now: int
    ) -> str | None:
        """Take a fragment; returns why it is dropped, or None."""
        place = (source, fragment.transfer)
        if fragment.index == NO_FRAGMENT:
            if fragment.data == WITHDRAWN:
                self._withdrawn(place)
            else:
                self._has_turn(place, fragment.data)
        elif not self._endings.is_of_ended(place, fragment):
            if place not in self._transfers and _is_for_others(fragment, received):
                return None
            if place not in self._transfers and self._gate.admit(source, 0).reason is not None:
                return None  # it is not for this node
            reason = self._collect(place, fragment, received, now)
            if reason is not None:
                return reason
        self._schedule(place, fragment, received, timing)
        return None

    def cancel(self, source: int, transfer: int) -> bool:
        """Refuse the rest of an object; False when it is not under way."""
        state = self._transfers.get((source, transfer))
        if state is None or state.is_ending:
            return False
        self._refuse((source, transfer), Reason.CANCELLED)
        return True

    def drop_unwanted(self, stream_id: int, sources: Set[int]) -> None:
        """Keep nothing of a stream of these sources: this node has unsubscribed."""
        for place, state in list(self._transfers):
            manifest = state.incoming.manifest
            is_of_it = manifest is not None and manifest.stream_id == stream_id
            if is_of_it and place[0] in sources and not state.is_ending:
                self._report(place, state, ObjectState.CANCELLED, "not subscribed any more")
                self._ignore(place, stream_id)

    def peer_forgotten(self, source: int, now: int) -> None:
        """Nothing is to be kept of a node, nor which of its objects were handed on."""
        for place in [place for place, state in self._transfers if place[0] == source]:
            self._drop(place)
        for place in [place for place in self._told if place[0] == source]:
            self._told.pop(place)
        self._alone -= {place for place in self._alone if place[0] == source}
        self._replies.forget(source)
        self._endings.forget(source)
        self._losses.pop(source, None)

    def look_again(self, source: int) -> None:
        """A sample of a source was handed on: what waits for its turn may have it now."""
        for place, state in list(self._transfers):
            # What is handed on may have others handed on, and they this one.
            is_there = self._transfers.get(place) is state
            if is_there and place[0] == source and state.incoming.lacking == 0:
                self._finish(place, state, is_turn=False)

    # Speaking

    def due_at(self, now: int) -> int | None:
        """Return the instant at which the next answer is to go, or None."""
        return self._replies.due_at(now)

    def destination(self, now: int) -> int | None:
        """Return the address that an answer which is due goes to, or None."""
        due = self._replies.due(now)
        return due[0][0] if due else None

    def owes_answer(self, now: int) -> bool:
        """Tell whether an answer is to go, or has not yet been on the air."""
        return self._replies.owes_answer(now)

    def take(self, destination: int, now: int) -> tuple[Feedback, Place] | None:
        """Return an answer that is due and goes there, and what it is about, or None."""
        for place in self._replies.due(now, destination):
            feedback = self._feedback(place)
            if feedback is None:
                self._replies.drop(place)
                continue
            self._replies.say(place)
            self._told[place] = feedback
            while len(self._told) > _MOST_TOLD:
                del self._told[next(iter(self._told))]
            return feedback, place
        return None

    def transmitted(self, place: Place, finished_at: int, timing: Timing) -> None:
        """An answer that was taken has been on the air."""
        self._replies.transmitted(place, finished_at, timing)

    @property
    def quiet_until(self) -> int:
        """Until then a frame of ours that is no answer may cost a fragment or an answer."""
        return self._replies.quiet_until

    # Below the methods above

    def _is_sayable(self, place: Place) -> bool:
        """Tell whether an answer does not wait for the journal."""
        state = self._transfers.get(place)
        return state is None or not state.is_ending

    def _collect(
        self, place: Place, fragment: Fragment, received: ReceivedFrame, now: int
    ) -> str | None:
        state = self._transfers.get(place)
        if state is not None and state.incoming.contradicts(fragment.index, fragment.data):
            self._drop(place)
            state = None
        if state is None:
            state = self._open(place, len(fragment.data))
        state.heard_at = now
        if state.is_ending:
            return None
        for given_up in self._transfers.make_room(place):
            self._drop(given_up)
        if place not in self._transfers:
            return "object_room"
        incoming = state.incoming
        knew = incoming.manifest
        if not incoming.add(fragment.index, fragment.data):
            self._judge(place, state, knew)
            return None
        state.received = received
        if knew is not None and incoming.manifest is None:
            self._forget_groups(place, state)
            return "object_digest"
        state.unwritten.append((fragment.index, fragment.data))
        self._judge(place, state, knew)
        fragments = incoming.fragments
        group = _FIRST_GROUP if fragments is None else fragments // _GROUP_DIVISOR
        is_kept = place in self._transfers and not state.is_ending
        if is_kept and len(state.unwritten) >= min(_LARGEST_GROUP, max(1, group)):
            self._write_group(place, state)
        return None

    def _judge(self, place: Place, state: Transfer, knew: Manifest | None) -> None:
        """Look at an object whose manifest has just become known, or that is complete."""
        incoming = state.incoming
        manifest = incoming.manifest
        if manifest is None:
            return
        if incoming.is_too_large:
            self._refuse(place, Reason.TOO_LARGE)
            return
        if knew is None:
            admission = self._gate.admit(place[0], manifest.stream_id)
            reason = admission.reason
            most_bytes = admission.largest_bytes
            if most_bytes is not None and manifest.payload_bytes > most_bytes:
                reason = Reason.TOO_LARGE
            if reason is not None:
                self._refuse(place, reason)
                return
            if not admission.is_wanted:
                self._ignore(place, manifest.stream_id)
                return
        self._gate.expect(place[0], manifest)
        if incoming.lacking == 0:
            self._finish(place, state, is_turn=False)

    def _has_turn(self, place: Place, check: bytes) -> None:
        """The source has sent the turn: nothing before its object will come."""
        state = self._transfers.get(place)
        if state is None or state.incoming.lacking != 0:
            return
        manifest = state.incoming.manifest
        assert manifest is not None
        if manifest.digest[:CHECK_BYTES] == check:
            self._finish(place, state, is_turn=True)
        elif not state.is_ending:
            self._drop(place)  # the number stands for another object now

    def _finish(self, place: Place, state: Transfer, *, is_turn: bool) -> None:
        """Write down that a complete object is handed on; it is when that is safe."""
        manifest = state.incoming.manifest
        assert manifest is not None
        if state.is_ending:
            return
        admission = self._gate.admit(place[0], manifest.stream_id)
        if not admission.is_open:
            return  # asked again with each further fragment
        if admission.reason is not None:
            # It was not yet known, when its manifest came, whether the tables agree. They do, so it
            # is of another node with that address: of another fleet, or of a former boot epoch.
            self._refuse(place, admission.reason)
            return
        claim = self._gate.claim(place[0], manifest, is_turn=is_turn)
        if claim is Claim.LATER:
            self._write_group(place, state)
            return
        if claim is Claim.FORMER:
            self._refuse(place, Reason.CANCELLED)
            return
        state.is_ending = True
        end = StoredEnd(manifest.digest, tuple(state.incoming.head().values()))
        is_over = claim is Claim.OVER
        if admission.keeps:
            if not is_over:
                self._write_group(place, state)
                end = msgspec.structs.replace(end, stream_digest=admission.stream_digest)
            self._journal.write(
                done_key(*place),
                msgspec.msgpack.encode(end),
                lambda at: self._hand_over(place, state, is_over=is_over),
            )
        else:
            self._journal.write(done_key(*place), msgspec.msgpack.encode(end))
            self._hand_over(place, state, is_over=is_over)

    def _hand_over(
        self, place: Place, state: Transfer, *, is_over: bool = False, again: bool = False
    ) -> None:
        manifest, payload = state.incoming.manifest, state.incoming.payload()
        assert manifest is not None
        assert payload is not None
        self._transfers.remove(place)
        self._forget_groups(place, state)  # committed when what is handed on here has been told
        end = StoredEnd(manifest.digest, tuple(state.incoming.head().values()))
        if self._endings.handed_on(place, end) or is_over:
            return  # it was delivered before, or must not be any more
        received = state.received or ReceivedFrame(frame_bytes=b"", received_at=state.heard_at)
        self._report(place, state, ObjectState.DELIVERED, "")
        self._gate.deliver(
            ObjectReceived(
                source=place[0],
                manifest=manifest,
                payload=payload,
                received=received,
                again=again,
            )
        )
        self.look_again(place[0])

    def _withdrawn(self, place: Place) -> None:
        state = self._transfers.get(place)
        if state is not None and not state.is_ending:
            self._report(place, state, ObjectState.CANCELLED, "withdrawn by its source")
            self._drop(place)
        if place not in self._endings and place not in self._transfers:
            head = dict(state.incoming.head()) if state is not None else {}
            self._endings.refuse(place, Refusal(Reason.CANCELLED, head))

    def _refuse(self, place: Place, reason: Reason) -> None:
        state = self._transfers.get(place)
        assert state is not None
        cancelled = reason is Reason.CANCELLED
        if reason is not Reason.NOT_SUBSCRIBED:
            outcome = ObjectState.CANCELLED if cancelled else ObjectState.REFUSED
            self._report(place, state, outcome, reason.name.lower())
        self._endings.refuse(place, Refusal(reason, self._drop(place)))

    def _ignore(self, place: Place, stream_id: int) -> None:
        """Keep nothing of an object as long as this node does not subscribe to its stream."""
        refusal = Refusal(Reason.NOT_SUBSCRIBED, self._drop(place), stream_id)
        self._endings.refuse(place, refusal)

    def _drop(self, place: Place) -> dict[int, bytes]:
        """Forget an object on its way; returns its fragments with the manifest."""
        state = self._transfers.remove(place)
        self._forget_groups(place, state)
        return dict(state.incoming.head())

    def _forget_groups(self, place: Place, state: Transfer) -> None:
        for group in range(state.groups):
            self._journal.write(group_key(*place, group), None)
        state.groups = 0
        state.unwritten.clear()

    def _write_group(self, place: Place, state: Transfer) -> None:
        if not state.unwritten:
            return
        self._journal.write(group_key(*place, state.groups), encode_group(state.unwritten))
        state.groups += 1
        state.unwritten.clear()
        if state.incoming.manifest is not None and not state.is_ending:
            self._report(place, state, ObjectState.UNDER_WAY, "")

    def _open(self, place: Place, fragment_bytes: int) -> Transfer:
        self._told.pop(place, None)
        return self._transfers.open(place, fragment_bytes)

    def _feedback(self, place: Place) -> Feedback | None:
        state = self._transfers.get(place)
        return self._endings.feedback(place) if state is None else state.incoming.feedback()

    def _schedule(
        self, place: Place, fragment: Fragment, received: ReceivedFrame, timing: Timing
    ) -> None:
        """Decide when to send feedback, after a fragment."""
        heard_at = received.received_at
        source = place[0]
        state = self._transfers.get(place)
        refusal = self._endings.refusal(place)
        alone = self._is_alone(place, fragment, received)
        is_unwanted = refusal is not None and bool(refusal.unwanted_of)
        if refusal is not None and is_unwanted:
            self._gate.unwanted(source, refusal.unwanted_of, is_alone=alone)
        if state is not None:
            self._losses[source] = state.incoming.loss
        if fragment.call in (Call.WINDOW, Call.NONE):
            # Several receivers would destroy each other's frames in one window.
            tell = alone and (refusal is not None or state is None or state.is_ending)
            tell = tell and not is_unwanted
            window = fragment.call is Call.WINDOW
            self._replies.goes_on(place, heard_at, timing, tell=tell, window=window)
        elif is_unwanted:
            self._replies.drop(place)
        elif alone:
            loss = self._losses.get(source, 0.0)
            self._replies.called(place, fragment.call, heard_at, timing, loss=loss)
        elif refusal is None or refusal.reason is not Reason.NOT_SUBSCRIBED:
            manifest = state.incoming.manifest if state else None
            admission = self._gate.admit(source, manifest.stream_id if manifest else 0)
            if manifest is None and not admission.is_wanted:
                return  # hardly one that is for this node
            self._replies.called_among(
                place,
                fragment.call,
                heard_at,
                timing,
                rank=admission.place,
                others=admission.others,
                repeats=self._told.get(place) == self._feedback(place),
            )

    def _is_alone(self, place: Place, fragment: Fragment, received: ReceivedFrame) -> bool:
        """Tell whether an object comes for this node alone; see `_is_for_others`."""
        if received.destination != BROADCAST:
            self._alone.add(place)
        elif fragment.call is not Call.WINDOW:
            self._alone.discard(place)
        return place in self._alone

    def _report(self, place: Place, state: Transfer, outcome: ObjectState, detail: str) -> None:
        incoming = state.incoming
        manifest = incoming.manifest
        total_bytes = manifest.payload_bytes if manifest else None
        done_bytes = incoming.held * incoming.fragment_bytes
        self._emit(
            ObjectProgress(
                stream_id=manifest.stream_id if manifest else 0,
                peer=place[0],
                transfer=place[1],
                state=outcome,
                done_bytes=done_bytes if total_bytes is None else min(done_bytes, total_bytes),
                total_bytes=total_bytes,
                detail=detail,
            )
        )


def _is_for_others(fragment: Fragment, received: ReceivedFrame) -> bool:
    """Tell whether a fragment may be of an object for another node, and opens none here.

    The last one of a run is broadcast wherever there are others, to tell them of the pause.
    """
    return fragment.call is Call.WINDOW and received.destination == BROADCAST
