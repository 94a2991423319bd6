"""Samples that fit no frame: they cross as objects between reliable topics.

This module asks the table, so that `zacoustic.core.transport.objects` need not know streams: which
nodes should receive an object, whether this node subscribes to an arriving one, and whether both
ends define its stream in the same way. It also asks for the count of the key
(`zacoustic.core.transport.reliable`), in which a large sample has its slot among the small ones. An
object that is complete before all this is known waits for it.
"""

from collections.abc import Callable, Mapping, Set
from typing import Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.moments import Made, instant_of
from zacoustic.core.base.qos import Reliability, Stamp
from zacoustic.core.base.stats import NO_STREAM
from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.context import Context
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import (
    DeliveryEvent,
    DeliveryOutcome,
    DeliveryStored,
    SampleReceived,
)
from zacoustic.core.transport.objects.admission import Admission, ObjectReceived
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.transport.objects.manifest import Manifest, take_age
from zacoustic.core.transport.objects.objects import Objects
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.transport.objects.sending.bulkpaths import BulkChanged
from zacoustic.core.transport.objects.sending.sending import Sending
from zacoustic.core.transport.objects.stored import StoredObject
from zacoustic.core.transport.reliable.receiving.receiving import Claim, ReliableReceiving
from zacoustic.core.transport.reliable.sending.keeping import NO_COUNT, OTHER_STREAM, given_up
from zacoustic.core.transport.reliable.sending.sending import ReliableSending
from zacoustic.core.transport.reliable.sending.sendlane import OutgoingSample
from zacoustic.core.transport.reliable.sending.slots import LargeSlots, SequenceSlot
from zacoustic.core.transport.subscriptions.subscriptions import NOBODY, Subscriptions
from zacoustic.core.values.age import NO_AGE
from zacoustic.core.values.encoding import decode_prefix
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.objects import (
    Complete,
    Feedback,
    Fragment,
    Headless,
    Lacks,
    Reason,
    Refused,
)
from zacoustic.errors import LocalError, UnknownStreamError

_OUTCOMES: Final = {
    ObjectState.DELIVERED: DeliveryOutcome.DELIVERED,
    ObjectState.REFUSED: DeliveryOutcome.REFUSED,
    ObjectState.CANCELLED: DeliveryOutcome.CANCELLED,
    ObjectState.EXPIRED: DeliveryOutcome.EXPIRED,
}
_ENCODING_AT: Final = 1


