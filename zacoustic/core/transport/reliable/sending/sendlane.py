"""The samples of one key that some receiver has not acknowledged."""

import enum
from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Iterator, Set
from heapq import heappop, heappush
from itertools import chain, count, islice, takewhile
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.moments import Made, Moment
from zacoustic.core.base.sizes import SIZES, SampleNumbering
from zacoustic.core.schedule.queue import LaneKey, QueuedRecord
from zacoustic.core.schedule.timing import FEW_RECEIVERS, LinkTimes
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import DeliveryEnded, DeliveryOutcome
from zacoustic.core.transport.reliable.rhythm import SendRhythm
from zacoustic.core.transport.reliable.sending.receiverstate import ReceiverState
from zacoustic.core.transport.reliable.spans import Spans
from zacoustic.core.wire.frame import Control, Sync
from zacoustic.core.wire.numbers import IN_RHYTHM, NUMBERS, Ack, resolve_floor

AT_ONCE: Final = 0
"""A `due_at` that has always passed."""
_DELETE: Final = bytes((Control.DELETE,))
_OVERHEAD_BYTES: Final = 64
_DOUBTED_TRIES: Final = 8
"""After this many tries a sample carries SYNC: its receiver may count in another lineage."""


_AIMED_SHARE: Final = 3
"""If this fraction of the receivers, 1/3, or fewer lack a sample, each gets its own copy: that
takes less airtime than acknowledgements from all."""


class Stage(enum.Enum):
    """The state of a sample."""

    STORING = "storing"
    """The journal has not committed it."""
    BEHIND = "behind"
    """Its number is too far ahead of the oldest one."""
    QUEUED = "queued"
    """It is in the transmit queue."""
    ON_AIR = "on_air"
    """It is in a transmission that has not ended."""
    SENT = "sent"
    """It is sent; an ACK is awaited until `due_at`."""
    OBJECT = "object"
    """It has a slot here and crosses as an object (`zacoustic.core.transport.objects`)."""
    SPARE = "spare"
    """It is sent again if its receiver shows that it lacks it."""
    ENDED = "ended"
    """Its end has been reported to the publisher."""


class JournalledSample(msgspec.Struct, frozen=True, array_like=True):
    """What makes the record of a sample, before and after a restart."""

    delivery_id: int
    prefix: bytes
    payload: bytes
    stamped: bool
    made: Moment | None = None
    """When it was made, if it is stamped and that is known."""

    @property
    def size_bytes(self) -> int:
        """What it takes of a bounded space, bytes."""
        return len(self.payload) + _OVERHEAD_BYTES


class OutgoingSample:
    """A sample under way.

    Args:
        number: Its number in the lane.
        delivery_id: What `Engine.publish` returned.
        waiting: Its record.
        expires_at: Instant after which it is worthless, ns, or None.
    """

    __slots__ = (
        "acknowledged", "aimed_at", "asked", "delivery_id", "due_at", "expires_at", "first_order",
        "follows", "held", "holes", "in_hole", "is_again", "is_clear", "made_of", "marked",
        "number", "order", "sent_at", "stage", "tries", "unknown", "waiting",
    )  # fmt: skip

    def __init__(
        self, number: int, delivery_id: int, waiting: "SampleWaiting", expires_at: int | None = None
    ) -> None:
        self.number = number
        self.delivery_id = delivery_id
        self.waiting = waiting
        self.expires_at = expires_at
        self.stage = Stage.STORING
        self.acknowledged: set[int] = set()
        """Receivers that have it and everything before it."""
        self.unknown: set[int] = set()
        """Receivers of which it is no longer known whether they have delivered it."""
        self.held: set[int] = set()
        """Receivers that hold it until they have everything before it."""
        self.follows = False
        """It was just sent, and is sent again without waiting for an answer."""
        self.in_hole = False
        """It goes twice, between two trains of other nodes."""
        self.holes = 0
        """Into how many such holes it has gone."""
        self.asked = False
        """Its receiver has reported that it lacks it, after it should have come."""
        self.is_clear = True
        """Whether an answer can only answer its last transmission: there was no other one, or it
        is too long ago."""
        self.marked = False
        """It was sent marked as in rhythm."""
        self.aimed_at: int | None = None
        """The one receiver, of several that lack it, to which it was last repeated; None: all of
        them."""
        self.made_of: JournalledSample | None = None
        """What its record is made of; None: its payload is not here."""
        self.is_again = False
        """It was delivered, and goes again to a receiver that may have forgotten it."""
        self.tries = 0
        self.order = 0
        """The position of its last transmission among all transmissions of the node."""
        self.first_order = 0
        """The same for its first transmission."""
        self.sent_at = 0
        """End of its last transmission, ns."""
        self.due_at = 0

    @property
    def is_delete(self) -> bool:
        """Whether it deletes its key."""
        return self.waiting.prefix[:1] == _DELETE


