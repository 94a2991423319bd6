"""The components of an engine above one link, one for each mechanism between nodes.

They share the transmit queue, and of the link they know only its airtimes. Handshake and journal
are common to all links. This module passes on whatever concerns all components: a link, a report,
the timer.

This is the native wire; `zacoustic.core.profiles.rmw_desert.protocols` has the other one.
"""

from collections.abc import Sequence, Set
from types import MappingProxyType
from typing import Final

from zacoustic.core.base.linktypes import LinkCapabilities, ReceivedFrame
from zacoustic.core.base.qos import Override
from zacoustic.core.peers.contact import PeerFound, PeerLost
from zacoustic.core.peers.handshake import SETTLING_UNITS, latest_ns, unit_ns
from zacoustic.core.peers.heartbeats import Heartbeats
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.profiles.entities import RosEntitySeen
from zacoustic.core.profiles.native.receiver import Receiver
from zacoustic.core.profiles.profile import Profile
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.composer import BULK_OVERHEAD_BYTES, Composer, Ingredients
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.sources import ForwardingSource
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.actions.actions import Actions
from zacoustic.core.transport.actions.events import ActionEvent
from zacoustic.core.transport.calls.calls import CallEvent
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.transport.carry.status import CarryStatus
from zacoustic.core.transport.contract import MakeTransport, Transport
from zacoustic.core.transport.deliveries import DeliveryEvent, SampleReceived
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.core.transport.objects.sending.bulkpaths import BulkChanged
from zacoustic.core.transport.publication import Publication
from zacoustic.core.transport.subscriptions.announcing import Announcing, has_lived
from zacoustic.core.transport.subscriptions.subscriptions import SubscribersChanged
from zacoustic.core.transport.topics.deadlines import DeadlineMissed
from zacoustic.core.transport.topics.topics import Topics
from zacoustic.core.wire.agreement import TAG_BYTES
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic.errors import ConfigError

ProtocolEvent = (
    SampleReceived
    | DeliveryEvent
    | CallEvent
    | ActionEvent
    | ObjectProgress
    | BulkChanged
    | SubscribersChanged
    | DeadlineMissed
    | RangeMeasured
    | RangeFailed
    | PeerLost
    | PeerFound
    | RosEntitySeen
)
"""The components' events for the application."""


_SPREAD_FRAMES: Final = 4
"""Samples of a steady period linger for at most so many of the longest frames."""


