"""Samples that cross as objects have their place in the count of their key.

A sample that fits no frame is sent by `zacoustic.core.transport.objects`, and its manifest has
lineage and number. Here it is a sample like any other, but for its record: there is none. So depth,
window and floor hold for small and large samples alike, and receivers hand them on in one order.
Its object tells when a receiver has it, and how it ends.

What ends before its receivers have it leaves a gap in the count, which they have to be told of by
SYNC; that is here as well.
"""

from collections.abc import Callable, Set
from typing import Final, Protocol

import msgspec

from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import DeliveryOutcome
from zacoustic.core.transport.reliable.sending.keeping import Keeping
from zacoustic.core.transport.reliable.sending.sendlane import (
    JournalledSample,
    Outgoing,
    SendLane,
    Stage,
)
from zacoustic.core.transport.reliable.sending.sendlanes import SendLanes
from zacoustic.core.transport.reliable.spans import Span, Spans
from zacoustic.core.wire.frame import SYNC_BYTES, Control
from zacoustic.core.wire.numbers import NUMBER_BYTES

LEAST_ACK_BYTES: Final = 10
"""ACK with SYNC, address and stream id, wildcards excepted: where a frame has no room for it, all
samples go as objects."""


class SequenceSlot(msgspec.Struct, frozen=True):
    """Where a large sample stands in the count of its key."""

    lineage: int
    number: int


class Large(Protocol):
    """Who sends large samples."""

    def enlarge(self, sample: Outgoing, stream_id: int, slot: SequenceSlot, now: int) -> str:
        """Send a sample that was published as a small one; returns why not, or nothing."""

    def handed_on(self, delivery_id: int, address: int, now: int) -> None:
        """A receiver has acknowledged the sample."""

    def withdraw(self, delivery_id: int, outcome: DeliveryOutcome, now: int) -> None:
        """The sample is over."""


