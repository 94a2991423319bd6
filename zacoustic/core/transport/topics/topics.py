"""Topics: a sample is queued, crosses the channel and becomes an event.

A best-effort sample crosses once or not at all. `zacoustic.core.transport.reliable` takes the
reliable ones. `zacoustic.core.wire.content` has the parts of a record.
"""

from collections.abc import Callable, Mapping, Set
from typing import Any, Final

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.qos import Reliability, Stamp
from zacoustic.core.base.stats import count
from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import SAMPLE_LANE, QueuedRecord
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.carry import CARRY_STREAM_ID
from zacoustic.core.streams.specs import TopicSpec, in_parts
from zacoustic.core.streams.table import AGE_FIELD, Stream
from zacoustic.core.transport.carry.carrying import Carrying
from zacoustic.core.transport.deliveries import (
    DeliveryEnded,
    DeliveryEvent,
    DeliveryStored,
    SampleReceived,
)
from zacoustic.core.transport.objects.large import LargeSamples
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.core.transport.objects.sending.bulkpaths import BulkChanged
from zacoustic.core.transport.outcomes import Outcomes
from zacoustic.core.transport.publication import EncodedSample, Publication, encode_sample
from zacoustic.core.transport.reliable.receiving.receiving import Arrival, ReliableReceiving
from zacoustic.core.transport.reliable.sending.sending import ReliableSending
from zacoustic.core.transport.reliable.sending.sendlane import JournalledSample
from zacoustic.core.transport.reliable.sending.slots import LEAST_ACK_BYTES
from zacoustic.core.transport.subscriptions.subscriptions import Subscriptions
from zacoustic.core.transport.topics.copied import CopiedSamples
from zacoustic.core.transport.topics.deadlines import Deadlines
from zacoustic.core.transport.topics.densestreams import DenseStreams
from zacoustic.core.transport.topics.latched import LatchedTopics
from zacoustic.core.transport.topics.successors import Successor, Successors
from zacoustic.core.values.age import NO_AGE, UNKNOWN
from zacoustic.core.values.payload import PayloadError, ReferenceUnknownError
from zacoustic.core.wire.frame import SYNC_BYTES, DenseBlock, Record
from zacoustic.core.wire.numbers import IN_RHYTHM, NUMBER_BYTES, NUMBERS, decode_ack
from zacoustic.errors import UnknownStreamError

_AGE_BYTES: Final = 1
NO_DELIVERY: Final = 0
"""The result of `Engine.publish` for a best-effort sample: it has no reported outcome."""


