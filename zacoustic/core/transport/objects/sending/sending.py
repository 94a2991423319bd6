"""The objects that a node sends: which of them is next, and their journal entries."""

import random
from collections.abc import Callable, Set
from functools import partial
from typing import Final, Protocol

import msgspec

from zacoustic.core.base.allowance import Allowance
from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.linktypes import BROADCAST, TransmitOutcome, TransmitReport
from zacoustic.core.base.moments import Made, Moments
from zacoustic.core.base.qos import Priority
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.schedule.pacers import Pacers
from zacoustic.core.streams.keys import Instance
from zacoustic.core.transport.objects.code.code import MOST_FRAGMENTS, Fragments
from zacoustic.core.transport.objects.manifest import Manifest, aged, encode_object
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.transport.objects.sending.bulkobject import BulkObject
from zacoustic.core.transport.objects.sending.bulkpaths import BulkChanged, BulkPaths, BulkRuns
from zacoustic.core.transport.objects.sending.outgoing import OutgoingObject
from zacoustic.core.transport.objects.sending.planning import LossEstimate
from zacoustic.core.transport.objects.stored import StoredObject, StoredProgress, out_key, sent_key
from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.wire.objects import CHECK_BYTES, Feedback, Fragment
from zacoustic.errors import PayloadTooLargeError, QueueFullError

_EPOCH_STRIDE: Final = 23
_STEP_DIVISOR: Final = 40


class Sending(msgspec.Struct, kw_only=True):
    """An outgoing object with its state here."""

    object_id: int
    stream_id: int
    instance: Instance
    priority: Priority
    exclusive: bool
    lifespan_ns: int | None
    expires_at: int | None
    """Instant at which it expires, ns; None: never, or not yet computed after a restart."""
    outgoing: OutgoingObject
    keeps: bool
    """Whether it survives a restart."""
    may_go: bool
    """Whether it may be sent: it is journalled, or need not be."""
    made_at: Made = None
    """When it was made, if its topic has ages."""
    source_journalled: int = 0
    """Source fragments below this number are journalled as sent."""
    seed_journalled: int = 0
    """Seeds below this number are journalled as sent."""
    told_bytes: int = 0
    """Bytes reported as transmitted."""
    allowance: Allowance = msgspec.field(default_factory=Allowance)
    """How many requests may still go in vain, while no receiver gets on with it."""
    rounds: int = 0
    """Requests since a receiver got on with it."""
    heard_rounds: int = 0
    """Those of them after which a receiver was heard."""
    since: int = 0
    """End of the first of them, ns."""

    @property
    def rank(self) -> tuple[int, int]:
        """Sort key: the smaller rank goes first."""
        return (self.priority, self.object_id)


class Owner(Protocol):
    """The component that publishes the objects."""

    def stored(self, sending: Sending, now: int) -> None:
        """Note that an object is journalled."""

    def is_turn(self, object_id: int, address: int) -> bool:
        """Return whether a receiver has everything before an object that it will ever get."""

    def passed(self, object_id: int, address: int, now: int) -> None:
        """Note that a receiver has delivered an object."""

    def refused(self, object_id: int, address: int, reason: int, now: int) -> None:
        """Note that a receiver refuses an object, for a `Reason` or one of a later version."""


_MOST_ROUNDS: Final = 12
_MOST_VAIN_NS: Final = 3600 * NS_PER_S
"""After so many requests without progress, after each of which a receiver was heard, and so long,
an object that is not journalled ends: the samples behind it must not wait for ever."""
_FEW_ROUNDS: Final = 6
"""After so many, rounds are single fragments."""
_LONGEST_CUT_NS: Final = 60 * NS_PER_S
"""After its device has dropped all that was under way an object pauses for so long at most, ns,
unless its receiver is not heard."""


