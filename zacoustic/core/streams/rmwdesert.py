"""What streams can be on the rmw_desert profile: everything else is refused by name.

Its topics are best effort, and a service request is sent once; there is no acknowledgement, no
address, and no type except a ROS message's. No option is dropped silently: a reliable topic there
is an error when the table is made.
"""

from typing import Final, NoReturn

from zacoustic.core.base.qos import Forward, Qos, Reliability, Stamp
from zacoustic.core.streams.specs import FIRST_STREAM_ID, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.values.payload import PayloadCodec
from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.core.values.rmw_desert.messages import LAST_STREAM_ID, encode_head
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import ConfigError

WIRE: Final = 'wire: "rmw_desert"'
"""The profile's key and name in the config."""
FIRST_SEQUENCE: Final = 1000
LAST_SEQUENCE: Final = 0xFFFF
"""Sequence ids of this node's calls: rmw_desert draws those of its own clients below, so that an
answer to one of them is not taken for an answer to this node. Most of these ids take three
bytes."""

_PLAIN: Final = "cbor"
_KIND_BYTES: Final = 1


def check_spec(spec: StreamSpec) -> None:
    """Check the specification of a stream.

    Raises:
        ConfigError: rmw_desert lacks it; states key, value and the allowed values.
    """
    if not FIRST_STREAM_ID <= spec.stream_id <= LAST_STREAM_ID:
        raise ConfigError(f"id: {spec.stream_id}; allowed: {FIRST_STREAM_ID}..{LAST_STREAM_ID}")
    if spec.codec != _PLAIN:
        raise ConfigError(
            f'codec: "{spec.codec}" with {WIRE}; allowed: none', hint="leave codec out"
        )
    if isinstance(spec, TopicSpec):
        _check_topic(spec)
    elif isinstance(spec, ServiceSpec):
        for key, name in (("request", spec.request_type), ("response", spec.response_type)):
            if name is None:
                _refuse_opaque(key)
    else:
        raise ConfigError(
            f'action: "{spec.name}" with {WIRE}; allowed: topic, service',
            hint="there an action is three services and two topics: a stream for each",
        )


def check_type(key: str, type_spec: TypeSpec) -> None:
    """Check a type that the stream's `key` names.

    Raises:
        ConfigError: It has fields that ROS messages lack.
    """
    for field in type_spec.fields:
        what = f"{key}: {type_spec.name}.{field.name}"
        if field.optional:
            raise ConfigError(
                f"{what} is optional with {WIRE}; allowed: fields that are always there"
            )
        if field.type == "bytes" and field.is_array:
            raise ConfigError(
                f"{what} is an array of bytes with {WIRE}; allowed: bytes, or an array of uint8"
            )
        if field.is_nested:
            check_type(key, type_spec.nested_type(field.type))


def payload_codec(spec: StreamSpec, key: str, type_spec: TypeSpec | None) -> PayloadCodec:
    """Make the codec of a stream's samples, requests or responses.

    Raises:
        ConfigError: There is no type, or one that rmw_desert cannot carry.
    """
    if type_spec is None:
        _refuse_opaque(key)
    check_type(key, type_spec)
    is_call = isinstance(spec, ServiceSpec)
    head = encode_head(spec.stream_id, LAST_SEQUENCE if is_call else None)
    return RmwDesertCodec(
        type_spec, head_items=3 if is_call else 2, head_bytes=_KIND_BYTES + len(head)
    )


def _check_topic(spec: TopicSpec) -> None:
    default = Qos()
    refused = (
        ("reliability", spec.qos.reliability.value, Reliability.BEST_EFFORT.value),
        ("forward", spec.qos.forward.value, Forward.ALWAYS.value),
        ("stamp", spec.qos.stamp.value, Stamp.NONE.value),
    )
    for key, value, allowed in refused:
        if value != allowed:
            raise ConfigError(f'{key}: "{value}" with {WIRE}; allowed: {allowed}')
    if spec.qos.exclusive != default.exclusive:
        raise ConfigError(f"exclusive: true with {WIRE}; allowed: false")
    if spec.journal or spec.max_bytes is not None:
        key = "journal" if spec.journal else "max_bytes"
        raise ConfigError(f"{key}: with {WIRE}; allowed: none", hint=f"leave {key} out")
    if "{" in spec.name:
        raise ConfigError(
            f'name: "{spec.name}" has a placeholder with {WIRE}; allowed: names without',
            hint="give each key a stream of its own",
        )
    if spec.type_name is None:
        _refuse_opaque("type")


def _refuse_opaque(key: str) -> NoReturn:
    raise ConfigError(
        f"{key}: is missing with {WIRE}; allowed: the name of a type",
        hint="a ROS message without fields is a type with fields: []",
    )
