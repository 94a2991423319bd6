"""The list `streams`: finds the kind of each entry by its keys, checks and declares it."""

import re
from collections.abc import Callable
from typing import Final, TypeVar

import msgspec

from zacoustic.config.later import check_word
from zacoustic.config.problems import Place, shown
from zacoustic.config.ros import RosReader
from zacoustic.config.sections import ALLOWED, ActionEntry, ServiceEntry, StreamEntry, TopicEntry
from zacoustic.core.base.qos import PRIORITY_NAMES, Durability, Forward, Qos, Reliability, Stamp
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.keys import NODE_PLACEHOLDER, Wildcard
from zacoustic.core.streams.specs import (
    CODECS,
    STREAM_OUTSIDE_WORDS,
    ActionSpec,
    ServiceSpec,
    StreamSpec,
    TopicSpec,
)
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.transport.objects.limits import LARGEST_BYTES
from zacoustic.core.values.dense import Model
from zacoustic.core.values.encoding import LONGEST_ENCODING_BYTES, TYPED_ENCODINGS
from zacoustic.core.values.types import TypeTable
from zacoustic.errors import ConfigError

E = TypeVar("E", bound=StreamEntry)

_KINDS: Final = ("topic", "service", "action")
# Form of the errors of `Qos`: the key, the value, the allowed values.
_QOS_REFUSAL: Final = re.compile(r"(\w+) is .*; allowed: (.*)")


class Fleet(msgspec.Struct, frozen=True, kw_only=True):
    """What streams refer to."""

    nodes: dict[int, str]
    """Name of each node by address; empty if the fleet is not listed."""
    types: TypeTable
    """The types by name."""
    model: Model | None = None
    """The fitted model of the dense streams."""
    largest_bytes: int = LARGEST_BYTES
    """Largest sample that the node sends or accepts, bytes."""
    wire: WireProfile = WireProfile.NATIVE
    """Wire profile of the link."""


def read_streams(place: Place, count: int, fleet: Fleet, ros: RosReader) -> StreamTable:
    """Read the list at `place`, which has `count` entries.

    Args:
        place: The list.
        count: Its length.
        fleet: Nodes, types and other things to which streams refer.
        ros: Reads their ROS settings.

    Raises:
        ConfigError: An entry is wrong; reports the first.
    """
    table = StreamTable(types=fleet.types, nodes=fleet.nodes, model=fleet.model, wire=fleet.wire)
    for index in range(count):
        here = place.at(index)
        spec = _read_stream(here, fleet, ros)
        try:
            table.declare(spec)
        except ConfigError as error:
            here.repeat(_in_written_keys(error, spec))
    return table


def _read_stream(place: Place, fleet: Fleet, ros: RosReader) -> StreamSpec:
    kinds = [kind for kind in _KINDS if kind in place.written]
    if len(kinds) != 1:
        what = " and ".join(kinds) if kinds else f"none of {', '.join(_KINDS)}"
        place.refuse(what, allowed=f"one of {', '.join(_KINDS)}")
    if kinds[0] == "topic":
        return _read_topic(place, _resolved(place, "topic", TopicEntry, ros), fleet)
    if kinds[0] == "service":
        return _read_service(place, _resolved(place, "service", ServiceEntry, ros), fleet)
    return _read_action(place, _resolved(place, "action", ActionEntry, ros), fleet)


def _resolved(place: Place, kind: str, record: type[E], ros: RosReader) -> E:
    """Read a table, with its ROS types and names resolved."""
    place.convert(record)
    return msgspec.convert(ros.resolve(place, kind), record)


