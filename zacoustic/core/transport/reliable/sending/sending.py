"""The publisher's side: reliable samples, until they are acknowledged or worth nothing."""

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.journal import LIFE_KEY
from zacoustic.core.base.linktypes import TransmitReport
from zacoustic.core.base.moments import Made
from zacoustic.core.base.parts import Part
from zacoustic.core.base.qos import Durability
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import (
    DeliveryEvent,
    DeliveryOutcome,
    DeliveryStored,
)
from zacoustic.core.transport.outcomes import Outcomes
from zacoustic.core.transport.reliable.sending.contradictions import Contradictions
from zacoustic.core.transport.reliable.sending.keeping import Keeping
from zacoustic.core.transport.reliable.sending.latched import LatchedSamples
from zacoustic.core.transport.reliable.sending.pacing import Pacing
from zacoustic.core.transport.reliable.sending.sendlane import (
    AT_ONCE,
    JournalledSample,
    OutgoingSample,
    SampleWaiting,
    SendLane,
    Stage,
)
from zacoustic.core.transport.reliable.sending.sendlanes import SendLanes
from zacoustic.core.transport.reliable.sending.slots import LargeSlots
from zacoustic.core.transport.subscriptions.subscriptions import NOBODY, Subscriptions
from zacoustic.core.wire.frame import Sync
from zacoustic.core.wire.numbers import Ack

_ANY_DEPTH: Final = 65535


