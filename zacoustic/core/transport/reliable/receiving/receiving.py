"""The subscriber's side: delivers samples in order, each once, and owes ACKs for them."""

import enum
from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.moments import instant_of
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.schedule.timing import ack_slots
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.transport.reliable.receiving.positions import LaneKey, Positions
from zacoustic.core.transport.reliable.receiving.receivelane import ReceiveLane
from zacoustic.core.transport.reliable.sending.slots import LEAST_ACK_BYTES, SequenceSlot
from zacoustic.core.wire.frame import SYNC_BYTES, Control, Sync
from zacoustic.core.wire.numbers import Ack, resolve_floor

ACK_LANE: Final = 4
ACK_HEAD_BYTES: Final = 3
"""Prefix, address and stream id."""
_ACK_QOS: Final = Qos(priority=Priority.INTERACTIVE_HIGH)
_MOST_UNHEARD: Final = 5


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """A sample that arrived, with the circumstances."""

    sync: Sync | None
    """The SYNC before the sample, if any."""
    low_number: int
    """The seven bits of its number."""
    in_rhythm: bool
    """Whether the sample is marked as in rhythm."""
    frame_bytes: int
    """Size of its frame, bytes."""
    sample: SampleReceived
    """The event to emit when it is the sample's turn."""
    is_alone: bool
    """Whether the frame was addressed to this node alone, so that no other node answers."""
    spare_bytes: int
    """Bytes left in the frame had it held the record twice, less the MTU; if negative, the
    publisher may have more to send."""


class _Turn(msgspec.Struct, frozen=True):
    """How long an ACK waits before it justifies a frame of its own."""

    linger_ns: int = 0
    """Wait for the end of the publisher's frames, ns; each further frame restarts it."""
    offset_ns: int = 0
    """Wait after that, ns, so that receivers do not all answer at once."""


class Claim(enum.Enum):
    """Whether a complete large sample may be delivered."""

    NOW = "now"
    """It is the next to be delivered."""
    LATER = "later"
    """A sample before it may still come."""
    OVER = "over"
    """It was delivered before, or is given up."""
    FORMER = "former"
    """Its lineage is over: it is not delivered, and whether it was before is unknown."""


class _AckWaiting(QueuedRecord):
    """An ACK in the transmit queue."""

    __slots__ = ("owed_at",)
    owed_at: int
    """Instant since which the ACK is owed, ns."""


