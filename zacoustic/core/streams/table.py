"""The stream table: which name is which byte, and what both ends must agree on.

A *stream* carries payloads with one type and one QoS, for a topic, a service or an action. Its id
is the first byte of each of its records, so a name of any length costs one byte. This only works
while both ends have the same table, so everything that changes the meaning of bytes goes into a
digest: of each stream, and of the whole table with its nodes. The digest excludes what only changes
*when* something is sent (priority, lifespan, intervals, the depth of a best-effort topic), or what
a node journals; each end may set these alone. It includes the timeouts of services and actions:
from them both ends derive how long a number must be remembered.

Some streams are in no table's digest, since nobody can define them differently: those of remote
commands (`zacoustic.core.transport.commands`), of the status, of keys and of commands about routes,
which every table has, and that of carried samples, if a topic is carried. A table that gives the id
of one to another stream lacks it, and so does one for another wire profile.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

import msgspec

from zacoustic.core.base.qos import Forward, Priority, Qos, Reliability, Stamp
from zacoustic.core.streams import rmwdesert as rmw_desert
from zacoustic.core.streams.carry import (
    CARRY_NAME,
    CARRY_STREAM_ID,
    CARRY_WILDCARD,
    FLEET_CARRY_NAME,
)
from zacoustic.core.streams.commands import (
    COMMANDS_STREAM_ID,
    COMMANDS_TIMEOUT_S,
    REQUEST_TYPE,
    RESPONSE_TYPE,
    command_types,
)
from zacoustic.core.streams.keydelivery import KEYS_STREAM_ID, KEYS_TIMEOUT_S
from zacoustic.core.streams.keys import Instance, KeyPattern
from zacoustic.core.streams.routing import ROUTING_STREAM_ID, ROUTING_TIMEOUT_S
from zacoustic.core.streams.specs import (
    CODECS,
    DENSE,
    DENSE_CODING,
    OPAQUE_CODECS,
    ActionSpec,
    ServiceSpec,
    StreamSpec,
    TopicSpec,
    check,
    check_times,
)
from zacoustic.core.streams.status import (
    STATUS_STREAM_ID,
    STATUS_TIMEOUT_S,
    STATUS_TYPE,
    status_types,
)
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.dense.model.prior import Model
from zacoustic.core.values.encoding import CBOR, OPAQUE
from zacoustic.core.values.payload import PayloadCodec, TypedCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import ConfigError, LocalError, UnknownStreamError

_CARRIED_DEPTH: Final = 4096
"""No carried sample supersedes another one: fewer are offered at once."""

EVERY_NODE: Final = 0
"""Stands for the address of a server where each node is one; the records name it."""

AGE_FIELD: Final = "zacoustic_age"
"""Field name of a sample's age in a dense block, as its code."""

_OCTETS_FIELD: Final = "octets"
_OCTETS: Final = TypeSpec(
    name="zacoustic/Octets", fields=(FieldSpec(name=_OCTETS_FIELD, type="bytes"),)
)
"""The type of untyped samples in a dense block."""

DIGEST_BYTES: Final = 4
"""Size of the digests of a stream and of a table, bytes."""


