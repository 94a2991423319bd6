"""The permissions of programs, operators and gateways of one local network, by key.

Programs publish a topic if its node is on this network, otherwise gateways do; servers follow the
same rule. So a program cannot impersonate a remote node, and its samples cross the channel only if
the table says so.

Under ``@acoustic`` gateways publish and answer; programs read documents; operators may query
everything, which includes commands to remote nodes (`silence`, `stream/ID`), pings (`ping`), and
the cancellation of transfers.
"""

import itertools
import math
from collections.abc import Iterator
from enum import Enum
from typing import Final

import msgspec

from zacoustic.config import Config
from zacoustic.core.base.qos import Durability
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.ros.streams import RosAction, RosService, RosTopic
from zacoustic.ros.tokens import PREFIX as ROS_TOKENS
from zacoustic.zenoh.gateway.dialect.ros.graph import ENCLAVE
from zacoustic.zenoh.requests.request import PREFIX
from zacoustic.zenoh.session.asking.goals import ActionKey

_DOCUMENTS: Final = (
    "node", "link", "link/*", "route/*", "bond/*", "relay", "ledger", "peers", "peer/*/*",
    "contact/*", "modem", "modem/*", "streams", "objects", "channel", "journal", "dropped",
    "events", "clock",
)  # fmt: skip
"""Documents of the health report, by the end of their keys: a query of them changes nothing."""
_MOST_KEYS: Final = 256
"""A topic with more keys of one node is named by an expression, which covers more."""
_CACHE: Final = "@adv/**"
"""Below a key: the cache of its publisher, and the token by which subscribers find it."""


class Role(Enum):
    """A group of clients."""

    PROGRAM = "programs"
    """Programs of the network."""
    OPERATOR = "operators"
    """Clients that command remote nodes."""
    GATEWAY = "gateways"
    """Gateways that are clients of the router."""


class Act(Enum):
    """An action on a key."""

    PUBLISH = "publish"
    """Put samples and deletes."""
    SUBSCRIBE = "subscribe"
    """Receive samples and deletes."""
    ASK = "ask"
    """Send a `get`."""
    ANSWER = "answer"
    """Declare a queryable, and reply."""
    APPEAR = "appear"
    """Declare a liveliness token."""
    WATCH = "watch"
    """Watch the tokens of others."""


class Grant(msgspec.Struct, frozen=True, order=True):
    """A permission."""

    role: Role
    """The group."""
    act: Act
    """The action."""
    key: str
    """The keys: an expression of Zenoh."""


def grants_of(config: Config, beside: tuple[int, ...] = ()) -> tuple[Grant, ...]:
    """Return all permissions from a network's stream table.

    Args:
        config: Configuration of the node there.
        beside: Addresses of other nodes on the same network.
    """
    found = _Finding(config, frozenset((config.address, *beside)))
    granted: dict[Grant, None] = {}
    for stream in config.table:
        granted |= dict.fromkeys(found.of(stream))
    granted |= dict.fromkeys(_of_lost_contact(config))
    granted |= dict.fromkeys(_of_network(config))
    return tuple(granted)


def exclusive_of(config: Config, grants: tuple[Grant, ...]) -> tuple[Grant, ...]:
    """Return the permissions reserved for gateways, whatever else is opened to programs."""
    acts = (Act.PUBLISH, Act.ANSWER, Act.APPEAR)
    of_programs = {(grant.act, grant.key) for grant in grants if grant.role is Role.PROGRAM}
    own = [
        grant
        for grant in grants
        if grant.role is Role.GATEWAY and grant.act in acts
        if (grant.act, grant.key) not in of_programs
    ]
    if config.ros is not None:
        enclave = ENCLAVE.replace("/", "%")
        own.append(Grant(Role.GATEWAY, Act.APPEAR, f"{ROS_TOKENS}/*/*/*/*/*/{enclave}/**"))
    return tuple(own)


