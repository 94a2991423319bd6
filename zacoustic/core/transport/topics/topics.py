"""Topics: a sample is queued, crosses, and becomes an event.

A best-effort sample crosses once or not at all; a reliable one goes to
`zacoustic.core.transport.reliable`. `zacoustic.core.wire.content` has the parts of a record.
"""

from collections.abc import Callable, Set
from typing import Any, Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.qos import Reliability, Stamp
from zacoustic.core.base.stats import EngineStats, count
from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.queue import SAMPLE_LANE, TransmitQueue, Waiting
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import AGE_FIELD, Stream, StreamTable
from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.transport.objects.large import LargeSamples
from zacoustic.core.transport.reliable.receiving.receiving import Arrival, ReliableReceiving
from zacoustic.core.transport.reliable.sending.sending import ReliableSending
from zacoustic.core.transport.reliable.sending.slots import LEAST_ACK_BYTES
from zacoustic.core.transport.subscriptions.subscriptions import Subscriptions
from zacoustic.core.transport.topics.copied import CopiedSamples
from zacoustic.core.transport.topics.densestreams import DenseStreams
from zacoustic.core.values.age import decode_age_s
from zacoustic.core.values.encoding import encode_prefix
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.frame import SYNC_BYTES, Control, DenseBlock, Record
from zacoustic.core.wire.numbers import IN_RHYTHM, NUMBER_BYTES, NUMBERS, decode_ack
from zacoustic.errors import UnknownStreamError

_AGE_BYTES: Final = 1
_IN_PARTS: Final = 'reliability: "reliable" in its stream: then it crosses in parts'
NO_DELIVERY: Final = 0
"""The result of `Engine.publish` for a best-effort sample: it has no reported outcome."""


