"""Specifications of streams: topics, services and actions, with the allowed values."""

from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import Duration, DurationOrZero
from zacoustic.core.base.linktypes import Node
from zacoustic.core.base.qos import Durability, Forward, Qos, Reliability, Stamp
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.keys import MOST_VALUES, Wildcard
from zacoustic.core.values.dense.stream.packedbytes import PackedBytesCodec
from zacoustic.core.values.payload import CborCodec, OpaqueCodec, PackedCodec, TypedCodec
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import check_fields, one_of

FIRST_STREAM_ID: Final = 1
LAST_STREAM_ID: Final = 175
"""Stream ids are 1…175; control codes and dense blocks are above (docs/wire.md)."""

CODECS: Final[dict[str, type[TypedCodec]]] = {
    "cbor": CborCodec,
    "packed": PackedCodec,
    "dense": PackedCodec,
}
"""How the values of a type are written in a record, by name in the config. Samples of a dense
stream are in records only when they are in no dense block
(`zacoustic.core.transport.topics.densestreams`)."""

OPAQUE_CODECS: Final[dict[str, type[OpaqueCodec]]] = {
    "cbor": OpaqueCodec,
    "packed": PackedBytesCodec,
    "dense": PackedBytesCodec,
}
"""Codecs of streams without a type, by the same names."""

Codec: TypeAlias = Annotated[str, one_of(CODECS)]
"""Name of a codec."""
StreamOutside: TypeAlias = Annotated[str, one_of(("reject", "clamp"))]
"""Treatment of values that are more than the types of a stream say."""
Publishers: TypeAlias = Annotated[int, Meta(ge=1, le=MOST_VALUES)]
"""How many publishers of a node a latched topic tells apart."""

DENSE: Final = "dense"
"""The codec of dense streams."""

DENSE_CODING: Final = 3
"""Version of the dense coding in the digests of dense streams: with another version a block might
decode, and look right."""


class TopicSpec(msgspec.Struct, frozen=True, kw_only=True, tag="topic"):
    """A topic: samples from publishers to subscribers."""

    stream_id: int
    """1…175, unique in the table."""
    name: str
    """Key expression with placeholders in braces (`zacoustic.core.streams.keys`)."""
    type_name: str | None = None
    """Type of the samples; None: opaque bytes."""
    publishers: tuple[int, ...] | None = None
    """Addresses that may publish; None: any."""
    subscribers: tuple[int, ...] | None = None
    """Addresses that subscribe; None: all."""
    wildcards: tuple[Wildcard, ...] = ()
    """The placeholders of the name without `{node}`."""
    local_publishers: Publishers = 1
    """How many publishers of a node the depth of a latched topic counts separately; the
    number of each crosses in one byte if there is more than one."""
    encoding: str | None = None
    """Zenoh encoding on the application side; None: CBOR for typed samples, bytes for opaque
    ones."""
    codec: Codec = "cbor"
    """Codec of the samples, one of `CODECS`."""
    outside: StreamOutside = "reject"
    """``clamp``: values that are more than their types say are cut down to them, and not refused
    (`TypeSpec.clamping`). Not in the digest."""
    qos: Qos = Qos()
    """How samples wait and cross."""
    max_bytes: int | None = None
    """Largest sample that this node sends or receives, bytes; None: as `ObjectLimits` says. Only
    for reliable topics: other samples fit a frame. Not in the digest."""
    journal: bool = False
    """Whether accepted and received samples survive a restart of this node; not in the digest,
    since each end may journal what it likes."""
    carry: Carry | None = None
    """Who carries samples to subscribers that their publisher does not reach; None: nobody. Not in
    the digest."""


class ServiceSpec(msgspec.Struct, frozen=True, kw_only=True, tag="service"):
    """A service: one server answers requests of any node."""

    stream_id: int
    """1…175, unique in the table."""
    name: str
    """Key expression, without placeholders."""
    server: Node
    """Address of the server."""
    request_type: str | None = None
    """Type of a request; None: opaque bytes."""
    response_type: str | None = None
    """Type of a response; None: opaque bytes."""
    timeout_s: Duration = 60.0
    """Time from call to answer after which the client gives up, s, > 0."""
    encoding: str | None = None
    """Zenoh encoding on the application side; None: CBOR for typed payloads, bytes for opaque
    ones."""
    codec: Codec = "cbor"
    """Codec of the payloads, one of `CODECS`."""
    outside: StreamOutside = "reject"
    """``clamp``: values that are more than their types say are cut down to them, and not refused
    (`TypeSpec.clamping`). Not in the digest."""
    qos: Qos = Qos()
    """Priority, linger and stamp of requests and responses; depth and lifespan do not apply to
    calls."""
    journal: bool = True
    """Whether calls survive a restart of this node; otherwise one may run twice. Not in the
    digest."""


