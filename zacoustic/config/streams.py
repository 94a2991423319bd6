"""The list `streams`: finds the kind of each entry by its keys, checks and declares it."""

import re
from typing import Any, Final

import msgspec

from zacoustic.config.problems import Place, shown
from zacoustic.config.references import Known, check_references
from zacoustic.config.ros import RosReader
from zacoustic.config.sections import STREAMS, ActionEntry, ServiceEntry, StreamEntry, TopicEntry
from zacoustic.core.base.qos import PRIORITY_NAMES, Forward, Qos, Reliability
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.keys import NODE_PLACEHOLDER
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.transport.objects.limits import LARGEST_BYTES
from zacoustic.core.values.dense import Model
from zacoustic.core.values.encoding import LONGEST_ENCODING_BYTES, TYPED_ENCODINGS
from zacoustic.core.values.types import TypeTable
from zacoustic.errors import ConfigError

# Form of the errors of `Qos`: the key, the value, the allowed values.
_QOS_REFUSAL: Final = re.compile(r"(\w+) is .*; allowed: (.*)")
_TYPE_KEYS: Final = ("type", "request", "response", "goal", "feedback", "result")


class Fleet(msgspec.Struct, frozen=True, kw_only=True):
    """What streams refer to."""

    nodes: dict[int, str]
    """Name of each node by address; empty if the fleet is not listed."""
    known: Known
    """What streams may refer to by a name or an address."""
    types: TypeTable
    """The types by name."""
    model: Model | None = None
    """The fitted model of the dense streams."""
    largest_bytes: int = LARGEST_BYTES
    """Largest sample that the node sends or accepts, bytes."""
    wire: WireProfile = WireProfile.NATIVE
    """Wire profile of the link."""


def read_streams(place: Place, fleet: Fleet, ros: RosReader) -> StreamTable:
    """Read the list at `place`.

    Args:
        place: The list.
        fleet: Nodes, types and other things to which streams refer.
        ros: Reads their ROS settings.

    Raises:
        ConfigError: An entry is wrong; reports the first.
    """
    table = StreamTable(types=fleet.types, nodes=fleet.nodes, model=fleet.model, wire=fleet.wire)
    for here in place.items:
        spec = _read_stream(here, fleet, ros)
        try:
            table.declare(spec)
        except ConfigError as error:
            here.repeat(_in_written_keys(error, spec))
    return table


def _read_stream(place: Place, fleet: Fleet, ros: RosReader) -> StreamSpec:
    kinds = [kind for kind in STREAMS if kind in place.written]
    if len(kinds) != 1:
        what = " and ".join(kinds) if kinds else f"none of {', '.join(STREAMS)}"
        place.refuse(what, allowed=f"one of {', '.join(STREAMS)}")
    (kind,) = kinds
    place.convert(STREAMS[kind])
    entry = msgspec.convert(ros.resolve(place, kind), STREAMS[kind])
    check_references(place, entry, None, fleet.known)
    _check_codec(place, entry, fleet)
    qos = _read_qos(place, entry)
    if isinstance(entry, TopicEntry):
        return _read_topic(place, entry, fleet, qos)
    if isinstance(entry, ServiceEntry):
        return ServiceSpec(
            name=entry.service,
            server=entry.server,
            request_type=entry.request,
            response_type=entry.response,
            timeout_s=entry.timeout_s,
            journal=entry.journal,
            **_common(entry, qos),
        )
    assert isinstance(entry, ActionEntry)
    return ActionSpec(
        name=entry.action,
        server=entry.server,
        goal_type=entry.goal,
        feedback_type=entry.feedback,
        result_type=entry.result,
        timeout_s=entry.timeout_s,
        result_timeout_s=entry.result_timeout_s,
        feedback_interval_s=entry.feedback_interval_s,
        journal=entry.journal,
        **_common(entry, qos),
    )


def _common(entry: StreamEntry, qos: Qos) -> dict[str, Any]:
    """Return what the specifications of all kinds have."""
    return {
        "stream_id": entry.id,
        "encoding": entry.encoding,
        "codec": entry.codec or "cbor",
        "outside": entry.outside,
        "qos": qos,
    }


def _read_topic(place: Place, entry: TopicEntry, fleet: Fleet, qos: Qos) -> TopicSpec:
    if f"{{{NODE_PLACEHOLDER}}}" in entry.topic and not fleet.nodes:
        place.at("topic").refuse(
            f'"{entry.topic}" has {{node}}, and nodes is empty', allowed="with nodes listed"
        )
    _check_large(place, entry, fleet)
    _check_reliability(place, entry, fleet)
    if qos.forward is Forward.ON_DEMAND and not (fleet.nodes or entry.publishers):
        place.at("publishers").refuse(
            "is missing, and so is nodes: nobody is known who could be asked for the topic",
            allowed=place.at("publishers").allowed,
            hint="list the publishers here, or the fleet under nodes",
        )
    return TopicSpec(
        name=entry.topic,
        type_name=entry.type,
        publishers=entry.publishers,
        subscribers=entry.subscribers,
        wildcards=entry.wildcards,
        local_publishers=entry.local_publishers,
        max_bytes=entry.max_bytes,
        journal=entry.journal,
        carry=_read_carried(place.at("carry"), entry, fleet),
        **_common(entry, qos),
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
    ends = {*(entry.publishers or ()), *(entry.subscribers or ())}
    for index, address in enumerate(written.by):
        if entry.subscribers is not None and set(entry.subscribers) == {address}:
            place.at("by").at(index).refuse(
                f"{address}, the only subscriber", allowed="nodes between the ends"
            )
    if ends and ends <= set(written.by):
        place.at("by").refuse(allowed="nodes between publishers and subscribers")
    return written


def _check_reliability(place: Place, entry: TopicEntry, fleet: Fleet) -> None:
    """Check that some node acknowledges, and that a journal is of use."""
    if entry.reliability is Reliability.RELIABLE:
        if entry.subscribers is None and not fleet.nodes:
            place.at("subscribers").refuse(
                "is missing, and so is nodes: nobody is known to acknowledge a reliable topic",
                allowed=place.at("subscribers").allowed,
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
        if is_written and entry.reliability is not Reliability.RELIABLE:
            place.at(key).refuse(
                f"{shown(place.at(key).written)} for a best-effort topic, "
                "whose samples fit a frame",
                allowed="with reliability: reliable",
                hint=f"say reliability, or leave {key} out",
            )
    if entry.max_bytes is not None and entry.max_bytes > fleet.largest_bytes:
        place.at("max_bytes").refuse(
            allowed=f"1..{fleet.largest_bytes}", hint="objects.max_bytes is the most"
        )


def _check_codec(place: Place, entry: StreamEntry, fleet: Fleet) -> None:
    """Check the types of a stream, and what its codec, encoding and `outside` need of them."""
    types = {key: getattr(entry, key, None) for key in _TYPE_KEYS}
    for key, name in types.items():
        _check_type(place.at(key), name, fleet)
    is_typed = any(types.values())
    if entry.outside == "clamp" and not is_typed:
        place.at("outside").refuse('"clamp" for opaque bytes', allowed="for typed streams")
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


def _read_qos(place: Place, entry: StreamEntry) -> Qos:
    """Return the QoS that the keys of a stream say."""
    keys = {key: getattr(entry, key) for key in Qos.__struct_fields__ if hasattr(entry, key)}
    try:
        return Qos(**keys | {"priority": PRIORITY_NAMES[entry.priority]})
    except ValueError as error:
        refusal = _QOS_REFUSAL.fullmatch(str(error))
        assert refusal is not None
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
