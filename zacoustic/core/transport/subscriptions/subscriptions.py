"""The on-demand topics of one node: its own subscriptions, and those of others at it."""

from collections.abc import Callable, Collection, Mapping, Set
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.signals import Signal
from zacoustic.core.base.stats import NO_STREAM, Cause
from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.specs import LAST_STREAM_ID, TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import DeliveryEnded, DeliveryOutcome
from zacoustic.core.transport.exchanges.repeating import Repeater
from zacoustic.core.transport.subscriptions.own import ANSWER_LANE, SUBSCRIBE_QOS, Own
from zacoustic.core.transport.subscriptions.subscribers import Subscribers
from zacoustic.core.wire.subscriptions import (
    PAGE_STREAMS,
    SUBSCRIBE_CODE,
    Subscribe,
    page_of,
    streams_of,
)
from zacoustic.errors import LocalError

NOBODY: Final = "nobody subscribes"
"""The reason for the end of a reliable sample without subscribers."""


class SubscribersChanged(msgspec.Struct, frozen=True, kw_only=True):
    """The subscribers of an on-demand topic of this node have changed."""

    stream_id: int
    """The topic's stream."""
    subscribers: tuple[int, ...]
    """Addresses of the present subscribers; empty: the topic's samples are not sent."""
    changed_at: int
    """Instant of the change, ns."""


