"""What comes off the water: taken apart, checked, handed to topics and services.

Nothing here raises, whatever arrives. Each thing that is dropped is counted under one word:

======================  ===================================================================
``short check stuffing  the envelope could not be opened (`zacoustic.core.wire.envelope`)
overlong address``
``own not_for_us``      a frame of this address, or for another one
``echo``                the same bytes again sooner than the sender can have sent them
``version``             a frame of another wire version
``truncated reserved    the frame cannot be read further (`zacoustic.core.wire.frame`)
unknown_stream``
``unconfirmed differs`` the tables are not known to agree (`zacoustic.core.peers.handshake`)
``not_publisher         the table does not allow this record between these nodes
not_subscriber``
``payload``             the content does not decode, or is out of the bounds of its type
``dense``               a dense string that is damaged, or refers to what is not known here
``unexpected_answer     an answer to no call, or too late; a request that came before
repeated_request
repeated_goal``
``stale_letter``        subscriptions of a node as they were before
``repeated_sample       a reliable sample that came before; one whose count is not known here
out_of_sync``
``unexpected_ack``      an acknowledgement of nothing, or of a former life
``too_many_calls        more requests or goals of one client than two lives of it can have
too_many_goals``
``suspended``           a request or goal that may be older than this life, while it is in question
                        whether this node has forgotten some; it is repeated
``old_cancel``          a cancel of a goal, or its refusal, before the last one
``object_answer         what a receiver says of no object of ours, or says again; an object that
object_digest           was not what its digest says; more transfers than are kept
object_room``
======================  ===================================================================
"""

from collections.abc import Callable
from functools import partial

import msgspec

from zacoustic.core.base.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.base.stats import NO_STREAM, EngineStats
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.actions import Actions
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.transport.objects.large import LargeSamples
from zacoustic.core.transport.reliable.sending.sending import ReliableSending
from zacoustic.core.transport.subscriptions.demand import Demand
from zacoustic.core.transport.topics.densestreams import DenseStreams
from zacoustic.core.transport.topics.topics import Topics
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.access import ANYBODY, AccessControl, ClockTime, Turn
from zacoustic.core.wire.content import measure_content
from zacoustic.core.wire.envelope import Opened
from zacoustic.core.wire.frame import (
    WIRE_VERSION,
    Ask,
    Confirm,
    DenseAck,
    DenseString,
    Hello,
    Prefixes,
    Record,
    Stray,
    TableRow,
    Tag,
    parse_frame,
)
from zacoustic.core.wire.objects import Call, Feedback, Fragment
from zacoustic.core.wire.subscriptions import Subscribe