class OutgoingObjects:
    """The objects that one node sends.

    Args:
        epoch: Its boot epoch: successive epochs begin with different transfer numbers.
        numbers: How many transfer numbers there are.
        most: The most objects at a time, waiting ones included.
        pacers: Decide when to repeat to the receivers.
        timers: Withdraw expired objects.
        rng: Draws pauses.
        emit: Takes events about their progress and their way.
        owner: Gets their events, and knows whose turn it is.
        journal: Holds what must survive a restart.
        moments: Find instants again after a restart.
    """

    def __init__(
        self,
        *,
        epoch: int,
        numbers: int,
        most: int,
        pacers: Pacers,
        timers: Timers,
        rng: random.Random,
        emit: Callable[[ObjectProgress | BulkChanged], None],
        owner: Owner,
        journal: JournalPort,
        moments: Moments,
    ) -> None:
        self._moments = moments
        self.sendings: dict[int, Sending] = {}
        """The objects under way, by transfer; read-only."""
        self._numbers, self._most = numbers, most
        self._pacers = pacers
        self._timers = timers
        self._rng = rng
        self._emit = emit
        self._owner = owner
        self._journal = journal
        self._next_transfer = (epoch - 1) * _EPOCH_STRIDE % numbers
        self._losses: dict[int, LossEstimate] = {}
        self.held: dict[int, int] = {}
        """Instant before which no fragment of a stream goes, ns, by stream."""
        self._off: set[int] = set()
        self._plain_bytes = self._bulk_bytes = 0
        self._bulk_paths = BulkPaths()
        self._bulk_runs = BulkRuns()
        self._priorities: dict[int, Priority] = {}
        pacers.released.connect(self._released)

    def __len__(self) -> int:
        return len(self.sendings)

    def pending(self, stream_id: int) -> int:
        """Return how many objects of a stream are not yet delivered."""
        return sum(each.stream_id == stream_id for each in self.sendings.values())

    def peer_forgotten(self, address: int, now: int) -> None:
        """Forget the loss on the way to a node."""
        self._losses.pop(address, None)
        self._bulk_paths.forget(address)

    # Commands

    def add(
        self,
        order: StoredObject,
        now: int,
        *,
        keep: bool = True,
        transfer: int | None = None,
        expires_at: int | None = None,
        made_at: Made = None,
    ) -> None:
        """Add an object to send.

        Raises:
            PayloadTooLargeError: It has more fragments than an index can name.
            QueueFullError: Too many objects are under way.
        """
        manifest, coded = encode_object(
            order.stream_id,
            order.instance,
            order.encoding,
            order.payload,
            lineage=order.lineage,
            number=order.number,
            has_age=order.has_age,
        )
        fragments = Fragments(coded, order.fragment_bytes)
        if fragments.layout.fragments > MOST_FRAGMENTS:
            most_bytes = MOST_FRAGMENTS * order.fragment_bytes - manifest.size_bytes
            raise PayloadTooLargeError(
                f"the payload is {len(order.payload)} bytes; an object on this link has at most "
                f"{most_bytes}",
                hint="publish it in pieces",
            )
        restored = transfer is not None
        if transfer is None:
            transfer = self._free_transfer()
        losses = {
            address: self._losses.setdefault(address, LossEstimate()) for address in order.receivers
        }
        outgoing = self._make(transfer, losses, manifest, fragments)
        outgoing.due_at = now
        lifespan_ns = None if order.lifespan_s is None else seconds_to_ns(order.lifespan_s)
        sending = self.sendings[transfer] = Sending(
            object_id=order.object_id,
            stream_id=order.stream_id,
            instance=order.instance,
            priority=self._priorities.get(order.stream_id, Priority(order.priority)),
            exclusive=order.exclusive,
            lifespan_ns=lifespan_ns,
            expires_at=None,
            outgoing=outgoing,
            keeps=keep,
            may_go=restored or not keep,
            made_at=self._moments.restored(order.made) if restored else made_at,
        )
        self._expire_at(sending, expires_at)
        self._report(sending, ObjectState.UNDER_WAY, "")
        if keep and not restored:
            self._journal.write(
                out_key(transfer),
                msgspec.msgpack.encode(order),
                lambda at: self._stored(sending, at),
            )

    def restore(self, transfer: int, order: StoredObject, place: StoredProgress) -> None:
        """Resume an object from an earlier boot epoch."""
        self.add(order, 0, transfer=transfer)
        sending = self.sendings[transfer]
        sending.outgoing.resume(place.next_source, place.next_seed)
        sending.source_journalled, sending.seed_journalled = place.next_source, place.next_seed

    def forget(self, transfer: int, then: Callable[[int], None] | None = None) -> None:
        """Delete the journal entries of an object; `then` is called once that is safe."""
        self._journal.write(sent_key(transfer), None)
        self._journal.write(out_key(transfer), None, then)

    def withdraw(self, object_id: int, state: ObjectState, detail: str, now: int) -> bool:
        """Withdraw an object; return False when it is not under way."""
        for sending in self.sendings.values():
            if sending.object_id == object_id and not sending.outgoing.is_withdrawn:
                self._withdraw(sending, state, detail, now)
                return True
        return False

    def is_crossing(self, object_id: int) -> bool:
        """Return whether some of an object was transmitted, and a receiver is there."""
        found = (each for each in self.sendings.values() if each.object_id == object_id)
        return any(each.outgoing.is_crossing for each in found)

    def keep_only(self, stream_id: int, receivers: Set[int], detail: str, now: int) -> None:
        """Keep only these receivers of a stream's objects; `detail` is for those left without."""
        for sending in list(self.sendings.values()):
            outgoing = sending.outgoing
            if sending.stream_id != stream_id or outgoing.is_withdrawn:
                continue
            if not outgoing.is_for(receivers):
                self._withdraw(sending, ObjectState.REFUSED, detail, now)
            elif outgoing.keep_only(receivers):
                self._conclude(sending)

    # Sending

    def fragment_bytes(self, receivers: tuple[int, ...], now: int) -> int:
        """Return the size of the fragments of an object for these receivers, bytes."""
        is_bulk = len(receivers) == 1 and not self._bulk_paths.is_off(receivers[0], now)
        return self._bulk_bytes if is_bulk and self._bulk_bytes else self._plain_bytes

    def use_link(
        self, fragment_bytes: int, bulk_bytes: int, now: int, *, hears_meanwhile: bool
    ) -> None:
        """Cut the objects again whose fragments are too large for a link's frames.

        Args:
            fragment_bytes: The largest fragment in a frame of the plain service, bytes.
            bulk_bytes: The same for the bulk service; 0: there is none.
            now: The instant.
            hears_meanwhile: This node hears all others while it uses that service.
        """
        self._bulk_runs.hears_meanwhile = hears_meanwhile
        self._plain_bytes, self._bulk_bytes = fragment_bytes, bulk_bytes
        for sending in list(self.sendings.values()):
            if sending.expires_at is None and sending.lifespan_ns is not None:
                # Its age is unknown without a clock: its lifespan starts again.
                self._expire_at(sending, now + sending.lifespan_ns)
            before = sending.outgoing
            cut_bytes = before.fragments.layout.fragment_bytes
            if cut_bytes <= fragment_bytes or (before.is_bulk and cut_bytes <= bulk_bytes):
                continue
            if cut_bytes <= bulk_bytes and len(before.views) == 1:
                # It was restored before the link was known.
                self._replace(sending, before.fragments, now)
                sending.outgoing.resume(before.next_source, before.next_seeds())
                continue
            self._cut(sending, fragment_bytes, now)

    def override(self, stream_id: int, priority: Priority, *, on: bool) -> None:
        """Set the priority of a stream's objects, or stop them."""
        self._priorities[stream_id] = priority
        (self._off.discard if on else self._off.add)(stream_id)
        for sending in self.sendings.values():
            if sending.stream_id == stream_id:
                sending.priority = priority

    def next(self, now: int, *, bulk: bool = False) -> tuple[Sending | None, int]:
        """Return the object whose fragment is next, and the instant from which it may go, ns.

        Args:
            now: The instant.
            bulk: By the bulk service; otherwise by the plain one.
        """
        if not self.sendings:
            return None, now
        quiet_until = self.listens_until(now)
        best: tuple[int, tuple[int, int]] | None = None
        chosen: Sending | None = None
        for sending in self.sendings.values():
            if not sending.may_go or sending.stream_id in self._off:
                continue
            outgoing = sending.outgoing
            is_bulk = isinstance(outgoing, BulkObject) and outgoing.needs_bulk
            if is_bulk is not bulk:
                continue
            if isinstance(outgoing, BulkObject) and is_bulk:
                at = outgoing.bulk_at
            else:
                at = outgoing.next_at(partial(self._owner.is_turn, sending.object_id))
            if at is None:
                continue
            if not outgoing.listens:
                at = max(at, quiet_until, self.held.get(sending.stream_id, 0))
            at = max(at, self._ready_at(sending))
            place = (max(at, now), sending.rank)
            if best is None or place < best:
                best, chosen = place, sending
        return chosen, best[0] if best is not None else now

    def take(
        self, now: int, timing: Timing, frames_before_pause: int
    ) -> tuple[Sending, Fragment] | None:
        """Take the next fragment for transmission.

        Args:
            now: The instant.
            timing: The durations.
            frames_before_pause: Full frames before the next listen window, this one included.
        """
        sending, at = self.next(now)
        if sending is None or at > now:
            return None
        outgoing = sending.outgoing
        if self._is_stuck(sending, now):
            names = ", ".join(map(str, outgoing.waiting))
            detail = f"no progress in {sending.heard_rounds} requests, though heard: node {names}"
            self._withdraw(sending, ObjectState.CANCELLED, detail, now)
            return self.take(now, timing, frames_before_pause)
        if outgoing.listens:
            self._give_up_listening(outgoing, now)
            is_alone = all(self._pacers[each].is_silent for each in outgoing.waiting)
            if outgoing.is_withdrawn and (is_alone or outgoing.is_past_asking):
                self._end(sending)
                return self.take(now, timing, frames_before_pause)
        turn = self._turn(sending, now)
        window_follows = not sending.exclusive and frames_before_pause == 1
        if turn is not None:
            fragment = outgoing.take_turn(turn)
        elif not outgoing.has_fragments:
            return self.take(now, timing, frames_before_pause)
        else:
            lacking = outgoing.lacking
            fragment = outgoing.take(
                timing,
                window_follows=window_follows,
                is_present=any(self._pacers.is_present(each, now) for each in lacking),
                is_silent=sending.rounds >= _FEW_ROUNDS
                or (bool(lacking) and all(self._pacers[each].is_silent for each in lacking)),
            )
        self._keep_progress(sending)
        return sending, aged(fragment, outgoing.manifest, sending.made_at, now)

    def take_bulk(self, now: int) -> tuple[Sending, Fragment] | None:
        """Take the next fragment for the bulk service."""
        sending, at = self.next(now, bulk=True)
        if sending is None or at > now:
            return None
        outgoing = sending.outgoing
        assert isinstance(outgoing, BulkObject)
        if outgoing.listens:
            self._give_up_listening(outgoing, now)
        self._bulk_runs.go_on(self._pacers.anybody_heard_at, now)
        pause_follows = not sending.exclusive and self._bulk_runs.is_over(
            self._pacers.heard_at(outgoing.receiver), now
        )
        fragment = outgoing.take_bulk(pause_follows=pause_follows)
        self._keep_progress(sending)
        return sending, aged(fragment, outgoing.manifest, sending.made_at, now)

    def bulk_reported(
        self,
        sending: Sending,
        outgoing: BulkObject,
        index: int,
        report: TransmitReport,
        timing: Timing,
        now: int,
    ) -> None:
        """Record the report of a fragment that went by the bulk service."""
        is_last_of_run = outgoing.ends_run
        if outgoing.listens:
            self._sent(outgoing, report.finished_at)
        is_in_vain = outgoing.reported(index, report, timing, self._silence_ns(sending))
        if self.sendings.get(outgoing.transfer) is not sending or sending.outgoing is not outgoing:
            return
        address = outgoing.receiver
        if report.outcome is TransmitOutcome.DELIVERED and self._bulk_paths.works(address):
            self._emit(BulkChanged(address=address, works=True, changed_at=now))
        if outgoing.listens:
            self._pacers[address].await_answer(report.finished_at, outgoing.due_at)
            self._bulk_runs.rest()
        if is_last_of_run and outgoing.bulk_at is not None:
            self._bulk_runs.pause(report.finished_at)
            outgoing.pause_until(report.finished_at + timing.bulk_pause_ns)
        if is_in_vain:
            self._fail_bulk(sending, outgoing, report, now)
        if outgoing.done_bytes > sending.told_bytes and not outgoing.is_withdrawn:
            sending.told_bytes = outgoing.done_bytes
            self._report(sending, ObjectState.UNDER_WAY, "")

    def next_bytes(self, sending: Sending, now: int) -> int:
        """Return the bytes of data in the next record of an object."""
        return CHECK_BYTES if self._turn(sending, now) else sending.outgoing.fragment_bytes

    def next_destination(self, sending: Sending, now: int) -> int:
        """Return the destination of the next record of an object."""
        return self._turn(sending, now) or sending.outgoing.destination

    def _turn(self, sending: Sending, now: int) -> int | None:
        return sending.outgoing.next_turn(partial(self._owner.is_turn, sending.object_id), now)

    @property
    def is_exclusive(self) -> bool:
        """Whether the first of the objects that have begun is exclusive."""
        if not self.sendings:
            return False
        going = (each for each in self.sendings.values() if each.stream_id not in self._off)
        begun = [each for each in going if each.outgoing.transmitted]
        return bool(begun) and min(begun, key=lambda each: each.rank).exclusive

    def transmitted(
        self, sending: Sending, finished_at: int, timing: Timing, *, asks: bool
    ) -> None:
        """Record that the transmission of a fragment has ended; `asks`: it requests feedback."""
        outgoing = sending.outgoing
        if self.sendings.get(outgoing.transfer) is sending:
            self._sent(outgoing, finished_at)
            silence_ns = self._silence_ns(sending)
            if asks:
                silence_ns = max(silence_ns, self._asked(sending, finished_at))
            outgoing.transmitted_until(finished_at, timing, silence_ns, asks=asks)
            if outgoing.listens and asks:
                for each in outgoing.waiting:
                    self._pacers[each].await_answer(finished_at, outgoing.due_at)
            if outgoing.sent_bytes > sending.told_bytes and not outgoing.is_withdrawn:
                sending.told_bytes = outgoing.sent_bytes
                self._report(sending, ObjectState.UNDER_WAY, "")

    def listens_until(self, now: int) -> int:
        """Return the instant until which an answer may come, ns; `now` if none is awaited."""
        if not self.sendings:
            return now
        listening = (each.outgoing for each in self.sendings.values() if each.outgoing.listens)
        return max((each.listens_until for each in listening), default=now)

    def answered(self, source: int, feedback: Feedback, now: int) -> bool:
        """Take a feedback; return False when it belongs to no object or is not new."""
        sending = self.sendings.get(feedback.transfer)
        before = None if sending is None else sending.outgoing.standing(source)
        if sending is None or not sending.outgoing.answered(source, feedback, now):
            return False
        if sending.outgoing.standing(source) != before:
            sending.allowance.answered()
            sending.rounds = 0
        else:
            pause_ns = sending.allowance.pause_ns(self._pacers.link_times.frames_each)
            sending.outgoing.due_at = max(sending.outgoing.due_at, now + pause_ns)
        self._pacers.answered(source, now)
        self._pacers.await_nothing(source)
        view = sending.outgoing.views[source]
        if view.complete:
            self._owner.passed(sending.object_id, source, now)
        elif view.refused is not None:
            self._owner.refused(sending.object_id, source, view.refused, now)
        self._conclude(sending)
        return True

    def handed_on(self, object_id: int, address: int) -> None:
        """Note that an ACK of the topic shows that a receiver has delivered an object."""
        for sending in list(self.sendings.values()):
            if sending.object_id == object_id and sending.outgoing.handed_on(address):
                self._conclude(sending)

    def _conclude(self, sending: Sending) -> None:
        """Report an object after a receiver's feedback, and end it after the last one."""
        outgoing = sending.outgoing
        if not outgoing.is_finished:
            self._report(sending, ObjectState.UNDER_WAY, "")
        else:
            self._end(sending)
            if not outgoing.is_withdrawn:
                refusals = [
                    f"{address}: {view.refused}"
                    for address, view in outgoing.views.items()
                    if view.refused is not None
                ]
                state = ObjectState.REFUSED if refusals else ObjectState.DELIVERED
                self._report(sending, state, ", ".join(refusals))

    # Below the methods above

    def _make(
        self,
        transfer: int,
        losses: dict[int, LossEstimate],
        manifest: Manifest,
        fragments: Fragments,
    ) -> OutgoingObject:
        """Make an object under way by the service that its fragments need."""
        is_bulk = 0 < self._plain_bytes < fragments.layout.fragment_bytes
        make = BulkObject if is_bulk and len(losses) == 1 else OutgoingObject
        return make(transfer, losses, manifest, fragments, self._rng)

    def _replace(self, sending: Sending, fragments: Fragments, now: int) -> None:
        """Begin an object anew with other fragments, or by another service."""
        before = sending.outgoing
        losses = {address: view.loss for address, view in before.views.items()}
        sending.outgoing = self._make(before.transfer, losses, before.manifest, fragments)
        sending.outgoing.due_at = now

    def _cut(self, sending: Sending, fragment_bytes: int, now: int) -> None:
        """Begin an object anew with fragments of another size."""
        fragments = sending.outgoing.fragments.cut(fragment_bytes)
        if fragments.layout.fragments > MOST_FRAGMENTS:
            self._report(sending, ObjectState.CANCELLED, "too large for this link")
            self._end(sending)
            return
        self._replace(sending, fragments, now)
        sending.source_journalled = sending.seed_journalled = sending.told_bytes = 0
        if sending.keeps:
            place = msgspec.msgpack.encode(StoredProgress(0, 0))
            self._journal.write(sent_key(sending.outgoing.transfer), place)

    def _fail_bulk(
        self, sending: Sending, outgoing: BulkObject, report: TransmitReport, now: int
    ) -> None:
        """Pause after all that was under way was lost; then go another way if need be."""
        address, times = outgoing.receiver, self._pacers.link_times
        pacer = self._pacers[address]
        pacer.allowance.sent(report.finished_at, times.frames_each, is_first=False)
        pause_ns = pacer.pause_ns(times, 0, self._rng, sending.priority)
        if report.outcome is TransmitOutcome.ABORTED:
            # That was the own device, for an urgent message perhaps: as long as nobody answers that
            # the next one would cut it short again.
            longer_ns = min(pause_ns << outgoing.cut_short(), _LONGEST_CUT_NS)
            outgoing.pause_until(report.finished_at + max(pause_ns, longer_ns))
            return
        outgoing.pause_until(report.finished_at + pause_ns)
        pacer.unanswered(now, times)
        if not self._bulk_paths.fails(address, self._pacers.heard_at(address), now):
            return
        self._emit(BulkChanged(address=address, works=False, changed_at=now))
        for each in list(self.sendings.values()):
            other = each.outgoing
            if isinstance(other, BulkObject) and other.receiver == address and other.needs_bulk:
                self._cut(each, self._plain_bytes, now)

    def _released(self, address: int, now: int) -> None:
        """Make due what waits for a receiver."""
        for sending in self.sendings.values():
            if address in sending.outgoing.views:
                sending.allowance.back(now)
            sending.outgoing.release(address, now)

    def _sent(self, outgoing: OutgoingObject, at: int) -> None:
        """Record the end of a frame that receivers may not answer, ns."""
        if outgoing.listens or not outgoing.is_heard:
            frames = self._pacers.link_times.frames_each
            for each in outgoing.waiting:
                is_first = not outgoing.views[each].unanswered
                self._pacers[each].allowance.sent(at, frames, is_first=is_first)

    def _asked(self, sending: Sending, at: int) -> int:
        """Record the end of a request, ns; return the shortest pause if nobody gets on, ns."""
        if not sending.rounds:
            sending.since, sending.heard_rounds = at, 0
        elif self._heard_at(sending.outgoing) > sending.outgoing.asked_at:
            sending.heard_rounds += 1
        sending.rounds += 1
        frames = self._pacers.link_times.frames_each
        sending.allowance.sent(at, frames, is_first=sending.rounds == 1)
        return sending.allowance.pause_ns(frames)

    def _is_stuck(self, sending: Sending, now: int) -> bool:
        """Return whether an object ends because nobody gets on with it."""
        is_vain = sending.heard_rounds >= _MOST_ROUNDS and now - sending.since >= _MOST_VAIN_NS
        return is_vain and not (sending.keeps or sending.outgoing.is_withdrawn)

    def _heard_at(self, outgoing: OutgoingObject) -> int:
        return max(map(self._pacers.heard_at, outgoing.waiting), default=-1)

    def _ready_at(self, sending: Sending) -> int:
        """Return the earliest instant for an object that no receiver has answered, ns."""
        times, outgoing = self._pacers.times, sending.outgoing
        if times is None or outgoing.is_withdrawn or not outgoing.is_unheard:
            return 0
        ready_at: list[int] = []
        for each in outgoing.lacking:
            pacer = self._pacers[each]
            is_back = self._pacers.heard_at(each) > outgoing.asked_at and not pacer.is_silent
            ready_at.append(0 if is_back else pacer.ready_at(times, sending.priority))
        return min(ready_at, default=0)

    def _silence_ns(self, sending: Sending) -> int:
        """Draw a pause for receivers that do not answer, ns; 0: one of them may answer."""
        times = self._pacers.link_times
        pacers = [self._pacers[each] for each in sending.outgoing.waiting]
        if not all(each.is_doubtful(times) for each in pacers):
            return 0
        pauses_ns = (each.pause_ns(times, 0, self._rng, sending.priority) for each in pacers)
        return min(pauses_ns, default=0)

    def _give_up_listening(self, outgoing: OutgoingObject, now: int) -> None:
        times = self._pacers.link_times
        for each in outgoing.give_up_listening(now):
            self._pacers[each].unanswered(now, times)

    def _expire_at(self, sending: Sending, instant: int | None) -> None:
        sending.expires_at = instant
        if instant is not None and not sending.outgoing.is_withdrawn:
            key = (Due.OBJECT, sending.outgoing.transfer)
            self._timers.at(key, instant, partial(self._expire, sending))

    def _expire(self, sending: Sending, now: int) -> None:
        self._withdraw(sending, ObjectState.EXPIRED, "older than its lifespan", now)

    def _stored(self, sending: Sending, now: int) -> None:
        """Release an object for transmission, now that it is journalled."""
        sending.may_go = True
        sending.outgoing.due_at = max(now, sending.outgoing.due_at)
        self._owner.stored(sending, now)

    def _free_transfer(self) -> int:
        if len(self.sendings) >= self._most:
            raise QueueFullError(f"{self._most} objects are on their way already")
        while self._next_transfer in self.sendings:
            self._next_transfer = (self._next_transfer + 1) % self._numbers
        transfer = self._next_transfer
        self._next_transfer = (transfer + 1) % self._numbers
        return transfer

    def _keep_progress(self, sending: Sending) -> None:
        """Journal, ahead of the transmission, what will have been sent."""
        if not sending.keeps:
            return
        outgoing = sending.outgoing
        fragments = outgoing.fragments.layout.fragments
        step = max(1, fragments // _STEP_DIVISOR)
        next_source, next_seed = outgoing.next_source, outgoing.next_seeds()
        if next_source > sending.source_journalled or next_seed > sending.seed_journalled:
            if next_source > sending.source_journalled:
                sending.source_journalled = min(fragments, next_source - 1 + step)
            sending.seed_journalled = (
                max(sending.seed_journalled, next_seed + step) if next_seed else 0
            )
            place = StoredProgress(sending.source_journalled, sending.seed_journalled)
            self._journal.write(sent_key(outgoing.transfer), msgspec.msgpack.encode(place))

    def _withdraw(self, sending: Sending, state: ObjectState, detail: str, now: int) -> None:
        self._timers.cancel((Due.OBJECT, sending.outgoing.transfer))
        self._report(sending, state, detail)
        sending.outgoing.withdraw(now)
        if not sending.outgoing.transmitted:
            self._end(sending)

    def _end(self, sending: Sending) -> None:
        transfer = sending.outgoing.transfer
        del self.sendings[transfer]
        if not any(each.outgoing.is_bulk for each in self.sendings.values()):
            self._bulk_runs.end()
        self._timers.cancel((Due.OBJECT, transfer))
        if sending.keeps:
            self.forget(transfer)

    def _report(self, sending: Sending, state: ObjectState, detail: str) -> None:
        manifest: Manifest = sending.outgoing.manifest
        views = sending.outgoing.views
        is_delivered = state is ObjectState.DELIVERED
        self._emit(
            ObjectProgress(
                stream_id=sending.stream_id,
                peer=next(iter(views)) if len(views) == 1 else BROADCAST,
                transfer=sending.outgoing.transfer,
                object_id=sending.object_id,
                state=state,
                done_bytes=manifest.payload_bytes if is_delivered else sending.outgoing.done_bytes,
                sent_bytes=sending.outgoing.sent_bytes,
                total_bytes=manifest.payload_bytes,
                missing=() if state is ObjectState.UNDER_WAY else sending.outgoing.missing,
                detail=detail,
            )
        )
