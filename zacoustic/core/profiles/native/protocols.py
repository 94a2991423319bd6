"""What an engine consists of above a link: one component for each thing that two nodes agree on.

They share the transmit queue, and know nothing of the link but its airtimes. Handshake and journal
they share with those of other links. What concerns all of them (a link, a report, the timer) is
passed on from here.

Here the native wire is spoken. Another wire profile overrides what is said and heard, and leaves
the rest asleep: `zacoustic.core.profiles.rmw_desert.protocols`.
"""

from collections.abc import Callable, Sequence, Set
from functools import partial

from zacoustic.core.base.linktypes import LinkCapabilities, ReceivedFrame
from zacoustic.core.base.qos import Override
from zacoustic.core.base.stats import count
from zacoustic.core.peers.contact import PeerFound, PeerLost
from zacoustic.core.peers.handshake import SETTLING_UNITS, unit_ns
from zacoustic.core.peers.heartbeats import Heartbeats
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured, Ranging
from zacoustic.core.peers.reception import Reception
from zacoustic.core.profiles.entities import RosEntitySeen
from zacoustic.core.profiles.native.receiver import Receiver
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.composer import Composed, Composer, Ingredients
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import SAMPLE_LANES, LaneKey
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.actions.actions import Actions
from zacoustic.core.transport.actions.events import ActionEvent
from zacoustic.core.transport.calls.calls import CallEvent
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.transport.contract import Transport
from zacoustic.core.transport.deliveries import DeliveryEvent, SampleReceived
from zacoustic.core.transport.objects.large import LargeSamples
from zacoustic.core.transport.objects.objects import Objects
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.core.transport.reliable.receiving.receiving import ReliableReceiving
from zacoustic.core.transport.reliable.sending.sending import ReliableSending
from zacoustic.core.transport.repeating import Repeater
from zacoustic.core.transport.subscriptions.subscriptions import SubscribersChanged, Subscriptions
from zacoustic.core.transport.topics.copied import CopiedSamples
from zacoustic.core.transport.topics.deadlines import DeadlineMissed, Deadlines
from zacoustic.core.transport.topics.densestreams import DenseStreams
from zacoustic.core.transport.topics.topics import Topics
from zacoustic.core.wire.agreement import TAG_BYTES
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic.core.wire.frame import DenseAck, DenseBlock
from zacoustic.core.wire.objects import Complete, Fragment, Headless, Lacks, Refused
from zacoustic.core.wire.subscriptions import Subscribe
from zacoustic.errors import ConfigError

MakeTransport = Callable[[Context], Transport]
"""Makes a transport of somebody else; a subclass of `Transport` itself is one."""

ProtocolEvent = (
    SampleReceived
    | DeliveryEvent
    | CallEvent
    | ActionEvent
    | ObjectProgress
    | SubscribersChanged
    | DeadlineMissed
    | RangeMeasured
    | RangeFailed
    | PeerLost
    | PeerFound
    | RosEntitySeen
)
"""What the components tell the application."""