class Topics:
    """The topics of one node.

    Args:
        address: Address of the node.
        table: Its streams.
        queue: Takes the samples.
        copied: Takes best-effort samples, which may go several times.
        dense: Reads dense blocks.
        stats: Counts.
        sending: Takes reliable samples on their way out.
        receiving: Takes reliable samples on their way in.
        large: Takes what fits no frame.
        subscriptions: Knows the subscribers of on-demand topics.
        emit: Takes the samples, and the instant.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        queue: TransmitQueue,
        copied: CopiedSamples,
        dense: DenseStreams,
        stats: EngineStats,
        sending: ReliableSending,
        receiving: ReliableReceiving,
        large: LargeSamples,
        subscriptions: Subscriptions,
        emit: Callable[[SampleReceived, int], None],
    ) -> None:
        self._address = address
        self._table = table
        self._queue = queue
        self._copied = copied
        self._dense = dense
        self._stats = stats
        self._sending = sending
        self._receiving = receiving
        self._large = large
        self._subscriptions = subscriptions
        self._emit = emit

    def publish(
        self,
        stream_id: int,
        value: object,
        now: int,
        *,
        instance: Instance,
        encoding: str | None,
        delete: bool,
        queued_at: int | None,
    ) -> int:
        """Queue a sample; see `Engine.publish`."""
        stream, spec = self._table.topic_of(self._address, stream_id)
        stream.keys.key(self._address, instance)
        prefix = bytes((Control.DELETE,)) if delete else b""
        if encoding is not None and encoding != stream.encoding and not delete:
            prefix = bytes((Control.ENCODING,)) + encode_prefix(encoding)
        made_at = now if queued_at is None else min(queued_at, now)
        lifespan_s = stream.qos.lifespan_s
        expires_at = None if lifespan_s is None else made_at + seconds_to_ns(lifespan_s)
        dense_value = None
        if stream.dense_type is not None and not prefix:
            dense_value, payload = stream.dense_value(value)
        else:
            payload = b"" if delete else stream.codec.encode(value)
        stamped = stream.qos.stamp is Stamp.AGE and not delete
        reliable = stream.qos.reliability is Reliability.RELIABLE
        needed_bytes = len(prefix) + 1 + len(instance) + stamped + len(payload)
        if reliable:
            self._sending.check(stream)
            needed_bytes += SYNC_BYTES + NUMBER_BYTES
            needed_bytes = max(needed_bytes, LEAST_ACK_BYTES + len(instance))
        if self._subscriptions.subscribers(stream) == frozenset():
            count(self._stats.published, stream_id)
            count(self._stats.unsubscribed, stream_id)
            if not reliable:
                return NO_DELIVERY
            return self._subscriptions.refuse(stream, self._sending.next_delivery_id(), now)
        largest_bytes = self._queue.largest_bytes
        is_large = reliable and largest_bytes is not None and needed_bytes > largest_bytes
        if reliable:
            self._large.check(stream, len(payload))
            if is_large and not delete:
                delivery_id = self._large.publish(
                    stream,
                    payload,
                    now,
                    instance=instance,
                    encoding=encoding if prefix else None,
                    expires_at=expires_at,
                )
                count(self._stats.published, stream_id)
                return delivery_id
        self._queue.check_size(stream.name, needed_bytes, hint=_IN_PARTS)
        count(self._stats.published, stream_id)
        if reliable:
            return self._sending.publish(
                stream,
                instance,
                prefix=prefix,
                payload=payload,
                stamped=stamped,
                queued_at=made_at,
                expires_at=expires_at,
                now=now,
            )
        item = Waiting(
            stream_id=stream_id,
            destination=self._destination(stream, spec),
            prefix=prefix,
            head=bytes(instance),
            payload=payload,
            stamped=stamped,
            delimits_itself=stream.codec.delimits_itself or delete,
            dense_value=dense_value,
            tick=self._stats.published[stream_id],
            queued_at=made_at,
            expires_at=expires_at,
        )
        self._copied.publish((stream_id, SAMPLE_LANE, *instance), item, stream.qos, now)
        return NO_DELIVERY

    def receive(self, heard: Heard, stream: Stream, record: Record) -> str | None:
        """Take a record that may be decoded; returns why it is dropped, or None."""
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
        low_number: int | None = None
        if stream.qos.reliability is Reliability.RELIABLE:
            if not content:
                return "payload"
            low_number, content = content[0], content[NUMBER_BYTES:]
        age_s: float | None = None
        if stream.qos.stamp is Stamp.AGE and not prefixes.delete:
            if not content:
                return "payload"
            age_s, content = decode_age_s(content[0]), content[_AGE_BYTES:]
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
            age_s=age_s,
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
            reason = self._receiving.receive(stream, arrival, now)
            self._large.at(now).objects.look_again(source)
            return reason
        sync = prefixes.sync
        if sync and self._copied.is_repeated(source, stream.stream_id, instance, sync):
            return "repeated_sample"
        self._emit(sample, now)
        return None

    def receive_block(self, heard: Heard, block: DenseBlock) -> str | None:
        """Take the samples of a dense block; returns why it is dropped, or None."""
        reason = heard.dense_refusal()
        if reason is not None:
            return reason
        if not self._dense.concerns_us(heard.source, heard.frame.destination):
            return "not_subscriber"
        try:
            samples = self._dense.receive(heard.source, block.block)
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
        """Take an ACK; returns why it is dropped, or None."""
        if record.prefixes.acknowledged not in (0, self._address):
            return None  # for another node
        wild = len(stream.keys.wildcards)
        ack = decode_ack(record.content[wild:])
        if ack is None:
            return "payload"
        instance = tuple(record.content[:wild])
        sync = record.prefixes.sync
        return self._sending.acknowledged(heard.source, stream, instance, ack, sync, heard.now)

    def subscribers_changed(self, stream: Stream, newcomers: Set[int], now: int) -> None:
        """Others subscribe to an on-demand topic than before: what waits is for those."""
        subscribers = self._subscriptions.subscribers(stream)
        if stream.qos.reliability is Reliability.RELIABLE:
            self._sending.subscribers_changed(stream, newcomers, now)
            self._large.subscribers_changed(stream, now)
            return
        self._copied.drop_stream(stream.stream_id)
        if subscribers:
            self._queue.readdress(stream.stream_id, self._subscriptions.destination(stream))
        else:
            for _ in range(self._queue.drop_stream(stream.stream_id)):
                count(self._stats.unsubscribed, stream.stream_id)

    def _receive_dense(self, heard: Heard, stream_id: int, value: dict[str, Any]) -> None:
        """Hand on a sample of a dense block."""
        stream = self._table.by_id(stream_id)
        code: int | None = value.pop(AGE_FIELD, None)
        sample = SampleReceived(
            stream_id=stream_id,
            source=heard.source,
            instance=(),
            value=stream.dense_sample(value),
            deleted=False,
            encoding=stream.encoding,
            age_s=None if code is None else decode_age_s(code),
            received_at=heard.frame.received_at,
            metrics=heard.frame.metrics,
        )
        self._emit(sample, heard.now)

    def _destination(self, stream: Stream, spec: TopicSpec) -> int:
        """Return the one subscriber of a topic, or `BROADCAST`."""
        if stream.is_on_demand:
            return self._subscriptions.destination(stream)
        if spec.subscribers is None:
            return BROADCAST
        others = [address for address in spec.subscribers if address != self._address]
        return others[0] if len(others) == 1 else BROADCAST
