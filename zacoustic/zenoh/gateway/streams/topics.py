"""Topics: local samples to the engine, received samples to the local network.

The topic's dialect defines their local form. A sample that cannot be read or that its type does not
allow is counted and reported as an input error; it does no harm.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.base.qos import Priority, Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import PayloadInvalidError, ZacousticError
from zacoustic.zenoh.gateway.dialect.dialects import Dialects, Reading, Written
from zacoustic.zenoh.gateway.dialect.lastvalues import LastValue, LastValues
from zacoustic.zenoh.gateway.dialect.mailbox import Parcel
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.gateway.streams.intake import Intake
from zacoustic.zenoh.gateway.streams.kept import KeptSamples
from zacoustic.zenoh.gateway.streams.localpublishers import LocalPublishers
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery

_APART_S: Final = 0.1
"""Time for one event to reach two local gateways, between their frames."""


class Topics:
    """The topics of one gateway; for the loop, except for `post`.

    Args:
        table: All streams.
        redundant: The jobs of the local gateways.
        input_errors: Takes the errors of local samples.
        dialects: Their local forms.
        kept: Samples of latched topics, in the journal.
        clock: Source of instants.
        ring: Wakes the loop, which then calls `drain`.
        submit: Runs a step in Zenoh's worker.
    """

    def __init__(
        self,
        table: StreamTable,
        redundant: RedundantGateways,
        input_errors: InputErrors,
        dialects: Dialects,
        kept: KeptSamples,
        *,
        clock: Clock,
        ring: Callable[[], None],
        submit: Callable[[Callable[[], object]], None],
    ) -> None:
        self.last_values = LastValues()
        self._kept = kept
        self._table = table
        self._redundant = redundant
        self._input_errors = input_errors
        self._clock = clock
        self.dialects = {
            stream.stream_id: dialects.topic(stream)
            for stream in table
            if isinstance(stream.spec, TopicSpec)
        }
        """The local form of each topic, by stream id."""
        self.intake = Intake(self.dialects, self._turn_ns, clock=clock, ring=ring, submit=submit)
        """The local samples that the engine does not have yet."""
        self._publishers = {
            stream_id: LocalPublishers(
                dialect.stream.keys.publishers,
                dialect.has_gone,
                partial(input_errors.add, dialect.stream.name, "publishers"),
                sees_them=dialect.sees_publishers,
            )
            for stream_id, dialect in self.dialects.items()
            if dialect.is_latched
        }

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the samples for late joiners from before the restart."""
        for stream, value in self._kept.recover(stored, self._table):
            dialect = self.dialects.get(stream.stream_id)
            if dialect is None or not dialect.is_latched:
                self._kept.forget(stream, value.key)
                continue
            attachment = dialect.mark_again(value)
            self.last_values.keep(msgspec.structs.replace(value, attachment=attachment))
            dialect.put(
                value.key,
                Written(
                    payload=value.payload,
                    encoding=value.encoding,
                    attachment=attachment,
                    expires_at=value.expires_at(stream.qos.lifespan_s),
                    publisher=value.publisher,
                ),
            )

    def drain(self, engine: Engine, now: int) -> None:
        """Publish the local samples that the engine can use."""
        for stream, parcels in self.intake.due(engine, now):
            for parcel in parcels:
                self._forward(engine, stream, parcel, now)

    def before_frames(self, engine: Engine, now: int) -> None:
        """Publish the newest local samples, if a frame can be made of them."""
        if self.intake.has_waited(engine, now):
            self.drain(engine, now)

    def deliver(self, event: SampleReceived) -> None:
        """Put a received sample on the local network, and keep it for `answer`."""
        if self._redundant.shares_network(event.source, self._table.by_id(event.stream_id)):
            return
        dialect = self.dialects[event.stream_id]
        stream, event = dialect.stream, event.aged(self._clock())
        key = dialect.key(stream.keys.key(event.source, event.instance))
        delivers = self._redundant.delivers(stream)
        if event.deleted:
            self.last_values.forget(key)
            self._kept.forget(stream, key)
            if delivers:
                dialect.delete(key, event.source)
            return
        try:
            written = dialect.write(key, event)
        except PayloadInvalidError as error:
            self._input_errors.add(stream.name, "payload", str(error))
            return
        value = LastValue(
            key=key,
            stream_id=stream.stream_id,
            payload=written.payload,
            encoding=written.encoding,
            source=event.source,
            age_s=event.age_s,
            age_error_s=event.age_error_s,
            received_at=event.received_at,
            attachment=written.attachment,
            publisher=stream.keys.publisher(event.instance),
        )
        self.last_values.keep(value)
        if dialect.is_latched:
            self._kept.keep(stream, value)
        if delivers:
            expires_at = value.expires_at(stream.qos.lifespan_s)
            publisher = value.publisher
            dialect.put(
                key, msgspec.structs.replace(written, expires_at=expires_at, publisher=publisher)
            )

    def answer(self, held: HeldQuery, stream_id: int) -> None:
        """Answer a `get` on a topic with the last values of the keys asked for."""
        asked = held.query.key_expr
        now = self._clock()
        dialect = self.dialects[stream_id]
        held.answer(
            [
                Answer(
                    key=last.key,
                    payload=last.payload,
                    encoding=last.encoding,
                    attachment=dialect.mark_of(last, now),
                )
                for last in self.last_values.of(stream_id)
                if asked.intersects(last.key)
            ]
        )

    def _turn_ns(self, stream: Stream, engine: Engine) -> int:
        """Return how long a sample waits for frames of earlier gateways about the same event."""
        link = engine.capabilities
        can_wait = (
            stream.qos.reliability is Reliability.BEST_EFFORT
            and stream.qos.priority is not Priority.REAL_TIME
        )
        if link is None or not can_wait:
            return 0
        frame_ns = link.airtime_ns(link.mtu_bytes) + seconds_to_ns(link.gap_s + _APART_S)
        return self._redundant.rank * frame_ns

    def _numbers(self, stream: Stream, parcel: Parcel) -> list[int]:
        """Return the number of a sample's publisher; of a deleted key, those of all publishers."""
        publishers = self._publishers.get(stream.stream_id)
        if publishers is None:
            return [0]
        if parcel.deleted:
            return publishers.numbers(parcel.key)
        return [publishers.number(parcel.key, parcel.publisher)]

    def _forward(self, engine: Engine, stream: Stream, parcel: Parcel, now: int) -> None:
        dialect = self.dialects[stream.stream_id]
        instance = stream.keys.match(dialect.stream_key(parcel.key), engine.address)
        if instance is None:
            text = f"the key {parcel.key} is not one of this stream"
            self._input_errors.add(stream.name, "unknown_key", text)
            return
        try:
            reading = Reading(value=None) if parcel.deleted else dialect.read(parcel)
            queued_at = parcel.arrived_at if reading.age_ns is None else now - reading.age_ns
            for number in self._numbers(stream, parcel):
                engine.publish(
                    stream.stream_id,
                    reading.value,
                    now,
                    instance=stream.keys.of_publisher(instance, number),
                    encoding=reading.encoding,
                    delete=parcel.deleted,
                    queued_at=queued_at,
                    is_dated=reading.is_dated,
                )
        except PayloadInvalidError as error:
            self._input_errors.add(stream.name, "payload", str(error))
        except ZacousticError as error:
            self._input_errors.add(stream.name, "refused", str(error))
