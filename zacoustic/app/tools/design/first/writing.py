"""The files: a survey as a configuration for both sides, with a comment where a user knows more.

The text is read back before it is returned, and every observed payload must fit its type. A topic
that fails becomes opaque bytes.
"""

import os
from collections.abc import Callable, Iterator, Sequence, Set
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.first.drafting import (
    Served,
    TopicDraft,
    draft_topic,
    type_names,
)
from zacoustic.app.tools.design.first.guessing import COMMANDING, USUAL, priority_of
from zacoustic.app.tools.design.first.inference import InferredField
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
from zacoustic.errors import ConfigError, LocalError
from zacoustic.text.safetext import json_line

FIRST_ID: Final = 10
"""Stream id of the first topic; lower ones are left for more important topics."""
_USUAL_PORT: Final = 7447
"""Port on which Zenoh's routers listen."""
DEFAULT_LINK: Final = "sim/127.0.0.1:7000"
"""Locator of a modem that is not named."""
_UNBOUNDED_BYTES: Final = 4096
"""Assumed size of a sample that nobody published, whose type has no largest one."""
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
    folder: Path = Path()
    """Folder of its file."""


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
    services: list[Served]
    left_out: list[str]
    ros: RosNetwork | None
    peer: Survey | None
    peer_listen: str
    packages: Path | None
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
    peer_listen: str | None = None,
    packages: Path | None = None,
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
        peer_listen: Where the other side's router listens; None: on the usual port, or on the next
            if this side's router has that one.
        packages: Folder with definitions of ROS that do not ship.
        others: Further nodes of the fleet.
        profile: The modem.
        choose: Changes the drafts before they are written, as a user does who is asked.

    Raises:
        ConfigError: Nothing was observed that could be a stream.
    """
    modem = profile_named(profile)
    content = _content(survey, here, there, peer, packages)
    content = msgspec.structs.replace(
        content,
        others=tuple(others),
        peer_listen=peer_listen or _free_of(survey.endpoint),
        packages=packages,
    )
    config = _read(_own_text(content), here)  # without intervals: for the sizes
    found = [
        _crossing(draft, config.table.by_id(stream_id), content.ros)
        for stream_id, draft in enumerate(content.drafts, FIRST_ID)
    ]
    named = zip(content.drafts, found, strict=True)
    content.left_out.extend(
        f"{draft.name}: {each.refused}" for draft, each in named if each.refused
    )
    sizes = [each.largest_bytes for each in found]
    drafts = [sized(each, size, modem) for each, size in zip(content.drafts, sizes, strict=True)]
    drafts = list(choose(paced(drafts, sizes, modem)))
    if not (drafts or content.services):
        raise ConfigError("nothing is left", hint="keep a topic")
    content = msgspec.structs.replace(content, drafts=drafts)
    text, peer_text = _own_text(content), _peer_text(content)
    config = _read(text, here)
    _read(peer_text, there)
    return Files(
        text=text,
        peer_text=peer_text,
        config=config,
        drafts=tuple(drafts),
        examples=tuple(
            _example(each, config.table.by_id(stream_id), content.ros)
            for stream_id, each in enumerate(drafts, FIRST_ID)
        ),
        left_out=tuple(content.left_out),
    )


def _content(
    survey: Survey, here: Side, there: Side, peer: Survey | None, packages: Path | None
) -> _Content:
    ros = joined(
        ros_network(survey, packages=packages),
        None if peer is None else ros_network(peer, packages=packages),
        both=peer is not None,
    )
    accounted = ros.keys if ros is not None else frozenset()
    topics = [topic for topic in survey.topics if topic.key not in accounted]
    own = {topic.key for topic in topics}
    from_peer = (
        [] if peer is None else [each for each in peer.topics if each.key not in own | accounted]
    )
    known = own | {topic.key for topic in from_peer} | accounted
    from_peer += [_unseen(key) for key in survey.subscribed if key not in known]
    everything = [*topics, *from_peer]
    faults = {topic.key: _fault_in(topic) for topic in everything}
    left_out = [f"{key}: {fault}" for key, fault in faults.items() if fault]
    usable = [topic for topic in everything if not faults[topic.key]]
    foreign = {topic.key for topic in from_peer}
    names = type_names([topic.key for topic in usable])
    spoken = set() if peer is None else own & {topic.key for topic in peer.topics}
    drafts = [
        msgspec.structs.replace(
            draft_topic(topic, name),
            is_from_peer=topic.key in foreign,
            is_from_both=topic.key in spoken,
        )
        for topic, name in zip(usable, names, strict=True)
    ]
    drafts += [] if ros is None else ros.drafts
    left_out += [] if ros is None else ros.left_out
    if peer is not None and _are_joined(survey, peer):
        left_out.append(
            f"{survey.endpoint} and {peer.endpoint} are one network: part their routers, as they "
            "are at sea, and listen again"
        )
    taken = {topic.key for topic in usable}
    services = list(_services(survey, peer, taken | accounted))
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
        left_out=left_out, ros=ros, peer=peer, peer_listen="", others=(), packages=None,
    )  # fmt: skip


def _services(survey: Survey, peer: Survey | None, known: Set[str]) -> Iterator[Served]:
    """Yield the services that are not of ROS: those of the other side are called here."""
    seen = {*known}
    sides = [(survey.services, False), (survey.called if peer is None else peer.services, True)]
    for keys, is_from_peer in sides:
        for key in keys:
            if key not in seen and _fault_of(key) is None:
                seen.add(key)
                yield Served(name=key, is_from_peer=is_from_peer)


def _are_joined(survey: Survey, peer: Survey) -> bool:
    """Tell whether both sides are one network: gateways on both would send everything round."""
    return bool({*survey.ids} & {*peer.ids})


def _free_of(endpoint: str | None) -> str:
    """Return where another router can listen on this machine."""
    is_here = endpoint is not None and endpoint.endswith(f":{_USUAL_PORT}")
    return f"tcp/127.0.0.1:{_USUAL_PORT + is_here}"


def _unseen(key: str) -> SeenTopic:
    return SeenTopic(
        key=key, samples=0, rate_hz=0.0, encoding=OPAQUE, smallest_bytes=0, largest_bytes=0
    )


def _read(text: str, side: Side) -> Config:
    whole: Any = parse_json5(text, source="the first configuration")
    section = whole["plugins"]["acoustic"]
    return config_from_mapping(section, source="the first configuration", folder=side.folder)


class _Crossing(msgspec.Struct, frozen=True):
    """The observed values of a topic as they cross."""

    values: tuple[Any, ...]
    """Those that are not refused."""
    largest_bytes: int
    """Largest transmitted payload, bytes."""
    refused: str
    """How many would be refused, and why; empty: none."""


def _crossing(draft: TopicDraft, stream: Stream, ros: RosNetwork | None) -> _Crossing:
    """Return the observed values of a topic as they cross."""
    seen = draft.seen
    read = _reader(draft, ros)
    values, sizes, refusals = [], [0], []
    for each in seen.payloads if draft.ros is not None else draft.values:
        try:
            value = read(each)
            sizes.append(len(stream.codec.encode(value)))
        except LocalError as error:
            refusals.append(str(error))
            continue
        values.append(value)
    largest = max(sizes) if values else (seen.largest_bytes or _unseen_bytes(draft, stream))
    if seen.largest_bytes > PAYLOAD_LIMIT_BYTES:
        # What is too large to be a value of a type was only counted.
        largest = max(largest, seen.largest_bytes)
    share = f"{len(refusals)} of {len(refusals) + len(values)} samples"
    refused = f"{share} would be refused; the first: {refusals[0]}" if refusals else ""
    return _Crossing(tuple(values), largest, refused)


def _unseen_bytes(draft: TopicDraft, stream: Stream) -> int:
    """Return the size of a sample that nobody published: the largest of its type, if it has one.

    A type without a largest size may need more than a frame, so it is reliable: then all crosses.
    """
    if draft.ros is None:
        return _UNSEEN_BYTES
    return stream.codec.largest_bytes or _UNBOUNDED_BYTES


def _example(draft: TopicDraft, stream: Stream, ros: RosNetwork | None) -> Any:  # noqa: ANN401
    if not draft.types and draft.ros is None:
        return None
    values = _crossing(draft, stream, ros).values
    return values[-1] if values else None


def _reader(draft: TopicDraft, ros: RosNetwork | None) -> Callable[[Any], Any]:
    """Return what makes a value of a kept one: a ROS topic has payloads, and its overlays."""
    if draft.ros is None or ros is None:
        return lambda value: value
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
    interfaces = Interfaces(ros.distro, ros.packages)
    stamp = HeaderStamp.AGE if draft.crosses_as_age else HeaderStamp.EXACT
    message = RosMessage(interfaces, TypeMapper(interfaces, overlays), draft.ros.interface, stamp)
    return lambda payload: message.read(payload)[0]


def _fault_of(key: str) -> str | None:
    """Return why a key cannot be the name of a stream, or None."""
    return "has a brace, which stands for a placeholder" if "{" in key else fault_of_name(key)


def _fault_in(topic: SeenTopic) -> str | None:
    """Return why a topic cannot be a stream, or None."""
    if topic.largest_bytes > LARGEST_BYTES:
        return _fault_of(topic.key) or f"{topic.largest_bytes} bytes; allowed: {LARGEST_BYTES}"
    return _fault_of(topic.key)


def _own_text(content: _Content) -> str:
    return _file(content, content.here, content.there, _joining(content.survey))


def _peer_text(content: _Content) -> str:
    if content.peer is not None:
        zenoh = _joining(content.peer)
    else:
        zenoh = [
            '  mode: "router", // programs on this side connect to it',
            f"  listen: {{ endpoints: [{_text(content.peer_listen)}] }},",
            "  scouting: { multicast: { enabled: false } },",
        ]
    return _file(content, content.there, content.here, zenoh)


def _joining(survey: Survey) -> list[str]:
    """Return how a gateway joins the network that was listened to."""
    lines = [] if survey.endpoint is None else [
        f"  connect: {{ endpoints: [{_text(survey.endpoint)}] }},"
    ]  # fmt: skip
    mode = "client" if survey.has_router else "peer"
    multicast = "true" if survey.endpoint is None else "false"
    scouting = f"  scouting: {{ multicast: {{ enabled: {multicast} }} }},"
    return [f'  mode: "{mode}",', *lines, scouting]


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
    where = f"at {survey.endpoint}" if survey.endpoint else "to peers"
    yield f"// Written by zacoustic config init after {survey.listened_s:g} s {where}."
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
        domain = content.ros.domain if own is content.here else content.ros.peer_domain
        keys = f"distro: {distro}, domain: {domain}"
        if content.packages is not None:
            written = os.path.relpath(content.packages, own.folder)
            keys += f", packages: {_text(Path(written).as_posix())}"
        yield f"    ros: {{ {keys} }},"
    yield ""
    yield "    types: ["
    for draft in content.drafts:
        for each in draft.types:
            yield from _field_lines("name", each.name, each.fields)
    yield "    ],"
    interfaces = {draft.ros.interface for draft in content.drafts if draft.ros is not None}
    overlays = [] if content.ros is None else content.ros.overlays
    if used := [each for each in overlays if each.interface in interfaces]:
        yield "    // What the definitions of ROS do not say: ranges and steps, as they were seen."
        yield "    overlays: ["
        for overlay in used:
            yield from _field_lines("type", overlay.interface, overlay.rules)
        yield "    ],"
    yield ""
    yield "    // Delete what need not cross: the others may then be faster."
    yield "    streams: ["
    for stream_id, draft in enumerate(content.drafts, FIRST_ID):
        yield from _topic_lines(stream_id, draft, content)
    first = FIRST_ID + len(content.drafts)
    for stream_id, service in enumerate(content.services, first):
        server = content.there if service.is_from_peer else content.here
        yield _service_line(stream_id, service, server.address)
    if not content.services and not survey.tells_services:
        yield "      // Services cannot be seen: this router has no admin space. As in:"
        yield '      // { id: 100, service: "auv1/arm", server: 1, timeout_s: 60 },'
    yield "    ],"
    yield from (f"    // left out: {_comment(reason)}" for reason in content.left_out)
    yield "  } },"
    yield "}"


def _field_lines(head: str, name: str, fields: Sequence[InferredField]) -> Iterator[str]:
    yield f"      {{ {head}: {_text(name)}, fields: ["
    for field in fields:
        remark = f" // {_comment(field.remark)}" if field.remark else ""
        yield f"        {{ {_keys(field.keys)} }},{remark}"
    yield "      ] },"


def _service_line(stream_id: int, each: Served, server: int) -> str:
    keys: dict[str, object] = {"id": stream_id}
    keys["action" if each.is_action else "service"] = each.name
    if each.interface is not None:
        keys["type"] = each.interface
    keys["server"] = server
    if not each.is_action:
        keys["timeout_s"] = 60
    ros = ", ros: {}" if each.interface is not None else ""
    priority = priority_of(each.name)
    if priority in COMMANDING:
        keys["priority"] = priority
    return f"      {{ {_keys(keys)}{ros} }},"


def _topic_lines(stream_id: int, draft: TopicDraft, content: _Content) -> Iterator[str]:
    topic = draft.seen
    sizes = f"{topic.smallest_bytes}..{topic.largest_bytes} bytes of {topic.encoding}"
    said = f"{topic.samples} samples, {topic.rate_hz:.3g} per second, {sizes}"
    other = content.here if draft.is_from_peer else content.there
    publisher = content.there if draft.is_from_peer else content.here
    if not topic.samples and topic.payloads:
        said = f"latched at {publisher.name}, {topic.smallest_bytes}..{topic.largest_bytes} bytes"
    elif not topic.samples:
        said = f"subscribed at {other.name}, nobody published it"
        if draft.is_silent:
            said = f"published at {publisher.name}, which said nothing meanwhile"
    yield f"      // {_comment(said)}{'; ' + _comment(draft.remark) if draft.remark else ''}"
    if draft.parts_s is not None:
        what = "Larger than a frame" if topic.payloads or topic.samples else "Perhaps large"
        yield f"      // {what}: in parts, which only reliable topics are."
    keys: dict[str, object] = {"id": stream_id, "topic": draft.name}
    if draft.ros is not None:
        keys |= {"type": draft.ros.interface, "codec": "packed"}
    elif draft.types:
        keys |= {"type": draft.types[-1].name, "codec": "packed"}
        if draft.encoding != CBOR:
            keys["encoding"] = draft.encoding
    elif draft.encoding != OPAQUE:
        keys["encoding"] = draft.encoding
    publishers = [publisher.address, *([other.address] if draft.is_from_both else [])]
    keys["publishers"] = sorted(publishers)
    if not (draft.is_latched and draft.is_reliable):  # what is latched is not too old to cross
        keys["lifespan_s"] = draft.parts_s or LIFESPAN_S
    if draft.priority != USUAL:
        keys["priority"] = draft.priority
    if draft.is_reliable:
        keys["reliability"] = "reliable"
    if draft.is_latched:
        keys["durability"] = "transient_local"
        keys["depth"] = draft.seen.kept
    if draft.parts_s is not None and topic.largest_bytes:
        keys["max_bytes"] = min(LARGEST_BYTES, 2 * topic.largest_bytes)
    if draft.interval_s:
        keys["min_interval_s"] = draft.interval_s
    ros = ""
    if draft.ros is not None:
        ros = ', ros: { stamp: "age" }' if draft.crosses_as_age else ", ros: {}"
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