class ReliableSending:
    """The samples that this node has published reliably.

    Args:
        context: What the components of its engine share.
        subscriptions: Knows the subscribers of on-demand topics.
        emit: Takes the events of samples.
    """

    def __init__(
        self,
        context: Context,
        subscriptions: Subscriptions,
        emit: Callable[[DeliveryEvent], None],
        outcomes: Outcomes,
    ) -> None:
        self._table = context.table
        self._queue = context.queue
        self._timers = context.timers
        self._handshake = context.handshake
        self._outcomes = outcomes
        self._moments = context.moments
        self._keeping = Keeping(context.journal, outcomes)
        self._pacers = context.pacers
        self._pacing = Pacing(
            context.table,
            context.pacers,
            context.generators.of("pacing"),
            context.stats,
            context.handshake,
        )
        self._contradictions = Contradictions(
            context.table,
            self._keeping,
            context.doubt,
            context.generators.of("contradictions"),
            self._out_of_sync,
        )
        self._emit = emit
        self._numbering = context.sizes.samples
        self._lanes = SendLanes(
            context.address,
            context.table,
            context.handshake,
            subscriptions,
            context.generators.of("lineages"),
            context.sizes.samples,
            context.moments,
        )
        self.slots = LargeSlots(
            self._lanes,
            self._keeping,
            end=self._end,
            lose=self._out_of_sync,
            go_on=self._go_on,
            begin_anew=self._contradictions.begin_anew,
            pause_ns=self._pacing.pause_ns,
        )
        """The sequence slots of samples that cross as objects."""
        self._latched = LatchedSamples()
        self._settling_ns = 0
        self._paced_until: int | None = None
        self._next_delivery_id = 1
        self._order = 0
        context.pacers.on_repeat(self._repeat)
        context.pacers.changed.connect(self._changed)
        context.pacers.released.connect(self._released)
        context.pacers.hole_begins.connect(self._hole_begins)
        context.peers.restarted.connect(self.peer_restarted)
        context.peers.asked.connect(self.peer_asked)
        context.peers.forgotten.connect(self.peer_forgotten)

    # For the application

    def check(self, stream: Stream) -> None:
        """Refuse a sample that could not be delivered or not be journalled.

        Raises:
            LocalError: No node is listed that could acknowledge it.
            JournalUnavailableError: It must be journalled, and the journal cannot be written.
        """
        self._lanes.check(stream)
        self._keeping.check(stream)

    def publish(
        self,
        stream: Stream,
        instance: Instance,
        *,
        prefix: bytes,
        payload: bytes,
        stamped: bool,
        queued_at: int,
        made_at: Made,
        expires_at: int | None,
        delivery_id: int,
        now: int,
    ) -> None:
        """Publish a sample that `check` has accepted."""
        lane = self._lanes.of(stream, instance)
        made = self._moments.keep(made_at) if stamped else None
        kept = JournalledSample(delivery_id, prefix, payload, stamped, made)
        sample = lane.add(stream, kept, queued_at=queued_at, expires_at=expires_at, made_at=made_at)
        if lane.is_journalled:
            # Journal it before deleting what it displaces: the journal then always has one of the
            # two.
            self._keeping.keep(
                stream, lane, sample, kept, lambda at: self._stored(lane, sample, at)
            )
        else:
            sample.stage = Stage.BEHIND
        # Compare numbers, as receivers do: they may get this sample before one that they lack.
        while (first := lane.samples[0]).number <= sample.number - stream.qos.depth:
            end = self.slots.give_up if first.number < lane.born else self._end
            end(lane, first, DeliveryOutcome.SUPERSEDED, now)
        self._latched.superseded(stream, lane)
        self._go_on(lane, now)

    def keep_large(self, stream: Stream, instance: Instance, kept: JournalledSample) -> None:
        """Keep what the newest sample of a key is made of, which crosses as an object."""
        lane = self._lanes.find(stream, instance)
        if lane is not None and lane.samples:
            lane.samples[-1].made_of = kept
            self._latched.superseded(stream, lane)

    def next_delivery_id(self) -> int:
        """Return a delivery id that was never used before."""
        self._next_delivery_id += 1
        return self._next_delivery_id - 1

    def delivering(self, stream_id: int) -> int:
        """Return how many samples of a topic are not acknowledged by all receivers."""
        return sum(len(lane.samples) for lane in self._lanes if lane.key[0] == stream_id)

    def is_delivering(self, delivery_id: int) -> bool:
        """Return whether a sample has not ended."""
        return delivery_id in self._lanes.under_way

    # For the link

    def use_link(self, settling_ns: int) -> None:
        """Set the time in which every repetition of a frame arrives, ns."""
        self._settling_ns = self._contradictions.settling_ns = settling_ns
        self._changed()

    def link_up(self, now: int) -> None:
        """Repeat what was sent before, and start the lifespans of restored samples."""
        for lane in self._lanes:
            lifespan_s = self._table.by_id(lane.key[0]).qos.lifespan_s
            for sample in lane.samples:
                if sample.stage is Stage.SENT:
                    sample.due_at = AT_ONCE
                is_large = sample.stage is Stage.OBJECT
                if sample.expires_at is None and lifespan_s is not None and not is_large:
                    lane.expire(sample, now + seconds_to_ns(lifespan_s))
            self._go_on(lane, now)

    # For a receiver that has forgotten what it had

    def has_for(self, address: int) -> bool:
        """Return whether samples of latched topics are there that a node may have forgotten."""
        return any(address in lane.receptions for lane in self._latched)

    def give_again(self, address: int, now: int) -> None:
        """Send the delivered samples of latched topics to a node again."""
        for lane in list(self._lanes):
            self._give_again(lane, address, now)

    def give_one_again(self, address: int, now: int) -> None:
        """Send the newest of these samples of one key."""
        for lane in list(self._latched):
            if self._give_again(lane, address, now):
                return

    # For the channel

    def peer_restarted(self, source: int, epoch: int, now: int) -> None:
        """Send the missing samples of a restarted node with SYNC."""
        self.peer_asked(source, now)

    def peer_forgotten(self, source: int, now: int) -> None:
        """Forget a node's round trips; send what it lacks with SYNC if it comes back."""
        self._pacing.forget(source)
        self._changed()
        self.peer_asked(source, now)

    def peer_asked(self, source: int, now: int) -> None:
        """Send with SYNC what a node lacks that does not know this node, or has restarted."""
        for lane in self._lanes:
            reception = lane.receptions.get(source)
            if reception is not None:
                reception.has_forgotten = True
            if reception is not None and reception.in_sync:
                self._out_of_sync(lane, source)

    def acknowledged(
        self, source: int, stream: Stream, instance: Instance, ack: Ack, sync: Sync | None, now: int
    ) -> str | None:
        """Take an ACK.

        Args:
            source: The receiver that acknowledges.
            stream: The topic.
            instance: The key within the topic.
            ack: The content of the ACK.
            sync: The SYNC before it, if any: lineage, and the expected number in full.
            now: The instant.

        Returns:
            The reason why it is dropped, or None.
        """
        lane = self._lanes.find(stream, instance)
        reception = lane.receptions.get(source) if lane else None
        if sync is not None and (lane is None or lane.is_former):
            self._lanes.claimed(stream, sync.lineage)
        if lane is None or reception is None:
            return "unexpected_ack"
        if not ack.knows:
            self._out_of_sync(lane, source)
            return None
        if sync is None:
            if not reception.in_sync:
                return "unexpected_ack"  # from another boot epoch perhaps, or about old numbers
            expected = self._numbering.resolve_expected(ack.expected, reception.expected)
        else:
            expected = lane.told(source, sync)
        if not lane.lacks(source):
            if lane.is_certain(source, sync) and lane.claims_too_much(expected, ack):
                self._contradictions.claimed(lane)
        elif sync is not None and expected > lane.next_number and lane.contradicts(source, sync):
            self._contradictions.heard(stream, lane, source, sync, now)
            self._go_on(lane, now)
        if expected > lane.next_number:
            return "unexpected_ack"
        self._contradictions.agrees(lane, source, expected)
        if sync is not None and not reception.in_sync:
            if expected < reception.expected:
                # The receiver has lost what it had and began at the floor: it lacks all that again.
                if reception.has_forgotten:
                    self._latched.again(stream, lane, source, now)
                lane.regress(source, expected)
            reception.has_forgotten = False
            if expected >= lane.floor:
                if reception.settled_at is None:
                    reception.settled_at = now + self._settling_ns
                reception.in_sync = now >= reception.settled_at
        if expected >= reception.expected:
            reception.expected = expected
            self._pacers.await_nothing(source)
            self._mark(lane, source, expected, ack.held, now)
            lane.answered(source)
            self._pacing.asked(lane, source, now)
            self.slots.acknowledged(lane, source, expected, now)
            lane.release(source)
        self._go_on(lane, now)
        return None

    def subscribers_changed(self, stream: Stream, newcomers: Set[int], now: int) -> None:
        """Apply a change of the subscribers of an on-demand topic."""
        for lane in self._lanes:
            if lane.key[0] == stream.stream_id:
                for sample in [] if lane.subscribers else list(lane.samples):
                    self.slots.give_up(lane, sample, DeliveryOutcome.REFUSED, now, NOBODY)
                for address in newcomers & lane.receptions.keys():
                    self._out_of_sync(lane, address)
                self.slots.subscribers_changed(lane)
                self._refresh(lane)
                self._go_on(lane, now)

    def dropped(self, records: Iterable[QueuedRecord], now: int) -> None:
        """Send as objects the records that no longer fit a frame of the link."""
        for record in records:
            if isinstance(record, SampleWaiting):
                self.slots.enlarge(record.lane, record.sample, now)
        self._changed()

    # The journal

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore samples from before the restart, and continue the delivery ids above theirs."""
        if life := int.from_bytes(stored.get(LIFE_KEY, b""), "big"):
            self._next_delivery_id += life << 36 | self._handshake.epoch << 20
        for kept in self._keeping.recover(stored, self._table):
            self._lanes.restore(self._table.by_id(kept.stream_id), kept)
        self._next_delivery_id = max(self._next_delivery_id, self._keeping.highest_id + 1)

    # Below the methods above

    def _give_again(self, lane: SendLane, address: int, now: int) -> bool:
        stream = self._table.by_id(lane.key[0])
        if stream.qos.durability is not Durability.TRANSIENT_LOCAL:
            return False
        newest = self._latched.again(stream, lane, address, now)
        if newest is None:
            return False
        if self.slots.is_large(newest, self._queue.largest_bytes):
            lane.release()  # an object waits for the turn of what comes before it
        self._out_of_sync(lane, address)
        self._go_on(lane, now)
        return True

    def _released(self, address: int, now: int) -> None:
        """Make due what waits for a node."""
        for lane in self._lanes:
            if address in lane.receptions:
                lane.receptions[address].allowance.back(now)
                lane.due_soon(address)
        self._changed()

    def _hole_begins(self, now: int) -> None:
        """Repeat emergencies in the hole between trains of other nodes."""
        for lane in self._lanes:
            self._pacing.hole_begins(lane, now)
        self._changed()

    def _changed(self) -> None:
        self._timers.changed((Due.SENDING,), self._due_at, self._go_on_all)

    def _due_at(self) -> int | None:
        """Return the earliest instant at which a sample expires or is due, ns, or None."""
        instants = [] if self._paced_until is None else [self._paced_until]
        times = self._pacing.times
        may_repeat = times is not None and self._lanes.repeating_bytes() < times.batch_bytes
        for lane in self._lanes:
            if not lane.samples:
                continue
            sent = (sample for sample in lane.active() if may_repeat and lane.awaits(sample))
            instants += (self._pacing.ready_at(lane, sample) for sample in sent)
            if self._table.by_id(lane.key[0]).qos.lifespan_s is not None:
                instants += filter(None, [lane.expires_at])
        return min(instants, default=None)

    def _go_on_all(self, now: int) -> None:
        """End expired samples, and repeat those that are due."""
        self._paced_until = None
        for lane in self._lanes:
            for sample in lane.expired(now):
                self.slots.give_up(lane, sample, DeliveryOutcome.EXPIRED, now)
            self._advance(lane, now)
        self._pacers.repeat(now)

    def _stored(self, lane: SendLane, sample: OutgoingSample, now: int) -> None:
        if sample.stage is not Stage.STORING:
            return
        sample.stage = Stage.BEHIND
        self._emit(DeliveryStored(delivery_id=sample.delivery_id, stream_id=lane.key[0]))
        self._advance(lane, now)

    def _go_on(self, lane: SendLane, now: int) -> None:
        """End the samples that are delivered, and queue the next ones."""
        while lane.samples and not lane.missing(first := lane.samples[0]):
            if first.stage is Stage.OBJECT:
                break  # its object ends it
            outcome = DeliveryOutcome.UNKNOWN if first.unknown else DeliveryOutcome.DELIVERED
            self._end(lane, first, outcome, now, missing=tuple(sorted(first.unknown)))
        self._advance(lane, now)

    def _advance(self, lane: SendLane, now: int) -> None:
        """Queue the samples that have come into the window."""
        self._changed()
        paced_until = lane.open(now, self._settling_ns)
        if paced_until is not None:
            self._paced_until = min(self._paced_until or paced_until, paced_until)
        for sample in list(lane.active()):
            if sample.stage is Stage.BEHIND and not lane.is_blocked(sample):
                self._queue_sample(lane, sample, now)

    def _queue_sample(self, lane: SendLane, sample: OutgoingSample, now: int) -> None:
        stream = self._table.by_id(lane.key[0])
        lacking = [
            address
            for address in lane.lacking(sample)
            if not self._handshake.differs(address, stream.stream_id)
        ]
        if not lacking:
            # The receivers that lack it define the stream differently: wait until that changes.
            sample.stage = Stage.SENT
            sample.due_at = now + self._pacing.pause_ns(lane, sample)
            return
        if self.slots.is_large(sample, self._queue.largest_bytes):
            self.slots.enlarge(lane, sample, now)
            return
        sample.stage = Stage.QUEUED
        lane.address(sample, lacking)
        sample.waiting.cause = Cause.REPEAT if sample.tries else None
        for address in lacking:
            self._pacers.introduce(address, stream.stream_id)
        sample.waiting.part = Part(
            transmitted=partial(self._transmitted, lane, sample),
            reported=partial(self._reported, lane, sample),
        )
        qos = msgspec.structs.replace(stream.qos, depth=_ANY_DEPTH, lifespan_s=None)
        self._queue.push(lane.key, sample.waiting, qos)

    def _transmitted(self, lane: SendLane, sample: OutgoingSample, now: int) -> None:
        """Record that a transmission of a sample begins."""
        self._changed()
        self._order += 1
        sample.order, sample.stage = self._order, Stage.ON_AIR
        self._pacing.begins(lane, sample, now)

    def _reported(
        self, lane: SendLane, sample: OutgoingSample, report: TransmitReport, now: int
    ) -> None:
        """Record that the transmission has ended, and await an ACK."""
        self._changed()
        if sample.stage is Stage.ON_AIR:
            sample.stage = Stage.SENT
            sample.sent_at = report.finished_at
            sample.due_at = self._pacing.repeat_at(lane, sample, report)

    def _refresh(self, lane: SendLane) -> None:
        """Readdress the waiting records after the knowledge of receivers has changed."""
        for sample in lane.address_anew():
            self._queue.discard(lane.key, sample.waiting)
            sample.stage = Stage.SENT

    def _mark(self, lane: SendLane, source: int, expected: int, held: int, now: int) -> None:
        """Note which samples a receiver has, and make due those that it must have missed."""
        latest: OutgoingSample | None = None
        had_gap = any(source in each.held for each in lane.named())
        lane.name(expected + held.bit_length() + 1)
        for sample in lane.named():
            if sample.stage is Stage.OBJECT:
                continue  # its object has feedback of its own
            ahead = sample.number - expected - 1
            has_it = sample.number < expected
            holds_it = ahead >= 0 and bool(held >> ahead & 1)
            if (has_it or holds_it) and source not in sample.acknowledged | sample.held:
                latest = sample if latest is None or latest.order < sample.order else latest
            if has_it:
                sample.acknowledged.add(source)
                sample.held.discard(source)
            elif holds_it:
                sample.held.add(source)
            else:
                sample.held.discard(source)  # it has restarted and lost what it held
        if latest is not None:
            is_last = latest.order == self._order
            order = self._pacing.first_acknowledged(
                lane, latest, source, now, is_last=is_last, had_gap=had_gap
            )
            lane.receptions[source].allowance.answered()
            self._pacers.answered(source, now)
            lane.due_soon(source, before=order)
        self._refresh(lane)

    def _repeat(self, now: int) -> None:
        """Queue what is due, and what will be due before an answer can come.

        A batch is limited to a few frames: a node that transmits without end hears no answer.
        """
        times = self._pacing.times
        if times is None:
            return
        room_bytes = times.batch_bytes - self._lanes.repeating_bytes()
        slack_ns = times.first_round_trip_ns // 2
        batch: list[tuple[SendLane, OutgoingSample]] = []
        for lane in self._lanes:
            sent = [sample for sample in lane.active() if lane.awaits(sample)]
            if not any(self._pacing.may_repeat(lane, each, now) for each in sent):
                continue
            for sample in sent:
                is_due = self._pacing.due_at(lane, sample) <= now + slack_ns
                if is_due and room_bytes > 0 and self._pacing.takes(lane, sample, now):
                    room_bytes -= sample.waiting.size_bytes
                    batch.append((lane, sample))
        for lane, sample in batch:
            self._pacing.repeats(lane, sample, now)
            self._queue_sample(lane, sample, now)

    def _out_of_sync(self, lane: SendLane, source: int) -> None:
        lane.lose_sync(source)
        self._pacers.await_nothing(source)
        self._refresh(lane)
        lane.due_soon(source)
        self._changed()

    def _end(
        self,
        lane: SendLane,
        sample: OutgoingSample,
        outcome: DeliveryOutcome,
        now: int,
        detail: str = "",
        *,
        missing: tuple[int, ...] | None = None,
        waiting: Sequence[int] = (),
    ) -> None:
        """Remove a sample and emit its end.

        Args:
            lane: Its lane.
            sample: The sample.
            outcome: How it has ended.
            now: The instant.
            detail: More about it, one line.
            missing: The receivers that do not have it; None: as far as known.
            waiting: The receivers that learn by SYNC that its number will not come.
        """
        if sample.stage is Stage.QUEUED:
            self._queue.discard(lane.key, sample.waiting)
        leaves_gap = lane.remove(sample)
        if sample.stage is Stage.OBJECT:
            self.slots.left(sample, outcome, now)
        sample.stage = Stage.ENDED
        if sample.is_again:  # its outcome is known
            for address in waiting if leaves_gap else ():
                self._out_of_sync(lane, address)
            return
        self._latched.ended(self._table.by_id(lane.key[0]), lane, sample, outcome)
        ended = lane.ended(sample, outcome, now, detail, missing)
        if lane.is_journalled:  # a later boot epoch must not find the sample and report another end
            if outcome is not DeliveryOutcome.DELIVERED:
                lane.leave(sample)
            self._outcomes.tell(ended)
            then = partial(self._forgotten, lane, sample, waiting)
            self._keeping.forget(lane, sample, then)
            return
        self._emit(ended)
        for address in waiting if leaves_gap else ():
            self._out_of_sync(lane, address)

    def _forgotten(
        self,
        lane: SendLane,
        sample: OutgoingSample,
        waiting: Sequence[int],
        now: int,
    ) -> None:
        lane.leaving = [each for each in lane.leaving if each is not sample]
        for address in waiting:
            self._out_of_sync(lane, address)
        self._advance(lane, now)
