"""The file: a survey as a configuration, with a comment wherever the user knows more.

The text is read back before it is returned, and every observed payload must fit its type. A topic
that fails becomes opaque bytes.
"""

import json
import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, Final

import msgspec

from zacoustic.app.tools.crossing import room_bytes
from zacoustic.app.tools.design.first.inference import (
    InferredField,
    InferredType,
    NoTypeError,
    infer_type,
)
from zacoustic.app.tools.design.first.survey import PAYLOAD_LIMIT_BYTES, SeenTopic, Survey
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.config import Config, config_from_mapping
from zacoustic.config.json5 import parse_json5
from zacoustic.core.streams.keys import fault_of_name
from zacoustic.core.streams.specs import LAST_STREAM_ID
from zacoustic.core.transport.objects.limits import LARGEST_BYTES
from zacoustic.core.values.encoding import CBOR, JSON, OPAQUE, TYPED_ENCODINGS, decode_application
from zacoustic.core.values.payload import CborCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import ConfigError, PayloadInvalidError

FIRST_ID: Final = 10
"""Stream id of the first topic; lower ones are left for more important topics."""
FAST_HZ: Final = 0.5
"""A faster topic gets a least interval: a channel carries one or two frames per second in all."""
INTERVAL_S: Final = 5.0
"""That interval, s."""
LIFESPAN_S: Final = 60.0
"""Largest age of a sample, s, unless it takes longer to cross."""

_HEAD_BYTES: Final = 1  # the stream id
_PARTS_MARGIN: Final = 3
_CDR_HEAD: Final = b"\x00\x01\x00\x00"


class TopicDraft(msgspec.Struct, frozen=True, kw_only=True):
    """The entry of one topic."""

    seen: SeenTopic
    """The observed samples."""
    types: tuple[InferredType, ...] = ()
    """Its types, the outermost last; none: opaque."""
    encoding: str = OPAQUE
    """Encoding of the application's payloads."""
    remark: str = ""
    """Why it has no type."""
    parts_s: float | None = None
    """Time of its largest sample to cross in parts, s; None: all samples fit a frame."""


def draft_topic(topic: SeenTopic, name: str) -> TopicDraft:
    """Determine the type of a topic's payloads.

    Args:
        topic: The observed samples.
        name: Name of its type.
        name: Name of its type.
    """
    for encoding in _encodings_to_try(topic):
        try:
            values = [decode_application(payload, encoding) for payload in topic.payloads]
            types = infer_type(name, values)
            _check(types, values)
        except NoTypeError as error:
            return TopicDraft(seen=topic, encoding=topic.encoding, remark=f"as bytes: {error}")
        except PayloadInvalidError:
            continue
        except ConfigError as error:
            return TopicDraft(seen=topic, encoding=topic.encoding, remark=f"as bytes: {error}")
        return TopicDraft(seen=topic, types=tuple(types), encoding=encoding)
    remark = "as bytes: it looks like CDR, as ROS 2 writes it" if _is_cdr(topic) else "as bytes"
    return TopicDraft(seen=topic, encoding=topic.encoding, remark=remark)


def write_config(survey: Survey) -> tuple[str, Config]:
    """Write a configuration.

    Returns:
        The text, and the configuration that it defines.

    Raises:
        ConfigError: Nothing was observed that could be a stream.
    """
    left_out = [
        f"{topic.key}: {fault}"
        for topic in survey.topics
        if (fault := _fault_of(topic.key)) is not None
    ]
    left_out += [
        f"{topic.key}: {topic.largest_bytes} bytes; allowed: {LARGEST_BYTES}"
        for topic in survey.topics
        if _fault_of(topic.key) is None and topic.largest_bytes > LARGEST_BYTES
    ]
    usable = [
        topic
        for topic in survey.topics
        if _fault_of(topic.key) is None and topic.largest_bytes <= LARGEST_BYTES
    ]
    taken = {topic.key for topic in usable}
    services = [key for key in survey.services if _fault_of(key) is None and key not in taken]
    room = LAST_STREAM_ID - FIRST_ID + 1
    left_out += [f"{topic.key}: no stream id left" for topic in usable[room:]]
    usable, services = usable[:room], services[: max(0, room - len(usable))]
    if not (usable or services):
        raise ConfigError(
            f"{survey.endpoint}: nothing was published within {survey.listened_s:g} s",
            hint="start the nodes first, or listen longer: --listen-s 30",
        )
    names = _type_names(usable)
    drafts = [_sized(draft_topic(topic, name)) for topic, name in zip(usable, names, strict=True)]
    text = "\n".join(_lines(survey, drafts, services, left_out)) + "\n"
    whole: Any = parse_json5(text, source="the first configuration")
    config = config_from_mapping(whole["plugins"]["acoustic"], source="the first configuration")
    return text, config


