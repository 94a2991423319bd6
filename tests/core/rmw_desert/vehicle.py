"""A shore (1) and a vehicle (2) that speak rmw_desert, and what is on their topics."""

from typing import Any, Final

from tests.core.rig import End, link
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

SHORE: Final = 1
VEHICLE: Final = 2
POSE: Final = 3
COMMAND: Final = 4
NOTE: Final = 200
EMPTY: Final = 201
MANY: Final = 202
FLAGS: Final = 203
ADD: Final = 20
TRIGGER: Final = 254


def _fields(scalar: str, *names: str) -> tuple[FieldSpec, ...]:
    return tuple(FieldSpec(name=name, type=scalar) for name in names)


TYPES: Final = TypeTable(
    [
        TypeSpec(name="Vector3", fields=_fields("float64", "x", "y", "z")),
        TypeSpec(name="geometry_msgs/msg/Twist", fields=_fields("Vector3", "linear", "angular")),
        TypeSpec(
            name="turtlesim/msg/Pose",
            fields=_fields("float32", "x", "y", "theta", "linear_velocity", "angular_velocity"),
        ),
        TypeSpec(name="std_msgs/msg/String", fields=_fields("string", "data")),
        TypeSpec(name="std_msgs/msg/Empty"),
        TypeSpec(
            name="Many",
            fields=(
                FieldSpec(name="numbers", type="uint8", max_length=100),
                FieldSpec(name="floats", type="float64", max_length=100),
            ),
        ),
        TypeSpec(name="Flags", fields=(FieldSpec(name="flags", type="bool", max_length=4),)),
        TypeSpec(name="AddRequest", fields=_fields("int64", "a", "b")),
        TypeSpec(name="AddResponse", fields=_fields("int64", "sum")),
        TypeSpec(
            name="TriggerResponse",
            fields=(*_fields("bool", "success"), *_fields("string", "message")),
        ),
    ]
)
_DEEP: Final = Qos(depth=100)
SPECS: Final[tuple[StreamSpec, ...]] = (
    TopicSpec(
        stream_id=POSE, name="turtle1/pose", type_name="turtlesim/msg/Pose", publishers=(VEHICLE,)
    ),
    TopicSpec(
        stream_id=COMMAND,
        name="turtle1/cmd_vel",
        type_name="geometry_msgs/msg/Twist",
        publishers=(SHORE,),
        qos=_DEEP,
    ),
    TopicSpec(stream_id=NOTE, name="note", type_name="std_msgs/msg/String", qos=_DEEP),
    TopicSpec(stream_id=EMPTY, name="empty", type_name="std_msgs/msg/Empty", qos=_DEEP),
    TopicSpec(stream_id=MANY, name="many", type_name="Many"),
    TopicSpec(stream_id=FLAGS, name="flags", type_name="Flags"),
    ServiceSpec(
        stream_id=ADD, name="add", server=VEHICLE,
        request_type="AddRequest", response_type="AddResponse",
    ),
    ServiceSpec(
        stream_id=TRIGGER, name="trigger", server=SHORE,
        request_type="std_msgs/msg/Empty", response_type="TriggerResponse",
    ),
)  # fmt: skip
TWIST: Final[dict[str, Any]] = {
    "linear": {"x": 2.0, "y": 0.0, "z": 0.0},
    "angular": {"x": 0.0, "y": 0.0, "z": 1.8},
}


def table(*specs: StreamSpec) -> StreamTable:
    """Return the streams, on that wire."""
    nodes = {SHORE: "shore", VEHICLE: "auv1"}
    return StreamTable(specs or SPECS, types=TYPES, nodes=nodes, wire=WireProfile.RMW_DESERT)


def socket(**settings: Any) -> LinkCapabilities:
    """Return a link as DESERT's socket: a byte stream, 64 bytes at once."""
    bare = {"addressed": False, "checked": False, "framed": False, "controls_access": True}
    return link(**(bare | settings))


def node(address: int, *, rules: TransmitRules | None = None, **settings: Any) -> End:
    """Return an engine at such a socket."""
    return End(address, table(), capabilities=socket(**settings), rules=rules or TransmitRules())


def said(end: End, now: int) -> bytes:
    """Return all that an engine wants to send now."""
    data = b""
    while (transmission := end.send(now)) is not None:
        data += transmission.frame_bytes
    return data


def hear(end: End, data: bytes, now: int = 0) -> None:
    end.hear(data, now, source=0)


def samples(end: End) -> list[tuple[int, Any]]:
    return [(each.stream_id, each.value) for each in end.got(SampleReceived)]
