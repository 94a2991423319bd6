"""Dialects: the form of a stream on the local network.

Frames are the same for all local programs. On the local network, a topic is a key with samples of
some form, each with an attachment that marks samples from the channel; a service is a key with
queries and replies. A dialect defines these forms. `PlainTopic` and `PlainService` are for Zenoh
programs: keys as in the configuration, CBOR or JSON, and a mark (`zenoh_session.marker`). ROS 2
nodes have another one: `zacoustic.zenoh.gateway.dialect.ros`.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import msgspec
import zenoh

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.base.qos import Durability, Stamp
from zacoustic.core.engine.events import CallKey, SampleReceived
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec
from zacoustic.core.streams.table import Stream
from zacoustic.zenoh.ends.zenohcalls import CallForm
from zacoustic.zenoh.gateway.dialect.lastvalues import LastValue
from zacoustic.zenoh.gateway.dialect.latched import LatchedKeys
from zacoustic.zenoh.gateway.dialect.mailbox import Parcel
from zacoustic.zenoh.gateway.dialect.translation import from_local, to_local
from zacoustic.zenoh.session.asking.goals import ActionForm, ActionKey, ActionMessages
from zacoustic.zenoh.session.latching import latched_subscriber
from zacoustic.zenoh.session.marker import Marker, is_marked
from zacoustic.zenoh.session.session import ZenohSession


class Declared(Protocol):
    """A declaration on the local network that can be withdrawn."""

    def undeclare(self) -> Any:  # noqa: ANN401 (Zenoh's own)
        """Withdraw it; in the worker."""
        ...


class Reading(msgspec.Struct, frozen=True, kw_only=True):
    """A local sample, decoded."""

    value: Any
    """Value for the engine."""
    encoding: str | None = None
    """Its encoding if it differs from the stream's."""
    age_ns: int | None = None
    """Its age when it was read, ns; None: the age of its parcel."""
    is_dated: bool = True
    """Whether its age is known."""


class Written(msgspec.Struct, frozen=True, kw_only=True):
    """A sample from the channel, encoded."""

    payload: bytes
    """Payload for the local network."""
    encoding: str
    """Its Zenoh encoding."""
    attachment: bytes | None
    """Its attachment."""
    expires_at: int | None = None
    """Instant from which no late joiner gets it, ns; None: never."""
    publisher: int = 0
    """Number of its publisher on the remote node."""


