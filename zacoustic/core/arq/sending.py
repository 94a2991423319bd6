"""The publisher's side: what was published reliably, until it is acknowledged or worth nothing."""

import random
from collections.abc import Callable, Iterable, Mapping
from typing import Final

import msgspec

from zacoustic.core.arq.numbers import Ack, resolve_expected, resolve_floor
from zacoustic.core.arq.sendlane import Outgoing, SendLane, Stage
from zacoustic.core.arq.timing import LinkTimes, PeerTiming
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.events import DeliveryEnded, DeliveryOutcome, DeliveryStored, Event
from zacoustic.core.frame import Sync
from zacoustic.core.handshake import Handshake
from zacoustic.core.journal import JournalPort
from zacoustic.core.keys import Instance
from zacoustic.core.linktypes import BROADCAST, TransmitOutcome, TransmitReport
from zacoustic.core.qos import Priority
from zacoustic.core.queue import LaneKey, TransmitQueue, Waiting
from zacoustic.core.stats import Cause
from zacoustic.core.streams import Stream, StreamTable, TopicSpec

RELIABLE_LANE: Final = 3
_URGENT_COPIES: Final = 4
"""A REAL_TIME sample is sent so often before an answer is awaited: at 40 % loss one of four arrives
in 97 of 100 cases, and a round trip lasts longer than four short frames."""
_URGENT_AT_ONCE: Final = 2
_AT_ONCE: Final = 0
_JOURNAL: Final = "out"
_ANY_DEPTH: Final = 65535


class SampleWaiting(Waiting):
    """A reliable sample in the transmit queue."""

    __slots__ = ("lane", "sample")
    lane: SendLane
    sample: Outgoing


class _Kept(msgspec.Struct, frozen=True, array_like=True):
    """A sample in the journal."""

    delivery_id: int
    prefix: bytes
    payload: bytes
    stamped: bool


class _KeptLane(msgspec.Struct, frozen=True, array_like=True):
    """A lane in the journal."""

    digest: bytes
    lineage: int
    next_number: int


