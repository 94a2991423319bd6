"""From the names of an application to routes: streams, keys, forms.

An endpoint names a topic, a service or an action in one of three ways, tried in this order:

1. as in the configuration (``fleet/{node}/status``), or by one of its keys (``fleet/auv1/status``);
2. on a link, with a stream id: the code then adds the stream to the table;
3. on Zenoh without a configuration: any key expression.

A publisher always has one key: ``{node}`` is this node, and the application fills in other
placeholders.
"""

from typing import Any

import msgspec

from zacoustic.core.base.qos import Durability, Qos, Reliability
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.values.types import TypeSpec, TypeTable
from zacoustic.errors import ConfigError, LocalError, UnknownStreamError
from zacoustic.zenoh.node.agreement import PARTS, kind_of, pair_of, triple_of, tune
from zacoustic.zenoh.node.api.identity import Identity
from zacoustic.zenoh.node.api.pubsub import DEFAULT_DEPTH
from zacoustic.zenoh.node.carrier import Carrier
from zacoustic.zenoh.node.form import Form, configured_form, free_form
from zacoustic.zenoh.node.routes import (
    ActionRoute,
    ServiceRoute,
    TopicRoute,
    free_action,
    free_service,
    free_topic,
)


class Catalogue:
    """The topics, services and actions of one node.

    Args:
        identity: Name, address and configuration of the node.
        table: Its streams; on a link the engine's table.
        carrier: Adds streams to the table, if it can.
    """

    def __init__(self, identity: Identity, table: StreamTable, carrier: Carrier) -> None:
        self._identity = identity
        self._table = table
        self._carrier = carrier

    def address_of(self, name: str) -> int:
        """Return the address of the node with this name.

        Raises:
            LocalError: No configuration lists nodes.
            ConfigError: The configuration has no node with this name.
        """
        if self._identity.config is None:
            raise LocalError(
                f'no node is called "{name}": there is no config that lists any',
                hint="give its acoustic address",
            )
        return self._identity.config.address_of(name)

    def publisher(
        self, sample_type: object, name: str, qos: Qos | None, stream_id: int | None
    ) -> TopicRoute[Any]:
        """Return the route of a publisher.

        Raises:
            ConfigError, LocalError: The name, the type or the id do not fit the node's streams.
        """
        stream, _ = self._topic(sample_type, name, qos, stream_id)
        if stream is None:
            return free_topic(sample_type, name, qos or Qos(), wildcards=False)
        address = self._own_address(stream)
        if not stream.may_publish(address):
            raise LocalError(
                f"{self._who()} is not a publisher of {stream.name}; "
                f"publishers: {_addresses(stream.spec, 'publishers')}"
            )
        tune(stream, qos)
        key, instance = self._own_key(stream, name, address)
        return TopicRoute(
            name=name,
            key=key,
            expression=key,
            stream=stream,
            instance=instance,
            form=configured_form(sample_type, stream.type, where=stream.name),
            encoding=stream.encoding,
            qos=stream.qos,
        )

    def subscription(
        self, sample_type: object, name: str, qos: Qos | None, stream_id: int | None
    ) -> TopicRoute[Any]:
        """Return the route of a subscription.

        Raises:
            ConfigError, LocalError: The name, the type or the id do not fit the node's streams.
        """
        stream, key = self._topic(sample_type, name, qos, stream_id)
        durability = stream.qos.durability if stream is not None else Durability.VOLATILE
        own = qos or Qos(depth=DEFAULT_DEPTH, durability=durability)
        if stream is None:
            return free_topic(sample_type, name, own, wildcards=True)
        on_link = self._carrier.can_declare
        if on_link and not stream.may_subscribe(self._own_address(stream)):
            raise LocalError(
                f"{self._who()} is not a subscriber of {stream.name}; "
                f"subscribers: {_addresses(stream.spec, 'subscribers')}"
            )
        return TopicRoute(
            name=name,
            key=key,
            expression=key or stream.keys.expression(None),
            stream=stream,
            form=configured_form(sample_type, stream.type, where=stream.name),
            encoding=stream.encoding,
            qos=own,
        )

    def client(
        self,
        service_type: object,
        name: str,
        qos: Qos | None,
        *,
        stream_id: int | None,
        server: int | None,
    ) -> ServiceRoute[Any, Any]:
        """Return the route of a client.

        Raises:
            ConfigError, LocalError: The name, the types or the id do not fit the node's streams.
        """
        route = self._service(service_type, name, qos, stream_id=stream_id, server=server)
        self._check_server(name, route.stream, server)
        return route

    def server(
        self, service_type: object, name: str, qos: Qos | None, *, stream_id: int | None
    ) -> ServiceRoute[Any, Any]:
        """Return the route of a service.

        Raises:
            ConfigError, LocalError: As for `client`, or another node is the server.
        """
        own = self._identity.address
        route = self._service(service_type, name, qos, stream_id=stream_id, server=own)
        known = _server_of(route.stream)
        if known not in (None, own):
            raise LocalError(f"{name} is served by node {known}; this is {self._who()}")
        return route

    def action_client(
        self,
        action_type: object,
        name: str,
        qos: Qos | None,
        *,
        stream_id: int | None,
        server: int | None,
    ) -> ActionRoute[Any, Any, Any]:
        """Return the route of an action client.

        Raises:
            ConfigError, LocalError: The name, the types or the id do not fit the node's streams.
        """
        route = self._action(action_type, name, qos, stream_id=stream_id, server=server)
        self._check_server(name, route.stream, server)
        return route

    def action_server(
        self, action_type: object, name: str, qos: Qos | None, *, stream_id: int | None
    ) -> ActionRoute[Any, Any, Any]:
        """Return the route of an action server.

        Raises:
            ConfigError, LocalError: As for `action_client`, or another node is the server.
        """
        own = self._identity.address
        route = self._action(action_type, name, qos, stream_id=stream_id, server=own)
        known = _server_of(route.stream)
        if known not in (None, own):
            raise LocalError(f"{name} is served by node {known}; this is {self._who()}")
        return route

    def topics(self) -> list[str]:
        """Return the names of the topics that this node may subscribe to."""
        address = self._identity.address
        return [
            stream.name
            for stream in self._table
            if isinstance(stream.spec, TopicSpec)
            and (address is None or stream.may_subscribe(address))
        ]

    def find(self, name: str) -> Stream | None:
        """Find the stream of a name or of a key; None: a plain Zenoh key.

        Raises:
            LocalError: No stream has this name.
        """
        found = self._find(name, None)
        if found is None:
            self._new_stream_id(name, None)
        return None if found is None else found[0]

    # Below the methods above

    def _topic(
        self, sample_type: object, name: str, qos: Qos | None, stream_id: int | None
    ) -> tuple[Stream | None, str | None]:
        found = self._find(name, stream_id)
        if found is not None:
            if not isinstance(found[0].spec, TopicSpec):
                raise LocalError(f"{found[0].name} is {kind_of(found[0])}, not a topic")
            return found
        new_id = self._new_stream_id(name, stream_id)
        if new_id is None:
            return None, None
        form = free_form(sample_type, where=name)
        if qos is not None and qos.reliability is Reliability.RELIABLE and not self._table.nodes:
            raise ConfigError(
                f"{name}: reliability: reliable, and nobody is known to acknowledge",
                hint="give config=FILE that lists the nodes",
            )
        spec = TopicSpec(
            stream_id=new_id, name=name, type_name=self._type_name(form), qos=qos or Qos()
        )
        return self._carrier.declare(spec), name

    def _service(
        self,
        service_type: object,
        name: str,
        qos: Qos | None,
        *,
        stream_id: int | None,
        server: int | None,
    ) -> ServiceRoute[Any, Any]:
        request_type, response_type = pair_of(service_type, name)
        found = self._find(name, stream_id)
        new_id = None if found else self._new_stream_id(name, stream_id)
        if new_id is not None:
            if server is None:
                raise ConfigError(f"{name}: no server is given", hint="give server=ADDRESS")
            request = free_form(request_type, where=f"{name}: request")
            response = free_form(response_type, where=f"{name}: response")
            spec = ServiceSpec(
                stream_id=new_id,
                name=name,
                server=server,
                request_type=self._type_name(request),
                response_type=self._type_name(response),
            )
            found = self._carrier.declare(spec), None
        if found is None:
            return free_service((request_type, response_type), name, qos or Qos())
        stream = found[0]
        spec_found = stream.spec
        if not isinstance(spec_found, ServiceSpec):
            raise LocalError(f"{stream.name} is {kind_of(stream)}, not a service")
        tune(stream, qos)
        return ServiceRoute(
            name=name,
            stream=stream,
            request=configured_form(request_type, stream.type, where=f"{name}: request"),
            response=configured_form(
                response_type, stream.response_type, where=f"{name}: response"
            ),
            encoding=stream.encoding,
            timeout_s=spec_found.timeout_s,
            qos=stream.qos,
        )

    def _action(
        self,
        action_type: object,
        name: str,
        qos: Qos | None,
        *,
        stream_id: int | None,
        server: int | None,
    ) -> ActionRoute[Any, Any, Any]:
        types = triple_of(action_type, name)
        found = self._find(name, stream_id)
        new_id = None if found else self._new_stream_id(name, stream_id)
        if new_id is not None:
            if server is None:
                raise ConfigError(f"{name}: no server is given", hint="give server=ADDRESS")
            goal, feedback, result = (
                self._type_name(free_form(each, where=f"{name}: {part}"))
                for each, part in zip(types, PARTS, strict=True)
            )
            spec = ActionSpec(
                stream_id=new_id,
                name=name,
                server=server,
                goal_type=goal,
                feedback_type=feedback,
                result_type=result,
            )
            found = self._carrier.declare(spec), None
        if found is None:
            return free_action(types, name, qos or Qos())
        stream = found[0]
        if not isinstance(stream.spec, ActionSpec):
            raise LocalError(f"{stream.name} is {kind_of(stream)}, not an action")
        tune(stream, qos)
        specs = (stream.type, stream.feedback_type, stream.response_type)
        goal_form, feedback_form, result_form = (
            configured_form(each, known, where=f"{name}: {part}")
            for each, known, part in zip(types, specs, PARTS, strict=True)
        )
        return ActionRoute(
            name=name,
            stream=stream,
            goal=goal_form,
            feedback=feedback_form,
            result=result_form,
            encoding=stream.encoding,
            timeout_s=stream.spec.timeout_s,
            result_timeout_s=stream.spec.result_timeout_s,
            qos=stream.qos,
        )

    def _check_server(self, name: str, stream: Stream | None, server: int | None) -> None:
        """Check that a client and its server are two nodes, and that all agree on the server."""
        known = _server_of(stream)
        if server is not None and known not in (None, server):
            raise ConfigError(f"{name}: server: {server}; allowed: {known}, as it is configured")
        if known is not None and known == self._identity.address and self._carrier.can_declare:
            raise LocalError(f"{name} is served by this node, {known}: it cannot call itself")

    def _find(self, name: str, stream_id: int | None) -> tuple[Stream, str | None] | None:
        """Find a stream by its name or by one of its keys; return also the key, if it is one."""
        stream = next((each for each in self._table if each.name == name), None)
        key: str | None = None
        if stream is None or not _has_placeholders(stream):
            key = name
        if stream is None:
            sources = self._table.nodes or (self._identity.address or 0,)
            hits = (self._table.find(self._as_own(name), source) for source in sources)
            stream = next((hit[0] for hit in hits if hit is not None), None)
        if stream is None:
            return None
        config = self._identity.config
        of_ros = config.ros.streams if config is not None and config.ros is not None else {}
        if stream.stream_id in of_ros and not self._carrier.can_declare:
            raise LocalError(
                f"{stream.name} is {kind_of(stream)} of ROS 2 on this local network",
                hint="use a ROS 2 client there, or open the node on a link",
            )
        if stream_id not in (None, stream.stream_id):
            raise ConfigError(
                f"{name}: stream_id: {stream_id}; allowed: {stream.stream_id}, which it has"
            )
        return stream, key

    def _new_stream_id(self, name: str, stream_id: int | None) -> int | None:
        """Return the id under which an unknown name becomes a stream; None: a plain Zenoh key.

        Raises:
            LocalError: The name is neither.
        """
        if stream_id is not None and self._carrier.can_declare:
            return stream_id
        if self._identity.config is not None:
            known = ", ".join(sorted(each.name for each in self._table)) or "none"
            raise UnknownStreamError(
                f'{self._identity.config.source}: no stream is called "{name}"; there are: {known}'
            )
        if self._carrier.can_declare:
            raise LocalError(
                f"{name} has no stream id", hint="give stream_id=1..175, or config=FILE"
            )
        return None

    def _own_key(self, stream: Stream, name: str, address: int) -> tuple[str, Instance]:
        if stream.keys.is_named_by_node and address not in self._table.nodes:
            raise LocalError(
                f"{stream.name}: {self._who()} has no name for {{node}}",
                hint="list it under nodes in the config",
            )
        key = self._as_own(name)
        instance = stream.keys.match(key, address)
        if instance is None:
            raise LocalError(
                f"{name} is no key that {self._who()} publishes under {stream.name}",
                hint="give the other placeholders one of their values",
            )
        return key, instance

    def _as_own(self, name: str) -> str:
        """Return a name with `{node}` replaced by this node's name, if it has one."""
        node = self._table.nodes.get(self._identity.address or 0)
        return name if node is None else name.replace("{node}", node)

    def _own_address(self, stream: Stream) -> int:
        if self._identity.address is None:
            raise LocalError(f"{stream.name}: this node has no address", hint="give address=1..254")
        return self._identity.address

    def _type_name(self, form: Form[Any]) -> str | None:
        """Add the type of a form to the table; return its name there."""
        if form.spec is None:
            return None
        known = {each.name: each for each in self._table.types}
        spec, name, number = form.spec, form.spec.name, 2
        while name in known and known[name].canonical() != spec.canonical():
            name = f"{spec.name}_{number}"  # another class of the same name
            number += 1
        if name not in known:
            added: TypeSpec = msgspec.structs.replace(spec, name=name)
            self._table.types = TypeTable([*known.values(), added])
        return name

    def _who(self) -> str:
        identity = self._identity
        known = identity.address is not None and str(identity.address) != identity.name
        return f"node {identity.address} ({identity.name})" if known else f"node {identity.name}"


def _has_placeholders(stream: Stream) -> bool:
    return stream.keys.is_named_by_node or stream.keys.has_wildcards


def _addresses(spec: StreamSpec, which: str) -> str:
    return ", ".join(str(address) for address in getattr(spec, which) or ()) or "none"


def _server_of(stream: Stream | None) -> int | None:
    spec = stream.spec if stream is not None else None
    return spec.server if isinstance(spec, ServiceSpec | ActionSpec) else None