class LargeSlots:
    """The large samples in the lanes of one publisher.

    Args:
        lanes: The lanes.
        keeping: Their counts in the journal.
        end: Ends a sample, tells of it, and returns whether receivers wait for its number.
        lose: A receiver of a lane has to be told by SYNC where the count stands.
        go_on: What was behind a sample may go.
        pause_ns: How long the receivers of a sample are given to acknowledge it, ns.
    """

    def __init__(
        self,
        lanes: SendLanes,
        keeping: Keeping,
        *,
        end: Callable[..., bool],
        lose: Callable[[SendLane, int], None],
        go_on: Callable[[SendLane, int], None],
        pause_ns: Callable[[SendLane, Outgoing], int],
    ) -> None:
        self._lanes = lanes
        self._keeping = keeping
        self._end = end
        self._lose = lose
        self._go_on = go_on
        self._pause_ns = pause_ns
        self._large: dict[int, tuple[SendLane, Outgoing]] = {}
        self.sender: Large | None = None
        """Who sends large samples."""

    # What is published

    def next_slot(self, stream: Stream, instance: Instance) -> SequenceSlot:
        """Return where the next sample of a key will stand."""
        lane = self._lanes.of(stream, instance)
        return SequenceSlot(lane.lineage, lane.next_number)

    def take(self, stream: Stream, instance: Instance, delivery_id: int, now: int) -> None:
        """Give the next place to a sample that has become an object."""
        lane = self._lanes.of(stream, instance)
        sample = lane.add(stream, _placeholder(delivery_id), queued_at=now, expires_at=None)
        sample.stage = Stage.OBJECT
        self._large[delivery_id] = lane, sample
        self._leave_out(lane, sample, lane.subscribers)
        if lane.is_journalled:
            self._keeping.keep_count(stream, lane)
        # Receivers learn by its number what is over, but not before they have all of it.
        while lane.samples[0].number <= sample.number - stream.qos.depth:
            self.give_up(lane, lane.samples[0], DeliveryOutcome.SUPERSEDED, now)
        self._go_on(lane, now)

    def is_large(self, sample: Outgoing, largest_bytes: int | None) -> bool:
        """Tell whether a sample fits no frame in which the largest record has so many bytes."""
        if largest_bytes is None:
            return False
        waiting = sample.waiting
        record_bytes = waiting.size_bytes - len(waiting.sync) + SYNC_BYTES
        least_bytes = LEAST_ACK_BYTES + len(waiting.head) - NUMBER_BYTES
        return max(record_bytes, least_bytes) > largest_bytes

    def enlarge(self, lane: SendLane, sample: Outgoing, now: int) -> None:
        """A sample turns out to fit no frame: it goes as an object, or is given up."""
        fault = "oversized"
        if self.sender is not None and sample.waiting.prefix[:1] != bytes((Control.DELETE,)):
            slot = SequenceSlot(lane.lineage, sample.number)
            fault = self.sender.enlarge(sample, lane.key[0], slot, now)
        if fault:
            self.give_up(lane, sample, DeliveryOutcome.CANCELLED, now, fault)
            return
        sample.stage = Stage.OBJECT
        sample.expires_at = None
        self._large[sample.delivery_id] = lane, sample
        self._leave_out(lane, sample, lane.subscribers)

    # What becomes of it

    def stored(self, delivery_id: int) -> bool:
        """Note that the object is in the journal; returns whether its sample was not before."""
        found = self._large.get(delivery_id)
        if found is None:
            return False  # it is over
        lane, sample = found
        if not (lane.is_journalled and sample.waiting.payload):
            return True
        self._keeping.forget(lane, sample)
        return False

    def is_turn(self, delivery_id: int, address: int) -> bool:
        """Tell whether nothing before a large sample will come for a receiver."""
        lane, sample = self._large[delivery_id]
        return all(
            address in each.acknowledged for each in lane.samples if each.number < sample.number
        )

    def passed(self, delivery_id: int, address: int, now: int) -> None:
        """A receiver has handed a large sample on, and so all before it."""
        found = self._large.get(delivery_id)
        if found is None:
            return
        lane, sample = found
        self._has_handed_on(lane, address, sample.number + 1, now)
        reception = lane.receptions.get(address)
        if reception is not None:
            reception.expected = max(reception.expected, sample.number + 1)
        for each in lane.samples:
            # What it held behind, it acknowledges now; or that is lost.
            if each.number > sample.number and address in each.held:
                each.held.discard(address)
                each.due_at = now + self._pause_ns(lane, each)
        self._go_on(lane, now)

    def refused(self, delivery_id: int, address: int, now: int) -> None:
        """A receiver does not want a large sample: it waits for it no longer."""
        found = self._large.get(delivery_id)
        if found is not None:
            lane, sample = found
            if address in lane.receptions:
                lane.skip(sample, address)
                self._lose(lane, address)

    def subscribers_changed(self, lane: SendLane) -> None:
        """Others subscribe than before: who leaves, waits for no large sample any more.

        Nor does who comes: an object is for those who had subscribed when it was made.
        """
        for sample in lane.samples:
            if sample.stage is Stage.OBJECT:
                self._leave_out(lane, sample, lane.subscribers)

    def acknowledged(self, lane: SendLane, address: int, expected: int, now: int) -> None:
        """A receiver has acknowledged all before a number: large samples are among it.

        Where it waits for something that will not come for it, it has to be told so.
        """
        self._has_handed_on(lane, address, expected, now)
        holds = any(address in each.held for each in lane.samples)
        if holds and lane.floor_of(address) > expected:
            self._lose(lane, address)

    def ended(
        self,
        delivery_id: int,
        outcome: DeliveryOutcome,
        now: int,
        detail: str,
        missing: tuple[int, ...],
    ) -> None:
        """The object has ended; nothing happens if it has left its place before."""
        found = self._large.pop(delivery_id, None)
        if found is not None:
            lane, sample = found
            self.give_up(lane, sample, outcome, now, detail, missing)
            self._go_on(lane, now)

    def left(self, sample: Outgoing, outcome: DeliveryOutcome, now: int) -> None:
        """A large sample has left its lane: it was superseded, or its object has ended."""
        if self._large.pop(sample.delivery_id, None) is not None and self.sender is not None:
            self.sender.withdraw(sample.delivery_id, outcome, now)

    def cancel(self, delivery_id: int, now: int) -> bool:
        """Give up a small sample; False when it is not on its way."""
        for lane in self._lanes:
            for sample in lane.samples:
                if sample.delivery_id == delivery_id and sample.stage is not Stage.OBJECT:
                    self.give_up(lane, sample, DeliveryOutcome.CANCELLED, now)
                    self._go_on(lane, now)
                    return True
        return False

    def give_up(
        self,
        lane: SendLane,
        sample: Outgoing,
        outcome: DeliveryOutcome,
        now: int,
        detail: str = "",
        missing: tuple[int, ...] | None = None,
    ) -> None:
        """End a sample: whoever waits for it has to be told, by the SYNC of a later one."""
        waiting = lane.missing(sample) if missing is None else list(missing)
        leaves_gap = self._end(lane, sample, outcome, now, detail, missing=tuple(waiting))
        if leaves_gap:
            for address in waiting:
                self._lose(lane, address)

    # The journal

    def restore(
        self,
        stream: Stream,
        instance: Instance,
        slot: SequenceSlot,
        delivery_id: int,
        receivers: tuple[int, ...],
    ) -> bool:
        """Give its place to a large sample of a former life; False: its count is over."""
        lane = self._lanes.find(stream, instance)
        if lane is None:
            spans = Spans([Span(slot.number, slot.lineage)])
            lane = self._lanes.begin(stream, instance, spans, slot.number)
            lane.is_former = True
        if not lane.spans.knows(slot.lineage):
            return False
        sample = lane.insert(stream, _placeholder(delivery_id), slot.number)
        lane.born = max(lane.born, slot.number + 1)
        sample.stage = Stage.OBJECT
        self._large[delivery_id] = lane, sample
        self._leave_out(lane, sample, frozenset(receivers))
        self._leave_out(lane, sample, lane.subscribers)
        return True

    # Below the methods above

    def _leave_out(self, lane: SendLane, sample: Outgoing, subscribers: Set[int] | None) -> None:
        """Let all receivers but those be without a large sample; None: it is for all."""
        if subscribers is not None:
            for address in lane.receptions.keys() - subscribers:
                lane.skip(sample, address)

    def _has_handed_on(self, lane: SendLane, address: int, end: int, now: int) -> None:
        """A receiver has handed on all before a number: the objects among it are complete."""
        for each in list(lane.samples):
            if each.number < end and address not in each.acknowledged:
                each.acknowledged.add(address)
                if each.stage is Stage.OBJECT and self.sender is not None:
                    self.sender.handed_on(each.delivery_id, address, now)


def _placeholder(delivery_id: int) -> JournalledSample:
    return JournalledSample(delivery_id, b"", b"", stamped=False)