class ReliableSending:
    """What this node has published reliably.

    Args:
        address: Address of the node.
        table: Its streams.
        queue: Takes records.
        handshake: Knows the boot epoch, and who defines a stream in another way.
        journal: Keeps what is to survive.
        rng: Draws the pauses between repetitions.
        emit: Takes events.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        queue: TransmitQueue,
        handshake: Handshake,
        journal: JournalPort,
        rng: random.Random,
        emit: Callable[[Event], None],
    ) -> None:
        self._address = address
        self._table = table
        self._queue = queue
        self._handshake = handshake
        self._journal = journal
        self._rng = rng
        self._emit = emit
        self._lanes: dict[LaneKey, SendLane] = {}
        self._timings: dict[int, PeerTiming] = {}
        self._times: LinkTimes | None = None
        self._settling_ns = 0
        self._paced_until: int | None = None
        self._on_air: list[tuple[SendLane, Outgoing]] = []
        self._next_delivery_id = 1
        self._order = 0

    # For the application

    def publish(
        self,
        stream: Stream,
        instance: Instance,
        *,
        prefix: bytes,
        payload: bytes,
        stamped: bool,
        queued_at: int,
        expires_at: int | None,
        now: int,
    ) -> int:
        """Take a sample; returns its delivery id."""
        lane = self._lane(stream, instance)
        delivery_id = self.next_delivery_id()
        sample = self._add(
            lane,
            stream,
            _Kept(delivery_id, prefix, payload, stamped),
            queued_at=queued_at,
            expires_at=expires_at,
        )
        while len(lane.samples) > stream.qos.depth:
            self._end(lane, lane.samples[0], DeliveryOutcome.SUPERSEDED, now)
        if _is_kept(stream):
            kept = _Kept(delivery_id, prefix, payload, stamped)
            self._write_lane(stream, lane)
            self._journal.write(
                f"{_lane_name(lane)}/{sample.number}",
                msgspec.msgpack.encode(kept),
                lambda at: self._stored(lane, sample, at),
            )
        else:
            sample.stage = Stage.BEHIND
            self._advance(lane, now)
        return delivery_id

    def next_delivery_id(self, above: int = 0) -> int:
        """Return a delivery id that no sample has, nor any up to `above`."""
        delivery_id = max(self._next_delivery_id, above + 1)
        self._next_delivery_id = delivery_id + 1
        return delivery_id

    def delivering(self) -> int:
        """Count the samples that not all receivers have acknowledged."""
        return sum(len(lane.samples) for lane in self._lanes.values())

    # For the link

    def use_link(self, times: LinkTimes, settling_ns: int) -> None:
        """Take the airtimes of a link, and within what time a repetition of a frame arrives."""
        self._times = times
        self._settling_ns = settling_ns

    def link_up(self, now: int) -> None:
        """The link is up: what was sent before is due, and what a former life has left."""
        for lane in self._lanes.values():
            lifespan_s = self._table.by_id(lane.key[0]).qos.lifespan_s
            for sample in lane.samples:
                if sample.stage is Stage.SENT:
                    sample.due_at = _AT_ONCE
                if sample.expires_at is None and lifespan_s is not None:
                    sample.expires_at = now + seconds_to_ns(lifespan_s)
            self._advance(lane, now)

    def transmitted(self, records: Iterable[Waiting]) -> None:
        """Note which samples are in the transmission that begins."""
        for record in records:
            if isinstance(record, SampleWaiting):
                self._order += 1
                record.sample.order = self._order
                record.sample.stage = Stage.ON_AIR
                record.sample.tries += 1
                self._on_air.append((record.lane, record.sample))

    def handle_report(self, report: TransmitReport) -> None:
        """A transmission has ended: from here an ACK is awaited."""
        on_air, self._on_air = self._on_air, []
        for lane, sample in on_air:
            if sample.stage is not Stage.ON_AIR:
                continue
            sample.stage = Stage.SENT
            sample.sent_at = report.finished_at
            sample.due_at = self._repeat_at(lane, sample, report)

    # For the water

    def heard(self, source: int, now: int) -> None:
        """A frame of a node arrived: if repetitions to it had become rare, they are due."""
        timing = self._timings.get(source)
        if timing is None or not timing.heard():
            return
        for lane in self._lanes.values():
            if source in lane.receptions:
                self._due_soon(lane, source, now)

    def lost_sync(self, source: int, now: int) -> None:
        """A node does not know us, or has begun a new life: what it lacks goes with SYNC."""
        for lane in self._lanes.values():
            reception = lane.receptions.get(source)
            if reception is not None and reception.in_sync:
                self._out_of_sync(lane, source, now)

    def acknowledged(
        self, source: int, stream: Stream, instance: Instance, ack: Ack, sync: Sync | None, now: int
    ) -> str | None:
        """Take an ACK.

        Args:
            source: Who acknowledges.
            stream: The topic.
            instance: Which of its keys.
            ack: The content.
            sync: What stands before it: lineage, and what is expected in full.
            now: The instant.

        Returns:
            Why it is dropped, or None.
        """
        lane = self._lanes.get((stream.stream_id, RELIABLE_LANE, *instance))
        reception = lane.receptions.get(source) if lane else None
        if lane is None or reception is None:
            return "unexpected_ack"
        if not ack.knows:
            self._out_of_sync(lane, source, now)
            return None
        if sync is None:
            if not reception.in_sync:
                return "unexpected_ack"  # it may be of another life, or about numbers long ago
            expected = resolve_expected(ack.expected, reception.expected)
        elif sync.lineage == lane.lineage:
            expected = resolve_floor(sync.floor, reception.expected)
        else:
            return "unexpected_ack"
        if expected > lane.next_number:
            return "unexpected_ack"
        if sync is not None and not reception.in_sync and expected >= lane.floor:
            if reception.settled_at is None:
                reception.settled_at = now + self._settling_ns
            reception.in_sync = now >= reception.settled_at
        if expected >= reception.expected:
            reception.expected = expected
            self._timing(source).quiet_until = 0
            self._mark(lane, source, expected, ack.held, now)
        while lane.samples and not _missing(lane, lane.samples[0]):
            self._end(lane, lane.samples[0], DeliveryOutcome.DELIVERED, now)
        self._advance(lane, now)
        return None

    # For the timer

    def expire(self, now: int) -> None:
        """End what is too old, and repeat what is due."""
        self._paced_until = None
        for lane in self._lanes.values():
            for sample in list(lane.samples):
                if sample.expires_at is not None and sample.expires_at <= now:
                    self._expire(lane, sample, now)
            self._advance(lane, now)
        self._repeat(now)

    def next_deadline_at(self) -> int | None:
        """Return the earliest instant at which something expires or is due, ns, or None."""
        earliest: int | None = None
        for lane in self._lanes.values():
            for sample in lane.samples:
                instants = [sample.expires_at] if sample.expires_at is not None else []
                if lane.awaits(sample):
                    instants.append(self._ready_at(lane, sample))
                for at in instants:
                    if earliest is None or at < earliest:
                        earliest = at
        if self._paced_until is not None and (earliest is None or self._paced_until < earliest):
            return self._paced_until
        return earliest

    def dropped(self, records: Iterable[Waiting], now: int) -> None:
        """Records fit no frame of the link any more."""
        for record in records:
            if isinstance(record, SampleWaiting):
                self._end(record.lane, record.sample, DeliveryOutcome.EXPIRED, now, "oversized")

    # The journal

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Go on with what a former life has left."""
        names = [key for key in stored if key.startswith(f"{_JOURNAL}/")]
        for name in sorted(key for key in names if key.count("/") == 2):
            numbers = sorted(
                int(key.rpartition("/")[2]) for key in names if key.startswith(f"{name}/")
            )
            kept_lane = msgspec.msgpack.decode(stored[name], type=_KeptLane)
            next_number = kept_lane.next_number
            lane = self._recover_lane(name, kept_lane, min(numbers, default=next_number))
            if lane is None:
                for key in (name, *(f"{name}/{number}" for number in numbers)):
                    self._journal.write(key, None)
                continue
            stream = self._table.by_id(lane.key[0])
            for number in numbers:
                kept = msgspec.msgpack.decode(stored[f"{name}/{number}"], type=_Kept)
                lane.next_number = number
                sample = self._add(lane, stream, kept, queued_at=0, expires_at=None)
                sample.stage = Stage.BEHIND
                self._next_delivery_id = max(self._next_delivery_id, kept.delivery_id + 1)
            lane.next_number = next_number

    def _recover_lane(self, name: str, kept: _KeptLane, first_number: int) -> SendLane | None:
        _, stream_id, instance = name.split("/")
        stream = self._table.get(int(stream_id))
        if stream is None or stream.digest != kept.digest:
            return None
        key = (stream.stream_id, RELIABLE_LANE, *bytes.fromhex(instance))
        lane = SendLane(key, self._receivers(stream), kept.lineage, first_number)
        self._lanes[key] = lane
        return lane

    # Below the methods above

    def _lane(self, stream: Stream, instance: Instance) -> SendLane:
        key = (stream.stream_id, RELIABLE_LANE, *instance)
        lane = self._lanes.get(key)
        if lane is None:
            lane = SendLane(key, self._receivers(stream), self._handshake.epoch)
            self._lanes[key] = lane
        return lane

    def _receivers(self, stream: Stream) -> tuple[int, ...]:
        assert isinstance(stream.spec, TopicSpec)
        listed = stream.spec.subscribers
        addresses = self._table.nodes if listed is None else listed
        return tuple(sorted(set(addresses) - {self._address}))

    def _timing(self, address: int) -> PeerTiming:
        timing = self._timings.get(address)
        if timing is None:
            timing = self._timings[address] = PeerTiming()
        return timing

    def _add(
        self,
        lane: SendLane,
        stream: Stream,
        kept: _Kept,
        *,
        queued_at: int,
        expires_at: int | None,
    ) -> Outgoing:
        number = lane.next_number
        lane.next_number += 1
        waiting = SampleWaiting(
            stream_id=stream.stream_id,
            destination=BROADCAST,
            prefix=kept.prefix,
            head=bytes(lane.key[2:]) + lane.number_byte(number),
            payload=kept.payload,
            stamped=kept.stamped,
            delimits_itself=stream.codec.delimits_itself,
            queued_at=queued_at,
        )
        sample = Outgoing(number, kept.delivery_id, waiting, expires_at)
        waiting.lane, waiting.sample = lane, sample
        lane.samples.append(sample)
        return sample

    def _stored(self, lane: SendLane, sample: Outgoing, now: int) -> None:
        if sample.stage is not Stage.STORING:
            return
        sample.stage = Stage.BEHIND
        self._emit(DeliveryStored(delivery_id=sample.delivery_id, stream_id=lane.key[0]))
        self._advance(lane, now)

    def _advance(self, lane: SendLane, now: int) -> None:
        """Queue what has come into the window."""
        paced_until = lane.open(now, self._settling_ns)
        if paced_until is not None:
            self._paced_until = min(self._paced_until or paced_until, paced_until)
        for sample in lane.active():
            if sample.stage is Stage.BEHIND:
                self._queue_sample(lane, sample, now)

    def _queue_sample(self, lane: SendLane, sample: Outgoing, now: int) -> None:
        stream = self._table.by_id(lane.key[0])
        lacking = [
            address
            for address in lane.lacking(sample)
            if not self._handshake.differs(address, stream.stream_id)
        ]
        if not lacking:
            # Whoever lacks it could not read it: until that changes.
            sample.stage = Stage.SENT
            sample.due_at = now + self._pause_ns(lane, sample)
            return
        sample.stage = Stage.QUEUED
        self._address_sample(lane, sample, lacking)
        sample.waiting.cause = Cause.REPEAT if sample.tries else None
        qos = msgspec.structs.replace(stream.qos, depth=_ANY_DEPTH, lifespan_s=None)
        self._queue.push(lane.key, sample.waiting, qos)

    def _address_sample(self, lane: SendLane, sample: Outgoing, lacking: list[int]) -> None:
        sample.waiting.destination = lacking[0] if len(lacking) == 1 else BROADCAST
        sample.waiting.sync = lane.sync(sample.number, lacking)

    def _refresh(self, lane: SendLane) -> None:
        """What is known of receivers has changed: so do the records that wait."""
        for sample in lane.active():
            if sample.stage is Stage.QUEUED:
                lacking = lane.lacking(sample)
                if lacking:
                    self._address_sample(lane, sample, lacking)
                else:
                    self._queue.discard(lane.key, sample.waiting)
                    sample.stage = Stage.SENT

    def _mark(self, lane: SendLane, source: int, expected: int, held: int, now: int) -> None:
        """Note what a receiver has, and repeat at once what it must have missed."""
        latest = 0
        for sample in lane.samples:
            ahead = sample.number - expected - 1
            has_it = sample.number < expected
            holds_it = ahead >= 0 and bool(held >> ahead & 1)
            if (has_it or holds_it) and source not in sample.acknowledged | sample.held:
                # Only what was sent last is surely what this answers.
                is_last = sample.order == self._order and sample.tries == 1
                if is_last and sample.stage is Stage.SENT:
                    self._timing(source).measured(now - sample.sent_at)
                latest = max(latest, sample.order)
            if has_it:
                sample.acknowledged.add(source)
                sample.held.discard(source)
            elif holds_it:
                sample.held.add(source)
            else:
                sample.held.discard(source)  # it has restarted, and lost what it held
        for sample in lane.active():
            if (
                sample.stage is Stage.SENT
                and sample.order < latest
                and source in lane.lacking(sample)
            ):
                sample.due_at = _AT_ONCE
        self._refresh(lane)

    def _repeat(self, now: int) -> None:
        """Queue what is due, and with it what will be before an answer can come.

        Not more at once than a few frames: whoever transmits without end hears no answer.
        """
        if self._times is None:
            return
        room_bytes = self._times.batch_bytes
        slack_ns = self._times.first_round_trip_ns // 2
        batch: list[tuple[SendLane, Outgoing]] = []
        for lane in self._lanes.values():
            sent = [sample for sample in lane.active() if lane.awaits(sample)]
            if all(self._ready_at(lane, sample) > now for sample in sent):
                continue
            for sample in sent:
                if sample.due_at <= now + slack_ns and room_bytes > 0:
                    room_bytes -= sample.waiting.size_bytes
                    batch.append((lane, sample))
        for lane, sample in batch:
            self._count_unanswered(lane, sample, now)
            self._await_answer(lane, sample, now + self._pause_ns(lane, sample))
            self._queue_sample(lane, sample, now)

    def _ready_at(self, lane: SendLane, sample: Outgoing) -> int:
        """Return when a sample may be repeated: an answer to what was sent later is waited for."""
        if sample.due_at == _AT_ONCE:
            return _AT_ONCE
        quiet = (self._timing(address).quiet_until for address in lane.lacking(sample))
        return max(sample.due_at, max(quiet, default=0))

    def _count_unanswered(self, lane: SendLane, sample: Outgoing, now: int) -> None:
        if self._times is None or self._copies_wait(lane, sample):
            return
        for address in lane.lacking(sample):
            self._timing(address).unanswered(now, self._times)

    def _copies_wait(self, lane: SendLane, sample: Outgoing) -> bool:
        """Tell whether it is sent again without waiting for an answer."""
        urgent = self._table.by_id(lane.key[0]).qos.priority is Priority.REAL_TIME
        # A stream of them would fill the channel with copies, and no answer could be heard.
        return urgent and sample.tries < _URGENT_COPIES and len(lane.samples) <= _URGENT_AT_ONCE

    def _out_of_sync(self, lane: SendLane, source: int, now: int) -> None:
        lane.receptions[source].in_sync = False
        lane.receptions[source].settled_at = None
        for sample in lane.samples:
            sample.held.discard(source)
        self._refresh(lane)
        self._due_soon(lane, source, now)

    def _due_soon(self, lane: SendLane, source: int, now: int) -> None:
        for sample in lane.active():
            if sample.stage is Stage.SENT and source in lane.lacking(sample):
                sample.due_at = _AT_ONCE

    def _repeat_at(self, lane: SendLane, sample: Outgoing, report: TransmitReport) -> int:
        """Return when a sample that was just sent is due again."""
        if self._copies_wait(lane, sample) and report.outcome is not TransmitOutcome.REJECTED:
            return _AT_ONCE
        pause_ns = self._pause_ns(lane, sample)
        if report.outcome is TransmitOutcome.NOT_DELIVERED:
            pause_ns //= 2
        due_at = report.finished_at + pause_ns
        self._await_answer(lane, sample, due_at)
        return due_at

    def _await_answer(self, lane: SendLane, sample: Outgoing, until: int) -> None:
        for address in lane.lacking(sample):
            timing = self._timing(address)
            timing.quiet_until = max(timing.quiet_until, until)

    def _pause_ns(self, lane: SendLane, sample: Outgoing) -> int:
        assert self._times is not None
        ranks = {address: rank for rank, address in enumerate(lane.receptions)}
        return max(
            (
                self._timing(address).pause_ns(self._times, ranks[address], self._rng)
                for address in lane.lacking(sample)
            ),
            default=self._times.first_round_trip_ns,
        )

    def _expire(self, lane: SendLane, sample: Outgoing, now: int) -> None:
        """A sample is too old: whoever waits for it has to be told, by the SYNC of a later one."""
        missing = _missing(lane, sample)
        self._end(lane, sample, DeliveryOutcome.EXPIRED, now)
        if sample.tries:
            for address in missing:
                self._out_of_sync(lane, address, now)

    def _end(
        self, lane: SendLane, sample: Outgoing, outcome: DeliveryOutcome, now: int, detail: str = ""
    ) -> None:
        if sample.stage is Stage.QUEUED:
            self._queue.discard(lane.key, sample.waiting)
        was_kept = _is_kept(self._table.by_id(lane.key[0]))
        lane.remove(sample, may_shift=not was_kept)
        if was_kept:
            self._journal.write(f"{_lane_name(lane)}/{sample.number}", None)
        self._emit(
            DeliveryEnded(
                delivery_id=sample.delivery_id,
                stream_id=lane.key[0],
                outcome=outcome,
                missing=tuple(_missing(lane, sample)),
                ended_at=now,
                detail=detail,
            )
        )

    def _write_lane(self, stream: Stream, lane: SendLane) -> None:
        kept = _KeptLane(stream.digest, lane.lineage, lane.next_number)
        self._journal.write(_lane_name(lane), msgspec.msgpack.encode(kept))


def _is_kept(stream: Stream) -> bool:
    return stream.spec.journal


def _lane_name(lane: SendLane) -> str:
    return f"{_JOURNAL}/{lane.key[0]}/{bytes(lane.key[2:]).hex()}"


def _missing(lane: SendLane, sample: Outgoing) -> list[int]:
    """Return the receivers that have not acknowledged a sample and all before it."""
    return [address for address in lane.receptions if address not in sample.acknowledged]