class TopicDialect(ABC):
    """One topic.

    Args:
        stream: The topic.
        zenoh_session: The session.
        clock: Source of instants.
    """

    def __init__(
        self, stream: Stream, zenoh_session: ZenohSession, clock: Clock = time.monotonic_ns
    ) -> None:
        self.stream = stream
        self.zenoh_session = zenoh_session
        """The session of its declarations."""
        self._latched: LatchedKeys | None = None
        if stream.qos.durability is Durability.TRANSIENT_LOCAL:
            self._latched = LatchedKeys(stream.qos.depth, zenoh_session, stream.qos.priority, clock)
        self._began_utc_s = time.time()

    @property
    def is_latched(self) -> bool:
        """Return whether late subscribers get the last samples."""
        return self._latched is not None

    def key(self, stream_key: str) -> str:
        """Return the local key for a key, or key expression, of the stream."""
        return stream_key

    def stream_key(self, key: str) -> str:
        """Return the stream's key for a local key."""
        return key

    @abstractmethod
    def is_marked(self, attachment: bytes) -> bool:
        """Return whether a sample with this attachment came from the channel; on any thread."""

    @abstractmethod
    def read(self, parcel: Parcel) -> Reading:
        """Decode a local sample.

        Raises:
            PayloadInvalidError: It cannot be read.
        """

    @abstractmethod
    def write(self, key: str, event: SampleReceived) -> Written:
        """Encode a sample from the channel for a local key.

        Raises:
            PayloadInvalidError: It cannot be written.
        """

    @abstractmethod
    def mark_of(self, last: LastValue, now: int) -> bytes | None:
        """Return the attachment of a stored value."""

    @abstractmethod
    def mark_again(self, last: LastValue) -> bytes:
        """Return the attachment of a value from before the restart that is put again."""

    def publisher_of(self, sample: zenoh.Sample) -> bytes:
        """Return what the network calls a sample's publisher; empty: unknown; on any thread.

        Only of latched topics. Zenoh's samples name it if their publisher numbers them; else their
        time stamp names its session, or the router that has stamped them.
        """
        if self._latched is None:
            return b""
        if sample.source_info is not None:
            return str(sample.source_info.source_id).encode()
        return b"" if sample.timestamp is None else bytes(sample.timestamp.get_id())

    @property
    def sees_publishers(self) -> bool:
        """Return whether the network shows which publishers are there."""
        return False

    def has_gone(self, publisher: bytes) -> bool:
        """Return whether a publisher was seen and is there no more."""
        return False

    def age_ns(self, sample: zenoh.Sample) -> int:
        """Return for how long a sample had been in its publisher's cache, ns; on any thread.

        It counts only for samples from before the gateway began: clocks of other computers may be
        wrong, and later samples come at once.
        """
        if self._latched is None or sample.timestamp is None:
            return 0
        put_utc_s = sample.timestamp.get_time().timestamp()
        if put_utc_s >= self._began_utc_s:
            return 0
        return seconds_to_ns(max(0.0, time.time() - put_utc_s))

    def put(self, key: str, written: Written) -> None:
        """Put a sample on the local network; into a cache if the topic is latched."""
        if self._latched is not None:
            self._latched.put(
                key,
                written.payload,
                written.encoding,
                written.attachment,
                expires_at=written.expires_at,
                source=written.publisher,
            )
            return
        self.zenoh_session.put(
            key,
            written.payload,
            encoding=written.encoding,
            priority=self.stream.qos.priority,
            attachment=written.attachment,
        )

    def delete(self, key: str, source: int) -> None:
        """Delete a key on the local network."""
        if self._latched is not None:
            self._latched.forget(key)
        self.zenoh_session.delete(
            key, priority=self.stream.qos.priority, attachment=Marker(acoustic=source).encode()
        )

    def subscribe(
        self, expression: str, take: Callable[[zenoh.Sample], None]
    ) -> Sequence[Declared]:
        """Subscribe to local samples, for a latched topic also to earlier ones; in the worker."""
        if self._latched is None:
            subscriber = self.zenoh_session.session.declare_subscriber(
                zenoh.KeyExpr(expression),
                self.zenoh_session.callback(take),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            return [subscriber]
        depth = self.stream.qos.depth
        return [latched_subscriber(self.zenoh_session, expression, take, depth)]

    def offer(self, sources: Sequence[int]) -> Sequence[Declared]:
        """Declare the publishers of remote nodes here; in the worker."""
        if self._latched is None:
            return []
        self._latched.declare()
        return [self._latched]


class PlainTopic(TopicDialect):
    """A topic of Zenoh."""

    def is_marked(self, attachment: bytes) -> bool:
        """Return whether it is a gateway's mark."""
        return is_marked(attachment)

    def read(self, parcel: Parcel) -> Reading:
        """Decode CBOR, JSON or bytes, by the encoding."""
        stream = self.stream
        value, encoding = from_local(parcel.payload, parcel.encoding, stream.type, stream.encoding)
        return Reading(value=value, encoding=encoding)

    def write(self, key: str, event: SampleReceived) -> Written:
        """Encode in the encoding of the publication."""
        stream = self.stream
        payload, encoding = to_local(event.value, stream.type, event.encoding, stream.encoding)
        mark = self._mark(event.source, event.age_s, event.age_error_s)
        return Written(payload=payload, encoding=encoding, attachment=mark)

    def mark_of(self, last: LastValue, now: int) -> bytes | None:
        """Return a mark with the current age."""
        return self._mark(last.source, last.age_at(now), last.age_error_s)

    def mark_again(self, last: LastValue) -> bytes:
        """Return a mark with its stored age."""
        return self._mark(last.source, last.age_s, last.age_error_s)

    def _mark(self, source: int, age_s: float | None, age_error_s: float | None) -> bytes:
        is_stamped = self.stream.qos.stamp is Stamp.AGE
        return Marker(
            acoustic=source, age_s=age_s, age_error_s=age_error_s, is_stamped=is_stamped
        ).encode()


class ServiceDialect(CallForm):
    """One service.

    Args:
        stream: The service.
    """

    def __init__(self, stream: Stream) -> None:
        self.stream = stream

    @property
    def key(self) -> str:
        """The local key."""
        return self.stream.name

    @abstractmethod
    def question_mark(self, call: CallKey) -> bytes:
        """Return the attachment of a call from the channel."""


class PlainService(ServiceDialect):
    """A service of Zenoh."""

    def is_marked(self, attachment: bytes) -> bool:
        """Return whether it is a gateway's mark."""
        return is_marked(attachment)

    def read_request(self, payload: bytes, encoding: object) -> tuple[object, str]:
        """Read CBOR, JSON or bytes; a request without payload is an empty one."""
        stream = self.stream
        if not payload and stream.type is not None:
            return {}, stream.encoding
        value, said = from_local(payload, encoding, stream.type, stream.encoding)
        return value, said or stream.encoding

    def write_response(self, value: object, encoding: str) -> tuple[bytes, str]:
        """Write in the encoding of the request."""
        return to_local(value, self.stream.response_type, encoding, self.stream.encoding)

    def write_request(self, value: object) -> tuple[bytes, str]:
        """Write in the encoding of the stream."""
        stream = self.stream
        return to_local(value, stream.type, stream.encoding, stream.encoding)

    def read_response(self, payload: bytes, encoding: object) -> object:
        """Decode by the encoding."""
        stream = self.stream
        return from_local(payload, encoding, stream.response_type, stream.encoding)[0]

    def answer_mark(self, asked: bytes | None) -> bytes:
        """Return a mark with the address of the server."""
        assert isinstance(self.stream.spec, ServiceSpec)
        return Marker(acoustic=self.stream.spec.server).encode()

    def question_mark(self, call: CallKey) -> bytes:
        """Return a mark with the address of the client, and the call id."""
        return Marker(acoustic=call.client, call=str(call)).encode()


class Dialects:
    """The dialect of each stream: plain ones, unless a subclass overrides that.

    Args:
        zenoh_session: The session of the streams.
        clock: Source of instants.
    """

    def __init__(self, zenoh_session: ZenohSession, clock: Clock = time.monotonic_ns) -> None:
        self._zenoh_session = zenoh_session
        self._clock = clock

    def topic(self, stream: Stream) -> TopicDialect:
        """Return the dialect of a topic."""
        return PlainTopic(stream, self._zenoh_session, self._clock)

    def service(self, stream: Stream) -> ServiceDialect:
        """Return the dialect of a service."""
        return PlainService(stream)

    def action(self, stream: Stream) -> ActionForm:
        """Return the form of the messages about an action's goals."""
        return ActionMessages(
            stream.name, stream.type, stream.feedback_type, stream.response_type, stream.encoding
        )

    def put_about_goals(
        self, stream: Stream, form: ActionForm
    ) -> Callable[[ActionKey, bytes], None]:
        """Return a function that puts feedback and status of remote goals."""
        assert isinstance(stream.spec, ActionSpec)
        mark = Marker(acoustic=stream.spec.server).encode()

        def put(which: ActionKey, payload: bytes) -> None:
            self._zenoh_session.put(
                form.key(which),
                payload,
                encoding=form.encoding,
                priority=stream.qos.priority,
                attachment=mark,
            )

        return put

    # Parts of a job beside subscribers and queryables

    async def open(self) -> None:
        """Begin to watch the local network, and become visible."""

    def declare(self, job: str, stream: Stream) -> Sequence[Declared]:
        """Declare what makes a job on a stream visible; in the worker."""
        return []

    def stands_back(self, stream: Stream) -> bool:
        """Return whether not to represent the server of a service or an action."""
        return False

    def note_peer(self, address: int, *, is_lost: bool) -> bool:
        """Note that a node was lost or is back; return whether jobs may have changed."""
        return False

    def visible(self, stream: Stream) -> bool:
        """Return whether programs can see the client of calls from the channel."""
        return False

    def settle(self) -> bool:
        """Process observations of the local network; return whether jobs may have changed."""
        return False

    def undeclare(self) -> None:
        """Become invisible; in the worker."""