def _read_topic(place: Place, entry: TopicEntry, fleet: Fleet) -> TopicSpec:
    check_word(
        place.at("reliability"), entry.reliability, tuple(each.value for each in Reliability)
    )
    check_word(place.at("durability"), entry.durability, tuple(each.value for each in Durability))
    check_word(place.at("forward"), entry.forward, tuple(forward.value for forward in Forward))
    check_word(place.at("stamp"), entry.stamp, tuple(stamp.value for stamp in Stamp))
    _check_type(place.at("type"), entry.type, fleet)
    _check_codec(place, entry, is_typed=entry.type is not None)
    _check_addresses(place.at("publishers"), entry.publishers, fleet)
    _check_addresses(place.at("subscribers"), entry.subscribers, fleet)
    if f"{{{NODE_PLACEHOLDER}}}" in entry.topic and not fleet.nodes:
        place.at("topic").refuse(
            f'"{entry.topic}" has {{node}}, and nodes is empty', allowed="with nodes listed"
        )
    qos = _read_qos(
        place,
        lambda: Qos(
            priority=PRIORITY_NAMES[entry.priority],
            reliability=Reliability(entry.reliability),
            durability=Durability(entry.durability),
            depth=entry.depth,
            lifespan_s=entry.lifespan_s,
            deadline_s=entry.deadline_s,
            min_interval_s=entry.min_interval_s,
            linger_s=entry.linger_s,
            max_airtime=entry.max_airtime,
            stamp=Stamp(entry.stamp),
            forward=Forward(entry.forward),
            exclusive=entry.exclusive,
        ),
    )
    _check_large(place, entry, fleet)
    _check_reliability(place, entry, fleet)
    if qos.forward is Forward.ON_DEMAND and not (fleet.nodes or entry.publishers):
        place.at("publishers").refuse(
            "is missing, and so is nodes: nobody is known who could be asked for the topic",
            allowed=ALLOWED["publishers"],
            hint="list the publishers here, or the fleet under nodes",
        )
    return TopicSpec(
        stream_id=entry.id,
        name=entry.topic,
        type_name=entry.type,
        publishers=entry.publishers,
        subscribers=entry.subscribers,
        wildcards=tuple(Wildcard(name=each.name, values=each.values) for each in entry.wildcards),
        local_publishers=entry.local_publishers,
        encoding=entry.encoding,
        codec=entry.codec or "cbor",
        outside=entry.outside,
        qos=qos,
        max_bytes=entry.max_bytes,
        journal=entry.journal,
        carry=_read_carried(place.at("carry"), entry, fleet),
    )


def _read_carried(place: Place, entry: TopicEntry, fleet: Fleet) -> Carry | None:
    """Read who carries a topic; `TopicSpec` is checked as a whole when it is declared."""
    written = entry.carry
    if written is None:
        return None
    if fleet.wire is WireProfile.RMW_DESERT:
        place.refuse('on wire: "rmw_desert"', allowed='on wire: "native"')
    if not fleet.nodes:
        place.refuse("without nodes", allowed="with the fleet listed under nodes")
    _check_addresses(place.at("by"), written.by, fleet)
    ends = {*(entry.publishers or ()), *(entry.subscribers or ())}
    for index, address in enumerate(written.by):
        if entry.subscribers is not None and set(entry.subscribers) == {address}:
            place.at("by").at(index).refuse(
                f"{address}, the only subscriber", allowed="nodes between the ends"
            )
    if ends and ends <= set(written.by):
        place.at("by").refuse(allowed="nodes between publishers and subscribers")
    return Carry(by=written.by, after_s=written.after_s, expires_s=written.expires_s)


def _read_service(place: Place, entry: ServiceEntry, fleet: Fleet) -> ServiceSpec:
    _check_type(place.at("request"), entry.request, fleet)
    _check_type(place.at("response"), entry.response, fleet)
    is_typed = entry.request is not None or entry.response is not None
    _check_codec(place, entry, is_typed=is_typed)
    check_address(place.at("server"), entry.server, fleet)
    qos = _read_qos(
        place,
        lambda: Qos(
            priority=PRIORITY_NAMES[entry.priority],
            linger_s=entry.linger_s,
            max_airtime=entry.max_airtime,
        ),
    )
    return ServiceSpec(
        stream_id=entry.id,
        name=entry.service,
        server=entry.server,
        request_type=entry.request,
        response_type=entry.response,
        timeout_s=entry.timeout_s,
        encoding=entry.encoding,
        codec=entry.codec or "cbor",
        outside=entry.outside,
        qos=qos,
        journal=entry.journal,
    )


def _read_action(place: Place, entry: ActionEntry, fleet: Fleet) -> ActionSpec:
    names = {"goal": entry.goal, "feedback": entry.feedback, "result": entry.result}
    for key, name in names.items():
        _check_type(place.at(key), name, fleet)
    _check_codec(place, entry, is_typed=any(name is not None for name in names.values()))
    check_address(place.at("server"), entry.server, fleet)
    qos = _read_qos(
        place,
        lambda: Qos(
            priority=PRIORITY_NAMES[entry.priority],
            linger_s=entry.linger_s,
            max_airtime=entry.max_airtime,
        ),
    )
    return ActionSpec(
        stream_id=entry.id,
        name=entry.action,
        server=entry.server,
        goal_type=entry.goal,
        feedback_type=entry.feedback,
        result_type=entry.result,
        timeout_s=entry.timeout_s,
        result_timeout_s=entry.result_timeout_s,
        feedback_interval_s=entry.feedback_interval_s,
        encoding=entry.encoding,
        codec=entry.codec or "cbor",
        outside=entry.outside,
        qos=qos,
        journal=entry.journal,
    )