class ReliableReceiving:
    """The samples that came reliably from other nodes.

    Args:
        context: What the components of its engine share.
        hand_on: Takes each sample in order, and the instant.
    """

    def __init__(self, context: Context, hand_on: Callable[[SampleReceived, int], None]) -> None:
        self._address = context.address
        self._table = context.table
        self._queue = context.queue
        self._pacers = context.pacers
        self._doubt = context.doubt
        self._positions = Positions(context.journal, context.table, context.moments)
        self._timers = context.timers
        self._rng = context.generators.of("receiving")
        self._emit = hand_on
        context.peers.forgotten.connect(self.peer_forgotten)
        self._sizes = context.sizes
        self._lanes: dict[LaneKey, ReceiveLane] = {}
        self._left: list[LaneKey] = []
        """Lanes with samples that were about to be delivered before the restart."""
        self._watched: dict[LaneKey, ReceiveLane] = {}
        """Lanes that may have to ask for a sample."""

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the positions from the journal."""
        self._lanes.update(self._positions.recover(stored))
        self._left = [key for key, lane in self._lanes.items() if lane.pending]

    def link_up(self, now: int) -> None:
        """Deliver the samples that were about to be delivered before the restart."""
        for key in self._left:
            lane = self._lanes[key]
            for sample, since in zip(lane.pending, lane.pending_since, strict=True):
                received_at = instant_of(since, now)
                if received_at is None:  # how long it has lain in the journal is not known
                    sample = msgspec.structs.replace(sample, age_s=None, age_error_s=None)
                else:
                    sample = msgspec.structs.replace(sample, received_at=received_at).aged(now)
                self._emit(msgspec.structs.replace(sample, received_at=now), now)
            lane.pending.clear()
            lane.pending_since.clear()
            self._positions.write(key, lane, lane.expected)
        self._left.clear()

    def receive(self, stream: Stream, arrival: Arrival, now: int) -> str | None:
        """Take a sample of a topic; return why it is dropped, or None."""
        sync, sample = arrival.sync, arrival.sample
        key = (sample.source, stream.stream_id, sample.instance)
        lane = self._lanes.get(key)
        ready: list[SampleReceived] = []
        if sync is not None and lane is not None and lane.is_over(sync.lineage):
            # The sample is late, or its publisher has forgotten what it has published since.
            self._owe(key, lane.ack(), lane.sync, now, self._turn(stream, arrival))
            return "repeated_sample"
        if sync is not None and (lane is None or lane.lineage != sync.lineage):
            lane, ready = ReceiveLane.behind(lane, sync.lineage, sync.floor)
            self._lanes[key] = lane
        if lane is None or (sync is None and not lane.is_settled):
            self._owe(key, Ack(0, knows=False), None, now, self._turn(stream, arrival))
            return "out_of_sync"
        lane.in_sync = sync is None
        before = lane.expected
        if sync is not None:
            floor = resolve_floor(sync.floor, lane.expected)
            lane.settle(floor, stream.qos.depth)
            ready += lane.hand_on(floor)
        number = self._sizes.samples.resolve(arrival.low_number, lane.expected)
        if self._doubt.reason and (sync is not None or number < lane.doubtful_end):
            sample = msgspec.structs.replace(sample, again=True)
        answers = self._learn(lane, number, arrival)
        self._watch_changed()
        reason = None
        if number < lane.expected or number in lane.held:
            reason = "repeated_sample"
        else:
            lane.held[number] = sample
            ready += lane.hand_on(number - stream.qos.depth + 1)
        is_first = reason is None and sync is None
        turn = self._turn(stream, arrival, is_first=is_first, unheard=lane.unheard)
        self._count(key, lane, is_new=reason is None)
        if is_first:
            self._watch(key, lane, now + turn.linger_ns + turn.offset_ns)
        own_turn = turn if answers else None
        if ready or lane.expected != before:  # do not ask for what is given up
            self._keep(key, lane, ready, stream, now, own_turn)
        else:
            self._owe_ack(key, lane, now, own_turn)
        return reason

    # Large samples

    def claim(
        self,
        stream: Stream,
        source: int,
        instance: Instance,
        slot: SequenceSlot,
        now: int,
        *,
        is_turn: bool,
    ) -> Claim:
        """Return whether a complete large sample may be delivered now.

        After NOW the caller journals the delivery and then calls `take`.

        Args:
            stream: The topic.
            source: The publisher's address.
            instance: The key within the topic.
            slot: The sample's lineage and number.
            now: The instant.
            is_turn: The publisher says that nothing before the sample will come.
        """
        key = (source, stream.stream_id, instance)
        lane = self._lanes.get(key)
        ready: list[SampleReceived] = []
        if lane is None or lane.lineage != slot.lineage:
            # Of two lineages only the publisher knows which one is over.
            if lane is not None and lane.is_over(slot.lineage):
                return Claim.FORMER
            if not is_turn and (slot.number or lane is not None):
                return Claim.LATER
            lane, ready = ReceiveLane.behind(lane, slot.lineage, slot.number)
            lane.in_sync = False
            lane.settle(slot.number, stream.qos.depth)
            self._lanes[key] = lane
        number = resolve_floor(slot.number, lane.expected)
        if number < lane.expected:
            return Claim.OVER
        ready += lane.hand_on(number if is_turn else number - stream.qos.depth + 1)
        if ready:
            self._keep(key, lane, ready, stream, now, self._large_turn)
        return Claim.LATER if number > lane.expected else Claim.NOW

    def is_over(self, source: int, stream_id: int, instance: Instance, slot: SequenceSlot) -> bool:
        """Return whether a large sample is known to be delivered or given up."""
        lane = self._lanes.get((source, stream_id, instance))
        if lane is None or lane.lineage != slot.lineage:
            return False
        return resolve_floor(slot.number, lane.expected) < lane.kept

    def peer_forgotten(self, source: int, now: int) -> None:
        """Forget a node and its positions."""
        for key in [key for key in self._lanes if key[0] == source]:
            del self._lanes[key]
            self._watched.pop(key, None)
            self._positions.forget(key)
        self._watch_changed()

    def expect(self, source: int, stream_id: int, instance: Instance, slot: SequenceSlot) -> None:
        """Suspend the rhythm of a key until a large sample under way is delivered or over."""
        lane = self._lanes.get((source, stream_id, instance))
        if lane is None or lane.lineage != slot.lineage:
            return
        lane.large_end = max(lane.large_end, resolve_floor(slot.number, lane.expected) + 1)
        if lane.awaits_large:
            lane.watch.forget()
            self._watch_changed()

    def take(
        self,
        stream: Stream,
        key: tuple[int, int, Instance],
        slot: SequenceSlot,
        sample: SampleReceived | None,
        now: int,
    ) -> None:
        """Deliver a large sample and the samples held behind it, unless it is over by now.

        Args:
            stream: The topic.
            key: Source, stream, instance.
            slot: The sample's lineage and number.
            sample: The sample; None: it is unreadable, and its number is passed over.
            now: The instant.
        """
        lane = self._lanes.get(key)
        if lane is None or lane.lineage != slot.lineage:
            return
        number = resolve_floor(slot.number, lane.expected)
        if number != lane.expected:
            return
        lane.settle(number, stream.qos.depth)
        lane.expected = lane.kept = number + 1
        self._positions.write(key, lane, lane.expected)
        if sample is not None:
            again = sample.again or bool(self._doubt.reason)
            self._emit(msgspec.structs.replace(sample, again=again), now)
        self._hand_on_held(key, lane, stream, now)

    def hand_on_left(self, sample: SampleReceived | None, now: int) -> None:
        """Deliver a large sample whose delivery a restart interrupted; None: it is unreadable."""
        if sample is not None:
            self._emit(sample, now)

    def recover_slot(
        self, stream_id: int, source: int, instance: Instance, slot: SequenceSlot
    ) -> None:
        """Note a large sample that, by the journal, was delivered before the restart."""
        key = (source, stream_id, instance)
        lane = self._lanes.get(key)
        if lane is None:
            lane = ReceiveLane(slot.lineage, slot.number, is_settled=False)
            self._lanes[key] = lane
        number = resolve_floor(slot.number, lane.expected)
        if lane.lineage == slot.lineage and lane.expected <= number:
            lane.expected = lane.kept = number + 1

    # Below the methods above

    def _ask(self, now: int) -> None:
        """Ask for overdue samples."""
        for key, lane in list(self._watched.items()):
            ask_at = lane.watch.ask_at
            if ask_at is None or self._lanes[key] is not lane:
                del self._watched[key]
            elif ask_at <= now:
                lane.watch.asks(now, self._pacers.link_times)
                self._owe_ack(key, lane, now, _Turn())
        self._watch_changed()

    def _watch_changed(self) -> None:
        self._timers.changed((Due.RECEIVING,), self._ask_at, self._ask)

    def _ask_at(self) -> int | None:
        instants = (lane.watch.ask_at for lane in self._watched.values())
        return min((at for at in instants if at is not None), default=None)

    def _learn(self, lane: ReceiveLane, number: int, arrival: Arrival) -> bool:
        """Learn the rhythm from a sample; return whether to answer it."""
        times = self._pacers.link_times
        is_rhythmic = not (times.is_delegated or lane.awaits_large)
        if arrival.sync is not None or not is_rhythmic:
            lane.watch.forget()
            return True
        frame_ns = times.airtime_ns(arrival.frame_bytes)
        return not lane.watch.take(
            number,
            at=arrival.sample.received_at - frame_ns,
            frame_ns=frame_ns,
            newest=number > lane.newest,
            marked=arrival.in_rhythm,
            times=times,
        )

    def _count(self, key: LaneKey, lane: ReceiveLane, *, is_new: bool) -> None:
        """Count the ACKs that were sent but followed by the same sample again."""
        source, stream_id, instance = key
        if is_new:
            lane.unheard = 0
        elif self._queue.first((stream_id, ACK_LANE, source, *instance)) is None:
            lane.unheard = min(lane.unheard + 1, _MOST_UNHEARD)

    def _watch(self, key: LaneKey, lane: ReceiveLane, soon_at: int) -> None:
        lane.watch.plan(
            lane.newest, is_whole=not lane.held, soon_at=soon_at, times=self._pacers.link_times
        )
        if lane.watch.ask_at is not None:
            self._watched[key] = lane

    def _hand_on_held(self, key: LaneKey, lane: ReceiveLane, stream: Stream, now: int) -> None:
        before = lane.expected
        ready = lane.hand_on(before)
        if lane.expected > before:
            self._keep(key, lane, ready, stream, now, self._large_turn)

    @property
    def _large_turn(self) -> _Turn:
        return _Turn(self._pacers.link_times.ack_linger_ns)

    def _keep(
        self,
        key: LaneKey,
        lane: ReceiveLane,
        ready: list[SampleReceived],
        stream: Stream,
        now: int,
        turn: _Turn | None,
    ) -> None:
        """Journal the position and deliver the samples; a journalled topic journals first."""
        expected = lane.expected

        def kept(at: int) -> None:
            for sample in ready:
                self._emit(sample, at)
            if stream.spec.journal and ready:
                del lane.pending[: len(ready)]
                if self._lanes.get(key) is lane:
                    self._positions.write(key, lane, lane.expected)
            lane.kept = max(lane.kept, expected)
            if self._lanes.get(key) is lane:
                self._owe_ack(key, lane, at, turn)

        if stream.spec.journal:
            lane.pending += ready
            self._positions.write(key, lane, expected, kept)
        else:
            # Nothing depends on this write; it avoids most repetitions after a restart.
            self._positions.write(key, lane, expected)
            kept(now)

    def _owe_ack(self, key: LaneKey, lane: ReceiveLane, now: int, turn: _Turn | None) -> None:
        """Queue an ACK; without a turn, it waits until the lane asks for the missing sample."""
        sync = None if lane.in_sync else lane.sync
        ask_at = lane.watch.ask_at
        if turn is None and ask_at is not None:
            self._push(key, lane.ack(), sync, owed_at=ask_at, due_at=ask_at)
        else:
            self._owe(key, lane.ack(), sync, now, turn or _Turn())

    def _owe(self, key: LaneKey, ack: Ack, sync: Sync | None, now: int, turn: _Turn) -> None:
        """Queue an ACK for its turn."""
        source, stream_id, instance = key
        before = self._queue.first((stream_id, ACK_LANE, source, *instance))
        owed_at = before.owed_at if isinstance(before, _AckWaiting) else now
        patient_until = owed_at + self._pacers.link_times.ack_patience_ns
        due_at = min(now + turn.linger_ns, patient_until) + turn.offset_ns
        if before is not None and now >= patient_until:
            due_at = min(due_at, before.queued_at)
        self._push(key, ack, sync, owed_at=owed_at, due_at=max(now, due_at))

    def _push(
        self, key: LaneKey, ack: Ack, sync: Sync | None, *, owed_at: int, due_at: int
    ) -> None:
        """Queue an ACK in place of one that waits already."""
        source, stream_id, instance = key
        lane_key = (stream_id, ACK_LANE, source, *instance)
        largest_bytes = self._queue.largest_bytes
        assert largest_bytes is not None
        if LEAST_ACK_BYTES + len(instance) > largest_bytes:
            return  # on such a link all samples are objects, which have their own feedback
        head_bytes = ACK_HEAD_BYTES + len(instance) + (SYNC_BYTES if sync else 0)
        item = _AckWaiting(
            stream_id=stream_id,
            destination=source,
            prefix=bytes((Control.ACK,)),
            address=bytes((source,)),
            head=bytes(instance),
            payload=ack.encode(max(1, largest_bytes - head_bytes)),
            delimits_itself=True,
            cause=Cause.ACK,
            is_reply=True,
            queued_at=due_at,
        )
        item.owed_at = owed_at
        item.sync = sync.encode() if sync else b""
        self._queue.drop_lane(lane_key)
        self._queue.push(lane_key, item, _ACK_QOS)

    def _turn(
        self, stream: Stream, arrival: Arrival, *, is_first: bool = False, unheard: int = 0
    ) -> _Turn:
        """Return how long an ACK waits: for the publisher's last frame, then for its turn.

        Receivers answer in the order of their addresses. If an answer was lost, because distances
        differ or because one receiver had more to send, the same order might lose it again. So a
        repetition is answered at a random instant. All receivers may wait for the same pause of the
        publisher, so the range of that instant doubles each time that nothing new follows, up to
        the topic's deadline.
        """
        times = self._pacers.link_times
        linger_ns = times.ack_linger_ns
        # A publisher continues when its frame is full, and with further copies of urgent samples.
        is_full = arrival.spare_bytes + times.mtu_bytes < 0
        if is_full or stream.qos.priority is Priority.REAL_TIME:
            linger_ns += times.next_frame_ns
        source = arrival.sample.source
        listed = stream.receivers(arrival.sample.instance, self._table.nodes)
        others = [each for each in listed if each != source]
        if not is_first:
            spread_ns = times.ack_spread_ns(len(others))
            if len(others) > 1:
                most_ns = stream.qos.deadline_ns or spread_ns << unheard
                spread_ns = max(spread_ns, min(spread_ns << unheard, most_ns))
            return _Turn(linger_ns, self._rng.randrange(spread_ns + 1))
        is_alone = arrival.is_alone or self._address not in others
        rank = 0 if is_alone else others.index(self._address)
        return _Turn(linger_ns, ack_slots(rank, len(others)) * times.ack_slot_ns)
