"""Discovery of rmw_desert: beacons that announce a node's entities, and requests for them.

A node of rmw_desert sends a *beacon* for each publisher, subscription, client and service that it
makes, a *request* when it starts, and all its beacons again when it hears a request. Its
command-line tools list entities from these. A beacon takes 75 to 140 bytes, and data flow without
it, so this node sends none unless the two topics have ids.

A node announces the entities in its stream table. A beacon waits at the lowest priority and
replaces one for the same entity that still waits.
"""

from collections.abc import Callable, Iterator
from typing import Final

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.profiles.entities import DiscoverySpec, EntityKind, RosEntitySeen
from zacoustic.core.schedule.queue import SAMPLE_LANE, QueuedRecord, TransmitQueue
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.core.values.rmw_desert.messages import Kind, Message, encode_head
from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.errors import LocalError

BEACON_TOPIC: Final = "/discovery"
REQUEST_TOPIC: Final = "/discovery_request"
"""Names of the two topics in the list of allowed topics."""

_GID_BYTES: Final = 16
_BEACON_QOS: Final = Qos(priority=Priority.BACKGROUND, depth=1)
_REQUEST_QOS: Final = Qos(priority=Priority.DATA_LOW, depth=1)
BEACON: Final = TypeSpec(
    name="Beacon",
    fields=(
        FieldSpec(name="node", type="string"),
        FieldSpec(name="namespace", type="string"),
        FieldSpec(name="kind", type="int32", range=(0, 3)),
        FieldSpec(name="gid", type="bytes", max_length=_GID_BYTES * 4),
        FieldSpec(name="topic", type="string"),
        FieldSpec(name="type", type="string"),
        FieldSpec(name="leaves", type="bool"),
    ),
)
"""The fields of a beacon."""


class Discovery:
    """The beacons and requests of one node.

    Args:
        address: Address of the node.
        table: Its streams.
        spec: The stream ids of beacons and requests.
        queue: Takes beacons and requests.
        emit: Takes the beacons of other nodes.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        spec: DiscoverySpec,
        queue: TransmitQueue,
        emit: Callable[[RosEntitySeen], None],
    ) -> None:
        self._address = address
        self._table = table
        self._spec = spec
        self._queue = queue
        self._emit = emit
        self._codec = RmwDesertCodec(BEACON, head_items=2, head_bytes=3)
        self._has_begun = False

    def begin(self, now: int) -> None:
        """Send the request and the beacons when the link first comes up; later, do nothing."""
        if self._has_begun:
            return
        self._has_begun = True
        if self._spec.request_id is not None:
            self._say(self._spec.request_id, b"", now, qos=_REQUEST_QOS)
        self._announce(now)

    def receive(self, message: Message, now: int) -> str | None:
        """Take a discovery message; return why it is dropped, or None."""
        if message.kind is Kind.SAMPLE and message.stream_id == self._spec.request_id:
            self._announce(now)
            return None
        if message.kind is not Kind.SAMPLE or message.stream_id != self._spec.beacon_id:
            return "unknown_stream"
        try:
            beacon = self._codec.decode(message.fields)
        except PayloadError:
            return "payload"
        kind = EntityKind(beacon.pop("kind"))
        self._emit(RosEntitySeen(kind=kind, seen_at=now, **beacon))
        return None

    def _announce(self, now: int) -> None:
        if self._spec.beacon_id is None:
            return
        for kind, stream, type_name in self._entities():
            beacon = {
                "node": self._spec.node_name,
                "namespace": "/",
                "kind": kind,
                "gid": bytes((self._address, kind, stream.stream_id)).ljust(_GID_BYTES, b"\0"),
                "topic": f"/{stream.name.lstrip('/')}",
                "type": type_name,
                "leaves": False,
            }
            try:
                fields = self._codec.encode(beacon)
            except LocalError:  # the name is too long for a beacon; the stream works without
                continue
            self._say(self._spec.beacon_id, fields, now, which=(kind, stream.stream_id))

    def _entities(self) -> Iterator[tuple[EntityKind, Stream, str]]:
        """Yield the entities of this node: kind, stream, name of the type."""
        for stream in self._table:
            spec = stream.spec
            if isinstance(spec, TopicSpec):
                name = spec.type_name or ""
                if stream.may_publish(self._address):
                    yield EntityKind.PUBLISHER, stream, name
                if stream.may_subscribe(self._address):
                    yield EntityKind.SUBSCRIPTION, stream, name
            elif isinstance(spec, ServiceSpec):
                if spec.server == self._address:
                    yield EntityKind.SERVICE, stream, spec.response_type or ""
                else:
                    yield EntityKind.CLIENT, stream, spec.request_type or ""

    def _say(
        self,
        stream_id: int,
        fields: bytes,
        now: int,
        *,
        which: tuple[int, ...] = (),
        qos: Qos = _BEACON_QOS,
    ) -> None:
        item = QueuedRecord(
            stream_id=stream_id,
            destination=BROADCAST,
            code=Kind.SAMPLE,
            head=encode_head(stream_id),
            payload=fields,
            queued_at=now,
        )
        key = (stream_id, SAMPLE_LANE, *which)
        if self._queue.fits(item):
            self._queue.replace(key, item, qos)
