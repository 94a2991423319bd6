"""The ROS side of a stream: a topic, a service or an action with its messages and hashes."""

from typing import TYPE_CHECKING, Final

import msgspec

from zacoustic.core.values.types import TypeSpec
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.names import RosKey, dds_type
from zacoustic.ros.qos import RosDurability, RosQos

if TYPE_CHECKING:
    from zacoustic.ros.messages import RosMessage

CANCEL_GOAL: Final = "action_msgs/srv/CancelGoal"
"""The service that cancels the goals of an action."""
GOAL_STATUS: Final = "action_msgs/msg/GoalStatusArray"
"""The status message of all actions."""

SERVICE_QOS: Final = RosQos(depth=10)
"""QoS of services, their clients and the feedback of an action: ROS's default profile."""
STATUS_QOS: Final = RosQos(depth=1, durability=RosDurability.TRANSIENT_LOCAL)
"""QoS of the status topic."""


class RosTopic(msgspec.Struct, frozen=True, kw_only=True):
    """A topic."""

    interface: str
    """Name of the type."""
    hash: str
    """Its hash, as in keys."""
    message: "RosMessage"
    """Reads and writes it."""
    qos: RosQos = RosQos()
    """The QoS of its endpoints in tokens."""

    def key(self, domain: int, name: str) -> RosKey:
        """Return the key of rmw_zenoh."""
        return RosKey(domain=domain, name=name, type=dds_type(self.interface), hash=self.hash)


class RosService(msgspec.Struct, frozen=True, kw_only=True):
    """A service."""

    interface: str
    """Name of the type."""
    hash: str
    """Its hash, as in keys."""
    request: "RosMessage"
    """Reads and writes a request."""
    response: "RosMessage"
    """Reads and writes a response."""

    def key(self, domain: int, name: str) -> RosKey:
        """Return the key of rmw_zenoh."""
        return RosKey(domain=domain, name=name, type=dds_type(self.interface), hash=self.hash)


class RosAction(msgspec.Struct, frozen=True, kw_only=True):
    """An action: three services and two topics."""

    interface: str
    """Name of the type."""
    send_goal: RosService
    """The service that begins a goal."""
    get_result: RosService
    """The service that waits for its end."""
    cancel_goal: RosService
    """The service that cancels it."""
    feedback: RosTopic
    """The topic with its feedback."""
    status: RosTopic
    """The topic with the status of all goals."""
    types: tuple[TypeSpec, TypeSpec, TypeSpec]
    """The parts of goal, feedback and result that cross."""


RosStream = RosTopic | RosService | RosAction
"""The ROS side of a stream."""


def ros_service(
    interfaces: Interfaces, interface: str, messages: "dict[str, RosMessage]"
) -> RosService:
    """Return a service.

    Args:
        interfaces: The definitions.
        interface: Its type.
        messages: Decodes and encodes messages, by interface.
    """
    return RosService(
        interface=interface,
        hash=interfaces.hash_of(interface),
        request=messages[f"{interface}_Request"],
        response=messages[f"{interface}_Response"],
    )


def ros_action(
    interfaces: Interfaces, interface: str, messages: "dict[str, RosMessage]"
) -> RosAction:
    """Return an action; arguments as for `ros_service`."""

    def topic(name: str, qos: RosQos) -> RosTopic:
        return RosTopic(
            interface=name, hash=interfaces.hash_of(name), message=messages[name], qos=qos
        )

    def service(name: str) -> RosService:
        return ros_service(interfaces, name, messages)

    goal, feedback, result = (
        messages[f"{interface}_{part}"].spec for part in ("Goal", "Feedback", "Result")
    )
    return RosAction(
        interface=interface,
        send_goal=service(f"{interface}_SendGoal"),
        get_result=service(f"{interface}_GetResult"),
        cancel_goal=service(CANCEL_GOAL),
        feedback=topic(f"{interface}_FeedbackMessage", SERVICE_QOS),
        status=topic(GOAL_STATUS, STATUS_QOS),
        types=(goal, feedback, result),
    )


def messages_of(interface: str) -> tuple[str, ...]:
    """Return the messages of a stream's interface, those that cross first.

    Args:
        interface: A message, a service or an action.
    """
    kind = interface.split("/")[1]
    if kind == "srv":
        return f"{interface}_Request", f"{interface}_Response"
    if kind == "action":
        return (
            f"{interface}_Goal",
            f"{interface}_Feedback",
            f"{interface}_Result",
            f"{interface}_SendGoal_Request",
            f"{interface}_SendGoal_Response",
            f"{interface}_GetResult_Request",
            f"{interface}_GetResult_Response",
            f"{interface}_FeedbackMessage",
            f"{CANCEL_GOAL}_Request",
            f"{CANCEL_GOAL}_Response",
            GOAL_STATUS,
        )
    return (interface,)
