"""Streams of ROS 2: names and types from keys and tokens of rmw_zenoh, bounds from the values.

The definition of a message has the types of its members, not their ranges; rules of an overlay
give those, as the values were seen: a frame id that never changed is a constant, a covariance that
was always zero does not cross, numbers get range and step as in other types.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.first.drafting import Overlaid, RosDraft, TopicDraft
from zacoustic.app.tools.design.first.guessing import priority_of
from zacoustic.app.tools.design.first.inference import InferredField, infer_number
from zacoustic.app.tools.design.first.survey import SeenTopic, Survey
from zacoustic.errors import ConfigError, PayloadInvalidError, ZacousticError
from zacoustic.ros.names import NO_HASH, RosKey, interface_of, is_interface, read_key
from zacoustic.ros.tokens import Entity, Token, read_token

_FRAME_IDS: Final = ("frame_id", "child_frame_id")
_RULE_KEYS: Final = ("range", "step", "unit", "wraps", "outside")
_INFRASTRUCTURE: Final = ("rosout", "parameter_events")
"""Topics of ROS itself, which every node has."""
_SERVICES_OF_NODES: Final = (
    "describe_parameters", "get_parameter_types", "get_parameters", "get_type_description",
    "list_parameters", "set_parameters", "set_parameters_atomically",
)  # fmt: skip


class RosNetwork(msgspec.Struct, frozen=True, kw_only=True):
    """What of a network is ROS 2."""

    distro: str
    """Distribution whose keys it has."""
    domain: int
    """``ROS_DOMAIN_ID``."""
    drafts: tuple[TopicDraft, ...]
    """Its topics."""
    services: tuple[tuple[str, str], ...]
    """Name and type of each service that somebody serves."""
    overlays: tuple[Overlaid, ...]
    """Rules for the types."""
    left_out: tuple[str, ...]
    """What cannot cross, with the reason."""
    keys: frozenset[str]
    """The keys that it accounts for."""


def ros_network(survey: Survey) -> RosNetwork | None:
    """Return what of a network is ROS 2; None: nothing, or its extra is not installed."""
    topics = {topic.key: key for topic in survey.topics if (key := _key(topic.key)) is not None}
    tokens = [token for each in survey.ros_tokens if (token := read_token(each)) is not None]
    if not (topics or any(token.topic for token in tokens)):
        return None
    try:
        from zacoustic.ros.interfaces import Interfaces
    except ModuleNotFoundError:
        return None
    some: Iterable[str] = [key.hash for key in topics.values()]
    hashes = {*some, *(token.hash for token in tokens if token.hash)}
    distro = "humble" if NO_HASH in hashes else "jazzy"
    domains = [key.domain for key in topics.values()] or [tokens[0].node.domain]
    drafting = _Drafting(Interfaces(distro))
    for topic in survey.topics:
        if topic.key in topics:
            drafting.add(topic, topics[topic.key])
    drafting.add_subscribed(tokens)
    served = {
        (token.topic, interface_of(token.type)) for token in tokens if token.kind is Entity.SERVER
    }
    accounted = {*topics, *(key for key in survey.services if _key(key) is not None)}
    return RosNetwork(
        distro=distro,
        domain=domains[0],
        drafts=tuple(drafting.drafts),
        services=tuple(sorted(drafting.usable_services(served))),
        overlays=tuple(drafting.overlays()),
        left_out=tuple(drafting.left_out),
        keys=frozenset({*accounted, *(key for key in survey.subscribed if _key(key) is not None)}),
    )


def joined(own: RosNetwork | None, peer: RosNetwork | None) -> RosNetwork | None:
    """Return the networks of both sides as one: what was published on the other is from there.

    A type whose values were seen on both sides gets no rules: those of one side may refuse the
    other's.
    """
    if peer is None:
        return own
    spoken = {
        draft.name: msgspec.structs.replace(draft, is_from_peer=True)
        for draft in peer.drafts
        if draft.seen.samples
    }
    if own is None:
        unseen = [
            msgspec.structs.replace(draft, is_from_peer=False)
            for draft in peer.drafts
            if not draft.seen.samples
        ]
        return msgspec.structs.replace(peer, drafts=(*spoken.values(), *unseen), services=())
    drafts = []
    for draft in own.drafts:
        theirs = spoken.pop(draft.name, draft)
        drafts.append(draft if draft.seen.samples else theirs)
    both = {each.interface for each in own.overlays} & {each.interface for each in peer.overlays}
    overlays = [each for each in (*own.overlays, *peer.overlays) if each.interface not in both]
    left_out = dict.fromkeys((*own.left_out, *peer.left_out))
    return msgspec.structs.replace(
        own,
        drafts=(*drafts, *spoken.values()),
        overlays=tuple(overlays),
        left_out=tuple(left_out),
        keys=own.keys | peer.keys,
    )


class _Drafting:
    def __init__(self, interfaces: Any) -> None:  # noqa: ANN401 (of an extra, imported late)
        from zacoustic.ros.mapping import TypeMapper

        self._interfaces = interfaces
        self._mapper = TypeMapper(interfaces)
        self.drafts: list[TopicDraft] = []
        self.left_out: list[str] = []
        self._values: dict[str, list[Mapping[str, Any]]] = {}
        self._stamped: set[str] = set()

    def add(self, topic: SeenTopic, key: RosKey) -> None:
        """Draft a topic that was published."""
        interface = interface_of(key.type)
        if key.name.rpartition("/")[2] in _INFRASTRUCTURE:
            self.left_out.append(f"/{key.name}: of ROS itself")
            return
        draft = self._draft(topic, f"/{key.name}", interface)
        if draft is not None:
            self.drafts.append(draft)
            self._values.setdefault(interface, []).extend(draft.values)

    def add_subscribed(self, tokens: Sequence[Token]) -> None:
        """Draft the topics that are subscribed and not published: the other side does that."""
        published = {token.topic for token in tokens if token.kind is Entity.PUBLISHER}
        known = {draft.name for draft in self.drafts} | published
        for token in tokens:
            if token.kind is not Entity.SUBSCRIPTION or token.topic in known:
                continue
            known.add(token.topic)
            nothing = SeenTopic(
                key=token.topic.lstrip("/"), samples=0, rate_hz=0.0, encoding="application/cdr",
                smallest_bytes=0, largest_bytes=0,
            )  # fmt: skip
            draft = self._draft(nothing, token.topic, interface_of(token.type))
            if draft is not None and token.topic.rpartition("/")[2] not in _INFRASTRUCTURE:
                self.drafts.append(msgspec.structs.replace(draft, is_from_peer=True))

    def usable_services(self, served: Iterable[tuple[str, str]]) -> Iterator[tuple[str, str]]:
        """Yield the services whose definitions are known, without those that every node has."""
        for name, interface in served:
            if name.rpartition("/")[2] in _SERVICES_OF_NODES:
                continue
            if not is_interface(interface) or f"{interface}_Request" not in self._interfaces:
                self.left_out.append(f"{name}: the definition of {interface} is not here")
                continue
            yield name, interface

    def overlays(self) -> Iterator[Overlaid]:
        """Yield the rules for each type whose values were seen."""
        for interface, values in self._values.items():
            rules = tuple(_rules(values)) if values else ()
            if rules:
                yield Overlaid(interface=interface, rules=rules)

    def _draft(self, topic: SeenTopic, name: str, interface: str) -> TopicDraft | None:
        from zacoustic.ros.interfaces import has_header
        from zacoustic.ros.messages import HeaderStamp, RosMessage

        try:
            stamped = has_header(self._interfaces, interface)
            stamp = HeaderStamp.AGE if stamped else HeaderStamp.EXACT
            message = RosMessage(self._interfaces, self._mapper, interface, stamp)
            values = [message.read(payload)[0] for payload in topic.payloads]
        except (ConfigError, PayloadInvalidError, ZacousticError) as error:
            self.left_out.append(f"{name}: {error.args[0]}")
            return None
        return TopicDraft(
            seen=topic,
            ros=RosDraft(name=name, interface=interface, has_header=stamped),
            encoding="application/cdr",
            values=tuple(values),
            priority=priority_of(name),
        )


def _key(text: str) -> RosKey | None:
    key = read_key(text)
    return key if key is not None and is_interface(interface_of(key.type)) else None


def _rules(values: Sequence[Mapping[str, Any]]) -> Iterator[InferredField]:
    """Yield a rule for each member that needs one."""
    for path, seen in _leaves(values).items():
        name = path.rpartition(".")[2]
        flat = [each for value in seen for each in (value if isinstance(value, list) else [value])]
        numbers = [each for each in flat if isinstance(each, int | float)]
        rule: dict[str, Any] = {}
        remark = ""
        if name in _FRAME_IDS and len({*map(str, seen)}) == 1 and isinstance(seen[0], str):
            rule, remark = {"constant": seen[0]}, "did not change"
        elif "covariance" in name and numbers and not any(numbers):
            rule, remark = {"omit": True}, "always zero: does not cross"
        elif numbers and len(numbers) == len(flat) and any(isinstance(n, float) for n in numbers):
            # `x` alone is a place; of an orientation or a velocity it is something else.
            named = "_".join(path.split(".")[-2:])
            keys, remark = infer_number(named, [float(each) for each in numbers])
            rule = {key: keys[key] for key in _RULE_KEYS if key in keys}
        if rule:
            yield InferredField(keys={"field": path, **rule}, remark=remark)


def _leaves(values: Sequence[Mapping[str, Any]], head: str = "") -> dict[str, list[Any]]:
    """Return the observed values of each member by its path, those of nested types included."""
    found: dict[str, list[Any]] = {}
    names = dict.fromkeys(name for value in values for name in value)
    for name in names:
        seen = [_plain(value[name]) for value in values if value.get(name) is not None]
        path = f"{head}{name}"
        if seen and all(isinstance(each, Mapping) for each in seen):
            found |= _leaves(seen, f"{path}.")
        elif seen:
            found[path] = seen
    return found


def _plain(value: Any) -> Any:  # noqa: ANN401 (of a message)
    """Return an array of numbers as a list."""
    is_array = hasattr(value, "tolist") and not isinstance(value, Mapping)
    return value.tolist() if is_array else list(value) if isinstance(value, tuple) else value