class Protocols(Profile):
    """The components of one engine on one link.

    Args:
        context: What they share.
        rules: The rules of the config.
        transports: Make third-party transports.
        relay: Has the frames of routes and bonds over this link; None: there are none.

    Raises:
        ConfigError: Two of them have the same name, or one has none.
    """

    def __init__(
        self,
        context: Context,
        rules: TransmitRules,
        transports: Sequence[MakeTransport] = (),
        relay: ForwardingSource | None = None,
    ) -> None:
        super().__init__(context)
        contact = rules.contact_on(context.link)
        self.heartbeats = Heartbeats(
            context.others,
            contact.heartbeat_s,
            context.generators.of("contact"),
            announces=contact.announces and has_lived(context),
        )
        self._announcing: Announcing | None = None
        if contact.announces:
            self._announcing = Announcing(context, self.subscriptions, self.heartbeats.announce)
        self.services: Services = Services(context, self.repeater)
        self.actions: Actions = Actions(context, self.repeater)
        self.topics = Topics(
            context, rules.objects, self.subscriptions, self.deadlines, rules.carry_bytes
        )
        self.objects = self.topics.large.objects
        """Samples larger than a frame, under way."""
        context.reception.read.connect(context.pacers.heard)
        self.transports = make_transports(context, transports)
        self.receiver = Receiver(
            context.table,
            context.handshake,
            context.reception,
            context.stats,
            context.seal,
            context.node.replies,
            context.node.alarms.forbidden,
        )
        made_of = Ingredients(
            queue=context.queue,
            dense=self.topics.dense,
            ranging=self.ranging,
            objects=self.objects,
            heartbeats=self.heartbeats,
            extensions=tuple(self.transports.values()),
            seal=context.seal,
            begins=self.topics.copied.begin_frame,
            relay=relay,
            other_end=context.other_end,
        )
        self.frames = Composer(
            context.link, context.handshake, context.epoch, made_of, context.stats
        )

    # Commands

    def hold_heartbeats(self, *, is_held: bool) -> None:
        """Send no heartbeats until told otherwise."""
        self.heartbeats.is_held = is_held

    def publish(self, publication: Publication, now: int) -> int:
        """Queue a sample; see `Engine.publish`."""
        delivery_id = self.topics.publish(publication, now)
        self.deadlines.published(
            publication.stream_id, publication.instance, now, deleted=publication.delete
        )
        return delivery_id

    def pending(self, stream_id: int) -> int:
        """Return how many payloads of a stream wait."""
        return super().pending(stream_id) + self.objects.pending(stream_id)

    def delivering(self, stream_id: int) -> int:
        """Return how many reliable samples of a stream have not ended."""
        return self.topics.delivering(stream_id)

    @property
    def carry(self) -> CarryStatus | None:
        """What this node keeps of carried topics; None: there are none."""
        return None if self.topics.carrying is None else self.topics.carrying.status

    def is_delivering(self, delivery_id: int) -> bool:
        """Return whether a reliable sample has not ended."""
        return self.topics.is_delivering(delivery_id)

    def cancel_delivery(self, delivery_id: int, now: int) -> bool:
        """Cancel a reliable sample; see `Engine.cancel_delivery`."""
        return self.topics.cancel(delivery_id, now)

    def end_taken(self, delivery_id: int) -> None:
        """Note that the application has taken the end of a sample."""
        self.topics.outcomes.taken(delivery_id)

    def refuse_object(self, source: int, transfer: int, now: int) -> bool:
        """Refuse the rest of an object; see `Engine.refuse_object`."""
        return self.topics.large.at(now).objects.cancel_incoming(source, transfer)

    def call(self, stream_id: int, value: object, now: int, *, timeout_s: float | None) -> int:
        """Call a service; see `Engine.call`."""
        return self.services.call(stream_id, value, now, timeout_s=timeout_s)

    def cancel(self, call_id: int, now: int) -> None:
        """Cancel a call; see `Engine.cancel`."""
        self.services.cancel(call_id, now)

    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """Answer a request; see `Engine.reply`."""
        return self.services.reply(call, value, now)

    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """Answer a request with an error; see `Engine.reply_error`."""
        return self.services.reply_error(call, failure, text, now)

    def override(self, stream: Stream, override: Override) -> None:
        """Apply an override to the QoS of a topic's waiting samples."""
        super().override(stream, override)
        self.objects.override(stream.stream_id, override.over(stream.qos).priority, on=override.on)

    # Getters

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits."""
        return super().is_idle and self.objects.is_idle

    # Reception

    def envelope(self, capabilities: LinkCapabilities) -> Envelope:
        """Make the envelope of the frames on a link.

        Raises:
            ConfigError: The link has no room for frames sealed as the config requires.
        """
        made = Envelope(capabilities, self._context.address, sealed=self._context.is_sealed)
        self._context.seal.check_room(made.room_bytes)
        return made

    def receive(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int
    ) -> tuple[int, ...]:
        """Decode a frame; return the streams of its content."""
        self._context.doubt.settle(now)
        self._context.peers[opened.source].link = self._context.link
        return self.receiver.handle(opened, frame, port, now)

    def receive_unsealed(
        self,
        opened: Opened,
        frame: ReceivedFrame,
        port: LinkPort,
        allowed: Set[int],
        now: int,
    ) -> tuple[int, ...]:
        """Take samples from an unsealed frame; return their streams."""
        return self.receiver.handle_unsealed(opened, frame, port, allowed, now)

    def overhear(self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int) -> None:
        """Learn from a frame for another node when its sender listens."""
        self.receiver.overhear(opened, frame, port, now)
        self._context.pacers.heard(opened.source, now)

    # Life cycle of the engine

    def begin(self, now: int) -> None:
        """Record the first instant since the restart; later calls have no effect."""
        self.heartbeats.begin(now)

    def recover(self) -> None:
        """Restore the journal's entries."""
        stored = self._context.stored
        self.subscriptions.recover(stored)
        self.topics.recover(stored)
        self.services.recover(stored)
        self.actions.recover(stored)

    def use_link(self, port: LinkPort, now: int) -> None:
        """Set the link's airtimes, and drop what is too large for it."""
        capabilities = port.capabilities
        self._context.handshake.use_link(self._context.link, capabilities, now)
        self.ranging.use_link(capabilities)
        # Nobody pauses on a route, and its relays repeat what is lost.
        has_pauses = not port.access.is_scheduled and self._context.other_end is None
        settling_ns = max(SETTLING_UNITS * unit_ns(capabilities), self._context.settling_ns)
        times = LinkTimes(
            capabilities,
            port.listening if has_pauses else None,
            crosses_within_ns=settling_ns if self._context.is_inside else None,
        )
        self._context.pacers.times = times
        meets_others = capabilities.half_duplex and has_pauses
        self._context.queue.spread.most_ns = _SPREAD_FRAMES * times.longest_ns * meets_others
        port.listening.transfers = self.objects
        port.hole_begins.connect(self._context.pacers.hole_begins)
        self.topics.use_link(times, settling_ns)
        self.services.use_link(times, latest_ns(settling_ns))
        self.subscriptions.use_link(times)
        self.actions.use_link(times, latest_ns(settling_ns))
        for each in self.transports.values():
            each.use_link(capabilities, now)
        seal, room_bytes = self._context.seal, port.envelope.room_bytes
        fragment_bytes = room_bytes - seal.fragment_overhead_bytes
        bulk_bytes = port.bulk_room_bytes - BULK_OVERHEAD_BYTES - seal.overhead_bytes
        self.objects.use_link(
            capabilities,
            fragment_bytes,
            port.listening.pause_ns,
            now,
            bulk_bytes=bulk_bytes,
            hears_meanwhile=port.rides_back and len(self._context.table.nodes) == 2,
            longest_answer_ns=times.longest_round_trip_ns if self._context.is_inside else None,
            lacks=port.bulk_goes_on,
        )
        oversized = self.queue.limit(room_bytes - (seal.overhead_bytes or TAG_BYTES))
        self.topics.sending.dropped(oversized, now)
        for _ in oversized:
            self._stats.drop("oversized")

    def link_up(self, now: int) -> None:
        """Resume the work of all components: the link is up."""
        self._context.doubt.link_up(now)
        self.heartbeats.link_up(now)
        if self._announcing is not None:
            self._announcing.link_up(now)
        self.topics.link_up(now)
        self._context.pacers.link_up(now)
        self.services.link_up(now)
        self.actions.link_up(now)
        for each in self.transports.values():
            each.link_up(now)

    def note(self, now: int) -> None:
        """Record the instant for a callback that does not take it."""
        self.topics.large.at(now)

    def handle_timeout(self, now: int) -> None:
        """Do, while the node is awake, the work that has no timer of its own."""
        self.topics.awake(now)


def make_transports(
    context: Context, makers: Sequence[MakeTransport]
) -> MappingProxyType[str, Transport]:
    """Make third-party transports; return them by name.

    Raises:
        ConfigError: Two have the same name, or one has none.
    """
    made: dict[str, Transport] = {}
    for make in makers:
        each = make(context)
        if not each.name or each.name in made:
            raise ConfigError(f"transport {each.name!r}: allowed: a name of its own")
        made[each.name] = each
    return MappingProxyType(made)
