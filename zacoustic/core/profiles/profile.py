"""What a node transmits and receives on one link: the part that all wires share.

The transmit queue with its lanes, priorities and lifespans is the same on every wire. So are
deadlines and what surrounds a wire: medium access, silence and airtime caps. Mechanisms that a wire
lacks are absent, and commands to them do nothing.
"""
# ruff: noqa: B027

from abc import ABC, abstractmethod
from collections.abc import Set
from types import MappingProxyType

from zacoustic.core.base.linktypes import LinkCapabilities, ReceivedFrame
from zacoustic.core.base.qos import Override
from zacoustic.core.peers.ranging import Ranging
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.frames import Frames
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import SAMPLE_LANES
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.actions.actions import Actions
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.transport.carry.status import CarryStatus
from zacoustic.core.transport.contract import Transport
from zacoustic.core.transport.exchanges.repeating import Repeater
from zacoustic.core.transport.publication import Publication
from zacoustic.core.transport.subscriptions.subscriptions import Subscriptions
from zacoustic.core.transport.topics.deadlines import Deadlines
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.core.wire.envelope import Envelope, Opened


class Profile(ABC):
    """One wire on one link of an engine.

    Args:
        context: What its components share.
    """

    services: Services | None = None
    """Carry remote commands; None: this wire has none."""
    actions: Actions | None = None
    """Take commands about goals; None: this wire has none."""
    frames: Frames
    """What is transmitted."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._stats = context.stats
        self.queue = context.queue
        """The waiting records."""
        self.ranging = Ranging(
            context.address,
            context.table,
            context.timers,
            context.generators.of("ranging"),
            context.emit,
            context.pacers.in_vain,
            context.pacers.quiet_until,
        )
        """The wanted ranges."""
        self.repeater = Repeater(
            context.queue,
            context.peers,
            context.pacers,
            context.timers,
            context.generators.of("repeater"),
        )
        """Repeats records that have no answer yet."""
        self.subscriptions = Subscriptions(context, self.repeater)
        """On-demand topics."""
        self.deadlines = Deadlines(context, self.subscriptions)
        """Watches for missing samples of topics with a deadline."""
        self.transports: MappingProxyType[str, Transport] = MappingProxyType({})
        """Third-party transports, by name."""
        context.peers.forgotten.connect(self.ranging.peer_forgotten)
        context.pacers.released.connect(self.ranging.peer_heard)

    # Commands

    def hold_heartbeats(self, *, is_held: bool) -> None:
        """Send no heartbeats until told otherwise."""

    @abstractmethod
    def publish(self, publication: Publication, now: int) -> int:
        """Queue a sample; see `Engine.publish`."""

    @abstractmethod
    def call(self, stream_id: int, value: object, now: int, *, timeout_s: float | None) -> int:
        """Call a service; see `Engine.call`."""

    @abstractmethod
    def cancel(self, call_id: int, now: int) -> None:
        """Cancel a call; see `Engine.cancel`."""

    @abstractmethod
    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """Answer a request; see `Engine.reply`."""

    @abstractmethod
    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """Answer a request with an error; see `Engine.reply_error`."""

    def cancel_delivery(self, delivery_id: int, now: int) -> bool:
        """Cancel a reliable sample; see `Engine.cancel_delivery`."""
        return False

    def end_taken(self, delivery_id: int) -> None:
        """Note that the application has taken the end of a sample."""

    def refuse_object(self, source: int, transfer: int, now: int) -> bool:
        """Refuse the rest of an object; see `Engine.refuse_object`."""
        return False

    def override(self, stream: Stream, override: Override) -> None:
        """Override the QoS of a topic's waiting samples."""
        for lane in SAMPLE_LANES:
            self.queue.override((stream.stream_id, lane), override)

    # Getters

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits."""
        return not self.queue

    def pending(self, stream_id: int) -> int:
        """Return how many payloads of a stream wait."""
        return self.queue.pending(stream_id)

    def delivering(self, stream_id: int) -> int:
        """Return how many reliable samples of a stream have not ended."""
        return 0

    def is_delivering(self, delivery_id: int) -> bool:
        """Return whether a reliable sample has not ended."""
        return False

    @property
    def carry(self) -> CarryStatus | None:
        """What this node keeps of carried topics; None: there are none."""
        return None

    # Reception

    @abstractmethod
    def envelope(self, capabilities: LinkCapabilities) -> Envelope:
        """Make the envelope of frames on a link."""

    @abstractmethod
    def receive(
        self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int
    ) -> tuple[int, ...]:
        """Decode a frame; return the streams of its content."""

    def receive_unsealed(
        self,
        opened: Opened,
        frame: ReceivedFrame,
        port: LinkPort,
        allowed: Set[int],
        now: int,
    ) -> tuple[int, ...]:
        """Take samples of the allowed topics from an unsealed frame; return their streams."""
        return ()

    def overhear(self, opened: Opened, frame: ReceivedFrame, port: LinkPort, now: int) -> None:
        """Learn from a frame for another node when its sender listens."""

    # Life cycle of the engine

    def begin(self, now: int) -> None:
        """Record the first instant since the restart; later calls have no effect."""

    def recover(self) -> None:
        """Restore the journal's entries, except for the boot epoch."""

    @abstractmethod
    def use_link(self, port: LinkPort, now: int) -> None:
        """Set the link's airtimes, and drop what is too large for it."""

    @abstractmethod
    def link_up(self, now: int) -> None:
        """Begin or resume work: the link is up."""

    def note(self, now: int) -> None:
        """Record the instant for a callback that follows and does not take it."""

    def handle_timeout(self, now: int) -> None:
        """Do, while the node is awake, the work that has no timer of its own."""