def _sized(draft: TopicDraft) -> TopicDraft:
    """Determine whether the largest sample fits a frame, and how long it takes if it does not."""
    profile = profile_named(DEFAULT_PROFILE)
    payload_bytes = _largest_payload(draft)
    if _HEAD_BYTES + payload_bytes <= room_bytes(profile.mtu_bytes):
        return draft
    frames = 1 + payload_bytes // (profile.mtu_bytes // 2)  # with headers, answers and repair
    frame_s = profile.airtime_s(profile.mtu_bytes) + profile.gap_s
    parts_s = math.ceil(_PARTS_MARGIN * frames * frame_s / INTERVAL_S) * INTERVAL_S
    return msgspec.structs.replace(draft, parts_s=max(LIFESPAN_S, parts_s))


def _largest_payload(draft: TopicDraft) -> int:
    """Return the largest transmitted payload of the observed values, bytes."""
    seen = draft.seen
    if not draft.types or seen.largest_bytes > PAYLOAD_LIMIT_BYTES:
        return seen.largest_bytes
    codec = CborCodec(_type_of(draft.types))
    values = (decode_application(payload, draft.encoding) for payload in seen.payloads)
    return max(len(codec.encode(value)) for value in values)


def _fault_of(key: str) -> str | None:
    """Return why a key cannot be the name of a stream, or None."""
    return "has a brace, which stands for a placeholder" if "{" in key else fault_of_name(key)


def _encodings_to_try(topic: SeenTopic) -> Sequence[str]:
    if not topic.payloads:
        return ()
    if topic.encoding in TYPED_ENCODINGS:
        return (topic.encoding,)
    if topic.encoding != OPAQUE or _is_cdr(topic):
        return ()
    # Programs often do not declare the encoding of their payloads.
    return (JSON, CBOR)


def _is_cdr(topic: SeenTopic) -> bool:
    return bool(topic.payloads) and all(payload[:4] == _CDR_HEAD for payload in topic.payloads)


def _check(types: Sequence[InferredType], values: Sequence[object]) -> None:
    """Make the types, and check every value.

    Raises:
        ConfigError: A type contradicts itself.
        NoTypeError: A value does not fit.
    """
    outermost = _type_of(types)
    for value in values:
        try:
            outermost.validate(value)
        except PayloadInvalidError as error:
            raise NoTypeError(str(error)) from error


def _type_of(types: Sequence[InferredType]) -> TypeSpec:
    """Return the outermost of the types of a topic.

    Raises:
        ConfigError: A type contradicts itself.
    """
    specs = [
        TypeSpec(name=each.name, fields=tuple(_spec(field) for field in each.fields))
        for each in types
    ]
    return TypeTable(specs)[types[-1].name]


def _spec(field: InferredField) -> FieldSpec:
    keys = dict(field.keys)
    if "range" in keys:
        keys["range"] = tuple(keys["range"])
    return FieldSpec(**keys)


def _type_names(topics: Sequence[SeenTopic]) -> list[str]:
    """Return a name for the type of each topic: its last chunk, or all of them if that is taken."""
    names: list[str] = []
    for topic in topics:
        chunks = [re.sub(r"[^A-Za-z0-9]", " ", chunk).title() for chunk in topic.key.split("/")]
        words = ["".join(chunk.split()) for chunk in chunks]
        name = f"T{words[-1]}" if words[-1][:1].isdigit() or not words[-1] else words[-1]
        if name in names:
            name = f"T{''.join(words)}"
        while name in names:
            name += "X"
        names.append(name)
    return names


