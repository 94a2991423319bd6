"""Checks that the code and the definition of a stream agree."""

from typing import Final

import msgspec

from zacoustic.core.base.qos import Durability, Forward, Qos, Reliability, Stamp
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.errors import ConfigError
from zacoustic.ros.names import is_interface

PARTS: Final = ("goal", "feedback", "result")
"""The parts of an action that have a type."""


def pair_of(service_type: object, name: str) -> tuple[object, object]:
    """Return the types of request and response.

    Raises:
        ConfigError: `service_type` does not have them.
    """
    if isinstance(service_type, tuple) and len(service_type) == 2:
        return service_type
    if isinstance(service_type, str) and is_interface(service_type):
        return f"{service_type}_Request", f"{service_type}_Response"
    request, response = (getattr(service_type, part, None) for part in ("Request", "Response"))
    if request is None or response is None:
        raise ConfigError(
            f"{name}: {service_type!r}; allowed: a class with Request and Response, a pair, or the "
            "name of a ROS service"
        )
    return request, response


def triple_of(action_type: object, name: str) -> tuple[object, object, object]:
    """Return the types of goal, feedback and result.

    Raises:
        ConfigError: `action_type` does not have them.
    """
    if isinstance(action_type, tuple) and len(action_type) == 3:
        return action_type
    if isinstance(action_type, str) and is_interface(action_type):
        return f"{action_type}_Goal", f"{action_type}_Feedback", f"{action_type}_Result"
    goal, feedback, result = (getattr(action_type, part.capitalize(), None) for part in PARTS)
    if goal is None or feedback is None or result is None:
        raise ConfigError(
            f"{name}: {action_type!r}; allowed: a class with Goal, Feedback and Result, the "
            "three of them, or the name of a ROS action"
        )
    return goal, feedback, result


def tune(stream: Stream, qos: Qos | None) -> None:
    """Apply the code's QoS to the payloads of this node; keep what both ends must agree on."""
    if qos is None:
        return
    if qos.stamp not in (Stamp.NONE, stream.qos.stamp):
        raise ConfigError(
            f"{stream.name}: stamp: {qos.stamp.value}; allowed: {stream.qos.stamp.value}, "
            "as it is defined: both ends must agree on it"
        )
    own = stream.qos
    if qos.reliability not in (Reliability.BEST_EFFORT, own.reliability):
        raise ConfigError(
            f"{stream.name}: reliability: {qos.reliability.value}; allowed: "
            f"{own.reliability.value}, as it is defined: both ends must agree on it"
        )
    if qos.forward not in (Forward.ALWAYS, own.forward):
        raise ConfigError(
            f"{stream.name}: forward: {qos.forward.value}; allowed: {own.forward.value}, as it is "
            "defined: both ends must agree on it"
        )
    reliable = own.reliability is Reliability.RELIABLE
    if reliable and qos.depth not in (Qos().depth, own.depth):
        raise ConfigError(
            f"{stream.name}: depth: {qos.depth}; allowed: {own.depth}, as it is defined: both ends "
            "of a reliable topic must agree on it"
        )
    deadline_s = own.deadline_s if qos.deadline_s is None else qos.deadline_s
    if deadline_s is not None and deadline_s <= qos.min_interval_s:
        raise ConfigError(
            f"{stream.name}: min_interval_s: {qos.min_interval_s:g}; allowed: below deadline_s, "
            f"which is {deadline_s:g}"
        )
    stream.qos = msgspec.structs.replace(
        qos,
        stamp=own.stamp,
        reliability=own.reliability,
        durability=own.durability if qos.durability is Durability.VOLATILE else qos.durability,
        forward=own.forward,
        depth=own.depth if reliable else qos.depth,
        deadline_s=deadline_s,
    )


def kind_of(stream: Stream) -> str:
    """Return the kind of a stream, with its article."""
    match stream.spec:
        case TopicSpec():
            return "a topic"
        case ServiceSpec():
            return "a service"
        case ActionSpec():
            return "an action"
