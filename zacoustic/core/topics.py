"""Best-effort topics: a sample is queued, crosses once or not at all, and becomes an event.

The content of a topic's record is one byte for each wildcard of its name, one byte of age where
the stream is stamped, and the payload. A delete has the wildcards only.
"""

from collections.abc import Callable
from typing import Final

from zacoustic.core.age import decode_age_s
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.encoding import encode_prefix
from zacoustic.core.events import Event, SampleReceived
from zacoustic.core.frame import Control, Record
from zacoustic.core.keys import Instance
from zacoustic.core.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.payload import PayloadError
from zacoustic.core.qos import Stamp
from zacoustic.core.queue import TransmitQueue, Waiting
from zacoustic.core.stats import EngineStats, count
from zacoustic.core.streams import Stream, StreamTable, TopicSpec
from zacoustic.errors import LocalError, UnknownStreamError

_LANE: Final = 0
_AGE_BYTES: Final = 1


class Topics:
    """The topics of one node.

    Args:
        address: Address of the node.
        table: Its streams.
        queue: Takes what is published.
        stats: Counts.
        emit: Takes the events.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        queue: TransmitQueue,
        stats: EngineStats,
        emit: Callable[[Event], None],
    ) -> None:
        self._address = address
        self._table = table
        self._queue = queue
        self._stats = stats
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
    ) -> None:
        """Queue a sample; see `Engine.publish`."""
        stream, spec = self._topic(stream_id)
        if not stream.may_publish(self._address):
            raise LocalError(
                f"node {self._address} is not a publisher of {stream.name}; "
                f"publishers: {spec.publishers}"
            )
        stream.keys.key(self._address, instance)
        prefix = bytes((Control.DELETE,)) if delete else b""
        if encoding is not None and encoding != stream.encoding and not delete:
            prefix = bytes((Control.ENCODING,)) + encode_prefix(encoding)
        made_at = now if queued_at is None else min(queued_at, now)
        lifespan_s = stream.qos.lifespan_s
        item = Waiting(
            stream_id=stream_id,
            destination=self._destination(spec),
            prefix=prefix,
            head=bytes(instance),
            payload=b"" if delete else stream.codec.encode(value),
            stamped=stream.qos.stamp is Stamp.AGE and not delete,
            delimits_itself=stream.codec.delimits_itself,
            queued_at=made_at,
            expires_at=None if lifespan_s is None else made_at + seconds_to_ns(lifespan_s),
        )
        self._queue.check_size(stream.name, item.size_bytes)
        self._queue.push((stream_id, _LANE, *instance), item, stream.qos)
        count(self._stats.published, stream_id)

    def measure(self, stream: Stream, buffer: bytes, offset: int, delete: bool) -> int | None:
        """Find the end of the content of a record; None: it does not delimit itself."""
        if not stream.codec.delimits_itself:
            return None
        offset += len(stream.keys.wildcards)
        if delete:
            return offset
        return stream.codec.measure(buffer, offset + (stream.qos.stamp is Stamp.AGE))

    def receive(
        self, source: int, stream: Stream, record: Record, received: ReceivedFrame
    ) -> str | None:
        """Take a record that may be decoded; returns why it is dropped, or None."""
        if not stream.may_publish(source):
            return "not_publisher"
        if not stream.may_subscribe(self._address):
            return "not_subscriber"
        wild = len(stream.keys.wildcards)
        instance = tuple(record.content[:wild])
        payload = record.content[wild:]
        age_s: float | None = None
        if stream.qos.stamp is Stamp.AGE and not record.delete:
            if not payload:
                return "payload"
            age_s = decode_age_s(payload[0])
            payload = payload[_AGE_BYTES:]
        try:
            stream.keys.key(source, instance)
            value = None if record.delete else stream.codec.decode(payload)
        except (PayloadError, UnknownStreamError):
            return "payload"
        count(self._stats.received, stream.stream_id)
        self._emit(
            SampleReceived(
                stream_id=stream.stream_id,
                source=source,
                instance=instance,
                value=value,
                deleted=record.delete,
                encoding=record.encoding or stream.encoding,
                age_s=age_s,
                received_at=received.received_at,
                metrics=received.metrics,
            )
        )
        return None

    def _topic(self, stream_id: int) -> tuple[Stream, TopicSpec]:
        stream = self._table.by_id(stream_id)
        if not isinstance(stream.spec, TopicSpec):
            raise UnknownStreamError(f"stream {stream_id} ({stream.name}) is not a topic")
        return stream, stream.spec

    def _destination(self, spec: TopicSpec) -> int:
        """Return the one subscriber of a topic, or `BROADCAST`."""
        if spec.subscribers is None:
            return BROADCAST
        others = [address for address in spec.subscribers if address != self._address]
        return others[0] if len(others) == 1 else BROADCAST
