"""A ROS 2 client written by others (`zenoh-ros2-sdk`), in a process of its own, led by JSON lines.

    python tests/ros/sdkpeer.py PORT DOMAIN FOLDER

FOLDER holds the definitions: without all nested ones it computes other hashes, and says nothing.
"""

import json
import queue
import sys
import threading
from typing import Any

from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2ServiceServer, ROS2Subscriber
from zenoh_ros2_sdk.discovery import get_service_names_and_types, get_topic_names_and_types
from zenoh_ros2_sdk.message_registry import get_registry
from zenoh_ros2_sdk.session import ZenohSession

STRING, TWIST = "std_msgs/msg/String", "geometry_msgs/msg/Twist"
ADD = "example_interfaces/srv/AddTwoInts"


def main(port: int, domain: int, folder: str) -> None:
    """Do what is read from standard input until it ends."""
    ZenohSession.get_instance("127.0.0.1", port)
    registry = get_registry(folder)
    where: dict[str, Any] = {"domain_id": domain, "router_ip": "127.0.0.1", "router_port": port}
    kept: dict[str, Any] = {}
    for name in ("geometry_msgs/msg/Vector3", TWIST, STRING):
        assert registry.load_message_type(name)
    vector = ZenohSession.get_instance().store.types["geometry_msgs/msg/Vector3"]
    said: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
    threading.Thread(target=write, args=(said,), daemon=True).start()

    def hear(message: Any) -> None:
        if hasattr(message, "data"):
            said.put({"heard": message.data})
        else:
            said.put({"heard": [message.linear.x, message.angular.z]})

    def call(a: int, b: int) -> None:
        response = kept["client"].call(a=a, b=b)
        said.put({"answer": None if response is None else int(response.sum)})

    def add(request: Any) -> Any:
        said.put({"asked": [int(request.a), int(request.b)]})
        return kept["server"].response_msg_class(sum=request.a + request.b)

    said.put({"ready": True})
    for line in sys.stdin:
        order = json.loads(line)
        match order["do"]:
            case "subscribe":
                kept[order["topic"]] = ROS2Subscriber(order["topic"], order["type"], hear, **where)
            case "advertise":
                kept[order["topic"]] = ROS2Publisher(order["topic"], order["type"], **where)
            case "publish" if "data" in order:
                kept[order["topic"]].publish(data=order["data"])
            case "publish":
                linear = vector(x=order["x"], y=0.0, z=0.0)
                angular = vector(x=0.0, y=0.0, z=order["z"])
                kept[order["topic"]].publish(linear=linear, angular=angular)
            case "serve":
                kept["server"] = ROS2ServiceServer(order["service"], ADD, add, **where)
            case "call":
                if "client" not in kept:
                    kept["client"] = ROS2ServiceClient(order["service"], ADD, timeout=60.0, **where)
                threading.Thread(target=call, args=(order["a"], order["b"]), daemon=True).start()
            case "list":
                topics = get_topic_names_and_types(timeout=5.0, **where)
                services = get_service_names_and_types(timeout=5.0, **where)
                said.put({"topics": dict(topics), "services": dict(services)})
                continue
        if order["do"] != "call":
            said.put({"done": order["do"]})
    said.put(None)
    ZenohSession.get_instance().close()


def write(said: "queue.SimpleQueue[dict[str, Any] | None]") -> None:
    """Write what is said, a line each."""
    while (each := said.get()) is not None:
        print(json.dumps(each), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
