"""The components of an engine above a link with the wire of rmw_desert.

The transmit queue with its lanes, priorities and lifespans is that of the native wire; so are
medium access, silence and airtime caps, which surround it. This module sends and receives one
message in a packet and nothing else: no handshake, no acknowledgement, no object, no heartbeat.

A packet does not name its sender. If only one other node may publish a topic, its samples are
attributed to that node. If there are several, or none is listed, the source is unknown (0), unless
the link itself carries addresses.

Drops are counted under the words of `zacoustic.core.profiles.native.receiver`: ``payload`` (no
message, or one that its sender cannot have written), ``unknown_stream``, ``not_publisher``,
``not_subscriber``, ``not_for_us``, ``unexpected_answer``, ``repeated_request``, ``too_many_calls``;
and ``no_packet`` for bytes of the stream that belong to no packet.
"""

from collections.abc import Sequence

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import (
    BROADCAST,
    UNKNOWN_SOURCE,
    LinkCapabilities,
    ReceivedFrame,
)
from zacoustic.core.base.stats import count
from zacoustic.core.profiles.entities import DiscoverySpec
from zacoustic.core.profiles.profile import Profile
from zacoustic.core.profiles.rmw_desert.calls import SETTLING_UNITS, DesertCalls
from zacoustic.core.profiles.rmw_desert.discovery import Discovery
from zacoustic.core.profiles.rmw_desert.envelope import PacketEnvelope
from zacoustic.core.profiles.rmw_desert.packets import Packets
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import SAMPLE_LANE, QueuedRecord
from zacoustic.core.schedule.sources import ForwardingSource
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.contract import MakeTransport
from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.transport.publication import Publication
from zacoustic.core.transport.topics.topics import NO_DELIVERY
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.rmw_desert.messages import Kind, Message, decode_message, encode_head
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.core.wire.envelope import Damaged, Envelope, Opened
from zacoustic.errors import ConfigError, PayloadInvalidError


