"""The node `lost_contact`: aborts the mission when the gateway says so, or is gone itself.

The gateway counts the silence, from authentic frames alone, over restarts (`lost_contact` of its
file), and calls the service `lost_contact` of this node until that answers `success: true`. This
node asks the mission, by a service or a topic of the parameters, and answers what the mission says.
"""

from __future__ import annotations

import time
from typing import Any

import rclpy
import yaml
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rosidl_runtime_py.set_message import set_message_fields
from rosidl_runtime_py.utilities import get_message, get_service
from std_srvs.srv import Trigger

from zacoustic_bringup.aborting import Aborting, GatewayWatch

LOOK_S = 1.0
"""How often the graph is asked for the gateway."""


class LostContact(Node):
    """Serves `lost_contact`, and watches the gateway's node."""

    def __init__(self) -> None:
        super().__init__("lost_contact")
        service = self.declare_parameter("abort_service", "abort").value
        topic = self.declare_parameter("abort_topic", "").value
        kind = self.declare_parameter("abort_type", "std_srvs/srv/Trigger").value
        self._said = yaml.safe_load(self.declare_parameter("abort_value", "").value) or {}
        timeout_s = self.declare_parameter("timeout_s", 10.0).value
        self._gateway = self.declare_parameter("gateway", "").value
        gone_after_s = self.declare_parameter("gateway_gone_after_s", 120.0).value
        if bool(service) == bool(topic):
            raise ValueError("abort_service and abort_topic: give one of them, and leave one empty")
        if service:
            self._kind: Any = get_service(kind)
            self._made(self._kind.Request)  # a wrong abort_value is found now, not under water
            self._client = self.create_client(self._kind, service)
            self._place = self.resolve_service_name(service)
            ask = self._call
        else:
            self._kind = get_message(kind)
            self._made(self._kind)
            self._publisher = self.create_publisher(self._kind, topic, 10)
            self._place = self.resolve_topic_name(topic)
            ask = self._publish
        self._aborting = Aborting(ask, timeout_s=timeout_s)
        self.create_service(Trigger, "lost_contact", self._lost)
        if self._gateway and gone_after_s > 0:
            self._watch = GatewayWatch(self._aborting, gone_after_s, time.monotonic())
            self._last = ""
            self.create_timer(LOOK_S, self._look)

    # Below the methods above

    def _lost(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._aborting.lost(time.monotonic())
        self.get_logger().warning(f"contact is lost: {self._place}: {response.message}")
        return response

    def _look(self) -> None:
        nodes = self.get_node_names_and_namespaces()
        is_there = self._gateway in {f"{space.rstrip('/')}/{name}" for name, space in nodes}
        said = self._watch.look(is_there, time.monotonic())
        if said and said != self._last:
            self.get_logger().error(f"{self._gateway}: {said}")
        self._last = said

    def _made(self, kind: Any) -> Any:
        made = kind()
        set_message_fields(made, self._said)
        return made

    def _call(self) -> None:
        if not self._client.service_is_ready():
            self._answered(False, f"nobody serves {self._place}")
            return
        future = self._client.call_async(self._made(self._kind.Request))
        future.add_done_callback(self._take)

    def _take(self, future: Any) -> None:
        response = future.result()
        if response is not None:
            success = bool(getattr(response, "success", True))
            text = str(getattr(response, "message", "")) or f"{self._place} has answered"
            self._answered(success, text)

    def _publish(self) -> None:
        # In any case: somebody whom the graph does not show yet may hear it.
        self._publisher.publish(self._made(self._kind))
        heard = self._publisher.get_subscription_count() > 0
        self._answered(heard, "published" if heard else f"nobody subscribes to {self._place}")

    def _answered(self, success: bool, text: str) -> None:
        self._aborting.answered(success, text, time.monotonic())


def main(arguments: list[str] | None = None) -> None:
    """Run the node until it is interrupted."""
    rclpy.init(args=arguments)
    try:
        rclpy.spin(LostContact())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
