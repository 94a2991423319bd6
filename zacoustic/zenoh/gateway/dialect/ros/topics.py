"""Topics of ROS 2: CDR and attachments, under the keys of rmw_zenoh."""

import threading
import time
from collections.abc import Sequence
from typing import Final

import zenoh

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.base.qos import Stamp
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.schedule.hosttime import EARLIEST_UTC_NS
from zacoustic.core.streams.table import Stream
from zacoustic.core.values.age import OLDEST_S
from zacoustic.ros.attachment import Attachment, read_attachment
from zacoustic.ros.names import RosKey
from zacoustic.ros.streams import RosTopic
from zacoustic.ros.tokens import Entity, Token, gid_of
from zacoustic.zenoh.gateway.dialect.dialects import Declared, Reading, TopicDialect, Written
from zacoustic.zenoh.gateway.dialect.lastvalues import LastValue
from zacoustic.zenoh.gateway.dialect.mailbox import Parcel
from zacoustic.zenoh.gateway.dialect.ros.graph import Graph
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.session.session import ZenohSession

CDR: Final = "application/cdr"
"""Zenoh encoding of the messages; ROS ignores it."""

_AHEAD_NS: Final = 1_000_000_000
"""A stamp may be ahead by this much: the clocks of two computers differ."""


class Teller:
    """Numbers the messages of one endpoint.

    Args:
        token: Token of the endpoint.
        wall_clock: Returns UTC, ns since 1970.
    """

    def __init__(self, token: Token, wall_clock: Clock) -> None:
        self.token = token
        self._gid = gid_of(token)
        self._wall_clock = wall_clock
        self._sequence = 0
        self._guard = threading.Lock()

    def attachment(self, age_s: float | None = 0.0) -> bytes:
        """Return the attachment of the next message, which was made `age_s` ago; None: unknown.

        Of unknown age it has the time stamp 0, as ROS has it for what it does not know.
        """
        with self._guard:
            self._sequence += 1
            sequence = self._sequence
        stamp_ns = 0 if age_s is None else self._wall_clock() - seconds_to_ns(age_s)
        return Attachment(sequence=sequence, stamp_ns=stamp_ns, gid=self._gid).encode()