class Receiver:
    """Takes opened frames apart.

    Args:
        table: The streams of this node.
        handshake: Decides what may be decoded.
        topics: Takes samples.
        dense: Reads dense strings.
        services: Takes requests and answers.
        actions: Takes what is said about goals.
        sending: Is told who has forgotten us.
        large: Takes fragments of objects, and what receivers say of them.
        demand: Takes subscriptions.
        stats: Counts what is dropped.
    """

    def __init__(
        self,
        table: StreamTable,
        handshake: Handshake,
        topics: Topics,
        dense: DenseStreams,
        services: Services,
        actions: Actions,
        sending: ReliableSending,
        large: LargeSamples,
        demand: Demand,
        stats: EngineStats,
    ) -> None:
        self._table = table
        self._handshake = handshake
        self._topics = topics
        self._dense = dense
        self._services = services
        self._actions = actions
        self._sending = sending
        self._large = large
        self._demand = demand
        self._stats = stats
        self.handle_access: Callable[[int, AccessControl, ReceivedFrame, int], None] | None = None
        """Takes controls of medium access: source, control, frame, now."""
        self.handle_call: Callable[[int, Call, ReceivedFrame, int], None] | None = None
        """Is told when the sender of a fragment will listen: source, call, frame, now."""

    def handle(self, opened: Opened, received: ReceivedFrame, now: int) -> tuple[int, ...]:
        """Take one frame apart; returns the streams of the records that were in it."""
        source = opened.source
        if received.destination != opened.destination:
            # The frame's own destination: a link without addresses does not know it.
            received = msgspec.structs.replace(received, destination=opened.destination)
        epoch: int | None = None
        tagged: int | None = None
        streams: list[int] = []
        self._handshake.begin_frame(source, now)
        measure = partial(self._measure, source)
        unicast = opened.destination != BROADCAST
        for item in parse_frame(opened.records, measure, unicast=unicast):
            if isinstance(item, Record):
                streams.append(item.stream_id)
                reason = self._handle_record(source, epoch, item, received, now)
                if reason is not None:
                    self._stats.drop(reason)
            elif isinstance(item, DenseString):
                streams += self._handle_dense(source, epoch, item, received, now)
            elif isinstance(item, DenseAck):
                reason = self._dense.acknowledged(source, item)
                if reason is not None:
                    self._stats.drop(reason)
            elif isinstance(item, Stray):
                self._stats.drop(item.reason)
            elif isinstance(item, Hello):
                self._handshake.heard_hello(source, item, now, unicast=unicast)
                if item.version != WIRE_VERSION:
                    self._stats.drop("version")
                    break
                epoch = item.epoch
            elif isinstance(item, Tag):
                self._handshake.heard_tag(source, item.epoch, now, unicast=unicast)
                epoch = tagged = item.epoch
            elif isinstance(item, Fragment | Feedback):
                streams.append(self._stream_of(source, item))
                reason = self._handle_object(opened, item, received, now)
                if reason is not None:
                    self._stats.drop(reason)
            elif isinstance(item, Subscribe):
                streams.append(NO_STREAM)
                reason = self._handle_letter(opened, epoch, item, now)
                if reason is not None:
                    self._stats.drop(reason)
            elif isinstance(item, ClockTime | Turn):
                if self.handle_access is not None:
                    self.handle_access(source, item, received, now)
            else:
                is_ours = isinstance(item, Confirm) and self._handshake.confirms_us(
                    item, unicast=unicast
                )
                if is_ours and tagged is not None:
                    # A TAG, and that its sender shares our table: as good as a HELLO.
                    hello = Hello(WIRE_VERSION, tagged, self._table.digest)
                    self._handshake.heard_hello(source, hello, now, unicast=unicast)
                    if unicast:
                        self._handshake.heard_introduction(source)
                self._handle_table_talk(opened, item, now)
        if streams and epoch is not None:
            self._handshake.heard_introduced(source, epoch, now)
        return tuple(streams)

    def overhear(self, opened: Opened, received: ReceivedFrame, now: int) -> None:
        """Take from a frame for another node when its sender pauses: that concerns everybody."""
        measure = partial(self._measure, opened.source)
        for item in parse_frame(opened.records, measure, unicast=True):
            if isinstance(item, Hello) and item.version != WIRE_VERSION:
                break
            if isinstance(item, Fragment):
                if self.handle_call is not None:
                    self.handle_call(opened.source, item.call, received, now)
            elif isinstance(item, Turn) and item.node == ANYBODY and self.handle_access is not None:
                self.handle_access(opened.source, item, received, now)

    def _handle_dense(
        self, source: int, epoch: int | None, item: DenseString, received: ReceivedFrame, now: int
    ) -> list[int]:
        """Take the samples of a dense string; returns their streams."""
        reason = self._handshake.verdict_dense(source, epoch, now)
        if reason is not None:
            self._stats.drop(reason)
            return []
        if not self._dense.concerns_us(source, received.destination):
            self._stats.drop("not_subscriber")
            return []
        try:
            samples = self._dense.receive(source, item.string)
        except PayloadError:
            self._stats.drop("dense")
            return []
        for stream_id, value in samples:
            reason = self._topics.receive_dense(source, stream_id, value, received, now)
            if reason is not None:
                self._stats.drop(reason)
        return [stream_id for stream_id, _ in samples]

    def _stream_of(self, source: int, item: Fragment | Feedback) -> int:
        """Return the stream of what a frame has of an object, as far as it is known here."""
        if isinstance(item, Feedback):
            return NO_STREAM
        return self._large.objects.stream_coming(source, item.transfer)

    def _handle_object(
        self, opened: Opened, item: Fragment | Feedback, received: ReceivedFrame, now: int
    ) -> str | None:
        objects = self._large.at(now).objects
        if isinstance(item, Fragment):
            if self.handle_call is not None:
                self.handle_call(opened.source, item.call, received, now)
            return objects.fragment(opened.source, item, received, now)
        if opened.destination == BROADCAST:
            return "not_for_us"
        return objects.feedback(opened.source, item, now)

    def _handle_letter(
        self, opened: Opened, epoch: int | None, letter: Subscribe, now: int
    ) -> str | None:
        if opened.destination == BROADCAST:
            return "not_for_us"
        return self._demand.receive(opened.source, epoch, letter, now)

    def _handle_record(
        self,
        source: int,
        epoch: int | None,
        record: Record,
        received: ReceivedFrame,
        now: int,
    ) -> str | None:
        if record.prefixes.acknowledged is not None:
            # Whoever acknowledges has read our records, so the stream is the same there.
            stream = self._table.get(record.stream_id)
            if stream is None or not isinstance(stream.spec, TopicSpec):
                return "unknown_stream"
            return self._topics.receive_ack(source, stream, record, now)
        reason = self._handshake.verdict(source, epoch, record.stream_id, now)
        if reason is not None:
            return reason
        stream = self._table.get(record.stream_id)
        if stream is None:
            return "unknown_stream"
        if isinstance(stream.spec, ActionSpec):
            return self._actions.receive(source, stream, stream.spec, record.content, now)
        if isinstance(stream.spec, ServiceSpec):
            return self._services.receive(
                source, stream, stream.spec, record.content, now, introduced=epoch is not None
            )
        return self._topics.receive(source, stream, record, received, now)

    def _handle_table_talk(self, opened: Opened, item: Confirm | Ask | TableRow, now: int) -> None:
        source = opened.source
        if isinstance(item, Confirm):
            unicast = opened.destination != BROADCAST
            self._handshake.heard_confirm(source, item, now, unicast=unicast)
        elif isinstance(item, Ask):
            if self._handshake.heard_ask(source, item, now):
                self._sending.lost_sync(source, now)
                self._dense.peer_forgot(source)
        else:
            self._handshake.heard_row(source, item, now)
            if self._handshake.differs(source, item.stream_id):
                self._services.stream_differs(source, item.stream_id, now)
                self._actions.stream_differs(source, item.stream_id, now)

    def _measure(
        self, source: int, stream_id: int, buffer: bytes, offset: int, prefixes: Prefixes
    ) -> int | None:
        stream = self._table.get(stream_id)
        if stream is None:
            raise KeyError(stream_id)
        return measure_content(stream, buffer, offset, prefixes, source)
