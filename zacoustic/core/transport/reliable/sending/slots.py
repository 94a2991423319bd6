"""The sequence slots of samples that cross as objects.

`zacoustic.core.transport.objects` sends a sample that fits no frame; the manifest of its object
carries lineage and number. Here it is a sample like any other, except that it has no record. So
depth, window and floor hold for small and large samples alike, and receivers deliver both in one
order. The object reports when a receiver has it, and how it ends.

A sample that ends before its receivers have it leaves a gap in the count. This module also marks
the receivers that must learn of the gap by SYNC.
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
    OutgoingSample,
    SendLane,
    Stage,
)
from zacoustic.core.transport.reliable.sending.sendlanes import SendLanes
from zacoustic.core.transport.reliable.spans import Span, Spans
from zacoustic.core.wire.frame import SYNC_BYTES, Control
from zacoustic.core.wire.numbers import NUMBER_BYTES

LEAST_ACK_BYTES: Final = 10
"""Size of an ACK with SYNC, address and stream id, without wildcards. Where a frame has no room for
it, all samples go as objects."""


class SequenceSlot(msgspec.Struct, frozen=True):
    """The position of a large sample in the count of its key."""

    lineage: int
    number: int


class Large(Protocol):
    """The sender of large samples."""

    def enlarge(self, sample: OutgoingSample, stream_id: int, slot: SequenceSlot, now: int) -> str:
        """Send as an object a sample that was published as a small one; return why not, or ''."""

    def is_crossing(self, delivery_id: int) -> bool:
        """Return whether some of the sample was transmitted, and a receiver is there."""

    def handed_on(self, delivery_id: int, address: int, now: int) -> None:
        """Note that a receiver has acknowledged the sample."""

    def withdraw(self, delivery_id: int, outcome: DeliveryOutcome, now: int) -> None:
        """Stop sending the sample: it has ended."""


class LargeSlots:
    """The large samples in the lanes of one publisher.

    Args:
        lanes: The lanes.
        keeping: Their counts in the journal.
        end: Ends a sample, emits its event, and marks the receivers that wait for its number.
        lose: Marks a receiver of a lane that needs SYNC.
        go_on: Sends what waited behind a sample.
        begin_anew: Begins another lineage of a lane, for the samples published from now on.
        pause_ns: Returns how long the receivers of a sample get to acknowledge it, ns.
    """

    def __init__(
        self,
        lanes: SendLanes,
        keeping: Keeping,
        *,
        end: Callable[..., None],
        lose: Callable[[SendLane, int], None],
        go_on: Callable[[SendLane, int], None],
        begin_anew: Callable[[SendLane], None],
        pause_ns: Callable[[SendLane, OutgoingSample], int],
    ) -> None:
        self._lanes = lanes
        self._keeping = keeping
        self._end = end
        self._lose = lose
        self._go_on = go_on
        self._begin_anew = begin_anew
        self._pause_ns = pause_ns
        self._large: dict[int, tuple[SendLane, OutgoingSample]] = {}
        self.sender: Large | None = None
        """The sender of large samples."""

    # Publication

    def next_slot(self, stream: Stream, instance: Instance) -> SequenceSlot:
        """Return the slot of a key's next sample."""
        lane = self._lanes.of(stream, instance)
        return SequenceSlot(lane.lineage, lane.next_number)

    def take(self, stream: Stream, instance: Instance, delivery_id: int, now: int) -> None:
        """Give the next slot to a sample that has become an object."""
        lane = self._lanes.of(stream, instance)
        sample = lane.add(stream, _placeholder(delivery_id), queued_at=now, expires_at=None)
        lane.enlarge(sample)
        self._large[delivery_id] = lane, sample
        self._leave_out(lane, sample, lane.subscribers)
        if lane.is_journalled:
            self._keeping.keep_count(stream, lane)
        # Receivers learn from its number what is over, but only once they have all of it.
        while lane.samples[0].number <= sample.number - stream.qos.depth:
            self.give_up(lane, lane.samples[0], DeliveryOutcome.SUPERSEDED, now)
        self._go_on(lane, now)

    def displaces_crossing(self, stream: Stream, instance: Instance) -> bool:
        """Return whether the next sample of a key would displace a large one that just crosses."""
        lane = self._lanes.find(stream, instance)
        if lane is None or not lane.samples or self.sender is None:
            return False
        first = lane.samples[0]
        is_displaced = first.number <= lane.next_number - stream.qos.depth
        is_object = first.stage is Stage.OBJECT
        return is_displaced and is_object and self.sender.is_crossing(first.delivery_id)

    def is_large(self, sample: OutgoingSample, largest_bytes: int | None) -> bool:
        """Return whether a sample fits no frame, given the size of the largest record, bytes."""
        if largest_bytes is None:
            return False
        waiting = sample.waiting
        record_bytes = waiting.size_bytes - len(waiting.sync) + SYNC_BYTES
        least_bytes = LEAST_ACK_BYTES + len(waiting.head) - NUMBER_BYTES
        return max(record_bytes, least_bytes) > largest_bytes

    def enlarge(self, lane: SendLane, sample: OutgoingSample, now: int) -> None:
        """Send as an object a sample that fits no frame, or give it up."""
        fault = "oversized"
        if self.sender is not None and sample.waiting.prefix[:1] != bytes((Control.DELETE,)):
            # A sample from before the restart keeps its lineage: a newer one would end that.
            slot = SequenceSlot(lane.spans.at(sample.number).lineage, sample.number)
            fault = self.sender.enlarge(sample, lane.key[0], slot, now)
        if fault:
            self.give_up(lane, sample, DeliveryOutcome.CANCELLED, now, fault)
            return
        lane.enlarge(sample)
        sample.expires_at = None
        self._large[sample.delivery_id] = lane, sample
        self._leave_out(lane, sample, lane.subscribers)

    # Outcome

    def stored(self, delivery_id: int) -> bool:
        """Note that an object is journalled; return whether its sample was not, until now."""
        found = self._large.get(delivery_id)
        if found is None:
            return False  # it has ended
        lane, sample = found
        if sample.is_again:
            return False
        if not (lane.is_journalled and sample.waiting.payload):
            return True
        self._keeping.forget(lane, sample)
        return False

    def is_turn(self, delivery_id: int, address: int) -> bool:
        """Return whether a receiver has everything before a large sample that it will ever get."""
        lane, sample = self._large[delivery_id]
        return lane.floor_of(address) >= sample.number

    def passed(self, delivery_id: int, address: int, now: int) -> None:
        """Note that a receiver has delivered a large sample, and so everything before it."""
        found = self._large.get(delivery_id)
        if found is None:
            return
        lane, sample = found
        self._has_handed_on(lane, address, sample.number + 1, now)
        reception = lane.receptions.get(address)
        if reception is not None:
            reception.expected = max(reception.expected, sample.number + 1)
        for each in lane.named():
            # The receiver now acknowledges what it held behind this sample, or that ACK is lost.
            if each.number > sample.number and address in each.held:
                each.held.discard(address)
                each.due_at = now + self._pause_ns(lane, each)
        self._go_on(lane, now)

    def refused(self, delivery_id: int, address: int, now: int, *, is_former: bool = False) -> None:
        """Skip a large sample for a receiver that refuses it.

        Args:
            delivery_id: The sample.
            address: The receiver.
            now: The instant.
            is_former: To the receiver its lineage is over.
        """
        found = self._large.get(delivery_id)
        if found is None:
            return
        lane, sample = found
        if address in lane.receptions:
            lane.skip(sample, address)
            self._lose(lane, address)
        if is_former and lane.spans.at(sample.number) is lane.spans.newest:
            self._begin_anew(lane)

    def subscribers_changed(self, lane: SendLane) -> None:
        """Skip the large samples for receivers that do not subscribe.

        An object goes only to those who had subscribed when it was made, so it also skips
        newcomers.
        """
        for sample in lane.samples:
            if sample.stage is Stage.OBJECT:
                self._leave_out(lane, sample, lane.subscribers)

    def acknowledged(self, lane: SendLane, address: int, expected: int, now: int) -> None:
        """Apply an ACK of everything before a number to the large samples among it.

        A receiver that waits for a sample that will not come for it is marked for SYNC.
        """
        self._has_handed_on(lane, address, expected, now)
        holds = any(address in each.held for each in lane.named())
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
        """End the sample of an object that has ended, unless the sample has ended before."""
        found = self._large.pop(delivery_id, None)
        if found is not None:
            lane, sample = found
            self.give_up(lane, sample, outcome, now, detail, missing)
            self._go_on(lane, now)

    def left(self, sample: OutgoingSample, outcome: DeliveryOutcome, now: int) -> None:
        """Withdraw the object of a large sample that has left its lane."""
        if self._large.pop(sample.delivery_id, None) is not None and self.sender is not None:
            self.sender.withdraw(sample.delivery_id, outcome, now)

    def cancel(self, delivery_id: int, now: int) -> bool:
        """Cancel a small sample; return False when it is not under way."""
        sample = self._lanes.under_way.get(delivery_id)
        if sample is None or sample.stage is Stage.OBJECT:
            return False
        lane = sample.waiting.lane
        self.give_up(lane, sample, DeliveryOutcome.CANCELLED, now)
        self._go_on(lane, now)
        return True

    def give_up(
        self,
        lane: SendLane,
        sample: OutgoingSample,
        outcome: DeliveryOutcome,
        now: int,
        detail: str = "",
        missing: tuple[int, ...] | None = None,
    ) -> None:
        """End a sample; receivers that wait for it learn so by the SYNC of a later one."""
        waiting = lane.missing(sample) if missing is None else list(missing)
        self._end(lane, sample, outcome, now, detail, missing=tuple(waiting), waiting=waiting)

    # The journal

    def restore(
        self,
        stream: Stream,
        instance: Instance,
        slot: SequenceSlot,
        delivery_id: int,
        receivers: tuple[int, ...],
    ) -> bool:
        """Give a large sample from before the restart its slot again; False: its count is over."""
        lane = self._lanes.find(stream, instance)
        if lane is None:
            spans = Spans([Span(slot.number, slot.lineage)])
            lane = self._lanes.begin(stream, instance, spans, slot.number)
            lane.is_former = True
        if not lane.spans.knows(slot.lineage):
            return False
        sample = lane.insert(stream, _placeholder(delivery_id), slot.number)
        lane.born = max(lane.born, slot.number + 1)
        lane.enlarge(sample)
        self._large[delivery_id] = lane, sample
        self._leave_out(lane, sample, frozenset(receivers))
        self._leave_out(lane, sample, lane.subscribers)
        return True

    # Below the methods above

    def _leave_out(
        self, lane: SendLane, sample: OutgoingSample, subscribers: Set[int] | None
    ) -> None:
        """Skip a large sample for all receivers but `subscribers`; None: it is for all."""
        if subscribers is not None:
            for address in lane.receptions.keys() - subscribers:
                lane.skip(sample, address)

    def _has_handed_on(self, lane: SendLane, address: int, end: int, now: int) -> None:
        """Mark each sample before a number as acknowledged, and tell its object, if it has one."""
        lane.name(end)
        for each in [each for each in lane.named() if each.number < end]:
            if address not in each.acknowledged:
                each.acknowledged.add(address)
                if each.stage is Stage.OBJECT and self.sender is not None:
                    self.sender.handed_on(each.delivery_id, address, now)


def _placeholder(delivery_id: int) -> JournalledSample:
    return JournalledSample(delivery_id, b"", b"", stamped=False)