class Topics:
    """The topics of one node.

    Args:
        context: What the components of its engine share.
        limits: How much memory samples may take that fit no frame.
        subscriptions: Knows the subscribers of on-demand topics.
        deadlines: Delivers samples to the application.
        carry_bytes: How much this node carries for others, bytes.
    """

    def __init__(
        self,
        context: Context,
        limits: ObjectLimits,
        subscriptions: Subscriptions,
        deadlines: Deadlines,
        carry_bytes: int,
    ) -> None:
        self._address = context.address
        self._table = context.table
        self._queue = context.queue
        self._stats = context.stats
        self._subscriptions = subscriptions
        self._emit: Callable[[Any], None] = context.emit
        self._deliver = deadlines.hand_on
        self.dense = DenseStreams(context, subscriptions)
        """Dense blocks."""
        self.outcomes = Outcomes(context.journal, self._told)
        self.sending = ReliableSending(context, subscriptions, self._told, self.outcomes)
        """Reliable samples that this node sends."""
        self.receiving = ReliableReceiving(context, self._hand_on)
        """Reliable samples that this node receives."""
        self.large = LargeSamples(
            context, limits, subscriptions, self.sending, self.receiving, self._told
        )
        """Samples that fit no frame."""
        self.successors = Successors(
            context,
            limits.most_outgoing,
            self.sending.slots.displaces_crossing,
            self.sending.is_delivering,
            self._publish_successor,
            self._told,
            self.outcomes,
        )
        """Samples that wait for a large one of their key."""
        self.latched = LatchedTopics(context, self.sending)
        """Samples for nodes that have forgotten what they had."""
        self.copied = CopiedSamples(context)
        """Best-effort samples, some of which are sent several times."""
        self.carrying: Carrying | None = None
        """Carried topics; None: the table has none."""
        if context.table.get(CARRY_STREAM_ID) is not None and context.table.carried:
            self.carrying = Carrying(
                context,
                carry_bytes,
                deadlines.hand_on,
                self.sending.next_delivery_id,
                self._offer,
                self.large.cancel,
                self.outcomes,
            )
        context.reception.on_records(TopicSpec, self.receive, self.receive_ack)
        context.reception.on(DenseBlock, self.receive_block)
        subscriptions.changed.connect(self.subscribers_changed)

    # Life cycle of the engine

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the samples that the journal has."""
        self.outcomes.recover(stored)
        self.sending.recover(stored)
        self.receiving.recover(stored)
        self.large.recover(stored)
        self.successors.recover(stored)
        if self.carrying is not None:
            self.carrying.recover(stored)

    def use_link(self, times: LinkTimes, settling_ns: int) -> None:
        """Set the link's airtimes and the time in which every repetition of a frame arrives, ns."""
        self.copied.use_link(times)
        self.sending.use_link(settling_ns)

    def link_up(self, now: int) -> None:
        """Resume unfinished deliveries: the link is up."""
        self.receiving.link_up(now)
        self.sending.link_up(now)
        self.large.link_up(now)
        self.successors.link_up(now)
        if self.carrying is not None:
            self.carrying.link_up(now)

    def awake(self, now: int) -> None:
        """Do, while the node is awake, the work that has no timer of its own."""
        self.large.at(now)
        self.copied.sweep(now)
        self.successors.changed()

    # For the application and for the channel

    def publish(self, publication: Publication, now: int) -> int:
        """Queue a sample; see `Engine.publish`."""
        stream, spec = self._table.topic_of(self._address, publication.stream_id)
        if len(publication.instance) < len(stream.keys.wildcards):  # of the only publisher here
            instance = stream.keys.of_publisher(publication.instance, 0)
            publication = msgspec.structs.replace(publication, instance=instance)
        stream.keys.key(self._address, publication.instance)
        sample = encode_sample(stream, publication, now)
        if self.carrying is not None and stream.stream_id in self.carrying:
            self.large.check(stream, len(sample.payload))
            delivery_id = self.carrying.publish(stream, sample, now)
            count(self._stats.published, stream.stream_id)
            return delivery_id
        is_reliable = stream.qos.reliability is Reliability.RELIABLE
        if is_reliable:
            self.sending.check(stream)
        if stream.is_on_demand:
            self._subscriptions.published(stream, now)
        if self._subscriptions.subscribers(stream) == frozenset():
            count(self._stats.published, stream.stream_id)
            count(self._stats.unsubscribed, stream.stream_id)
            if not is_reliable:
                return NO_DELIVERY
            return self._subscriptions.refuse(stream, self.sending.next_delivery_id(), now)
        if is_reliable:
            return self._publish_reliably(stream, sample, now, is_delete=publication.delete)
        item = QueuedRecord(
            stream_id=stream.stream_id,
            destination=self._destination(stream, spec),
            prefix=sample.prefix,
            head=bytes(sample.instance),
            payload=sample.payload,
            stamped=sample.stamped,
            delimits_itself=stream.codec.delimits_itself or publication.delete,
            dense_value=sample.dense_value,
            tick=self._stats.published.get(stream.stream_id, 0) + 1,
            queued_at=sample.made_at,
            made_at=sample.dated_at,
            expires_at=sample.expires_at,
        )
        largest_bytes = self._queue.largest_bytes
        if largest_bytes is not None and sample.record_bytes > largest_bytes:
            item.block_bytes = self.dense.alone_bytes(item, largest_bytes, now)
            if not item.block_bytes:
                self._queue.check_size(stream.name, sample.record_bytes, hint=in_parts(spec))
        count(self._stats.published, stream.stream_id)
        lane = (stream.stream_id, SAMPLE_LANE, *sample.instance)
        self.latched.published(stream, lane, item)
        self.copied.publish(lane, item, stream.qos, now)
        return NO_DELIVERY

    def cancel(self, delivery_id: int, now: int) -> bool:
        """Cancel a reliable sample; return False when it is not under way."""
        if self.carrying is not None and self.carrying.cancel(delivery_id, now):
            return True
        return self.successors.cancel(delivery_id, now) or self.large.cancel(delivery_id, now)

    def delivering(self, stream_id: int) -> int:
        """Return how many reliable samples of a topic have not ended."""
        carried = 0 if self.carrying is None else self.carrying.delivering(stream_id)
        return carried + self.successors.of(stream_id) + self.sending.delivering(stream_id)

    def is_delivering(self, delivery_id: int) -> bool:
        """Return whether a reliable sample has not ended."""
        is_carried = self.carrying is not None and self.carrying.is_delivering(delivery_id)
        is_waiting = (
            is_carried or self.successors.has(delivery_id) or self.outcomes.has(delivery_id)
        )
        return is_waiting or self.sending.is_delivering(delivery_id)

    def _hand_on(self, sample: SampleReceived, now: int) -> None:
        if self.carrying is not None and sample.stream_id == CARRY_STREAM_ID:
            self.carrying.take(sample, now)
        else:
            self._deliver(sample, now)

    def _told(self, event: ObjectProgress | BulkChanged | DeliveryEvent) -> None:
        """Pass an event on, to the carried topics if it is of one of their hops."""
        if isinstance(event, DeliveryEnded):
            self.successors.sample_ended(event.delivery_id)
        elif isinstance(event, DeliveryStored) and self.successors.knows_stored(event.delivery_id):
            return
        is_hop = not isinstance(event, BulkChanged) and event.stream_id == CARRY_STREAM_ID
        if self.carrying is None or not is_hop:
            self._emit(event)
        elif isinstance(event, DeliveryEnded):
            self.carrying.told(event)
            self.outcomes.taken(event.delivery_id)

    def _offer(self, receiver: int, message: bytes, now: int) -> int:
        """Publish a message of the carried topics to a node; return its delivery id."""
        stream = self._table.by_id(CARRY_STREAM_ID)
        publication = Publication(CARRY_STREAM_ID, message, instance=(receiver,))
        sample = encode_sample(stream, publication, now)
        return self._publish_reliably(stream, sample, now, is_delete=False)

    def _publish_reliably(
        self, stream: Stream, sample: EncodedSample, now: int, *, is_delete: bool
    ) -> int:
        self.large.check(stream, len(sample.payload))
        is_large = self._is_large(sample, is_delete=is_delete)
        if not is_large:
            self._queue.check_size(stream.name, _needed_bytes(sample), hint=in_parts(stream.spec))
        delivery_id = self.sending.next_delivery_id()
        successor = Successor(
            delivery_id=delivery_id, sample=sample, is_delete=is_delete, is_large=is_large
        )
        if self.successors.must_wait(stream, sample.instance, now):
            self.successors.add(stream, successor, now)
        else:
            self._number(stream, successor, now)
        count(self._stats.published, stream.stream_id)
        return delivery_id

    def _publish_successor(self, stream: Stream, successor: Successor, now: int) -> None:
        if self._subscriptions.subscribers(stream) == frozenset():
            self._subscriptions.refuse(stream, successor.delivery_id, now)
        else:
            self._number(stream, successor, now)

    def _number(self, stream: Stream, successor: Successor, now: int) -> None:
        """Give a sample the next number of its key."""
        sample = successor.sample
        if self._is_large(sample, is_delete=successor.is_delete):
            self.large.publish(
                stream,
                sample.payload,
                now,
                instance=sample.instance,
                encoding=sample.encoding,
                made_at=sample.dated_at,
                expires_at=sample.expires_at,
                delivery_id=successor.delivery_id,
            )
            kept = JournalledSample(0, sample.prefix, sample.payload, sample.stamped)
            self.sending.keep_large(stream, sample.instance, kept)
            self.successors.began(stream, sample.instance, now)
            return
        self.sending.publish(
            stream,
            sample.instance,
            prefix=sample.prefix,
            payload=sample.payload,
            stamped=sample.stamped,
            queued_at=sample.made_at,
            made_at=sample.dated_at,
            expires_at=sample.expires_at,
            delivery_id=successor.delivery_id,
            now=now,
        )

    def _is_large(self, sample: EncodedSample, *, is_delete: bool) -> bool:
        """Return whether a reliable sample fits no frame."""
        largest_bytes = self._queue.largest_bytes
        is_too_large = largest_bytes is not None and _needed_bytes(sample) > largest_bytes
        return is_too_large and not is_delete

    def receive(self, heard: Heard, stream: Stream, record: Record) -> str | None:
        """Take a record that may be decoded; return why it is dropped, or None."""
        source, received, now = heard.source, heard.frame, heard.now
        if not stream.may_publish(source):
            return "not_publisher"
        if not stream.may_subscribe(self._address):
            return "not_subscriber"
        is_alone = received.destination == self._address
        self._subscriptions.sample_received(source, stream, now, is_alone=is_alone)
        prefixes = record.prefixes
        wild = len(stream.keys.wildcards)
        instance, content = tuple(record.content[:wild]), record.content[wild:]
        if stream.is_addressed and instance != (self._address,):
            return "not_subscriber"
        low_number: int | None = None
        if stream.qos.reliability is Reliability.RELIABLE:
            if not content:
                return "payload"
            low_number, content = content[0], content[NUMBER_BYTES:]
        age = NO_AGE
        if stream.qos.stamp is Stamp.AGE and not prefixes.delete:
            if not content:
                return "payload"
            age, content = heard.age(content[0]), content[_AGE_BYTES:]
        if prefixes.delete and content:
            return "payload"
        try:
            stream.keys.key(source, instance)
            value = None if prefixes.delete else stream.codec.decode(content)
        except (PayloadError, UnknownStreamError):
            return "payload"
        sample = SampleReceived(
            stream_id=stream.stream_id,
            source=source,
            instance=instance,
            value=value,
            deleted=prefixes.delete,
            encoding=prefixes.encoding or stream.encoding,
            age_s=age.seconds,
            age_error_s=age.error_s,
            received_at=received.received_at,
            metrics=received.metrics,
        )
        if low_number is not None:
            arrival = Arrival(
                sync=prefixes.sync,
                low_number=low_number % NUMBERS,
                in_rhythm=bool(low_number & IN_RHYTHM),
                sample=sample,
                is_alone=is_alone,
                frame_bytes=len(received.frame_bytes),
                spare_bytes=-len(received.frame_bytes) - len(record.content) - 1,
            )
            reason = self.receiving.receive(stream, arrival, now)
            self.large.at(now).objects.look_again(source)
            return reason
        sync = prefixes.sync
        if sync and self.copied.is_repeated(source, stream.stream_id, instance, sync):
            return "repeated_sample"
        self._hand_on(sample, now)
        return None

    def receive_block(self, heard: Heard, block: DenseBlock) -> str | None:
        """Take the samples of a dense block; return why it is dropped, or None."""
        reason = heard.dense_refusal()
        if reason is not None:
            return reason
        if not self.dense.concerns_us(heard.source, heard.frame.destination):
            return "not_subscriber"
        try:
            samples = self.dense.receive(heard.source, block.block, heard.now)
        except ReferenceUnknownError:
            heard.misses_reference()
            return "dense"
        except PayloadError:
            return "dense"
        for stream_id, value in samples:
            heard.streams.append(stream_id)
            if not self._table.by_id(stream_id).may_subscribe(self._address):
                self._stats.drop("not_subscriber")
            else:
                self._receive_dense(heard, stream_id, value)
        return None

    def receive_ack(self, heard: Heard, stream: Stream, record: Record) -> str | None:
        """Take an ACK; return why it is dropped, or None."""
        if record.prefixes.acknowledged not in (0, self._address):
            return None  # for another node
        wild = len(stream.keys.wildcards)
        ack = decode_ack(record.content[wild:])
        if ack is None:
            return "payload"
        instance = tuple(record.content[:wild])
        sync = record.prefixes.sync
        return self.sending.acknowledged(heard.source, stream, instance, ack, sync, heard.now)

    def subscribers_changed(self, stream: Stream, newcomers: Set[int], now: int) -> None:
        """Readdress the waiting samples of an on-demand topic to its present subscribers."""
        subscribers = self._subscriptions.subscribers(stream)
        if stream.qos.reliability is Reliability.RELIABLE:
            self.sending.subscribers_changed(stream, newcomers, now)
            self.large.subscribers_changed(stream, now)
            return
        self.copied.drop_stream(stream.stream_id)
        if subscribers:
            self._queue.readdress(stream.stream_id, self._subscriptions.destination(stream))
        else:
            for _ in range(self._queue.drop_stream(stream.stream_id)):
                count(self._stats.unsubscribed, stream.stream_id)

    def _receive_dense(self, heard: Heard, stream_id: int, value: dict[str, Any]) -> None:
        """Deliver a sample of a dense block."""
        stream = self._table.by_id(stream_id)
        age = heard.age(value.pop(AGE_FIELD, UNKNOWN))
        sample = SampleReceived(
            stream_id=stream_id,
            source=heard.source,
            instance=(),
            value=stream.dense_sample(value),
            deleted=False,
            encoding=stream.encoding,
            age_s=age.seconds,
            age_error_s=age.error_s,
            received_at=heard.frame.received_at,
            metrics=heard.frame.metrics,
        )
        self._hand_on(sample, heard.now)

    def _destination(self, stream: Stream, spec: TopicSpec) -> int:
        """Return the one subscriber of a topic, or `BROADCAST`."""
        if stream.is_on_demand:
            return self._subscriptions.destination(stream)
        if spec.subscribers is None:
            return BROADCAST
        others = [address for address in spec.subscribers if address != self._address]
        return others[0] if len(others) == 1 else BROADCAST


def _needed_bytes(sample: EncodedSample) -> int:
    """Return what a frame needs for a reliable sample, or for its acknowledgement, bytes."""
    return max(
        sample.record_bytes + SYNC_BYTES + NUMBER_BYTES, LEAST_ACK_BYTES + len(sample.instance)
    )