class RmwDesertProtocols(Profile):
    """The components of one engine on one link.

    Args:
        context: What they share.
        rules: The rules of the config.
        transports: Must be empty: this wire has no extensions.
        relay: Must be None: nor has it routes.

    Raises:
        ConfigError: There are transports or routes.
    """

    def __init__(
        self,
        context: Context,
        rules: TransmitRules,
        transports: Sequence[MakeTransport] = (),
        relay: ForwardingSource | None = None,
    ) -> None:
        if relay is not None:
            raise ConfigError("wire rmw_desert has no routes; allowed: routes over native links")
        if transports:
            raise ConfigError("wire rmw_desert has no extensions; allowed: no other transports")
        super().__init__(context)
        self._calls = DesertCalls(context)
        discovery = rules.discovery or DiscoverySpec()
        self._discovery = Discovery(
            context.address, context.table, discovery, context.queue, context.emit
        )
        self._packets: PacketEnvelope | None = None
        self._sent = self.frames = Packets(context.queue, context.epoch, context.stats)

    # Commands

    def publish(self, publication: Publication, now: int) -> int:
        """Queue a sample; see `Engine.publish`."""
        stream_id, encoding = publication.stream_id, publication.encoding
        stream, _ = self._context.table.topic_of(self._context.address, stream_id)
        stream.keys.key(self._context.address, publication.instance)
        if publication.delete:
            raise PayloadInvalidError(f"{stream.name}: a delete does not exist on this wire")
        if encoding is not None and encoding != stream.encoding:
            raise PayloadInvalidError(
                f"{stream.name}: encoding {encoding}; allowed: {stream.encoding}"
            )
        item = QueuedRecord(
            stream_id=stream_id,
            destination=BROADCAST,
            code=Kind.SAMPLE,
            head=encode_head(stream_id),
            payload=stream.codec.encode(publication.value),
            queued_at=publication.made_at(now),
            expires_at=publication.expires_at(stream, now),
        )
        self.queue.check_size(stream.name, item.size_bytes)
        count(self._stats.published, stream_id)
        self.queue.push((stream_id, SAMPLE_LANE), item, stream.qos)
        self.deadlines.published(stream_id, publication.instance, now, deleted=False)
        return NO_DELIVERY

    def call(self, stream_id: int, value: object, now: int, *, timeout_s: float | None) -> int:
        """Call a service; see `Engine.call`."""
        return self._calls.call(stream_id, value, now, timeout_s=timeout_s)

    def cancel(self, call_id: int, now: int) -> None:
        """Cancel a call; see `Engine.cancel`."""
        self._calls.cancel(call_id)

    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """Answer a request; see `Engine.reply`."""
        return self._calls.reply(call, value, now)

    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """Forget a request: this wire has no errors, and its client hears nothing."""
        return self._calls.reply_error(call, now)

    # Reception

    def envelope(self, capabilities: LinkCapabilities) -> Envelope:
        """Make the envelope of the messages on a link."""
        self._packets = PacketEnvelope(
            capabilities, self._context.address, self._context.timers, self._give_up
        )
        return self._packets

    def receive(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int
    ) -> tuple[int, ...]:
        """Decode a message; return its stream."""
        return self._take(opened, frame, now)

    # Life cycle of the engine

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits."""
        return super().is_idle and not self._sent.is_under_way

    def use_link(self, port: LinkPort, now: int) -> None:
        """Set the link's airtimes, and drop what is too large for it."""
        self._sent.clear()
        capabilities = port.capabilities
        unit_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        unit_ns += seconds_to_ns(capabilities.propagation_s)
        self._calls.settling_ns = SETTLING_UNITS * unit_ns
        # Whatever the modem measures, this wire sends nothing only to measure a range.
        self.ranging.use_link(msgspec.structs.replace(capabilities, measures_range=False))
        for _ in self.queue.limit(port.envelope.room_bytes):
            self._stats.drop("oversized")

    def link_up(self, now: int) -> None:
        """Drop the rest of a packet begun on another connection, and begin discovery."""
        self._sent.clear()
        if self._packets is not None:
            self._packets.forget()
        self._discovery.begin(now)

    # Below the methods above

    def _give_up(self, now: int) -> None:
        """Search the bytes of an incomplete packet for other packets."""
        for opened in self._packets.flush() if self._packets is not None else ():
            if isinstance(opened, Damaged):
                self._stats.drop(opened.reason)
            else:
                frame = ReceivedFrame(frame_bytes=opened.records, received_at=now)
                self._take(opened, frame, now)

    def _take(self, opened: Opened, frame: ReceivedFrame, now: int) -> tuple[int, ...]:
        try:
            message = decode_message(opened.records)
        except PayloadError:
            self._stats.drop("payload")
            return ()
        reason = self._receive(opened.source, message, frame, now)
        if reason is not None:
            self._stats.drop(reason)
        return (message.stream_id,)

    def _receive(self, source: int, message: Message, frame: ReceivedFrame, now: int) -> str | None:
        stream = self._context.table.get(message.stream_id)
        if stream is None:
            return self._discovery.receive(message, now)
        if message.kind is not Kind.SAMPLE:
            return self._calls.receive(source, stream, message, now)
        if not isinstance(stream.spec, TopicSpec):
            return "unknown_stream"
        return self._receive_sample(source, stream, stream.spec, message, frame)

    def _receive_sample(
        self, source: int, stream: Stream, spec: TopicSpec, message: Message, frame: ReceivedFrame
    ) -> str | None:
        others = [address for address in spec.publishers or () if address != self._context.address]
        if source == UNKNOWN_SOURCE and len(others) == 1:
            source = others[0]
        if spec.publishers is not None and not others:
            return "not_publisher"
        if source != UNKNOWN_SOURCE and not stream.may_publish(source):
            return "not_publisher"
        if not stream.may_subscribe(self._context.address):
            return "not_subscriber"
        try:
            value = stream.codec.decode(message.fields)
        except PayloadError:
            return "payload"
        sample = SampleReceived(
            stream_id=stream.stream_id,
            source=source,
            instance=(),
            value=value,
            encoding=stream.encoding,
            received_at=frame.received_at,
            metrics=frame.metrics,
        )
        self.deadlines.hand_on(sample, frame.received_at)
        return None