def _lines(
    survey: Survey,
    drafts: Sequence[TopicDraft],
    services: Sequence[str],
    left_out: Sequence[str],
) -> Iterator[str]:
    yield f"// Written by zacoustic config init after {survey.listened_s:g} s at {survey.endpoint}."
    yield "// A first draft: look for EDIT. `zacoustic config check FILE` shows what each costs."
    yield "{"
    yield '  mode: "client",'
    yield f"  connect: {{ endpoints: [{_text(survey.endpoint)}] }},"
    yield "  scouting: { multicast: { enabled: false } },"
    yield "  plugins_loading: { enabled: false },"
    yield "  plugins: { acoustic: {"
    yield "    __required__: false,"
    yield "    address: 1, // EDIT: acoustic address of this gateway, 1..254"
    yield "    // EDIT: everybody who takes part, the same list in every file."
    yield '    nodes: [ { address: 1, name: "here" }, { address: 2, name: "there" } ],'
    yield "    // EDIT: the modem; `zacoustic links` lists what is installed."
    yield '    links: [ { locator: "sim/127.0.0.1:7000" } ],'
    yield ""
    yield "    types: ["
    for draft in drafts:
        for each in draft.types:
            yield from _type_lines(each)
    yield "    ],"
    yield ""
    yield "    // EDIT: delete what need not cross. Sound carries a frame or two per second in all."
    yield "    streams: ["
    for stream_id, draft in enumerate(drafts, FIRST_ID):
        yield from _topic_lines(stream_id, draft)
    for stream_id, key in enumerate(services, FIRST_ID + len(drafts)):
        yield "      // EDIT: the types of request and response; without, both are bytes."
        yield f"      {{ id: {stream_id}, service: {_text(key)}, server: 1, timeout_s: 60 }},"
    if not services and not survey.tells_services:
        yield "      // Services cannot be seen: this router has no admin space. EDIT, as in:"
        yield '      // { id: 100, service: "auv1/arm", server: 1, timeout_s: 60 },'
    yield "    ],"
    yield from (f"    // left out: {_comment(reason)}" for reason in left_out)
    yield "  } },"
    yield "}"


def _type_lines(each: InferredType) -> Iterator[str]:
    yield f"      {{ name: {_text(each.name)}, fields: ["
    for field in each.fields:
        keys = ", ".join(f"{key}: {_written(value)}" for key, value in field.keys.items())
        remark = f" // {_comment(field.remark)}" if field.remark else ""
        yield f"        {{ {keys} }},{remark}"
    yield "      ] },"


def _topic_lines(stream_id: int, draft: TopicDraft) -> Iterator[str]:
    topic = draft.seen
    sizes = f"{topic.smallest_bytes}..{topic.largest_bytes} bytes of {topic.encoding}"
    said = f"{topic.samples} samples, {topic.rate_hz:.3g} per second, {sizes}"
    yield f"      // {_comment(said)}{'; ' + _comment(draft.remark) if draft.remark else ''}"
    keys: dict[str, object] = {"id": stream_id, "topic": topic.key}
    if draft.types:
        keys["type"] = draft.types[-1].name
        if draft.encoding != CBOR:
            keys["encoding"] = draft.encoding
    elif draft.encoding != OPAQUE:
        keys["encoding"] = draft.encoding
    keys |= {"publishers": [1], "lifespan_s": LIFESPAN_S}
    interval_s = INTERVAL_S if topic.rate_hz > FAST_HZ else None
    if draft.parts_s is not None:
        yield "      // Larger than a frame: in parts, which only reliable topics are."
        most_bytes = min(LARGEST_BYTES, 2 * topic.largest_bytes)
        keys |= {"reliability": "reliable", "max_bytes": most_bytes, "lifespan_s": draft.parts_s}
        if topic.rate_hz * draft.parts_s > 1:
            interval_s = draft.parts_s
    if interval_s is not None:
        keys["min_interval_s"] = interval_s
    written = ", ".join(f"{key}: {_written(value)}" for key, value in keys.items())
    edit = " // EDIT: how often" if interval_s is not None else ""
    yield f"      {{ {written} }},{edit}"


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
    return json.dumps(text)


def _comment(text: str) -> str:
    """Return a text that cannot end its comment, whatever was published."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)[:200]