class Stream:
    """One row of the table, with the codecs and keys made from its spec.

    Raises:
        ConfigError: An unknown type, or a bad name, id, address or time; states the key, its value
            and what is allowed.
    """

    def __init__(
        self,
        spec: StreamSpec,
        types: TypeTable,
        node_names: Mapping[int, str],
        *,
        wire: WireProfile = WireProfile.NATIVE,
        is_built_in: bool = False,
    ) -> None:
        on_desert = wire is WireProfile.RMW_DESERT
        if on_desert:
            rmw_desert.check_spec(spec)
        elif not is_built_in:
            check(spec)
        if not is_built_in:
            check_times(spec)
        self.spec = spec
        self.is_built_in = is_built_in
        """Whether it is not the table's own: nobody defines it differently."""
        self.is_addressed = is_built_in and spec.stream_id == CARRY_STREAM_ID
        """Whether each key of it is for one node, whose address is its instance."""
        self.stream_id = spec.stream_id
        self.name = spec.name
        self.qos = spec.qos
        wildcards = spec.wildcards if isinstance(spec, TopicSpec) else ()
        publishers = spec.local_publishers if isinstance(spec, TopicSpec) else 1
        self.keys = KeyPattern(spec.name, wildcards, node_names, publishers)
        """The keys of the name."""
        names = _type_names(spec)
        used = [types.by_name(name) if name is not None else None for name in names.values()]
        if spec.outside == "clamp":
            used = [None if each is None else each.clamping() for each in used]
        codecs: list[PayloadCodec]
        if on_desert:
            keyed = zip(names, used, strict=True)
            codecs = [rmw_desert.payload_codec(spec, key, each) for key, each in keyed]
        else:
            typed, opaque = CODECS[spec.codec], OPAQUE_CODECS[spec.codec]
            codecs = [typed(each) if each else opaque() for each in used]
        self.type: TypeSpec | None = used[0]
        """Type of samples, requests or goals; None: opaque."""
        self.response_type: TypeSpec | None = used[-1]
        """Type of responses or results, of samples for a topic; None: opaque."""
        self.feedback_type: TypeSpec | None = used[len(used) // 2]
        """Type of an action's feedback; None: opaque. Meaningless for topics and services."""
        self.codec = codecs[0]
        """Codec of samples, requests or goals."""
        self.response_codec = codecs[-1]
        """Codec of responses or results, of samples for a topic."""
        self.feedback_codec = codecs[len(codecs) // 2]
        """Codec of an action's feedback. Meaningless for topics and services."""
        self.dense_type = _dense_type(spec, used[0])
        """Type of its samples in dense blocks; None: the stream is not dense."""
        self.encoding = spec.encoding or (CBOR if any(used) else OPAQUE)
        """Zenoh encoding on the application side."""
        description = msgspec.json.encode(self._description())
        self.digest = hashlib.sha256(description).digest()[:DIGEST_BYTES]
        """Changes with everything that both ends must agree on."""
        self.is_on_demand = isinstance(spec, TopicSpec) and spec.qos.forward is Forward.ON_DEMAND
        """Whether samples cross only to nodes that have subscribed."""
        if self.is_on_demand and not (node_names or self._publishers):
            raise ConfigError(
                "forward: on_demand, and nobody is known who could be asked; allowed: with nodes "
                "listed, or publishers"
            )

    def may_publish(self, address: int) -> bool:
        """Return whether samples of this topic may come from that node; True for other streams."""
        return self._publishers is None or address in self._publishers

    def may_subscribe(self, address: int) -> bool:
        """Return whether that node subscribes to this topic; True for other streams."""
        subscribers = self.spec.subscribers if isinstance(self.spec, TopicSpec) else None
        return subscribers is None or address in subscribers

    def receivers(self, instance: Instance, nodes: Iterable[int]) -> tuple[int, ...]:
        """Return the nodes that should get the samples of a key of this topic, by address.

        Args:
            instance: The key within the topic.
            nodes: The nodes of the fleet.
        """
        if self.is_addressed:
            return instance[:1]
        subscribers = self.spec.subscribers if isinstance(self.spec, TopicSpec) else None
        return tuple(sorted(set(nodes if subscribers is None else subscribers)))

    @property
    def journals_sent(self) -> bool:
        """Whether its transport journals what this node publishes."""
        return self.spec.journal and not self.is_addressed

    def dense_value(self, value: object) -> tuple[dict[str, Any], bytes]:
        """Return an application's value for a dense block, and its payload.

        Raises:
            PayloadInvalidError: The value is not of the stream's type.
        """
        if isinstance(self.codec, TypedCodec):
            normal = self.codec.normalised(value)
            return normal, self.codec.write(normal)
        payload = self.codec.encode(value)
        return {_OCTETS_FIELD: self.codec.decode(payload)}, payload

    def dense_sample(self, value: dict[str, Any]) -> object:
        """Return the application's value of a sample from a dense block, without its age."""
        return value if self.type is not None else value[_OCTETS_FIELD]

    @property
    def _publishers(self) -> tuple[int, ...] | None:
        return self.spec.publishers if isinstance(self.spec, TopicSpec) else None

    def _description(self) -> list[object]:
        spec = self.spec
        types = [
            each.canonical().decode() if each else None for each in (self.type, self.response_type)
        ]
        head: list[object] = [spec.stream_id, spec.name, types, self.encoding]
        if spec.codec == DENSE:
            head.append(f"codec {DENSE} {DENSE_CODING}")
        elif spec.codec != "cbor":
            head.append(f"codec {spec.codec}")
        if isinstance(spec, ActionSpec):
            feedback = self.feedback_type.canonical().decode() if self.feedback_type else None
            times = (_seconds(spec.timeout_s), _seconds(spec.result_timeout_s))
            return ["action", *head, feedback, spec.server, *times]
        if isinstance(spec, ServiceSpec):
            return ["service", *head, spec.server, _seconds(spec.timeout_s)]
        wildcards = [[wildcard.name, *wildcard.values] for wildcard in self.keys.wildcards]
        nodes = sorted(self.keys.node_names.items()) if self.keys.is_named_by_node else []
        subscribers = [
            None if part is None else sorted(part) for part in (spec.publishers, spec.subscribers)
        ]
        description = ["topic", *head, subscribers, wildcards, nodes, spec.qos.stamp.value]
        if spec.qos.reliability is Reliability.RELIABLE:
            # The depth tells a receiver which samples are over; see
            # zacoustic.core.transport.reliable.
            description += [spec.qos.reliability.value, spec.qos.depth]
        if spec.qos.forward is Forward.ON_DEMAND:
            # A node that takes the topic for another kind never subscribes.
            description.append(spec.qos.forward.value)
        return description


class StreamTable:
    """The streams of a fleet, by id and by name.

    Args:
        specs: The streams, in any order.
        types: The types that they name.
        nodes: Name of each node by address; empty: the fleet is not listed.
        model: The fitted model of the dense streams.
        wire: The wire profile of the link.

    Raises:
        ConfigError: A duplicate id or name, or anything that `Stream` refuses.
    """

    def __init__(
        self,
        specs: Iterable[StreamSpec] = (),
        *,
        types: TypeTable | None = None,
        nodes: Mapping[int, str] | None = None,
        model: Model | None = None,
        wire: WireProfile = WireProfile.NATIVE,
    ) -> None:
        self.types = types or TypeTable()
        self.wire = wire
        """The wire profile of the link."""
        self.nodes: dict[int, str] = dict(nodes or {})
        """Name of each node by address."""
        self.model = model
        """The fitted model of the dense streams; part of the digest."""
        self._by_id: dict[int, Stream] = {}
        self._by_name: dict[str, Stream] = {}
        self._built_in: dict[int, Stream] = {}
        if wire is WireProfile.NATIVE:
            built_in = (_commands(), _status(), _keys(), _routing())
            self._built_in = {each.stream_id: each for each in built_in}
        self._digest: bytes | None = None
        for spec in specs:
            self.declare(spec)

    def declare(self, spec: StreamSpec) -> Stream:
        """Add a stream; the digest changes.

        Raises:
            ConfigError: The id or the name is taken, or `Stream` refuses the spec.
        """
        stream = Stream(spec, self.types, self.nodes, wire=self.wire)
        known = self._by_id.get(stream.stream_id)
        if known is not None:
            raise ConfigError(
                f"id: {stream.stream_id} is taken by {known.name}",
                hint="give each stream an id of its own",
            )
        known = self._by_name.get(stream.name)
        if known is not None:
            raise ConfigError(
                f'name: "{stream.name}" is taken by stream {known.stream_id}',
                hint="give each stream a name of its own",
            )
        if isinstance(spec, TopicSpec) and spec.carry is not None:
            self._built_in.setdefault(CARRY_STREAM_ID, _carried(self.nodes))
        own = {stream.stream_id, *self._by_id}
        if CARRY_STREAM_ID in self._built_in and CARRY_STREAM_ID in own:
            raise ConfigError(
                f"id: {CARRY_STREAM_ID} is that of carried samples",
                hint="give the stream another id, or carry no topic",
            )
        self._by_id[stream.stream_id] = stream
        self._by_name[stream.name] = stream
        self._digest = None
        return stream

    @property
    def carried(self) -> tuple[Stream, ...]:
        """The topics that other nodes carry."""
        return tuple(
            each
            for each in self
            if isinstance(each.spec, TopicSpec) and each.spec.carry is not None
        )

    def lists(self, address: int) -> bool:
        """Return whether a node belongs to the fleet; True if no nodes are listed."""
        return not self.nodes or address in self.nodes

    @property
    def digest(self) -> bytes:
        """Four bytes that change with any stream and with the list of nodes."""
        if self._digest is None:
            whole = hashlib.sha256(msgspec.json.encode(sorted(self.nodes.items())))
            for stream in self:
                whole.update(stream.digest)
            if self.model is not None:
                whole.update(self.model.digest)
            self._digest = whole.digest()[:DIGEST_BYTES]
        return self._digest

    def __iter__(self) -> Iterator[Stream]:
        """Iterate over the table's own streams, by id."""
        return iter(sorted(self._by_id.values(), key=lambda stream: stream.stream_id))

    def every(self) -> list[Stream]:
        """Return the table's own streams, and those that are in no digest."""
        return [*self, *self._built_in.values()]

    def __len__(self) -> int:
        return len(self._by_id)

    def get(self, stream_id: int) -> Stream | None:
        """Return the stream with an id, or None."""
        return self._by_id.get(stream_id) or self._built_in.get(stream_id)

    def by_id(self, stream_id: int) -> Stream:
        """Return the stream with an id.

        Raises:
            UnknownStreamError: There is none; lists the known ids.
        """
        stream = self.get(stream_id)
        if stream is None:
            known = ", ".join(str(known) for known in sorted(self._by_id)) or "none"
            raise UnknownStreamError(f"no stream has id {stream_id}; there are: {known}")
        return stream

    def topic(self, stream_id: int) -> tuple[Stream, TopicSpec]:
        """Return a topic and its spec.

        Raises:
            UnknownStreamError: There is no such topic.
        """
        stream = self.by_id(stream_id)
        if not isinstance(stream.spec, TopicSpec):
            raise UnknownStreamError(f"stream {stream_id} ({stream.name}) is not a topic")
        return stream, stream.spec

    def topic_of(self, publisher: int, stream_id: int) -> tuple[Stream, TopicSpec]:
        """Return a topic to which a node may publish, and its spec.

        Raises:
            UnknownStreamError: There is no such topic.
            LocalError: The node is not among its publishers.
        """
        stream, spec = self.topic(stream_id)
        if not stream.may_publish(publisher):
            raise LocalError(
                f"node {publisher} is not a publisher of {stream.name}; "
                f"publishers: {spec.publishers}"
            )
        return stream, spec

    def service(self, stream_id: int) -> tuple[Stream, ServiceSpec]:
        """Return a service and its spec.

        Raises:
            UnknownStreamError: There is no such service.
        """
        stream = self.by_id(stream_id)
        if not isinstance(stream.spec, ServiceSpec):
            raise UnknownStreamError(f"stream {stream_id} ({stream.name}) is not a service")
        return stream, stream.spec

    def by_name(self, name: str) -> Stream:
        """Return the stream with a name, placeholders included.

        Raises:
            UnknownStreamError: There is none; lists the known names.
        """
        stream = self._by_name.get(name)
        if stream is None:
            known = ", ".join(sorted(self._by_name)) or "none"
            raise UnknownStreamError(f'no stream is called "{name}"; there are: {known}')
        return stream

    def find(self, key: str, source: int) -> tuple[Stream, Instance] | None:
        """Return the stream and the instance of a key of `source`, or None."""
        stream = self._by_name.get(key)
        if stream is not None and not stream.keys.is_named_by_node and not stream.keys.wildcards:
            return stream, ()
        for stream in self:
            instance = stream.keys.match(key, source)
            if instance is not None:
                return stream, instance
        return None


def _commands() -> Stream:
    """Return the stream of remote commands."""
    spec = ServiceSpec(
        stream_id=COMMANDS_STREAM_ID,
        name="orders",
        server=EVERY_NODE,
        request_type=REQUEST_TYPE,
        response_type=RESPONSE_TYPE,
        timeout_s=COMMANDS_TIMEOUT_S,
        qos=Qos(priority=Priority.REAL_TIME, stamp=Stamp.AGE),
        journal=False,  # executed commands have their own deduplication table
    )
    return Stream(spec, command_types(), {}, is_built_in=True)


def _status() -> Stream:
    """Return the stream of the status of nodes."""
    spec = ServiceSpec(
        stream_id=STATUS_STREAM_ID,
        name="status",
        server=EVERY_NODE,
        response_type=STATUS_TYPE,
        timeout_s=STATUS_TIMEOUT_S,
        qos=Qos(priority=Priority.DATA_HIGH, stamp=Stamp.AGE),
        journal=False,
    )
    return Stream(spec, status_types(), {}, is_built_in=True)


def _keys() -> Stream:
    """Return the stream of delivered keys."""
    spec = ServiceSpec(
        stream_id=KEYS_STREAM_ID,
        name="keys",
        server=EVERY_NODE,
        timeout_s=KEYS_TIMEOUT_S,
        qos=Qos(priority=Priority.DATA_HIGH),
        journal=False,  # the same key may be stored twice
    )
    return Stream(spec, TypeTable(), {}, is_built_in=True)


def _carried(nodes: Mapping[int, str]) -> Stream:
    """Return the stream of carried samples of a fleet."""
    spec = TopicSpec(
        stream_id=CARRY_STREAM_ID,
        name=FLEET_CARRY_NAME if nodes else CARRY_NAME,
        wildcards=(CARRY_WILDCARD,),
        qos=Qos(reliability=Reliability.RELIABLE, depth=_CARRIED_DEPTH),
        journal=True,
    )
    return Stream(spec, TypeTable(), nodes, is_built_in=True)


def _routing() -> Stream:
    """Return the stream of commands about routes."""
    spec = ServiceSpec(
        stream_id=ROUTING_STREAM_ID,
        name="routing",
        server=EVERY_NODE,
        timeout_s=ROUTING_TIMEOUT_S,
        qos=Qos(priority=Priority.DATA_HIGH),
        journal=False,  # the revision tells what was executed
    )
    return Stream(spec, TypeTable(), {}, is_built_in=True)


def _type_names(spec: StreamSpec) -> dict[str, str | None]:
    """Return the types of a stream, by their keys in the config."""
    match spec:
        case TopicSpec():
            return {"type": spec.type_name}
        case ServiceSpec():
            return {"request": spec.request_type, "response": spec.response_type}
        case ActionSpec():
            return {
                "goal": spec.goal_type,
                "feedback": spec.feedback_type,
                "result": spec.result_type,
            }


def aged(type_spec: TypeSpec) -> TypeSpec:
    """Return a type with the code of the age as its last field."""
    age = FieldSpec(name=AGE_FIELD, type="uint8")
    return msgspec.structs.replace(type_spec, fields=(*type_spec.fields, age))


def _dense_type(spec: StreamSpec, type_spec: TypeSpec | None) -> TypeSpec | None:
    if spec.codec != DENSE:
        return None
    type_spec = type_spec or _OCTETS
    return aged(type_spec) if spec.qos.stamp is Stamp.AGE else type_spec


def _seconds(time_s: float) -> object:
    """Return a time, s, as a description has it: 60 and 60.0 are equal."""
    return int(time_s) if time_s == int(time_s) else time_s