class RosTopicDialect(TopicDialect):
    """One topic.

    Args:
        stream: The topic.
        zenoh_session: The session.
        topic: Its ROS side.
        graph: Its endpoints.
        input_errors: Takes the errors of stamps.
        wall_clock: Returns UTC, ns since 1970.
        clock: Source of instants.
    """

    def __init__(
        self,
        stream: Stream,
        zenoh_session: ZenohSession,
        topic: RosTopic,
        graph: Graph,
        input_errors: InputErrors,
        wall_clock: Clock,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        super().__init__(stream, zenoh_session, clock)
        self._topic = topic
        self._graph = graph
        self._input_errors = input_errors
        self._wall_clock = wall_clock
        whole = topic.key(graph.domain, "x")
        self._before, self._behind = f"{whole.domain}/", f"/{whole.type}/{whole.hash}"
        self._tellers: dict[str, Teller] = {}
        self._subscriptions: dict[str, Token] = {}

    def key(self, stream_key: str) -> str:
        """Return the key of rmw_zenoh."""
        return f"{self._before}{stream_key}{self._behind}"

    def stream_key(self, key: str) -> str:
        """Return the key without domain, type and hash."""
        return key.removeprefix(self._before).removesuffix(self._behind)

    def ros_key(self, stream_key: str) -> RosKey:
        """Return the parts of the key of rmw_zenoh."""
        return self._topic.key(self._graph.domain, stream_key)

    def is_marked(self, attachment: bytes) -> bool:
        """Return whether its gid belongs to a gateway."""
        read = read_attachment(attachment)
        return read is not None and self._graph.is_gateway(read.gid)

    def publisher_of(self, sample: zenoh.Sample) -> bytes:
        """Return the gid of a message's publisher."""
        attachment = None if sample.attachment is None else sample.attachment.to_bytes()
        read = None if attachment is None else read_attachment(attachment)
        return b"" if read is None or not self.is_latched else read.gid

    @property
    def sees_publishers(self) -> bool:
        """Return that it does, by tokens."""
        return True

    def has_gone(self, publisher: bytes) -> bool:
        """Return whether the token of a publisher was there and is gone."""
        return self._graph.has_gone(publisher)

    def read(self, parcel: Parcel) -> Reading:
        """Read CDR; if the stamp becomes an age, it gives the sample its age.

        What this computer's clock cannot have shown tells no age: a stamp of zero, and one of
        another clock, such as that of a simulation. It crosses as unknown. But a message that is
        stamped ahead was made as it came, whatever its clock.
        """
        value, stamp_ns = self._topic.message.read(parcel.payload)
        if stamp_ns is None:
            return Reading(value=value)
        if stamp_ns == 0:
            return Reading(value=value, is_dated=False)
        age_ns = self._wall_clock() - stamp_ns
        if stamp_ns < EARLIEST_UTC_NS:
            self._warn(
                f"header.stamp is {stamp_ns / 1e9:.0f} s since 1970, which is not by the clock of "
                "this computer: the age crosses as unknown"
            )
            return Reading(value=value, is_dated=False)
        if age_ns < -_AHEAD_NS:
            self._warn(
                f"header.stamp is {-age_ns / 1e9:.0f} s ahead of the clock of this computer: the "
                "message counts as made when it came"
            )
            return Reading(value=value)
        if age_ns > seconds_to_ns(OLDEST_S):
            self._warn(f"header.stamp is {age_ns / 86_400e9:.0f} days old: it crosses as 30 days")
        return Reading(value=value, age_ns=max(age_ns, 0))

    def write(self, key: str, event: SampleReceived) -> Written:
        """Write CDR; an age becomes a stamp by the clock of this computer."""
        age_s: float | None = 0.0  # on a topic without ages its source is the gateway, now
        stamp_ns: int | None = None
        if self.stream.qos.stamp is Stamp.AGE:
            age_s = event.age_s
            if age_s is None:
                self._warn(f"node {event.source} does not know a sample's age: header.stamp is 0")
            else:
                stamp_ns = self._wall_clock() - seconds_to_ns(age_s)
                if age_s >= OLDEST_S:
                    self._warn("a sample is at least 30 days old: header.stamp says 30 days")
        payload = self._topic.message.write(event.value, stamp_ns)
        teller = self._teller(self.stream_key(key))
        return Written(payload=payload, encoding=CDR, attachment=teller.attachment(age_s))

    def mark_of(self, last: LastValue, now: int) -> bytes | None:
        """Return its attachment."""
        return last.attachment

    def mark_again(self, last: LastValue) -> bytes:
        """Return an attachment of the publisher's current token."""
        age_s = last.age_s if self.stream.qos.stamp is Stamp.AGE else 0.0
        return self._teller(self.stream_key(last.key)).attachment(age_s)

    def delete(self, key: str, source: int) -> None:
        """Drop the samples for late joiners; ROS has no deletes to report to present ones."""
        if self._latched is not None:
            self._latched.forget(key)

    def offer(self, sources: Sequence[int]) -> Sequence[Declared]:
        """Declare the publishers of remote topics; in the worker."""
        names = self._names(sources)
        if self._latched is not None:
            # Late joiners look for the caches of the publishers that they see.
            self._latched.declare(*map(self.key, names))
        tokens = [self._teller(name).token for name in names]
        return [*super().offer(sources), *self._graph.announce(tokens)]

    def hear(self, address: int) -> Sequence[Declared]:
        """Declare the subscription to this node's topics; in the worker."""
        (name,) = self._names([address])
        if name not in self._subscriptions:
            self._subscriptions[name] = self._graph.endpoint(
                Entity.SUBSCRIPTION, self.ros_key(name), self._topic.qos
            )
        return self._graph.announce([self._subscriptions[name]])

    def expect(self, addresses: Sequence[int]) -> None:
        """Report local endpoints that do not fit."""
        for name in self._names(addresses):
            self._graph.expect(self.stream.name, self.ros_key(name), self._topic.qos)

    # Below the methods above

    def _warn(self, text: str) -> None:
        self._input_errors.add(self.stream.name, "stamp", text)

    def _names(self, sources: Sequence[int]) -> list[str]:
        keys = self.stream.keys
        if not keys.is_named_by_node:
            return [self.stream.name]
        return [keys.key(source, ()) for source in sources if source in keys.node_names]

    def _teller(self, name: str) -> Teller:
        # Either the loop or the worker comes first; `setdefault` is atomic.
        known = self._tellers.get(name)
        if known is None:
            token = self._graph.endpoint(Entity.PUBLISHER, self.ros_key(name), self._topic.qos)
            known = self._tellers.setdefault(name, Teller(token, self._wall_clock))
        return known