class Protocols:
    """The components of one engine on one link.

    Args:
        context: What they share.
        rules: What the config says.
        transports: Make transports of somebody else.

    Raises:
        ConfigError: Two of them have the same name, or one has none.
    """

    def __init__(
        self,
        context: Context,
        rules: TransmitRules,
        transports: Sequence[MakeTransport] = (),
    ) -> None:
        address, table, emit = context.address, context.table, context.emit
        peers, handshake, queue = context.peers, context.handshake, context.queue
        timers, generators, stats = context.timers, context.generators, context.stats
        journal, doubt = context.journal, context.doubt
        self._context = context
        self._stats = stats
        self.queue = queue
        self.heartbeats = Heartbeats(
            address, table, rules.contact.heartbeat_s, generators.of("contact")
        )
        self.ranging = Ranging(address, table, timers, generators.of("ranging"), emit)
        self.repeater = Repeater(
            queue,
            peers,
            timers,
            generators.of("repeater"),
            partial(handshake.introduce, context.link),
        )
        self.subscriptions = Subscriptions(
            address,
            table,
            queue=queue,
            repeater=self.repeater,
            handshake=handshake,
            journal=journal,
            changed=self._subscribers_changed,
            unsubscribed=self._unsubscribed,
            emit=emit,
        )
        self.deadlines = Deadlines(address, table, self.subscriptions, timers, stats, emit)
        self.dense = DenseStreams(address, table, handshake, self.subscriptions)
        self.sending = ReliableSending(
            address,
            table,
            queue=queue,
            peers=peers,
            handshake=handshake,
            subscriptions=self.subscriptions,
            journal=journal,
            doubt=doubt,
            timers=timers,
            generators=generators,
            stats=stats,
            emit=emit,
        )
        self.receiving = ReliableReceiving(
            address,
            table,
            queue=queue,
            journal=journal,
            doubt=doubt,
            timers=timers,
            rng=generators.of("receiving"),
            emit=self._hand_on,
        )
        self.large = LargeSamples(
            address,
            table,
            rules.objects,
            handshake=handshake,
            subscriptions=self.subscriptions,
            sending=self.sending,
            receiving=self.receiving,
            journal=journal,
            timers=timers,
            stats=stats,
            generators=generators,
            emit=emit,
        )
        self.copied = CopiedSamples(queue, handshake, timers)
        self.topics = Topics(
            address,
            table,
            queue=queue,
            copied=self.copied,
            stats=stats,
            sending=self.sending,
            receiving=self.receiving,
            large=self.large,
            subscriptions=self.subscriptions,
            dense=self.dense,
            emit=self._hand_on,
        )
        self.services = Services(
            address,
            table,
            queue=queue,
            repeater=self.repeater,
            journal=journal,
            handshake=handshake,
            begin_epoch=context.node.epoch.begin,
            doubt=doubt,
            timers=timers,
            stats=stats,
            emit=emit,
        )
        self.actions = Actions(
            address,
            table,
            queue=queue,
            repeater=self.repeater,
            journal=journal,
            handshake=handshake,
            begin_epoch=context.node.epoch.renew,
            doubt=doubt,
            timers=timers,
            stats=stats,
            emit=emit,
        )
        self._register(context.reception)
        self.receiver = Receiver(table, handshake, context.reception, stats)
        self.transports = self._transports(context, transports)
        made_of = Ingredients(
            queue=queue,
            dense=self.dense,
            ranging=self.ranging,
            objects=self.large.objects,
            heartbeats=self.heartbeats,
            extensions=tuple(self.transports.values()),
        )
        self.composer = Composer(context.link, handshake, made_of, stats)
        for each in (self.services, self.actions, self.sending, self.subscriptions, self.dense):
            peers.restarted.connect(each.peer_restarted)
        for told in (self.sending.peer_asked, self.dense.peer_asked):
            peers.asked.connect(told)
        for stopped in (self.services.stream_differs, self.actions.stream_differs):
            peers.differs.connect(stopped)
        context.reception.read.connect(self.sending.heard)
        context.reception.read.connect(lambda address, now: self.repeater.heard(address))
        for one in (
            self.services, self.actions, self.sending, self.receiving, self.subscriptions,
            self.dense,
            self.objects, self.copied, self.deadlines, self.ranging,
        ):  # fmt: skip
            peers.forgotten.connect(one.peer_forgotten)
        context.node.epoch.began.connect(self._epoch_changed)
        context.node.epoch.outlast(lambda: self.services.is_calling)

    @property
    def may_speak(self) -> bool:
        """The boot epoch is written down: no other life of the node will have it."""
        return self._context.node.epoch.may_speak

    @property
    def objects(self) -> Objects:
        """Samples that are larger than a frame, on the channel."""
        return self.large.objects

    @property
    def is_idle(self) -> bool:
        """Nothing waits."""
        return not self.queue and self.large.objects.is_idle

    def owes_acknowledgement(self, now: int) -> bool:
        """Tell whether something waits that says what has come."""
        return self.queue.has_acknowledgement or self.large.objects.owes_answer(now)

    # Commands

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
        delivery_id = self.topics.publish(
            stream_id,
            value,
            now,
            instance=instance,
            encoding=encoding,
            delete=delete,
            queued_at=queued_at,
        )
        self.deadlines.published(stream_id, instance, now, deleted=delete)
        return delivery_id

    def pending(self, stream_id: int) -> int:
        """Count the payloads of a stream that wait."""
        return self.queue.pending(stream_id) + self.large.objects.pending(stream_id)

    def call(self, stream_id: int, value: object, now: int, *, timeout_s: float | None) -> int:
        """Call a service; see `Engine.call`."""
        return self.services.call(stream_id, value, now, timeout_s=timeout_s)

    def cancel(self, call_id: int, now: int) -> None:
        """Give up a call; see `Engine.cancel`."""
        self.services.cancel(call_id, now)

    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """Answer a request; see `Engine.reply`."""
        return self.services.reply(call, value, now)

    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """Answer a request with an error; see `Engine.reply_error`."""
        return self.services.reply_error(call, failure, text, now)

    def override(self, stream: Stream, override: Override) -> None:
        """Lay an override over the QoS of what waits of a topic."""
        for lane in SAMPLE_LANES:
            self.queue.override((stream.stream_id, lane), override)
        self.objects.override(stream.stream_id, override.over(stream.qos).priority, on=override.on)

    # What is said and heard

    def envelope(self, capabilities: LinkCapabilities) -> Envelope:
        """Make what goes around a frame on a link."""
        return Envelope(capabilities, self._context.address)

    def due_at(self, now: int) -> int | None:
        """Return the instant from which a frame is to go, ns; None: nothing is to be said."""
        return self.composer.due_at(now)

    def compose(self, port: LinkPort, now: int) -> Composed | None:
        """Make the frame that is worth most now, or return None."""
        return self.composer.compose(port, now)

    def compose_only(self, port: LinkPort, lane: LaneKey, now: int) -> Composed | None:
        """Make a frame of what waits in one lane, or return None."""
        return self.composer.compose_only(port, lane, now)

    def speak(self, port: LinkPort, now: int) -> Composed | None:
        """Make a frame of what medium access has to say, or return None."""
        return self.composer.speak(port, now)

    def receive(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int
    ) -> tuple[int, ...]:
        """Take a frame apart; returns the streams of what was in it."""
        self._context.doubt.settle(now)
        self._context.peers[opened.source].link = self._context.link
        return self.receiver.handle(opened, frame, port, now)

    def overhear(self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int) -> None:
        """Learn from a frame for somebody else when its sender listens."""
        self.receiver.overhear(opened, frame, port, now)

    # The life of the engine

    def begin(self, now: int) -> None:
        """This is the first instant of the life; no effect later on."""
        self.heartbeats.begin(now)

    def recover(self) -> None:
        """Go on with what a former life has left of this link."""
        stored = self._context.stored
        self.subscriptions.recover(stored)
        self.sending.recover(stored)
        self.receiving.recover(stored)
        self.large.recover(stored)
        self.services.recover(stored)
        self.actions.recover(stored)

    def use_link(self, port: LinkPort, now: int) -> None:
        """Take the airtimes of a link, and drop what is too large for it."""
        capabilities = port.capabilities
        self._context.handshake.use_link(self._context.link, capabilities, now)
        self.ranging.use_link(capabilities)
        times = LinkTimes(capabilities, None if port.access.is_scheduled else port.listening)
        settling_ns = SETTLING_UNITS * unit_ns(capabilities)
        self.copied.use_link(times)
        self.sending.use_link(times, settling_ns)
        self.services.use_link(times, settling_ns)
        self.actions.use_link(times, settling_ns)
        self.repeater.use_link(times)
        self.receiving.use_link(times)
        for each in self.transports.values():
            each.use_link(capabilities, now)
        self.large.objects.use_link(
            capabilities, port.envelope.room_bytes, port.listening.pause_ns, now
        )
        oversized = self.queue.limit(port.envelope.room_bytes - TAG_BYTES)
        self.sending.dropped(oversized, now)
        for _ in oversized:
            self._stats.drop("oversized")

    def link_up(self, now: int) -> None:
        """The link is up."""
        self._context.doubt.link_up(now)
        self.receiving.link_up(now)
        self.sending.link_up(now)
        self.large.link_up(now)
        self.repeater.link_up()
        self.services.link_up(now)
        self.actions.link_up(now)
        for each in self.transports.values():
            each.link_up(now)

    def handle_timeout(self, now: int) -> None:
        """The node is awake, and timers may be due: do what has no instant of its own."""
        self.large.at(now)
        self.copied.sweep(now)

    # Below the methods above

    def _transports(
        self, context: Context, makers: Sequence[MakeTransport]
    ) -> dict[str, Transport]:
        made: dict[str, Transport] = {}
        for make in makers:
            each = make(context)
            if not each.name or each.name in made:
                raise ConfigError(f"transport {each.name!r}: allowed: a name of its own")
            made[each.name] = each
        return made

    def _register(self, reception: Reception) -> None:
        """Say who takes what of a frame."""
        reception.on_records(TopicSpec, self.topics.receive, self.topics.receive_ack)
        reception.on_records(ServiceSpec, self.services.receive)
        reception.on_records(ActionSpec, self.actions.receive)
        reception.on(DenseBlock, self.topics.receive_block)
        reception.on(DenseAck, self.dense.acknowledged)
        reception.on(Fragment, self.large.fragment)
        for kind in (Lacks, Complete, Refused, Headless):
            reception.on(kind, self.large.feedback)
        reception.on(Subscribe, self.subscriptions.receive)

    def _epoch_changed(self, now: int) -> None:
        self.dense.epoch_changed()
        self.services.epoch_changed()
        self.actions.epoch_changed(now)

    def _subscribers_changed(self, stream: Stream, newcomers: Set[int], now: int) -> None:
        self.topics.subscribers_changed(stream, newcomers, now)

    def _unsubscribed(self, stream_id: int, sources: Set[int], now: int) -> None:
        self.large.unsubscribed(stream_id, sources, now)

    def _hand_on(self, sample: SampleReceived, now: int) -> None:
        count(self._stats.received, sample.stream_id)
        self.deadlines.handed_on(sample, now)
        self._context.emit(sample)
