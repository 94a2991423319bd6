"""The files: a survey as a configuration for both sides, with a comment where a user knows more.

The text is read back before it is returned, and every observed payload must fit its type. A topic
that fails becomes opaque bytes.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.first.drafting import (
    Overlaid,
    RosDraft,
    TopicDraft,
    draft_topic,
    type_names,
)
from zacoustic.app.tools.design.first.guessing import COMMANDING, USUAL, priority_of
from zacoustic.app.tools.design.first.inference import InferredType
from zacoustic.app.tools.design.first.pacing import LIFESPAN_S, paced, sized
from zacoustic.app.tools.design.first.rosdrafting import RosNetwork, joined, ros_network
from zacoustic.app.tools.design.first.survey import PAYLOAD_LIMIT_BYTES, SeenTopic, Survey
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.config import Config, config_from_mapping
from zacoustic.config.json5 import parse_json5
from zacoustic.core.peers.agreementpolicy import TAGS_FROM_NODES, AgreementMethod
from zacoustic.core.streams.keys import fault_of_name
from zacoustic.core.streams.specs import LAST_STREAM_ID
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.objects.limits import LARGEST_BYTES
from zacoustic.core.values.encoding import CBOR, OPAQUE
from zacoustic.errors import ConfigError
from zacoustic.text.safetext import json_line

FIRST_ID: Final = 10
"""Stream id of the first topic; lower ones are left for more important topics."""
DEFAULT_LINK: Final = "sim/127.0.0.1:7000"
"""Locator of a modem that is not named."""
_UNSEEN_BYTES: Final = 16
"""Assumed size of a sample that nobody published."""


class Side(msgspec.Struct, frozen=True, kw_only=True):
    """One end of the channel."""

    address: int
    """Acoustic address, 1…254."""
    name: str
    """Name of the node, one chunk of a key."""
    locator: str | None = None
    """Locator of its modem; None: not known yet."""


HERE: Final = Side(address=1, name="here")
THERE: Final = Side(address=2, name="there")


class Files(msgspec.Struct, frozen=True, kw_only=True):
    """What has been written."""

    text: str
    """The file of the side that was listened to."""
    peer_text: str
    """The file of the other side: the same streams, a router of its own."""
    config: Config
    """The configuration that the first defines."""
    drafts: tuple[TopicDraft, ...]
    """The topics in it."""
    examples: tuple[Any, ...]
    """The last observed value of each topic, as it crosses; None: none, or it has no type."""
    left_out: tuple[str, ...]
    """What is not in it, with the reason."""


class _Content(msgspec.Struct, frozen=True, kw_only=True):
    """What both files have."""

    survey: Survey
    here: Side
    there: Side
    drafts: list[TopicDraft]
    services: list[tuple[str, str | None]]
    """Name and ROS type; None: it is not of ROS."""
    left_out: list[str]
    ros: RosNetwork | None
    peer_listen: str
    others: tuple[Side, ...]


def write_config(survey: Survey) -> tuple[str, Config]:
    """Write the file of the side that was listened to.

    Returns:
        The text, and the configuration that it defines.

    Raises:
        ConfigError: Nothing was observed that could be a stream.
    """
    files = write_files(survey)
    return files.text, files.config


def write_files(
    survey: Survey,
    *,
    here: Side = HERE,
    there: Side = THERE,
    peer: Survey | None = None,
    peer_listen: str = "tcp/127.0.0.1:7447",
    others: Sequence[Side] = (),
    profile: str = DEFAULT_PROFILE,
    choose: Callable[[Sequence[TopicDraft]], Sequence[TopicDraft]] = lambda drafts: drafts,
) -> Files:
    """Write the files of both sides.

    Args:
        survey: What was observed on this side.
        here: This side.
        there: The other side.
        peer: What was observed on the other side; None: it was not listened to.
        peer_listen: Where the other side's router listens.
        others: Further nodes of the fleet.
        profile: The modem.
        choose: Changes the drafts before they are written, as a user does who is asked.

    Raises:
        ConfigError: Nothing was observed that could be a stream.
    """
    modem = profile_named(profile)
    content = _content(survey, here, there, peer, peer_listen)
    content = msgspec.structs.replace(content, others=tuple(others))
    config = _read(_own_text(content))  # without intervals: for the sizes
    sizes = [
        _largest_bytes(draft, config.table.by_id(stream_id), content.ros)
        for stream_id, draft in enumerate(content.drafts, FIRST_ID)
    ]
    drafts = [sized(each, size, modem) for each, size in zip(content.drafts, sizes, strict=True)]
    drafts = list(choose(paced(drafts, sizes, modem)))
    if not (drafts or content.services):
        raise ConfigError("nothing is left", hint="keep a topic")
    content = msgspec.structs.replace(content, drafts=drafts)
    text, peer_text = _own_text(content), _peer_text(content)
    _read(peer_text)
    return Files(
        text=text,
        peer_text=peer_text,
        config=_read(text),
        drafts=tuple(drafts),
        examples=tuple(_example(each, content.ros) for each in drafts),
        left_out=tuple(content.left_out),
    )


def _content(
    survey: Survey, here: Side, there: Side, peer: Survey | None, peer_listen: str
) -> _Content:
    ros = joined(ros_network(survey), None if peer is None else ros_network(peer))
    accounted = ros.keys if ros is not None else frozenset()
    topics = [topic for topic in survey.topics if topic.key not in accounted]
    own = {topic.key for topic in topics}
    from_peer = (
        [] if peer is None else [each for each in peer.topics if each.key not in own | accounted]
    )
    known = own | {topic.key for topic in from_peer} | accounted
    from_peer += [_unseen(key) for key in survey.subscribed if key not in known]
    everything = [*topics, *from_peer]
    left_out = [f"{topic.key}: {fault}" for topic in everything if (fault := _fault_of(topic.key))]
    left_out += [
        f"{topic.key}: {topic.largest_bytes} bytes; allowed: {LARGEST_BYTES}"
        for topic in everything
        if _fault_of(topic.key) is None and topic.largest_bytes > LARGEST_BYTES
    ]
    usable = [
        topic
        for topic in everything
        if _fault_of(topic.key) is None and topic.largest_bytes <= LARGEST_BYTES
    ]
    foreign = {topic.key for topic in from_peer}
    names = type_names([topic.key for topic in usable])
    drafts = [
        msgspec.structs.replace(draft_topic(topic, name), is_from_peer=topic.key in foreign)
        for topic, name in zip(usable, names, strict=True)
    ]
    drafts += [] if ros is None else ros.drafts
    left_out += [] if ros is None else ros.left_out
    taken = {topic.key for topic in usable}
    services: list[tuple[str, str | None]] = [
        (key, None)
        for key in survey.services
        if _fault_of(key) is None and key not in taken and key not in accounted
    ]
    services += [] if ros is None else list(ros.services)
    room = LAST_STREAM_ID - FIRST_ID + 1
    left_out += [f"{draft.name}: no stream id left" for draft in drafts[room:]]
    drafts, services = drafts[:room], services[: max(0, room - len(drafts))]
    if not (drafts or services):
        raise ConfigError(
            f"{survey.endpoint}: nothing was published within {survey.listened_s:g} s",
            hint="start the nodes first, or listen longer: --listen-s 30",
        )
    return _Content(
        survey=survey, here=here, there=there, drafts=drafts, services=services,
        left_out=left_out, ros=ros, peer_listen=peer_listen, others=(),
    )  # fmt: skip


def _unseen(key: str) -> SeenTopic:
    return SeenTopic(
        key=key, samples=0, rate_hz=0.0, encoding=OPAQUE, smallest_bytes=0, largest_bytes=0
    )


def _read(text: str) -> Config:
    whole: Any = parse_json5(text, source="the first configuration")
    return config_from_mapping(whole["plugins"]["acoustic"], source="the first configuration")


def _largest_bytes(draft: TopicDraft, stream: Stream, ros: RosNetwork | None) -> int:
    """Return the largest transmitted payload of the observed values, bytes."""
    seen = draft.seen
    if not draft.values:
        return seen.largest_bytes or _UNSEEN_BYTES
    largest = max(len(stream.codec.encode(value)) for value in _crossing(draft, ros))
    # What is too large to be a value of a type was only counted.
    return max(largest, seen.largest_bytes) if seen.largest_bytes > PAYLOAD_LIMIT_BYTES else largest


def _example(draft: TopicDraft, ros: RosNetwork | None) -> Any:  # noqa: ANN401
    is_typed = draft.types or draft.ros is not None
    return _crossing(draft, ros)[-1] if is_typed and draft.values else None


def _crossing(draft: TopicDraft, ros: RosNetwork | None) -> Sequence[Any]:
    """Return the observed values as they cross."""
    if draft.ros is not None and ros is not None:
        return _overlaid(draft.ros, draft, ros)
    return draft.values


def _overlaid(said: RosDraft, draft: TopicDraft, ros: RosNetwork) -> list[Any]:
    """Return the observed values of a ROS topic as they cross with its overlays."""
    from zacoustic.ros.interfaces import Interfaces
    from zacoustic.ros.mapping import TypeMapper
    from zacoustic.ros.messages import HeaderStamp, RosMessage
    from zacoustic.ros.overlays import Overlay, OverlayField

    overlays = [
        Overlay(
            type=each.interface,
            fields=tuple(msgspec.convert(rule.keys, OverlayField) for rule in each.rules),
        )
        for each in ros.overlays
    ]
    interfaces = Interfaces(ros.distro)
    stamp = HeaderStamp.AGE if said.has_header else HeaderStamp.EXACT
    message = RosMessage(interfaces, TypeMapper(interfaces, overlays), said.interface, stamp)
    return [message.read(payload)[0] for payload in draft.seen.payloads]


def _fault_of(key: str) -> str | None:
    """Return why a key cannot be the name of a stream, or None."""
    return "has a brace, which stands for a placeholder" if "{" in key else fault_of_name(key)


def _own_text(content: _Content) -> str:
    endpoint = _text(content.survey.endpoint)
    zenoh = [
        '  mode: "client",',
        f"  connect: {{ endpoints: [{endpoint}] }},",
        "  scouting: { multicast: { enabled: false } },",
    ]
    return _file(content, content.here, content.there, zenoh)


def _peer_text(content: _Content) -> str:
    zenoh = [
        '  mode: "router", // programs on this side connect to it',
        f"  listen: {{ endpoints: [{_text(content.peer_listen)}] }},",
        "  scouting: { multicast: { enabled: false } },",
    ]
    return _file(content, content.there, content.here, zenoh)


def _file(content: _Content, own: Side, other: Side, zenoh: Sequence[str]) -> str:
    return "\n".join(_lines(content, own, other, zenoh)) + "\n"


def _node_lines(nodes: Sequence[Side]) -> Iterator[str]:
    entries = [f"{{ address: {node.address}, name: {_text(node.name)} }}" for node in nodes]
    wanted = f'agreement: "{AgreementMethod.TAG.value}"'
    yield "    // Everybody who takes part, the same list in every file."
    if len(nodes) < TAGS_FROM_NODES:
        yield f"    // From {TAGS_FROM_NODES} nodes on, add `{wanted}`."
        yield f"    nodes: [ {', '.join(entries)} ],"
        return
    yield "    nodes: ["
    yield from (f"      {entry}," for entry in entries)
    yield "    ],"
    yield f"    {wanted}, // so many nodes do not confirm each other's frames by pairs"


def _lines(content: _Content, own: Side, other: Side, zenoh: Sequence[str]) -> Iterator[str]:
    survey = content.survey
    yield f"// Written by zacoustic config init after {survey.listened_s:g} s at {survey.endpoint}."
    yield "// A first draft: look for EDIT. `zacoustic config check FILE` shows what each costs."
    yield "{"
    yield from zenoh
    yield "  plugins_loading: { enabled: false },"
    yield "  plugins: { acoustic: {"
    yield "    __required__: false,"
    yield f"    address: {own.address}, // acoustic address of this gateway, 1..254"
    yield from _node_lines(sorted([own, other, *content.others], key=lambda side: side.address))
    if own.locator is None:
        yield "    // EDIT: the modem; `zacoustic links` lists what is installed."
    yield f"    links: [ {{ locator: {_text(own.locator or DEFAULT_LINK)} }} ],"
    if content.ros is not None:
        distro = _text(content.ros.distro)
        yield f"    ros: {{ distro: {distro}, domain: {content.ros.domain} }},"
    yield ""
    yield "    types: ["
    for draft in content.drafts:
        for each in draft.types:
            yield from _type_lines(each)
    yield "    ],"
    interfaces = {draft.ros.interface for draft in content.drafts if draft.ros is not None}
    overlays = [] if content.ros is None else content.ros.overlays
    if used := [each for each in overlays if each.interface in interfaces]:
        yield "    // What the definitions of ROS do not say: ranges and steps, as they were seen."
        yield "    overlays: ["
        for overlay in used:
            yield from _overlay_lines(overlay)
        yield "    ],"
    yield ""
    yield "    // Delete what need not cross: the others may then be faster."
    yield "    streams: ["
    for stream_id, draft in enumerate(content.drafts, FIRST_ID):
        yield from _topic_lines(stream_id, draft, content)
    first = FIRST_ID + len(content.drafts)
    for stream_id, (key, interface) in enumerate(content.services, first):
        yield _service_line(stream_id, key, interface, content.here.address)
    if not content.services and not survey.tells_services:
        yield "      // Services cannot be seen: this router has no admin space. As in:"
        yield '      // { id: 100, service: "auv1/arm", server: 1, timeout_s: 60 },'
    yield "    ],"
    yield from (f"    // left out: {_comment(reason)}" for reason in content.left_out)
    yield "  } },"
    yield "}"


def _type_lines(each: InferredType) -> Iterator[str]:
    yield f"      {{ name: {_text(each.name)}, fields: ["
    for field in each.fields:
        remark = f" // {_comment(field.remark)}" if field.remark else ""
        yield f"        {{ {_keys(field.keys)} }},{remark}"
    yield "      ] },"


def _overlay_lines(overlay: Overlaid) -> Iterator[str]:
    yield f"      {{ type: {_text(overlay.interface)}, fields: ["
    for rule in overlay.rules:
        remark = f" // {_comment(rule.remark)}" if rule.remark else ""
        yield f"        {{ {_keys(rule.keys)} }},{remark}"
    yield "      ] },"


def _service_line(stream_id: int, key: str, interface: str | None, server: int) -> str:
    keys: dict[str, object] = {"id": stream_id, "service": key}
    if interface is not None:
        keys["type"] = interface
    keys |= {"server": server, "timeout_s": 60}
    ros = ", ros: {}" if interface is not None else ""
    priority = priority_of(key)
    if priority in COMMANDING:
        keys["priority"] = priority
    return f"      {{ {_keys(keys)}{ros} }},"


def _topic_lines(stream_id: int, draft: TopicDraft, content: _Content) -> Iterator[str]:
    topic = draft.seen
    sizes = f"{topic.smallest_bytes}..{topic.largest_bytes} bytes of {topic.encoding}"
    said = f"{topic.samples} samples, {topic.rate_hz:.3g} per second, {sizes}"
    if not topic.samples:
        said = f"subscribed at {content.here.name}, nobody published it"
    yield f"      // {_comment(said)}{'; ' + _comment(draft.remark) if draft.remark else ''}"
    if draft.parts_s is not None:
        yield "      // Larger than a frame: in parts, which only reliable topics are."
    if draft.is_too_often:
        yield "      // EDIT: it may be published faster than it crosses; a newer one replaces it:"
        yield "      // publish it less often, or delete it."
    publisher = content.there if draft.is_from_peer else content.here
    keys: dict[str, object] = {"id": stream_id, "topic": draft.name}
    if draft.ros is not None:
        keys |= {"type": draft.ros.interface, "codec": "packed"}
    elif draft.types:
        keys |= {"type": draft.types[-1].name, "codec": "packed"}
        if draft.encoding != CBOR:
            keys["encoding"] = draft.encoding
    elif draft.encoding != OPAQUE:
        keys["encoding"] = draft.encoding
    keys |= {"publishers": [publisher.address], "lifespan_s": draft.parts_s or LIFESPAN_S}
    if draft.priority != USUAL:
        keys["priority"] = draft.priority
    if draft.is_reliable:
        keys["reliability"] = "reliable"
    if draft.parts_s is not None:
        keys["max_bytes"] = min(LARGEST_BYTES, 2 * topic.largest_bytes)
    if draft.interval_s:
        keys["min_interval_s"] = draft.interval_s
    ros = ""
    if draft.ros is not None:
        ros = ', ros: { stamp: "age" }' if draft.ros.has_header else ", ros: {}"
    yield f"      {{ {_keys(keys)}{ros} }},"


def _keys(keys: dict[str, Any]) -> str:
    return ", ".join(f"{key}: {_written(value)}" for key, value in keys.items())


def _written(value: object) -> str:
    """Return a value as text of the file."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.12g}"
    if isinstance(value, list):
        return f"[{', '.join(_written(each) for each in value)}]"
    return _text(value) if isinstance(value, str) else str(value)


def _text(text: str) -> str:
    # Not in ASCII: readers exist that join two escapes to another letter.
    return json_line(text)


def _comment(text: str) -> str:
    """Return a text that cannot end its comment, whatever was published."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)[:200]
