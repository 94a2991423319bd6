"""Samples that fit no frame: a reliable topic hands them on as objects, and takes them back.

The table is asked here, so that `zacoustic.core.objects` knows no streams: who is to have an
object, whether this node wants one that arrives, and whether both ends define its stream in the
same way. An object that is complete before that is known waits for it.
"""

import random
from collections.abc import Callable, Mapping
from typing import Final

from zacoustic.core.demand.demand import Demand
from zacoustic.core.events import (
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    Event,
    SampleReceived,
)
from zacoustic.core.handshake import Handshake
from zacoustic.core.journal import JournalPort
from zacoustic.core.keys import Instance
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.objects.objects import ObjectLimits, Objects
from zacoustic.core.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.objects.receiving import Gate, ObjectReceived
from zacoustic.core.objects.sending import Sending
from zacoustic.core.objects.wire import Reason
from zacoustic.core.payload import PayloadError
from zacoustic.core.stats import EngineStats
from zacoustic.core.streams import Stream, StreamTable, TopicSpec
from zacoustic.errors import LocalError, UnknownStreamError

_OUTCOMES: Final = {
    ObjectState.DELIVERED: DeliveryOutcome.DELIVERED,
    ObjectState.REFUSED: DeliveryOutcome.REFUSED,
    ObjectState.CANCELLED: DeliveryOutcome.CANCELLED,
    ObjectState.EXPIRED: DeliveryOutcome.EXPIRED,
}


class LargeSamples:
    """The objects of one node, and their topics.

    Args:
        address: Address of the node.
        table: Its streams.
        handshake: Knows whether the tables agree.
        demand: Knows who has subscribed to on-demand topics.
        journal: Keeps what is to survive.
        stats: Counts.
        rng: Source of randomness.
        emit: Takes events.
        hand_on: Takes samples.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        handshake: Handshake,
        demand: Demand,
        journal: JournalPort,
        stats: EngineStats,
        rng: random.Random,
        emit: Callable[[Event], None],
        hand_on: Callable[[SampleReceived], None],
    ) -> None:
        self._address = address
        self._table = table
        self._handshake = handshake
        self._demand = demand
        self._stats = stats
        self._emit = emit
        self._hand_on = hand_on
        self._now = 0
        self.objects = Objects(
            epoch=handshake.epoch,
            limits=ObjectLimits(),
            rng=rng,
            gate=self._gate,
            emit=self._progress,
            deliver=self._deliver,
            on_stored=self._stored,
            journal=journal,
        )

    def recover(self, stored: Mapping[str, bytes]) -> int:
        """Go on with what a former life has left; returns the largest delivery id of it."""
        return self.objects.restore(stored)

    def publish(
        self,
        delivery_id: int,
        stream: Stream,
        payload: bytes,
        now: int,
        *,
        instance: Instance,
        encoding: str | None,
    ) -> None:
        """Send a sample as an object; `DeliveryEnded` will name the delivery id.

        Raises:
            LocalError: Nobody is listed who could receive it.
            PayloadTooLargeError: It is too large for an object.
            QueueFullError: Too many objects are on their way.
        """
        self._now = now
        audience = self._demand.audience(stream)
        receivers = tuple(
            each
            for each in self._receivers(stream)
            if each != self._address and (audience is None or each in audience)
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
            destination=receivers[0] if len(receivers) == 1 else BROADCAST,
            receivers=receivers,
            priority=stream.qos.priority,
            exclusive=stream.qos.exclusive,
            lifespan_s=stream.qos.lifespan_s,
        )

    def cancel_stream(self, stream: Stream, now: int) -> None:
        """Give up all objects of a topic: nobody subscribes to it any more."""
        self._now = now
        for object_id in self.objects.under_way(stream.stream_id):
            self.objects.cancel(object_id, now)

    def at(self, now: int) -> "LargeSamples":
        """Note the instant, for what is asked of the table and told to the application."""
        self._now = now
        return self

    # Below the methods above

    def _receivers(self, stream: Stream) -> list[int]:
        assert isinstance(stream.spec, TopicSpec)
        listed = stream.spec.subscribers
        return sorted(self._table.nodes if listed is None else listed)

    def _gate(self, source: int, stream_id: int) -> Gate:
        if not stream_id:
            others = sorted(set(self._table.nodes) - {source})
            return Gate(place=others.index(self._address) if self._address in others else 0)
        epoch = self._handshake.last_epoch(source)
        is_open = self._handshake.verdict(source, epoch, stream_id, self._now) is None
        stream = self._table.get(stream_id)
        if stream is None or not isinstance(stream.spec, TopicSpec):
            return Gate(Reason.NOT_SUBSCRIBED if is_open else None, is_open)
        if not (stream.may_publish(source) and stream.may_subscribe(self._address)):
            return Gate(Reason.NOT_SUBSCRIBED, is_open)
        others = [each for each in self._receivers(stream) if each != source]
        return Gate(None, is_open, others.index(self._address) if self._address in others else 0)

    def _deliver(self, arrived: ObjectReceived) -> None:
        manifest = arrived.manifest
        stream = self._table.by_id(manifest.stream_id)
        try:
            stream.keys.key(arrived.source, manifest.instance)
            value = stream.codec.decode(arrived.payload)
        except (PayloadError, UnknownStreamError):
            self._stats.drop("payload")
            return
        self._hand_on(
            SampleReceived(
                stream_id=stream.stream_id,
                source=arrived.source,
                instance=manifest.instance,
                value=value,
                encoding=manifest.encoding or stream.encoding,
                received_at=arrived.received.received_at,
                metrics=arrived.received.metrics,
            )
        )

    def _progress(self, progress: ObjectProgress) -> None:
        self._emit(progress)
        outcome = _OUTCOMES.get(progress.state)
        if progress.object_id is None or outcome is None:
            return
        self._emit(
            DeliveryEnded(
                delivery_id=progress.object_id,
                stream_id=progress.stream_id,
                outcome=outcome,
                missing=progress.missing,
                ended_at=self._now,
                detail=progress.detail,
            )
        )

    def _stored(self, sending: Sending) -> None:
        stream = self._table.get(sending.stream_id)
        if stream is not None and isinstance(stream.spec, TopicSpec) and stream.spec.journal:
            self._emit(DeliveryStored(delivery_id=sending.object_id, stream_id=sending.stream_id))