class ActionSpec(msgspec.Struct, frozen=True, kw_only=True, tag="action"):
    """An action: one server executes goals of any node and sends feedback."""

    stream_id: int
    """1…175, unique in the table."""
    name: str
    """Key expression, without placeholders."""
    server: Node
    """Address of the server."""
    goal_type: str | None = None
    """Type of a goal; None: opaque bytes."""
    feedback_type: str | None = None
    """Type of feedback; None: opaque bytes."""
    result_type: str | None = None
    """Type of a result; None: opaque bytes."""
    timeout_s: Duration = 60.0
    """Time from a goal to its answer (accepted or rejected) after which its client gives up, s, >
    0."""
    result_timeout_s: Duration = 3600.0
    """How long an unconfirmed result is kept, and how long a client waits while it hears nothing of
    a goal, s, > 0."""
    feedback_interval_s: DurationOrZero = 0.0
    """Minimum time between two feedback records for one goal on the channel, s, ≥ 0; the newest
    wins. Not in the digest."""
    encoding: str | None = None
    """Zenoh encoding on the application side; None: CBOR for typed payloads, bytes for opaque
    ones."""
    codec: Codec = "cbor"
    """Codec of goals, feedback and results, one of `CODECS`."""
    outside: StreamOutside = "reject"
    """``clamp``: values that are more than their types say are cut down to them, and not refused
    (`TypeSpec.clamping`). Not in the digest."""
    qos: Qos = Qos()
    """Priority and linger of goals, feedback and results; a cancel is REAL_TIME. Depth and
    lifespan do not apply."""
    journal: bool = True
    """Whether goals survive a restart of this node; otherwise one may run twice. Not in the
    digest."""


StreamSpec = TopicSpec | ServiceSpec | ActionSpec


def in_parts(spec: StreamSpec) -> str:
    """Return the settings with which a sample that is larger than a frame crosses."""
    codec = 'codec: "packed" and ' if spec.codec == DENSE else ""  # a dense topic is best-effort
    return f'{codec}reliability: "reliable" in its stream: then it crosses in parts'


def _check_dense(spec: StreamSpec) -> None:
    """Check a dense stream: its block names a sample by its stream alone, and is not repeated."""
    if not isinstance(spec, TopicSpec):
        raise ConfigError(f'codec: "{DENSE}"; allowed: packed, cbor', hint="topics can be dense")
    if spec.qos.reliability is Reliability.RELIABLE:
        raise ConfigError(
            f'codec: "{DENSE}" for a reliable topic; allowed: packed, cbor',
            hint="what is repeated is not what follows the last one",
        )
    if spec.wildcards:
        raise ConfigError(
            f'codec: "{DENSE}" with placeholders other than {{node}}; allowed: packed, cbor',
            hint="give each of them a stream of its own",
        )


def _check_carried(spec: TopicSpec, carry: Carry) -> None:
    """Check a carried topic: each sample is for listed nodes, and survives on its way."""
    if spec.qos.reliability is not Reliability.RELIABLE or not spec.journal:
        raise ConfigError(
            "carry for a topic that is not both reliable and journalled; allowed: with "
            'reliability: "reliable" and journal: true',
            hint="a node that carries a sample must not lose it",
        )
    if spec.publishers is None or spec.subscribers is None:
        raise ConfigError(
            "carry without publishers and subscribers; allowed: with both listed",
            hint="a node that carries a sample must know for whom",
        )
    if spec.qos.forward is not Forward.ALWAYS:
        raise ConfigError('carry with forward: "on_demand"; allowed: with forward: "always"')
    if spec.qos.stamp is not Stamp.NONE:
        raise ConfigError(
            'carry with stamp: "age"; allowed: with stamp: "none"',
            hint="put the time into the sample: the way of a carried one takes hours",
        )


def _check_local_publishers(spec: TopicSpec) -> None:
    """Check a topic that tells apart the publishers of a node."""
    if spec.qos.durability is not Durability.TRANSIENT_LOCAL:
        raise ConfigError(
            f"local_publishers: {spec.local_publishers} for a volatile topic; allowed: with "
            'durability: "transient_local"',
            hint="only what is kept for late joiners is counted for each publisher",
        )
    if spec.codec == DENSE or spec.carry is not None:
        raise ConfigError(
            f"local_publishers: {spec.local_publishers} with a dense codec or carry; allowed: "
            "without them",
            hint="neither has room for the number of a publisher",
        )


def check(spec: StreamSpec) -> None:
    """Check a stream for the native wire.

    Raises:
        ConfigError: A part of it is not allowed.
    """
    check_fields(spec, ConfigError)
    if spec.codec == DENSE:
        _check_dense(spec)
    if isinstance(spec, TopicSpec) and spec.carry is not None:
        _check_carried(spec, spec.carry)
    if isinstance(spec, TopicSpec) and spec.local_publishers != 1:
        _check_local_publishers(spec)
    if not FIRST_STREAM_ID <= spec.stream_id <= LAST_STREAM_ID:
        allowed = f"{FIRST_STREAM_ID}..{LAST_STREAM_ID}"
        raise ConfigError(f"id: {spec.stream_id}; allowed: {allowed}")


def check_times(spec: StreamSpec) -> None:
    """Check server and timeouts, for any wire profile.

    Raises:
        ConfigError: A value is not allowed.
    """
    check_fields(spec, ConfigError)
    if isinstance(spec, ServiceSpec | ActionSpec) and "{" in spec.name:
        raise ConfigError(f'name: "{spec.name}" has a placeholder; allowed in topics only')