class _Finding:
    """Finds the permissions of streams."""

    def __init__(self, config: Config, own: frozenset[int]) -> None:
        self._config = config
        self._own = own
        self._ros = {} if config.ros is None else config.ros.streams

    def of(self, stream: Stream) -> Iterator[Grant]:
        """Return the permissions of a stream."""
        match stream.spec:
            case TopicSpec():
                yield from self._of_topic(stream)
            case ServiceSpec(server=server):
                yield from _of_service(self._key(stream, stream.name), server in self._own)
            case ActionSpec(server=server):
                for which in ActionKey:
                    key = self._key_of_action(stream, which)
                    if which in (ActionKey.FEEDBACK, ActionKey.STATUS):
                        yield from _of_news(key, server in self._own)
                    else:
                        yield from _of_service(key, server in self._own)
                if stream.stream_id not in self._ros:
                    yield from _of_service(f"{stream.name}/_action/*", server in self._own)

    def _of_topic(self, stream: Stream) -> Iterator[Grant]:
        is_cached = (
            stream.stream_id in self._ros or stream.qos.durability is Durability.TRANSIENT_LOCAL
        )
        for key in self._keys(stream, are_here=True):
            yield from _publishes(Role.PROGRAM, key, is_cached=is_cached)
            yield from _subscribes(Role.GATEWAY, key, is_cached=is_cached)
        for key in self._keys(stream, are_here=False):
            yield from _publishes(Role.GATEWAY, key, is_cached=is_cached)
            yield Grant(Role.GATEWAY, Act.ANSWER, key)
        everything = self._key(stream, stream.keys.expression(None))
        yield from _subscribes(Role.PROGRAM, everything, is_cached=is_cached)
        yield Grant(Role.PROGRAM, Act.ASK, everything)

    def _nodes(self, stream: Stream, are_here: bool) -> list[int | None]:
        """Return the nodes, on this network or remote, that may publish a topic."""
        if not stream.keys.is_named_by_node:
            assert isinstance(stream.spec, TopicSpec)
            if stream.spec.publishers is None:
                return [None]
            return [None for each in stream.spec.publishers if (each in self._own) is are_here]
        known = self._config.nodes or dict.fromkeys(self._own)
        return [
            each for each in known if stream.may_publish(each) and (each in self._own) is are_here
        ]

    def _keys(self, stream: Stream, *, are_here: bool) -> list[str]:
        """Return the keys on which nodes, of this network or remote, publish a topic."""
        keys = stream.keys
        nodes = self._nodes(stream, are_here)
        sizes = [len(wildcard.values) for wildcard in keys.wildcards]
        if math.prod(sizes) > _MOST_KEYS:
            names = {keys.expression(node) for node in nodes}
        else:
            instances = list(itertools.product(*map(range, sizes)))
            names = {keys.key(node or 0, each) for node in nodes for each in instances}
        return [self._key(stream, name) for name in sorted(names)]

    def _key(self, stream: Stream, name: str) -> str:
        ros = self._ros.get(stream.stream_id)
        if isinstance(ros, RosTopic | RosService) and self._config.ros is not None:
            key = ros.key(self._config.ros.domain, "NAME")
            return f"{key.domain}/{name}/{key.type}/{key.hash}"
        return name

    def _key_of_action(self, stream: Stream, which: ActionKey) -> str:
        ros = self._ros.get(stream.stream_id)
        if isinstance(ros, RosAction) and self._config.ros is not None:
            part: RosTopic | RosService = getattr(ros, which.value)
            return str(part.key(self._config.ros.domain, which.of(stream.name)))
        return which.of(stream.name)


def _publishes(role: Role, key: str, *, is_cached: bool) -> Iterator[Grant]:
    yield Grant(role, Act.PUBLISH, key)
    if is_cached:
        for act in (Act.PUBLISH, Act.ANSWER, Act.APPEAR):
            yield Grant(role, act, f"{key}/{_CACHE}")


def _subscribes(role: Role, key: str, *, is_cached: bool) -> Iterator[Grant]:
    yield Grant(role, Act.SUBSCRIBE, key)
    if is_cached:
        for act in (Act.SUBSCRIBE, Act.ASK, Act.WATCH):
            yield Grant(role, act, f"{key}/{_CACHE}")


def _of_service(key: str, is_here: bool) -> Iterator[Grant]:
    yield Grant(Role.PROGRAM if is_here else Role.GATEWAY, Act.ANSWER, key)
    yield Grant(Role.PROGRAM, Act.ASK, key)
    if is_here:
        yield Grant(Role.GATEWAY, Act.ASK, key)


def _of_news(key: str, is_here: bool) -> Iterator[Grant]:
    """Yield the permissions for feedback and status of an action."""
    role = Role.PROGRAM if is_here else Role.GATEWAY
    yield from _publishes(role, key, is_cached=True)
    yield from _subscribes(Role.PROGRAM, key, is_cached=True)
    if is_here:
        yield from _subscribes(Role.GATEWAY, key, is_cached=True)


def _of_lost_contact(config: Config) -> Iterator[Grant]:
    """Yield the permissions for what the gateway does when it hears nobody any more.

    Programs may publish such a key as well: it belongs to the local network.
    """
    for each in config.lost_contact:
        if each.stream_id is not None:
            continue  # a stream, with permissions of its own
        if each.is_call:
            yield from _of_service(each.key, is_here=True)
        else:
            for role in (Role.GATEWAY, Role.PROGRAM):
                yield from _publishes(role, each.key, is_cached=False)
            yield from _subscribes(Role.PROGRAM, each.key, is_cached=False)


def _of_network(config: Config) -> Iterator[Grant]:
    """Yield the permissions besides streams: health, commands, liveliness."""
    everything = f"{PREFIX}/**"
    for act in Act:
        yield Grant(Role.GATEWAY, act, everything)
    for role in (Role.PROGRAM, Role.OPERATOR):
        for act in (Act.SUBSCRIBE, Act.WATCH):
            yield Grant(role, act, everything)
    for name in _DOCUMENTS:
        yield Grant(Role.PROGRAM, Act.ASK, f"{PREFIX}/*/{name}")
    yield Grant(Role.OPERATOR, Act.ASK, everything)
    if config.ros is not None:
        tokens = f"{ROS_TOKENS}/{config.ros.domain}/**"
        for role in (Role.PROGRAM, Role.GATEWAY):
            for act in (Act.APPEAR, Act.WATCH):
                yield Grant(role, act, tokens)