class Subscriptions:
    """The on-demand topics of one node.

    Args:
        context: What the components of its engine share.
        repeater: Repeats subscribe messages.
    """

    def __init__(self, context: Context, repeater: Repeater) -> None:
        self._address = context.address
        self._table = context.table
        self._queue = context.queue
        self._emit: Callable[[SubscribersChanged | DeliveryEnded], None] = context.emit
        self._handshake = context.handshake
        self._own = Own(repeater, context.handshake, context.sizes.versions)
        self._subscribers = Subscribers(context, self._answer)
        self.changed = self._subscribers.changed
        """``(topic, newcomers, now)``: the subscribers of a topic have changed."""
        self.changed.connect(self._tell)
        self.published = Signal[Stream, int]()
        """``(topic, now)``: this node publishes on an on-demand topic."""
        self.unsubscribed = Signal[int, Set[int], int]()
        """``(stream_id, sources, now)``: this node has unsubscribed from a topic of these nodes."""
        self._linger_s = 0.0
        context.reception.on(Subscribe, self.receive)
        context.peers.restarted.connect(self.peer_restarted)
        context.peers.forgotten.connect(self.peer_forgotten)

    def use_link(self, times: LinkTimes) -> None:
        """Set the link's airtimes."""
        self._linger_s = times.confirm_linger_s

    # Commands

    def want(self, stream_id: int, now: int, sources: Collection[int] | None = None) -> None:
        """Subscribe to an on-demand topic at some of its publishers, and at no others.

        A topic that is not on demand is unaffected.

        Args:
            stream_id: The topic.
            now: The instant.
            sources: Addresses of the publishers; this node and nodes that do not publish the topic
                are ignored. None: all publishers. Empty: unsubscribe.

        Raises:
            UnknownStreamError: No such topic.
            LocalError: This node may not subscribe to it.
        """
        stream, spec = self._table.topic(stream_id)
        if not stream.may_subscribe(self._address):
            raise LocalError(
                f"node {self._address} is not a subscriber of {stream.name}; "
                f"subscribers: {spec.subscribers}"
            )
        if stream.is_on_demand:
            publishers = self.publishers(stream)
            wanted = publishers if sources is None else publishers & frozenset(sources)
            before = self._own.wanted(stream_id)
            self._own.want(stream_id, wanted, now)
            if before - wanted:
                self.unsubscribed(stream_id, before - wanted, now)

    # Getters

    def publishers(self, stream: Stream) -> frozenset[int]:
        """Return the other nodes that may publish an on-demand topic."""
        assert isinstance(stream.spec, TopicSpec)
        listed = stream.spec.publishers
        return frozenset(self._table.nodes if listed is None else listed) - {self._address}

    def wanted(self, stream_id: int) -> frozenset[int]:
        """Return the publishers at which this node subscribes to an on-demand topic."""
        return self._own.wanted(stream_id)

    def subscribers(self, stream: Stream) -> Set[int] | None:
        """Return the nodes that have subscribed to an on-demand topic; None for any other.

        The set changes with the subscriptions.
        """
        return self._subscribers.of(stream) if stream.is_on_demand else None

    def destination(self, stream: Stream) -> int:
        """Return the one node that has subscribed to an on-demand topic, or `BROADCAST`."""
        subscribers = self._subscribers.of(stream)
        return next(iter(subscribers)) if len(subscribers) == 1 else BROADCAST

    # For the publisher

    def refuse(self, stream: Stream, delivery_id: int, now: int) -> int:
        """Report that a reliable sample of this node has no subscribers; return its id."""
        self._emit(
            DeliveryEnded(
                delivery_id=delivery_id,
                stream_id=stream.stream_id,
                outcome=DeliveryOutcome.REFUSED,
                missing=(),
                ended_at=now,
                detail=NOBODY,
            )
        )
        return delivery_id

    # For the channel

    def receive(self, heard: Heard, message: Subscribe) -> str | None:
        """Take a subscribe message or an answer; return why it is dropped, or None."""
        heard.streams.append(NO_STREAM)
        if not heard.is_unicast:
            return "not_for_us"
        if message.page > LAST_STREAM_ID // PAGE_STREAMS:
            return "payload"
        readable = set()
        for stream_id in self._named(message):
            reason = heard.refusal(stream_id)
            if reason == "unconfirmed":
                return reason
            if reason is None:
                readable.add(stream_id)
        if message.is_answer:
            return self._own.answered(heard.source, message, heard.now)
        return self._subscribers.receive(heard.source, message, readable, heard.now)

    def sample_received(self, source: int, stream: Stream, now: int, *, is_alone: bool) -> None:
        """Check whether a sample from `source` belongs to a subscription of this node."""
        if stream.is_on_demand and source in self.publishers(stream):
            self._own.sample_received(source, stream.stream_id, now, is_alone=is_alone)

    def peer_forgotten(self, source: int, now: int) -> None:
        """Forget a node."""
        self._own.peer_forgotten(source, now)
        self._subscribers.peer_forgotten(source, now)

    def peer_restarted(self, source: int, epoch: int, now: int) -> None:
        """Send the subscriptions again to a node that has begun a new epoch."""
        self._own.publisher_restarted(source, now)

    # The journal

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore other nodes' subscriptions from the journal."""
        self._subscribers.recover(stored)

    # Below the methods above

    def _named(self, message: Subscribe) -> list[int]:
        """Return the streams that decide on a message: those it names, or all of its page."""
        return list(streams_of(message.page, message.streams)) or [
            stream.stream_id
            for stream in self._table
            if stream.is_on_demand and page_of(stream.stream_id) == message.page
        ]

    def _tell(self, stream: Stream, newcomers: Set[int], now: int) -> None:
        subscribers = tuple(sorted(self._subscribers.of(stream)))
        self._emit(
            SubscribersChanged(stream_id=stream.stream_id, subscribers=subscribers, changed_at=now)
        )

    def _answer(self, source: int, message: Subscribe, now: int) -> None:
        answer = Subscribe(
            message.page,
            message.version,
            message.streams,
            is_answer=True,
            heard=self._handshake.heard_epoch(source),
            is_kept=self._handshake.is_present(message.heard),
        )
        record = QueuedRecord(
            stream_id=NO_STREAM,
            code=SUBSCRIBE_CODE,
            destination=source,
            payload=answer.body,
            delimits_itself=True,
            for_one_node=True,
            cause=Cause.SUBSCRIBE,
            is_reply=True,
            queued_at=now,
        )
        # Sent at once, it would meet again and again what is repeated together with the message.
        qos = msgspec.structs.replace(SUBSCRIBE_QOS, linger_s=self._linger_s)
        self._queue.replace((NO_STREAM, ANSWER_LANE, source, message.page), record, qos)
