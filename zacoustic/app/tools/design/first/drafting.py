"""The draft of a stream: its type, from the values that were seen, and what its name says."""

import re
from collections.abc import Sequence
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.first.guessing import COMMANDING, USUAL, priority_of
from zacoustic.app.tools.design.first.inference import (
    InferredField,
    InferredType,
    NoTypeError,
    infer_type,
)
from zacoustic.app.tools.design.first.survey import SeenTopic
from zacoustic.core.values.encoding import CBOR, JSON, OPAQUE, TYPED_ENCODINGS, decode_application
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import ConfigError, PayloadInvalidError

REPEATED_S: Final = 10.0
"""A topic with at most this period repeats itself, s."""
_CDR_HEAD: Final = b"\x00\x01\x00\x00"


class RosDraft(msgspec.Struct, frozen=True, kw_only=True):
    """What a stream of ROS 2 is besides."""

    name: str
    """ROS name, with a leading slash."""
    interface: str
    """Its type, such as ``nav_msgs/msg/Odometry``."""
    has_age: bool
    """It has a header, whose stamp can cross as an age: the instants that were seen are of this
    machine's clock."""


class Overlaid(msgspec.Struct, frozen=True, kw_only=True):
    """Rules for the members of a ROS type."""

    interface: str
    """The type."""
    rules: tuple[InferredField, ...]
    """`field` and other keys of a rule, and the observed values."""


class Served(msgspec.Struct, frozen=True, kw_only=True):
    """The entry of a service or an action."""

    name: str
    """Its name, as the file writes it."""
    interface: str | None = None
    """Its type in ROS; None: it is not of ROS."""
    is_action: bool = False
    """It is an action."""
    is_from_peer: bool = False
    """It is served on the other side."""


class TopicDraft(msgspec.Struct, frozen=True, kw_only=True):
    """The entry of one topic."""

    seen: SeenTopic
    """The observed samples; none: somebody only subscribes to it."""
    types: tuple[InferredType, ...] = ()
    """Its types, the outermost last; none: opaque, or of ROS."""
    encoding: str = OPAQUE
    """Encoding of the application's payloads."""
    remark: str = ""
    """Why it has no type."""
    ros: RosDraft | None = None
    """Its name and type in ROS; None: it is not of ROS."""
    values: tuple[Any, ...] = ()
    """The observed values, decoded; of an opaque topic its payloads."""
    is_from_peer: bool = False
    """It is published on the other side."""
    is_from_both: bool = False
    """It is published on both sides."""
    is_silent: bool = False
    """It has a publisher that said nothing meanwhile."""
    priority: str = USUAL
    """Zenoh's priority."""
    parts_s: float | None = None
    """Time of its largest sample to cross in parts, s; None: all samples fit a frame."""
    interval_s: float | None = None
    """Least time between two samples, s; None: too seldom to count."""

    @property
    def is_reliable(self) -> bool:
        """Whether each sample must arrive, or is larger than a frame.

        What an urgent topic repeats every few seconds anyway needs no acknowledgement; what is
        latched is said once.
        """
        period_s = self.seen.period_s
        is_repeated = period_s is not None and period_s <= REPEATED_S
        is_urgent = self.priority in COMMANDING and not is_repeated
        return self.parts_s is not None or self.is_latched or is_urgent

    @property
    def is_latched(self) -> bool:
        """Whether its publishers keep samples for late subscribers."""
        return self.seen.kept > 0

    @property
    def crosses_as_age(self) -> bool:
        """Whether its stamp crosses as an age; what crosses in parts keeps its own."""
        return self.ros is not None and self.ros.has_age and self.parts_s is None

    @property
    def name(self) -> str:
        """Name of the stream, as the file writes it."""
        return self.seen.key if self.ros is None else self.ros.name


def draft_topic(topic: SeenTopic, name: str) -> TopicDraft:
    """Determine the type of a topic's payloads.

    Args:
        topic: The observed samples.
        name: Name of its type.
    """
    opaque = TopicDraft(
        seen=topic,
        encoding=topic.encoding,
        values=topic.payloads,
        priority=priority_of(topic.key),
        remark="as bytes",
    )
    for encoding in _encodings_to_try(topic):
        try:
            values = [decode_application(payload, encoding) for payload in topic.payloads]
            types = infer_type(name, values)
            _check(types, values)
        except (NoTypeError, ConfigError) as error:
            return msgspec.structs.replace(opaque, remark=f"as bytes: {error}")
        except PayloadInvalidError:
            continue
        return msgspec.structs.replace(
            opaque, types=tuple(types), encoding=encoding, values=tuple(values), remark=""
        )
    if _is_cdr(topic):
        remark = "as bytes: it looks like CDR, as ROS 2 writes it"
        return msgspec.structs.replace(opaque, remark=remark)
    return opaque


def type_names(keys: Sequence[str]) -> list[str]:
    """Return a name for the type of each topic: its last chunk, or all of them if that is taken."""
    names: list[str] = []
    for key in keys:
        chunks = [re.sub(r"[^A-Za-z0-9]", " ", chunk).title() for chunk in key.split("/")]
        words = ["".join(chunk.split()) for chunk in chunks]
        name = f"T{words[-1]}" if words[-1][:1].isdigit() or not words[-1] else words[-1]
        if name in names:
            name = f"T{''.join(words)}"
        while name in names:
            name += "X"
        names.append(name)
    return names


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