def _check_reliability(place: Place, entry: TopicEntry, fleet: Fleet) -> None:
    """Check that some node acknowledges, and that a journal is of use."""
    if entry.reliability == Reliability.RELIABLE.value:
        if entry.subscribers is None and not fleet.nodes:
            place.at("subscribers").refuse(
                "is missing, and so is nodes: nobody is known to acknowledge a reliable topic",
                allowed=ALLOWED["subscribers"],
                hint="list the subscribers here, or the fleet under nodes",
            )
        others = set(fleet.nodes if entry.subscribers is None else entry.subscribers)
        if entry.publishers is not None and others == set(entry.publishers) and len(others) == 1:
            place.at("subscribers").refuse(
                "nobody but the publisher", allowed="at least one node that does not publish"
            )
    elif entry.journal:
        place.at("journal").refuse(
            "true for a best-effort topic, of which nothing is promised",
            allowed="with reliability: reliable",
            hint="say reliability, or leave journal out",
        )


def _check_large(place: Place, entry: TopicEntry, fleet: Fleet) -> None:
    """Check the settings of samples that are larger than a frame."""
    for key, is_written in (
        ("max_bytes", entry.max_bytes is not None),
        ("exclusive", entry.exclusive),
    ):
        if is_written and entry.reliability != Reliability.RELIABLE.value:
            place.at(key).refuse(
                f"{shown(place.at(key).written)} for a best-effort topic, "
                "whose samples fit a frame",
                allowed="with reliability: reliable",
                hint=f"say reliability, or leave {key} out",
            )
    if entry.max_bytes is not None and not 1 <= entry.max_bytes <= fleet.largest_bytes:
        place.at("max_bytes").refuse(
            allowed=f"1..{fleet.largest_bytes}", hint="objects.max_bytes is the most"
        )


def _check_codec(place: Place, entry: StreamEntry, *, is_typed: bool) -> None:
    """Check codec, encoding and priority."""
    check_word(place.at("priority"), entry.priority, tuple(PRIORITY_NAMES))
    check_word(place.at("outside"), entry.outside, STREAM_OUTSIDE_WORDS)
    if entry.outside == "clamp" and not is_typed:
        place.at("outside").refuse('"clamp" for opaque bytes', allowed="for typed streams")
    if entry.codec is not None:
        check_word(place.at("codec"), entry.codec, tuple(CODECS))
        if entry.codec == "cbor" and not is_typed:
            place.at("codec").refuse(
                f'"{entry.codec}" for opaque bytes',
                allowed="typed streams; here packed, for topics dense, or none",
                hint="add a type",
            )
    if entry.encoding is None:
        return
    if is_typed and entry.encoding.split(";", 1)[0] not in TYPED_ENCODINGS:
        place.at("encoding").refuse(allowed=f"for a typed stream {', '.join(TYPED_ENCODINGS)}")
    if not 1 <= len(entry.encoding.encode(errors="replace")) <= LONGEST_ENCODING_BYTES:
        place.at("encoding").refuse(allowed=f"1..{LONGEST_ENCODING_BYTES} bytes of text")


def _check_type(place: Place, name: str | None, fleet: Fleet) -> None:
    if name is None:
        return
    try:
        fleet.types.by_name(name)
    except ConfigError as error:
        _, _, allowed = str(error.args[0]).partition("allowed: ")
        place.refuse(f'"{name}" is not known', allowed=allowed, hint=error.hint)


def _check_addresses(place: Place, addresses: tuple[int, ...] | None, fleet: Fleet) -> None:
    if addresses is None:
        return
    if not addresses:
        place.refuse(allowed="at least one address", hint="leave it out for all nodes")
    for index, address in enumerate(addresses):
        check_address(place.at(index), address, fleet)
        if address in addresses[:index]:
            place.at(index).refuse(f"{address} a second time", allowed="each address once")


def check_address(place: Place, address: int, fleet: Fleet) -> None:
    """Check the address that is written at `place`.

    Raises:
        ConfigError: No node of the fleet has the address, or no node can.
    """
    if fleet.nodes and address not in fleet.nodes:
        known = ", ".join(f"{known} ({name})" for known, name in fleet.nodes.items())
        place.refuse(f"{address} is no node", allowed=known, hint="add it to nodes")
    if not 1 <= address <= 254:
        place.refuse(allowed=ALLOWED["address"])


def _read_qos(place: Place, make: Callable[[], Qos]) -> Qos:
    try:
        return make()
    except ValueError as error:
        refusal = _QOS_REFUSAL.fullmatch(str(error))
        if refusal is None:
            place.refuse(str(error))
        place.at(refusal[1]).refuse(allowed=refusal[2])


def _in_written_keys(error: ConfigError, spec: StreamSpec) -> ConfigError:
    """Return the error with the key of the file in place of the core's `name`."""
    kind = "topic"
    if not isinstance(spec, TopicSpec):
        kind = "service" if isinstance(spec, ServiceSpec) else "action"
    message = str(error.args[0])
    if message.startswith("name: "):
        message = kind + message.removeprefix("name")
    return ConfigError(message, hint=error.hint)
