"""Streams of ROS 2: names and types from keys and tokens of rmw_zenoh, bounds from the values.

The definition of a message has the types of its members, not their ranges; rules of an overlay
give those, as the values were seen: a frame id that never changed is a constant, a covariance that
was always zero does not cross, numbers get range and step as in other types.

Tokens tell more than samples: who publishes and said nothing, who only subscribes, who serves and
who calls. The topics and services of an action are one stream.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from zacoustic.app.tools.design.first.drafting import Overlaid, RosDraft, Served, TopicDraft
from zacoustic.app.tools.design.first.guessing import priority_of
from zacoustic.app.tools.design.first.inference import InferredField, infer_number
from zacoustic.app.tools.design.first.survey import SeenTopic, Survey
from zacoustic.core.transport.objects.limits import LARGEST_BYTES
from zacoustic.errors import ConfigError, PayloadInvalidError, ZacousticError
from zacoustic.ros.names import NO_HASH, RosKey, interface_of, is_interface, read_key
from zacoustic.ros.qos import RosDurability
from zacoustic.ros.tokens import Entity, Token, read_token

if TYPE_CHECKING:  # needs the extra
    from zacoustic.ros.interfaces import Interfaces

_FRAME_IDS: Final = ("frame_id", "child_frame_id")
_RULE_KEYS: Final = ("range", "step", "unit", "wraps", "outside")
_INFRASTRUCTURE: Final = ("rosout", "parameter_events", "_service_event")
"""Topics of ROS itself, which every node has."""
_SERVICES_OF_NODES: Final = (
    "describe_parameters", "get_parameter_types", "get_parameters", "get_type_description",
    "list_parameters", "set_parameters", "set_parameters_atomically",
)  # fmt: skip
_ACTION: Final = "/_action/"
_SEND_GOAL: Final = "_action/send_goal"
_GOAL_SUFFIX: Final = "_SendGoal"
_USUAL_DISTRO: Final = "jazzy"
_MOST_KEPT: Final = 64
"""Most kept samples of a latched topic that are proposed."""
_OLDEST_NS: Final = 3600 * 10**9
_EARLY_NS: Final = 60 * 10**9
"""Clocks of a vessel differ by less."""


class RosNetwork(msgspec.Struct, frozen=True, kw_only=True):
    """What of a network is ROS 2."""

    distro: str
    """Distribution whose keys it has."""
    domain: int
    """``ROS_DOMAIN_ID``."""
    peer_domain: int | None = None
    """That of the other side; None: the same, as far as is known."""
    packages: Path | None = None
    """Folder with further definitions."""
    drafts: tuple[TopicDraft, ...]
    """Its topics."""
    services: tuple[Served, ...]
    """Its services and actions."""
    called: tuple[Served, ...] = ()
    """Services and actions that somebody calls and nobody serves."""
    wanted: frozenset[str] = frozenset()
    """Names of all services that somebody calls."""
    overlays: tuple[Overlaid, ...]
    """Rules for the types."""
    nested: frozenset[str] = frozenset()
    """Types inside of others that it uses: a rule for one would hold there, too."""
    left_out: tuple[str, ...]
    """What cannot cross, with the reason."""
    keys: frozenset[str]
    """The keys that it accounts for."""


def ros_network(survey: Survey, *, packages: Path | None = None) -> RosNetwork | None:
    """Return what of a network is ROS 2; None: nothing, or its extra is not installed.

    Args:
        survey: What was observed.
        packages: Folder with definitions that do not ship; None: none.

    Raises:
        ConfigError: A definition in the folder cannot be read.
    """
    topics = {topic.key: key for topic in survey.topics if (key := _key(topic.key)) is not None}
    tokens = [token for each in survey.ros_tokens if (token := read_token(each)) is not None]
    if not (topics or any(token.topic for token in tokens)):
        return None
    try:
        import zacoustic.ros.interfaces  # noqa: F401
    except ModuleNotFoundError:
        return None
    domain = _domain(topics.values(), tokens)
    others = sorted({token.node.domain for token in tokens} - {domain})
    own = {text: key for text, key in topics.items() if key.domain == domain}
    tokens = [token for token in tokens if token.node.domain == domain and token.topic]
    interfaces = _interfaces(own.values(), tokens, packages)
    drafting = _Drafting(interfaces, survey.ended_utc_ns)
    drafting.left_out += [f"ROS domain {each}: a gateway has one, here {domain}" for each in others]
    kept = _kept(tokens)
    for topic in survey.topics:
        if topic.key in own:
            key = own[topic.key]
            known = kept.get(f"/{key.name}", topic.kept)
            drafting.add(msgspec.structs.replace(topic, kept=known), key)
    drafting.add_silent(tokens, kept)
    drafting.add_subscribed(tokens)
    services = _served(tokens, Entity.SERVER)
    called = _served(tokens, Entity.CLIENT)
    texts = (*survey.services, *survey.subscribed, *survey.called)
    return RosNetwork(
        distro=interfaces.distro,
        domain=domain,
        packages=packages,
        drafts=tuple(drafting.drafts),
        services=tuple(drafting.usable(services)),
        called=tuple(drafting.usable(called - services, tells=False)),
        wanted=frozenset(each.name for each in called),
        overlays=tuple(drafting.overlays()),
        nested=drafting.nested(each.interface or "" for each in (*services, *called)),
        left_out=tuple(dict.fromkeys(drafting.left_out)),
        keys=frozenset({*topics, *(key for key in texts if _key(key) is not None)}),
    )


def joined(own: RosNetwork | None, peer: RosNetwork | None, *, both: bool) -> RosNetwork | None:
    """Return the networks of both sides as one.

    A topic that was published on the other side is from there, a service that is served there as
    well; one that is called here and served nowhere is assumed to be there, if nobody listened. A
    type whose values were seen on both sides gets no rules: those of one side may refuse the
    other's.

    Args:
        own: This side's.
        peer: The other side's; None: nothing of ROS.
        both: Both sides were listened to.
    """
    if own is None and peer is None:
        return None
    here, there = own or _none_like(peer), peer or _none_like(own)
    counted = Counter(each.interface for each in (*here.overlays, *there.overlays))
    nested = here.nested | there.nested
    overlays = [
        each
        for each in (*here.overlays, *there.overlays)
        if counted[each.interface] == 1 and each.interface not in nested
    ]
    left_out = [*here.left_out, *there.left_out]
    drafts = _joined_drafts(here, there)
    wanted = here.wanted | there.wanted
    services = [
        msgspec.structs.replace(each, is_from_peer=from_peer)
        for side, from_peer in ((here, False), (there, True))
        for each in side.services
        if each.name in wanted or not _is_of_node(each.name)
    ]
    known = {each.name for each in services}
    for side, from_peer in ((here, True), (there, False)):
        for each in side.called:
            if each.name in known or _is_of_node(each.name):
                continue
            known.add(each.name)
            if both:
                left_out.append(f"{each.name}: somebody calls it, and nobody serves it")
            else:
                services.append(msgspec.structs.replace(each, is_from_peer=from_peer))
    return msgspec.structs.replace(
        here if own is not None else there,
        domain=here.domain,
        peer_domain=there.domain,
        drafts=drafts,
        services=tuple(_once(services)),
        overlays=tuple(overlays),
        left_out=tuple(dict.fromkeys(left_out)),
        keys=here.keys | there.keys,
    )


def _joined_drafts(here: RosNetwork, there: RosNetwork) -> tuple[TopicDraft, ...]:
    published = {draft.name: draft for draft in there.drafts if not draft.is_from_peer}
    drafts = []
    for draft in here.drafts:
        theirs = published.pop(draft.name, None)
        if theirs is None or theirs.ros != draft.ros:
            drafts.append(draft)
        elif draft.is_from_peer:
            drafts.append(msgspec.structs.replace(theirs, is_from_peer=True))
        else:
            spoke = draft if draft.seen.samples or not theirs.seen.samples else theirs
            drafts.append(msgspec.structs.replace(spoke, is_from_both=True))
    known = {draft.name for draft in drafts} | published.keys()
    drafts += [msgspec.structs.replace(each, is_from_peer=True) for each in published.values()]
    # What the other side waits for, and nobody published yet, comes from here.
    drafts += [
        msgspec.structs.replace(each, is_from_peer=False)
        for each in there.drafts
        if each.is_from_peer and each.name not in known
    ]
    return tuple(drafts)


def _none_like(other: RosNetwork | None) -> RosNetwork:
    """Return a network without anything, of the distribution of the other."""
    assert other is not None
    return RosNetwork(
        distro=other.distro, domain=other.domain, packages=other.packages, drafts=(), services=(),
        overlays=(), left_out=(), keys=frozenset(),
    )  # fmt: skip


def _once(services: Iterable[Served]) -> Iterator[Served]:
    """Yield each name once: a stream has one server."""
    names: set[str] = set()
    for each in services:
        if each.name not in names:
            names.add(each.name)
            yield each


def _domain(topics: Iterable[RosKey], tokens: Sequence[Token]) -> int:
    """Return the domain of most endpoints."""
    found = Counter(token.node.domain for token in tokens if token.topic)
    found.update(key.domain for key in topics)
    return found.most_common(1)[0][0]


def _interfaces(
    topics: Iterable[RosKey], tokens: Sequence[Token], packages: Path | None
) -> "Interfaces":
    """Return the definitions of the distribution that explains most of the hashes."""
    from zacoustic.ros.interfaces import Interfaces, distros

    seen: dict[str, str] = {interface_of(key.type): key.hash for key in topics}
    seen |= {interface_of(token.type): token.hash for token in tokens if token.hash}
    if NO_HASH in seen.values():
        return Interfaces("humble", packages)
    best = Interfaces(_USUAL_DISTRO, packages)
    most = sum(_has(best, name, digest) for name, digest in seen.items())
    for distro in reversed(distros()):
        if most == len(seen):
            break
        candidate = Interfaces(distro, packages)
        alike = sum(_has(candidate, name, digest) for name, digest in seen.items())
        if alike > most:
            best, most = candidate, alike
    return best


def _has(interfaces: "Interfaces", name: str, digest: str) -> bool:
    """Tell whether a definition has this hash."""
    try:
        return name in interfaces and interfaces.hash_of(name) == digest
    except ConfigError:
        return False


def _kept(tokens: Iterable[Token]) -> dict[str, int]:
    """Return how many samples the publishers of each latched topic keep, together."""
    found: Counter[str] = Counter()
    for token in tokens:
        if token.kind is Entity.PUBLISHER and token.qos.durability is RosDurability.TRANSIENT_LOCAL:
            found[token.topic] += token.qos.depth
    return {topic: min(_MOST_KEPT, depth) for topic, depth in found.items()}


def _served(tokens: Iterable[Token], kind: Entity) -> set[Served]:
    """Return the services and actions of servers or of clients."""
    found: set[Served] = set()
    for token in tokens:
        if token.kind is not kind:
            continue
        interface = interface_of(token.type)
        if _ACTION not in token.topic:
            found.add(Served(name=token.topic, interface=interface))
        elif token.topic.endswith(_SEND_GOAL):
            name = token.topic.removesuffix(_SEND_GOAL).rstrip("/")
            type_ = interface.removesuffix(_GOAL_SUFFIX)
            found.add(Served(name=name, interface=type_, is_action=True))
    return found


def _is_of_node(name: str) -> bool:
    return name.rpartition("/")[2] in _SERVICES_OF_NODES


def _is_infrastructure(name: str) -> bool:
    """Tell whether a topic is of ROS itself, or a part of an action."""
    return name.rpartition("/")[2] in _INFRASTRUCTURE or _ACTION in name


class _Drafting:
    def __init__(self, interfaces: "Interfaces", ended_utc_ns: int | None) -> None:
        from zacoustic.ros.mapping import TypeMapper

        self._interfaces = interfaces
        self._ended_utc_ns = ended_utc_ns
        self._mapper = TypeMapper(interfaces)
        self.drafts: list[TopicDraft] = []
        self.left_out: list[str] = []
        self._values: dict[str, list[Mapping[str, Any]]] = {}
        self._unseen: set[str] = set()

    def add(self, topic: SeenTopic, key: RosKey) -> None:
        """Draft a topic that was published."""
        name = f"/{key.name}"
        if _is_infrastructure(name):
            if _ACTION not in name:
                self.left_out.append(f"{name}: of ROS itself")
            return
        if topic.largest_bytes > LARGEST_BYTES:
            self.left_out.append(f"{name}: {topic.largest_bytes} bytes; allowed: {LARGEST_BYTES}")
            return
        draft = self._draft(topic, name, interface_of(key.type), key.hash)
        if draft is not None:
            self.drafts.append(draft)
            self._values.setdefault(interface_of(key.type), []).extend(draft.values)

    def add_silent(self, tokens: Sequence[Token], kept: Mapping[str, int]) -> None:
        """Draft the topics that have a publisher who said nothing meanwhile."""
        for draft in self._unseen_drafts(tokens, Entity.PUBLISHER, kept):
            self.drafts.append(msgspec.structs.replace(draft, is_silent=True))

    def add_subscribed(self, tokens: Sequence[Token]) -> None:
        """Draft the topics that are subscribed and not published: the other side does that."""
        kept: Counter[str] = Counter()
        for token in tokens:
            if token.qos.durability is RosDurability.TRANSIENT_LOCAL:
                kept[token.topic] = max(kept[token.topic], min(_MOST_KEPT, token.qos.depth))
        for draft in self._unseen_drafts(tokens, Entity.SUBSCRIPTION, kept):
            self.drafts.append(msgspec.structs.replace(draft, is_from_peer=True))

    def usable(self, served: Iterable[Served], *, tells: bool = True) -> Iterator[Served]:
        """Yield the services and actions whose definitions are known, by name."""
        for each in sorted(served, key=lambda each: each.name):
            interface = each.interface or ""
            part = f"{interface}_{'Goal' if each.is_action else 'Request'}"
            if is_interface(interface) and part in self._interfaces:
                yield each
            elif tells and not _is_of_node(each.name):
                self.left_out.append(
                    f"{each.name}: the definition of {interface} is not here: --packages FOLDER"
                )

    def overlays(self) -> Iterator[Overlaid]:
        """Yield the rules for each type whose values were seen."""
        for interface, values in self._values.items():
            is_whole = interface not in self._unseen
            rules = tuple(_rules(values, interface, are_all=is_whole)) if values else ()
            if rules:
                yield Overlaid(interface=interface, rules=rules)

    def nested(self, services: Iterable[str]) -> frozenset[str]:
        """Return the types inside of those of the topics, and of services."""
        from zacoustic.ros.streams import messages_of

        found: set[str] = set()
        outer = [draft.ros.interface for draft in self.drafts if draft.ros is not None]
        outer += [part for each in services if is_interface(each) for part in messages_of(each)]
        for name in dict.fromkeys(outer):
            if name in self._interfaces:
                self._add_nested(name, found)
        return frozenset(found)

    def _add_nested(self, name: str, found: set[str]) -> None:
        for member in self._interfaces.members(name):
            if member.is_nested and member.type not in found:
                found.add(member.type)
                self._add_nested(member.type, found)

    def _unseen_drafts(
        self, tokens: Sequence[Token], kind: Entity, kept: Mapping[str, int]
    ) -> Iterator[TopicDraft]:
        known = {draft.name for draft in self.drafts}
        for token in tokens:
            if token.kind is not kind or token.topic in known or _is_infrastructure(token.topic):
                continue
            known.add(token.topic)
            nothing = SeenTopic(
                key=token.topic.lstrip("/"), samples=0, rate_hz=0.0, encoding="application/cdr",
                smallest_bytes=0, largest_bytes=0, kept=kept.get(token.topic, 0),
            )  # fmt: skip
            draft = self._draft(nothing, token.topic, interface_of(token.type), token.hash)
            if draft is not None:
                self._unseen.add(interface_of(token.type))
                yield draft

    def _draft(self, topic: SeenTopic, name: str, interface: str, digest: str) -> TopicDraft | None:
        from zacoustic.ros.interfaces import has_header
        from zacoustic.ros.messages import HeaderStamp, RosMessage

        try:
            if interface not in self._interfaces:
                raise ConfigError(f"the definition of {interface} is not here: --packages FOLDER")
            if digest and self._interfaces.hash_of(interface) != digest:
                distro = self._interfaces.distro
                raise ConfigError(
                    f"its {interface} is another than that of {distro}: --packages FOLDER"
                )
            stamped = has_header(self._interfaces, interface)
            stamp = HeaderStamp.AGE if stamped else HeaderStamp.EXACT
            message = RosMessage(self._interfaces, self._mapper, interface, stamp)
            read = [message.read(payload) for payload in topic.payloads]
            has_age = stamped and self._are_of_now([stamp_ns for _, stamp_ns in read])
            if stamped and not has_age:
                message = RosMessage(self._interfaces, self._mapper, interface, HeaderStamp.EXACT)
                read = [message.read(payload) for payload in topic.payloads]
        except (ConfigError, PayloadInvalidError, ZacousticError) as error:
            self.left_out.append(f"{name}: {error.args[0]}")
            return None
        return TopicDraft(
            seen=topic,
            ros=RosDraft(name=name, interface=interface, has_age=has_age),
            encoding="application/cdr",
            values=tuple(value for value, _ in read),
            priority=priority_of(name),
        )

    def _are_of_now(self, stamps_ns: Sequence[int | None]) -> bool:
        """Tell whether stamps have an age: they are set, by a clock that shows the time of day.

        Those of a simulation, or of a node that sets none, do not.
        """
        if self._ended_utc_ns is None or not stamps_ns:
            return True
        earliest, latest = self._ended_utc_ns - _OLDEST_NS, self._ended_utc_ns + _EARLY_NS
        return all(each is not None and earliest <= each <= latest for each in stamps_ns)


def _key(text: str) -> RosKey | None:
    key = read_key(text)
    return key if key is not None and is_interface(interface_of(key.type)) else None


def _rules(
    values: Sequence[Mapping[str, Any]], interface: str, *, are_all: bool
) -> Iterator[InferredField]:
    """Yield a rule for each member that needs one.

    Args:
        values: Observed values.
        interface: Their type.
        are_all: All topics of the type were heard; otherwise nothing is constant or left out.
    """
    what = "acceleration_" if "Accel" in interface else ""
    for path, seen in _leaves(values).items():
        name = path.rpartition(".")[2]
        flat = [each for value in seen for each in (value if isinstance(value, list) else [value])]
        numbers = [each for each in flat if isinstance(each, int | float)]
        rule: dict[str, Any] = {}
        remark = ""
        if (
            name in _FRAME_IDS
            and are_all
            and len({*map(str, seen)}) == 1
            and isinstance(seen[0], str)
        ):
            rule, remark = {"constant": seen[0]}, "did not change"
        elif "covariance" in name and are_all and numbers and not any(numbers):
            rule, remark = {"omit": True}, "always zero: does not cross"
        elif numbers and len(numbers) == len(flat) and any(isinstance(n, float) for n in numbers):
            # `x` alone is a place; of an orientation or a velocity it is something else.
            named = what + "_".join(path.split(".")[-2:])
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