class SampleWaiting(QueuedRecord):
    """A reliable sample in the transmit queue."""

    __slots__ = ("lane", "sample")
    lane: "SendLane"
    sample: OutgoingSample

    def head_at(self, now: int) -> bytes:
        """Return wildcards and number, marked if the sample is in rhythm now."""
        mark = IN_RHYTHM if self.lane.is_marked(self.sample, now) else 0
        return self.head[:-1] + bytes((self.head[-1] | mark,))


class SendLane:
    """Samples of one key in the order of their numbers.

    Thousands may wait, and few of them are under way: whatever is done for each frame looks at
    those alone (`active`, `named`).

    Args:
        key: Key of its lane in the transmit queue: stream id first, then wildcards.
        receivers: Addresses that should get each sample.
        spans: The lineages of its numbers.
        next_number: The number of the next sample.
        is_journalled: Its samples and its count are journalled.
        subscribers: The receivers that want samples, as they change; None: all receivers.
        rhythm: Learns the rhythm of the samples; None: each sample is acknowledged.
        numbering: How samples are numbered.
        may_aim: Whether a sample that few of many receivers lack is repeated to each of them alone.
        under_way: Gets its samples by their delivery ids, until they end.
    """

    def __init__(
        self,
        key: LaneKey,
        receivers: tuple[int, ...],
        spans: Spans,
        next_number: int = 0,
        *,
        is_journalled: bool = False,
        subscribers: Set[int] | None = None,
        rhythm: SendRhythm | None = None,
        may_aim: bool = False,
        numbering: SampleNumbering = SIZES.samples,
        under_way: dict[int, OutgoingSample] | None = None,
    ) -> None:
        self._numbering = numbering
        self._under_way = {} if under_way is None else under_way
        self.key = key
        self._may_aim = may_aim
        self.is_journalled = is_journalled
        self.subscribers = subscribers
        self.rhythm = rhythm
        self.spans = spans
        self.born = 0
        """Samples with smaller numbers were published before the restart."""
        self.leaving: list[OutgoingSample] = []
        """Samples that are given up but not yet deleted in the journal, by number. Receivers must
        not pass over them: a later boot epoch that finds one would take that for its delivery."""
        self.is_former = False
        """Whether nothing is published since the restart; the first sample begins a new lineage."""
        self.next_number = next_number
        self.anew_at: int | None = None
        """The number at which the count was last begun anew; None: never."""
        self.samples: deque[OutgoingSample] = deque()
        self._large: dict[int, OutgoingSample] = {}
        """Those of them that cross as objects, by delivery id."""
        self._expiring: list[tuple[int, int, OutgoingSample]] = []
        """A heap of instants, places in it and samples; also of those that have ended since. One
        that is given again has the delivery id and the instant of the one that ended."""
        self._expiring_place = count()
        self.oldest_kept: int | None = None
        """The oldest delivered number that may go to a receiver again; None: none."""
        self._end = next_number
        self._named_end = next_number
        """No acknowledgement or refusal has named this number or a later one."""
        self._marks: deque[tuple[int, int]] = deque()
        """Instants at which numbers came into use lately, with the first of those numbers."""
        self.receptions = {address: ReceiverState(next_number) for address in receivers}

    @property
    def lineage(self) -> int:
        """The boot epoch in which the newest samples were published."""
        return self.spans.newest.lineage

    def begin_life(self, lineage: int) -> None:
        """Begin a new lineage with the first sample since the restart; numbers continue."""
        self.is_former, self.born = False, self.next_number
        self.spans.begin(self.next_number, lineage)
        self.spans.forget_before(self.floor)

    def told(self, address: int, sync: Sync) -> int:
        """Return the number that a receiver awaits by its SYNC; above `next_number`: impossible."""
        first = self.spans.heard_of(address, self._next_for(address), sync.lineage)
        expected = resolve_floor(sync.floor, self.receptions[address].expected)
        is_possible = first is not None and expected <= self.spans.end_of(first, self.next_number)
        if not is_possible:
            return self.next_number + 1
        self.receptions[address].lineage = sync.lineage
        return expected

    def contradicts(self, address: int, sync: Sync) -> bool:
        """Return whether a receiver's SYNC that `told` rejects is a contradiction."""
        return self._is_present(address, sync) or not self.spans.knows(sync.lineage)

    def is_certain(self, address: int, sync: Sync | None) -> bool:
        """Return whether an ACK, with or without SYNC, is no late one of another count."""
        if sync is not None and self._is_present(address, sync):
            return True
        is_unknown = sync is None or not self.spans.knows(sync.lineage)
        return is_unknown and self.receptions[address].in_sync

    def claims_too_much(self, expected: int, ack: Ack) -> bool:
        """Return whether an ACK names a sample that was never published.

        Args:
            expected: The number that the receiver awaits.
            ack: The ACK.
        """
        return expected + (ack.held.bit_length() + 1 if ack.held else 0) > self.next_number

    def lacks(self, address: int) -> bool:
        """Return whether a receiver has not acknowledged some sample."""
        return any(address not in each.acknowledged for each in self.samples)

    @property
    def floor(self) -> int:
        """The oldest number that may still come."""
        first = self.samples[0].number if self.samples else self.next_number
        return min(first, self.leaving[0].number) if self.leaving else first

    def floor_of(self, address: int) -> int:
        """Return the oldest number that may still come for one receiver."""
        lacking = (each.number for each in self.samples if address not in each.acknowledged)
        first = next(lacking, self.next_number)
        if not self.leaving:
            return first
        leaving = (each.number for each in self.leaving if address not in each.acknowledged)
        return min(first, next(leaving, first))

    def add(
        self,
        stream: Stream,
        kept: JournalledSample,
        *,
        queued_at: int,
        expires_at: int | None,
        made_at: Made = None,
    ) -> OutgoingSample:
        """Add a sample with the next number."""
        number = self.next_number
        self.next_number += 1
        waiting = SampleWaiting(
            stream_id=stream.stream_id,
            destination=BROADCAST,
            prefix=kept.prefix,
            head=bytes(self.key[2:]) + self.number_byte(number),
            payload=kept.payload,
            stamped=kept.stamped,
            delimits_itself=stream.codec.delimits_itself or kept.prefix[:1] == _DELETE,
            queued_at=queued_at,
            made_at=made_at,
        )
        sample = OutgoingSample(number, kept.delivery_id, waiting)
        sample.made_of = kept
        waiting.lane, waiting.sample = self, sample
        self.samples.append(sample)
        self._under_way[sample.delivery_id] = sample
        if expires_at is not None:
            self.expire(sample, expires_at)
        return sample

    def give_again(
        self, stream: Stream, delivered: Iterable[OutgoingSample], first: int, address: int
    ) -> OutgoingSample | None:
        """Send to one receiver again what it has acknowledged from a number on.

        Args:
            stream: The topic.
            delivered: Samples that have ended, with their numbers.
            first: The number.
            address: The receiver.

        Returns:
            The newest sample that it may lack; the others that have ended are spare. None: none.
        """
        reception = self.receptions.get(address)
        if reception is None or (self.subscribers is not None and address not in self.subscribers):
            return None
        there = {each.number for each in self.samples}
        end, others = self.next_number, self.receptions.keys() - {address}
        for each in delivered:
            if each.number in there or each.made_of is None:
                continue
            self.next_number = each.number
            queued_at = each.waiting.queued_at
            again = self.add(stream, each.made_of, queued_at=queued_at, expires_at=each.expires_at)
            again.is_again, again.stage = True, Stage.SPARE
            again.acknowledged |= others
        self.next_number = end
        self.samples = deque(sorted(self.samples, key=lambda each: each.number))
        given = [
            each for each in self.samples if each.number >= first and each.stage is not Stage.OBJECT
        ]
        if not given:
            return None
        self.regress(address, min(reception.expected, given[0].number))
        if given[-1].stage is Stage.SPARE:
            given[-1].stage = Stage.BEHIND
        return given[-1]

    def release(self, address: int | None = None) -> None:
        """Send the spare samples that a receiver lacks; None: that any receiver may lack."""
        for sample in self.samples:
            lacks = address is None or address not in sample.acknowledged
            if sample.stage is Stage.SPARE and lacks:
                sample.stage = Stage.BEHIND

    def insert(self, stream: Stream, kept: JournalledSample, number: int) -> OutgoingSample:
        """Insert a sample from before the restart at its number, in place of the one there."""
        end, self.next_number = self.next_number, number
        sample = self.add(stream, kept, queued_at=0, expires_at=None)
        self.next_number = max(self.next_number, end)
        self.samples.pop()
        index = bisect_left(self.samples, number, key=lambda each: each.number)
        if index < len(self.samples) and self.samples[index].number == number:
            self._left(self.samples[index])
            del self.samples[index]
        self.samples.insert(index, sample)
        for reception in self.receptions.values():
            reception.expected = min(reception.expected, number)
        return sample

    def active(self) -> Iterator[OutgoingSample]:
        """Yield the samples whose numbers are in use."""
        for sample in self.samples:
            if sample.number >= self._end:
                return
            yield sample

    def named(self) -> Iterator[OutgoingSample]:
        """Yield the samples that may have been sent, or that a receiver has named."""
        end = max(self._end, self._named_end)
        return takewhile(lambda each: each.number < end, self.samples)

    def name(self, end: int) -> None:
        """Note that a receiver has named samples before this number."""
        self._named_end = max(self._named_end, end)

    def enlarge(self, sample: OutgoingSample) -> None:
        """Note that a sample crosses as an object."""
        sample.stage, sample.made_of = Stage.OBJECT, None
        self._large[sample.delivery_id] = sample

    def expire(self, sample: OutgoingSample, at: int) -> None:
        """Set the instant after which a sample is worthless, ns."""
        if sample.expires_at == at:
            return
        sample.expires_at = at
        heappush(self._expiring, (at, next(self._expiring_place), sample))

    @property
    def expires_at(self) -> int | None:
        """The earliest instant at which a sample expires, ns; None: none does."""
        while self._expiring:
            at, _, sample = self._expiring[0]
            if sample.stage is not Stage.ENDED and sample.expires_at == at:
                return at
            heappop(self._expiring)
        return None

    def expired(self, now: int) -> list[OutgoingSample]:
        """Return the samples that have expired, by number, for their end; each only once."""
        samples: list[OutgoingSample] = []
        while (at := self.expires_at) is not None and at <= now:
            samples.append(heappop(self._expiring)[2])
        return sorted(samples, key=lambda each: each.number)

    def open(self, now: int, settling_ns: int) -> int | None:
        """Take numbers into use; return when to try again because of the pace, ns, or None."""
        while self._marks and self._marks[0][0] + settling_ns <= now:
            self._marks.popleft()
        wanted = min(self.floor + self._numbering.window, self.next_number)
        begin = self._marks[0][1] if self._marks else self._end
        end = min(wanted, begin + self._numbering.pace)
        if end > self._end:
            self._marks.append((now, self._end))
            self._end = end
        return self._marks[0][0] + settling_ns if end < wanted else None

    def remove(self, sample: OutgoingSample) -> bool:
        """Remove a sample; return whether receivers wait for its number.

        If neither it nor any sample behind it was ever sent, those behind move up by one number,
        unless the numbers are journalled.
        """
        was_sent = any(
            each.tries or each.is_again or each.stage is Stage.ON_AIR
            for each in chain((sample,), self.active())
            if each.number >= sample.number
        )
        was_sent |= any(each.number >= sample.number for each in self._large.values())
        index = 0 if sample is self.samples[0] else self.samples.index(sample)
        del self.samples[index]
        self._left(sample)
        if self.is_journalled or was_sent:
            return True
        for other in islice(self.samples, index, None):
            other.number -= 1
            other.waiting.head = other.waiting.head[:-1] + self.number_byte(other.number)
        self.next_number -= 1
        self._end = min(self._end, self.next_number)
        return False

    def awaits(self, sample: OutgoingSample) -> bool:
        """Return whether a sample is sent and still lacks an answer."""
        return sample.stage is Stage.SENT and bool(self.lacking(sample))

    def lacking(self, sample: OutgoingSample) -> list[int]:
        """Return the receivers that may have the sample now and are not known to have it."""
        first = self.spans.first_of(sample.number)
        return [
            address
            for address in self.missing(sample)
            if address not in sample.held and not self._waits(address, first)
        ]

    def addressed(self, sample: OutgoingSample) -> list[int]:
        """Return those of `lacking` that its last transmission was addressed to."""
        lacking = self.lacking(sample)
        if sample.aimed_at is None:
            return lacking
        return [address for address in lacking if address == sample.aimed_at]

    def ended(
        self,
        sample: OutgoingSample,
        outcome: DeliveryOutcome,
        now: int,
        detail: str,
        missing: tuple[int, ...] | None,
    ) -> DeliveryEnded:
        """Return the event that reports the end of a sample."""
        return DeliveryEnded(
            delivery_id=sample.delivery_id,
            stream_id=self.key[0],
            outcome=outcome,
            missing=tuple(self.missing(sample)) if missing is None else missing,
            ended_at=now,
            detail=detail,
        )

    def leave(self, sample: OutgoingSample) -> None:
        """Note a given up sample until its end is journalled."""
        self.leaving = sorted([*self.leaving, sample], key=lambda each: each.number)

    def _waits(self, address: int, first: int) -> bool:
        """Return whether a receiver lacks something of a lineage before this number's."""
        return bool(first) and self.floor_of(address) < first

    def _some_wait(self, sample: OutgoingSample) -> bool:
        first = self.spans.first_of(sample.number)
        return any(self._waits(address, first) for address in self.missing(sample))

    def is_blocked(self, sample: OutgoingSample) -> bool:
        """Return whether all receivers of a sample lack something of an earlier lineage."""
        return bool(self.missing(sample)) and not self.lacking(sample)

    def missing(self, sample: OutgoingSample) -> list[int]:
        """Return the receivers that have not acknowledged a sample and everything before it."""
        return [
            address
            for address in self.receptions
            if address not in sample.acknowledged
            and (self.subscribers is None or address in self.subscribers)
        ]

    def is_marked(self, sample: OutgoingSample, now: int) -> bool:
        """Return whether a sample that is sent now is marked as in rhythm."""
        if self.rhythm is None or sample.waiting.sync or self._has_large:
            return False
        (reception,) = self.receptions.values()
        if sample.tries:
            return sample.asked and self.rhythm_is_known(sample)
        return self.rhythm.marks(sample.number, reception.expected, now)

    def rhythm_is_known(self, sample: OutgoingSample) -> bool:
        """Return whether the receiver would ask for a sample, the newest that was sent."""
        if self.rhythm is None or self._has_large:
            return False
        (reception,) = self.receptions.values()
        return reception.in_sync and self.rhythm.is_known(sample.number, reception.expected)

    def begins(self, sample: OutgoingSample, now: int, times: LinkTimes) -> None:
        """Record that a transmission of a sample begins."""
        sample.marked = self.is_marked(sample, now)
        if self.rhythm is not None:
            (reception,) = self.receptions.values()
            if not (sample.tries or sample.is_again):
                self.rhythm.first_sent(sample.number, reception.expected, now, times)
            is_off_beat = (bool(sample.tries) or sample.is_again) and not sample.marked
            if sample.waiting.sync or is_off_beat or self._has_large:
                self.rhythm.end()
        sample.first_order = sample.first_order or sample.order
        is_long_ago = now - sample.sent_at >= times.longest_round_trip_ns
        sample.is_clear = not sample.tries or is_long_ago
        sample.tries += 1
        sample.asked = False

    def due_soon(self, address: int, before: int | None = None) -> None:
        """Make due the sent samples that a receiver lacks.

        Args:
            address: The receiver.
            before: Only samples sent before the transmission of this order; None: all.
        """
        for sample in self.active():
            is_earlier = before is None or sample.order < before
            if sample.stage is Stage.SENT and is_earlier and address in self.lacking(sample):
                sample.due_at = AT_ONCE

    def address(self, sample: OutgoingSample, lacking: list[int]) -> None:
        """Address the record of a sample to receivers, with SYNC if one of them needs it."""
        waiting = sample.waiting
        skip = (each for each in lacking if self.receptions[each].skips_to > self._told(each))
        alone = next(skip, None)
        is_private = bool(self.spans.own) or self._some_wait(sample)
        if alone is None and is_private:
            alone = lacking[0]  # other receivers must not hear this lineage yet, or at all
        sample.aimed_at = None
        if alone is None and self._aims(sample, lacking):
            alone = sample.aimed_at = lacking[sample.tries % len(lacking)]
        lacking = lacking if alone is None else [alone]
        waiting.destination = lacking[0] if len(lacking) == 1 else BROADCAST
        waiting.sync, waiting.for_one_node = b"", is_private or sample.aimed_at is not None
        span = self.spans.of(lacking[0], sample.number)
        for address in lacking:
            reception = self.receptions[address]
            if reception.lineage not in (None, span.lineage):
                self.lose_sync(address)
                reception.expected = max(reception.expected, span.first)
            reception.lineage = span.lineage
            ahead = sample.number - reception.expected
            if ahead >= self._numbering.window or sample.tries >= _DOUBTED_TRIES:
                reception.in_sync = False
        if all(self.receptions[address].in_sync for address in lacking):
            return
        floor = self.floor
        if len(lacking) == 1:
            # It need not wait for what others lack, but they must not read this floor.
            floor = max(floor, self._told(lacking[0]), self.floor_of(lacking[0]))
            waiting.for_one_node = True
        if self.oldest_kept is not None and any(
            self.receptions[address].has_forgotten for address in lacking
        ):
            floor = min(floor, self.oldest_kept)  # whoever lacks that says so
        waiting.sync = Sync(span.lineage, max(floor, span.first)).encode()

    def answered(self, address: int) -> None:
        """Make due, for the next receiver, what was repeated to this one alone."""
        for sample in self.active():
            if sample.aimed_at == address and self.awaits(sample) and not self.addressed(sample):
                sample.due_at = AT_ONCE

    def address_anew(self) -> list[OutgoingSample]:
        """Readdress the queued samples to those who lack them; return those nobody lacks."""
        queued = [sample for sample in self.active() if sample.stage is Stage.QUEUED]
        for sample in queued:
            if lacking := self.lacking(sample):
                self.address(sample, lacking)
        return [sample for sample in queued if not self.lacking(sample)]

    def put_off(self, due_at: int) -> int:
        """Postpone the sent samples that nobody asked for until `due_at`; return that."""
        for sample in self.active():
            if sample.stage is Stage.SENT and not sample.asked:
                sample.due_at = max(sample.due_at, due_at)
        return due_at

    def skip(self, sample: OutgoingSample, address: int) -> None:
        """Skip a sample for a receiver; others may still lack it."""
        self.name(sample.number + 1)
        sample.acknowledged.add(address)
        self.receptions[address].skips_to = sample.number + 1

    def lose_sync(self, address: int) -> None:
        """Assume that a receiver knows neither lineage nor floor, and lost what it held."""
        self.receptions[address].in_sync = False
        self.receptions[address].settled_at = None
        for sample in self.named():
            sample.held.discard(address)

    def regress(self, address: int, expected: int) -> None:
        """Note that a receiver has lost everything from a number on."""
        self.receptions[address].expected = expected
        for sample in self.named():
            if sample.number >= expected and sample.stage is not Stage.OBJECT:
                sample.acknowledged.discard(address)

    def number_byte(self, number: int) -> bytes:
        """Return the byte of a number in a record."""
        return bytes((number % NUMBERS,))

    # Below the methods above

    def _aims(self, sample: OutgoingSample, lacking: list[int]) -> bool:
        """Return whether to repeat a sample to one receiver alone.

        All receivers that hear a repetition addressed to all acknowledge it again, since they
        cannot know whether their last ACK arrived.
        """
        receivers = len(self.receptions)
        is_crowd = self._may_aim and receivers > FEW_RECEIVERS
        return is_crowd and sample.tries > 0 and len(lacking) * _AIMED_SHARE <= receivers

    @property
    def _has_large(self) -> bool:
        """Whether a large sample is under way, so that its receiver expects no rhythm."""
        return bool(self._large)

    def _left(self, sample: OutgoingSample) -> None:
        for samples in (self._under_way, self._large):
            if samples.get(sample.delivery_id) is sample:
                del samples[sample.delivery_id]

    def _is_present(self, address: int, sync: Sync) -> bool:
        return sync.lineage == self.spans.of(address, self._next_for(address)).lineage

    def _next_for(self, address: int) -> int:
        """Return the oldest number that a receiver lacks, or the newest number if it lacks none."""
        return max(0, min(self.floor_of(address), self.next_number - 1))

    def _told(self, address: int) -> int:
        return self.receptions[address].expected