class LargeSamples:
    """The objects of one node, and their topics.

    Args:
        context: What the components of its engine share.
        limits: How much memory objects may take.
        subscriptions: Knows the subscribers of on-demand topics.
        sending: Holds the counts of this node's keys.
        receiving: Holds the counts of other nodes' keys, and delivers large samples.
        emit: Takes events.
    """

    def __init__(
        self,
        context: Context,
        limits: ObjectLimits,
        subscriptions: Subscriptions,
        sending: ReliableSending,
        receiving: ReliableReceiving,
        emit: Callable[[ObjectProgress | BulkChanged | DeliveryEvent], None],
    ) -> None:
        self._address = context.address
        self._table = context.table
        self._handshake = context.handshake
        self._subscriptions = subscriptions
        self._sending = sending
        self._slots: LargeSlots = sending.slots
        self._receiving = receiving
        self._stats = context.stats
        self._emit = emit
        self._now = 0
        self.objects = Objects(
            epoch=context.handshake.epoch,
            limits=limits,
            pacers=context.pacers,
            timers=context.timers,
            generators=context.generators,
            admission=self,
            owner=self,
            emit=self._progress,
            journal=context.journal,
            moments=context.moments,
            sizes=context.sizes,
        )
        context.reception.on(Fragment, self.fragment)
        for kind in (Lacks, Complete, Refused, Headless):
            context.reception.on(kind, self.feedback)
        context.peers.forgotten.connect(self.objects.peer_forgotten)
        subscriptions.unsubscribed.connect(self.unsubscribed)
        self._slots.sender = self

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore large samples from before the restart, after the small ones."""
        for source, manifest in self.objects.restore(stored, self._refuse, self._give_up):
            slot = SequenceSlot(manifest.lineage, manifest.number)
            if self._table.get(manifest.stream_id) is not None:
                self._receiving.recover_slot(manifest.stream_id, source, manifest.instance, slot)

    def link_up(self, now: int) -> None:
        """Resume the samples of an earlier boot epoch: the link is up."""
        self._now = now
        self.objects.link_up(now)
        for stream in self._table.every():
            if self.objects.pending(stream.stream_id):
                self.subscribers_changed(stream, now)

    def subscribers_changed(self, stream: Stream, now: int) -> None:
        """Stop sending a topic's objects to nodes that have unsubscribed.

        An object with no other receivers is given up. New subscribers get the objects that are made
        from now on.
        """
        self._now = now
        subscribers = self._subscriptions.subscribers(stream)
        if subscribers is not None:
            self.objects.keep_only(stream.stream_id, subscribers, NOBODY, now)

    def unsubscribed(self, stream_id: int, sources: Set[int], now: int) -> None:
        """Drop a topic's incoming objects from nodes where this node has unsubscribed."""
        self._now = now
        self.objects.drop_unwanted(stream_id, sources)

    def check(self, stream: Stream, payload_bytes: int) -> None:
        """Refuse a payload that is too large for an object.

        Raises:
            PayloadTooLargeError: States its size and the largest allowed size.
        """
        assert isinstance(stream.spec, TopicSpec)
        self.objects.check_size(stream.name, payload_bytes, stream.spec.max_bytes)

    def publish(
        self,
        stream: Stream,
        payload: bytes,
        now: int,
        *,
        instance: Instance,
        encoding: str | None,
        made_at: Made,
        expires_at: int | None,
        delivery_id: int,
    ) -> None:
        """Send a sample as an object; `DeliveryEnded` will name its delivery id.

        Raises:
            LocalError: No node is listed that could receive it.
            PayloadTooLargeError: It is too large for an object on this link.
            QueueFullError: Too many objects are under way.
        """
        self._now = now
        slot = self._slots.next_slot(stream, instance)
        self._send(
            delivery_id,
            stream,
            payload,
            slot,
            instance,
            encoding,
            made_at=made_at,
            expires_at=expires_at,
            now=now,
        )
        self._slots.take(stream, instance, delivery_id, now)

    def at(self, now: int) -> "LargeSamples":
        """Record the instant, for questions to the table and for events."""
        self._now = now
        return self

    def cancel(self, delivery_id: int, now: int) -> bool:
        """Cancel a sample, large or small; return False when it is not under way."""
        self._now = now
        withdrawn = self.objects.withdraw(delivery_id, ObjectState.CANCELLED, "cancelled here", now)
        return withdrawn or self._slots.cancel(delivery_id, now)

    # For the sequence slots: `zacoustic.core.transport.reliable.sending.slots.Large`

    def enlarge(self, sample: OutgoingSample, stream_id: int, slot: SequenceSlot, now: int) -> str:
        """Send as an object a sample that was published as a small one; return why not, or ''."""
        self._now = now
        stream = self._table.by_id(stream_id)
        waiting = sample.waiting
        prefix = decode_prefix(waiting.prefix, _ENCODING_AT) if waiting.prefix else None
        try:
            self._send(
                sample.delivery_id,
                stream,
                waiting.payload,
                slot,
                tuple(waiting.head[:-1]),
                prefix[0] if prefix else None,
                made_at=waiting.made_at,
                expires_at=sample.expires_at,
                now=now,
                but=sample.acknowledged if sample.is_again else frozenset(),
                is_again=sample.is_again,
            )
        except LocalError as error:
            return str(error.args[0])
        return ""

    def is_crossing(self, delivery_id: int) -> bool:
        """Return whether some of a sample was transmitted, and a receiver is there."""
        return self.objects.is_crossing(delivery_id)

    def handed_on(self, delivery_id: int, address: int, now: int) -> None:
        """Note that a receiver has acknowledged a sample."""
        self._now = now
        self.objects.handed_on(delivery_id, address)

    def withdraw(self, delivery_id: int, outcome: DeliveryOutcome, now: int) -> None:
        """Stop sending a sample: it has ended."""
        self._now = now
        state = ObjectState(outcome.value)
        self.objects.withdraw(delivery_id, state, "", now)

    # For outgoing objects: `zacoustic.core.transport.objects.sending.sending.Owner`

    def stored(self, sending: Sending, now: int) -> None:
        """Report that an object is journalled."""
        if self._slots.stored(sending.object_id):
            self._emit(DeliveryStored(delivery_id=sending.object_id, stream_id=sending.stream_id))

    def is_turn(self, object_id: int, address: int) -> bool:
        """Return whether a receiver has everything before an object that it will ever get."""
        return self._slots.is_turn(object_id, address)

    def passed(self, object_id: int, address: int, now: int) -> None:
        """Note that a receiver has delivered an object."""
        self._slots.passed(object_id, address, now)

    def refused(self, object_id: int, address: int, reason: int, now: int) -> None:
        """Note that a receiver refuses an object."""
        self._slots.refused(object_id, address, now, is_former=reason == Reason.FORMER)

    # For incoming objects: `zacoustic.core.transport.objects.admission.AdmissionControl`

    def fragment(self, heard: Heard, fragment: Fragment) -> str | None:
        """Take a fragment; return why it is dropped, or None."""
        self._now = heard.now
        heard.streams.append(self.objects.stream_coming(heard.source, fragment.transfer))
        age = NO_AGE
        if fragment.index == 0:
            data, code = take_age(fragment.data)
            fragment, age = msgspec.structs.replace(fragment, data=data), heard.age(code)
        return self.objects.fragment(heard.source, fragment, heard.frame, heard.now, age)

    def feedback(self, heard: Heard, feedback: Feedback) -> str | None:
        """Take a feedback; return why it is dropped, or None."""
        self._now = heard.now
        heard.streams.append(NO_STREAM)
        if not heard.is_unicast:
            return "not_for_us"
        return self.objects.feedback(heard.source, feedback, heard.now)

    def admit(self, source: int, stream_id: int) -> Admission:
        """Return what the table says about an object; stream 0: not yet known."""
        if not stream_id:
            taken = [each for each in self._table.every() if self._may_take(each, source)]
            is_wanted = any(self._is_wanted(each, source) for each in taken)
            others = sorted(set(self._table.nodes) - {source})
            reason = None if taken else Reason.NOT_SUBSCRIBED
            return self._among(others, Admission(reason, is_wanted))
        is_open = self._is_open(source, stream_id)
        stream = self._table.get(stream_id)
        if stream is None or not isinstance(stream.spec, TopicSpec):
            return Admission(Reason.NOT_SUBSCRIBED if is_open else None, is_open=is_open)
        if not self._may_take(stream, source):
            return Admission(Reason.NOT_SUBSCRIBED, is_open=is_open)
        # Whose key it is, is not known before the manifest has come.
        listed = stream.receivers((self._address,), self._table.nodes)
        others = [each for each in listed if each != source]
        admission = Admission(
            is_wanted=self._is_wanted(stream, source),
            is_open=is_open,
            largest_bytes=stream.spec.max_bytes,
            keeps=stream.spec.journal,
            stream_digest=stream.digest,
        )
        return self._among(others, admission)

    def claim(self, source: int, manifest: Manifest, *, is_turn: bool) -> Claim:
        """Return whether a complete object may be delivered now."""
        return self._receiving.claim(
            self._table.by_id(manifest.stream_id),
            source,
            manifest.instance,
            SequenceSlot(manifest.lineage, manifest.number),
            self._now,
            is_turn=is_turn,
        )

    def is_over(self, source: int, manifest: Manifest) -> bool:
        """Return whether an object is known to be delivered or given up, before it is complete."""
        slot = SequenceSlot(manifest.lineage, manifest.number)
        return self._receiving.is_over(source, manifest.stream_id, manifest.instance, slot)

    def unwanted(self, source: int, stream_id: int, *, is_alone: bool) -> None:
        """Note that an unwanted object is under way, perhaps for this node alone."""
        if self._is_open(source, stream_id):
            stream = self._table.by_id(stream_id)
            self._subscriptions.sample_received(source, stream, self._now, is_alone=is_alone)

    def expect(self, source: int, manifest: Manifest) -> None:
        """Note that an object is under way."""
        slot = SequenceSlot(manifest.lineage, manifest.number)
        self._receiving.expect(source, manifest.stream_id, manifest.instance, slot)

    def deliver(self, arrived: ObjectReceived) -> None:
        """Deliver a complete object."""
        manifest = arrived.manifest
        stream = self._table.by_id(manifest.stream_id)
        slot = SequenceSlot(manifest.lineage, manifest.number)
        age, received_at = NO_AGE, arrived.received.received_at
        aged_at = instant_of(arrived.aged_at, self._now)
        if stream.qos.stamp is Stamp.AGE and aged_at is not None:
            age = arrived.age.later(ns_to_seconds(received_at - aged_at))
        try:
            stream.keys.key(arrived.source, manifest.instance)
            value = stream.codec.decode(arrived.payload)
            sample = SampleReceived(
                stream_id=stream.stream_id,
                source=arrived.source,
                instance=manifest.instance,
                value=value,
                encoding=manifest.encoding or stream.encoding,
                age_s=age.seconds,
                age_error_s=age.error_s,
                received_at=received_at,
                metrics=arrived.received.metrics,
                again=arrived.again,
            )
        except (PayloadError, UnknownStreamError):
            self._stats.drop("payload")
            sample = None
        if arrived.again:  # its slot is passed already
            self._receiving.hand_on_left(sample, self._now)
            return
        key = (arrived.source, stream.stream_id, manifest.instance)
        self._receiving.take(stream, key, slot, sample, self._now)

    # Below the methods above

    def _is_open(self, source: int, stream_id: int) -> bool:
        """Return whether both ends are known to define a stream in the same way."""
        epoch = self._handshake.peer(source).epoch
        return self._handshake.verdict(source, epoch, stream_id, self._now) is None

    def _may_take(self, stream: Stream, source: int) -> bool:
        """Return whether a large sample of a stream may be for this node."""
        is_reliable = stream.qos.reliability is Reliability.RELIABLE
        is_ours = stream.may_publish(source) and stream.may_subscribe(self._address)
        return isinstance(stream.spec, TopicSpec) and is_reliable and is_ours

    def _is_wanted(self, stream: Stream, source: int) -> bool:
        return not stream.is_on_demand or source in self._subscriptions.wanted(stream.stream_id)

    def _among(self, receivers: list[int], admission: Admission) -> Admission:
        """Add this node's rank among the receivers to an admission."""
        if self._address not in receivers:
            return admission
        rank = receivers.index(self._address)
        return msgspec.structs.replace(admission, rank=rank, others=len(receivers) - 1)

    def _send(
        self,
        delivery_id: int,
        stream: Stream,
        payload: bytes,
        slot: SequenceSlot,
        instance: Instance,
        encoding: str | None,
        *,
        made_at: Made,
        expires_at: int | None,
        now: int,
        but: Set[int] = frozenset(),
        is_again: bool = False,
    ) -> None:
        """Send an object to the receivers of its key, but for those that have it."""
        subscribers = self._subscriptions.subscribers(stream)
        receivers = tuple(
            each
            for each in stream.receivers(instance, self._table.nodes)
            if each != self._address
            and each not in but
            and (subscribers is None or each in subscribers)
        )
        if not receivers:
            raise LocalError(
                f"{stream.name}: nobody is listed who could receive an object",
                hint="list the nodes, or the subscribers of the stream",
            )
        self.objects.publish(
            delivery_id,
            stream.stream_id,
            payload,
            now,
            instance=instance,
            encoding=encoding,
            lineage=slot.lineage,
            number=slot.number,
            receivers=receivers,
            stream_digest=stream.digest,
            keep=stream.journals_sent and not is_again,
            priority=stream.qos.priority,
            exclusive=stream.qos.exclusive,
            lifespan_s=stream.qos.lifespan_s,
            expires_at=expires_at,
            has_age=stream.qos.stamp is Stamp.AGE,
            made_at=made_at,
        )

    def _refuse(self, order: StoredObject) -> str:
        """Return why an outgoing object from before the restart cannot be resumed, or ''."""
        stream = self._table.get(order.stream_id)
        if stream is None or stream.digest != order.stream_digest:
            return OTHER_STREAM
        slot = SequenceSlot(order.lineage, order.number)
        if self._slots.restore(stream, order.instance, slot, order.object_id, order.receivers):
            return ""
        return NO_COUNT

    def _give_up(self, order: StoredObject, why: str, now: int) -> None:
        self._emit(given_up(order.stream_id, order.object_id, why, now))

    def _progress(self, progress: ObjectProgress | BulkChanged) -> None:
        self._emit(progress)
        if isinstance(progress, BulkChanged):
            return
        outcome = _OUTCOMES.get(progress.state)
        if progress.object_id is not None and outcome is not None:
            self._slots.ended(
                progress.object_id, outcome, self._now, progress.detail, progress.missing
            )
