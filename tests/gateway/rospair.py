"""Two local networks with a node of ROS 2 on each, and gateways between them."""

from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from typing import Any, Final

from tests.gateway.networks import Channel, local_network, run
from tests.gateway.rosnode import Node, ros_session

TWIST: Final = "geometry_msgs/msg/Twist"
STRING: Final = "std_msgs/msg/String"
FIX: Final = "sensor_msgs/msg/NavSatFix"
ADD: Final = "example_interfaces/srv/AddTwoInts"
FIBONACCI: Final = "example_interfaces/action/Fibonacci"

SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "ros": {"domain": 7},
    "overlays": [
        {"type": TWIST, "fields": [{"field": "*.*", "range": [-2, 2], "step": 0.01}]},
        {"type": FIX, "fields": [{"field": "header.frame_id", "constant": "gps"}]},
    ],
    "streams": [
        {
            "id": 11,
            "topic": "/auv1/cmd_vel",
            "type": TWIST,
            "ros": {},
            "codec": "packed",
            "publishers": [1],
        },
        {
            "id": 12,
            "topic": "/auv1/fix",
            "type": FIX,
            "ros": {"stamp": "age"},
            "publishers": [2],
            "reliability": "reliable",
        },
        {
            "id": 13,
            "topic": "/map",
            "type": STRING,
            "ros": {},
            "durability": "transient_local",
            "reliability": "reliable",
            "publishers": [2],
        },
        {"id": 14, "topic": "/chat", "type": STRING, "ros": {}, "depth": 8},
        {"id": 15, "topic": "/fleet/{node}/name", "type": STRING, "ros": {}},
        {"id": 16, "topic": "plain", "type": STRING},
        {"id": 20, "service": "/add", "type": ADD, "server": 2, "ros": {}},
        {"id": 30, "action": "/fibonacci", "type": FIBONACCI, "server": 2, "ros": {}},
    ],
}
"""A section with a stream of each kind."""


class Pair:
    """Shore 1 and vehicle 2."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self._stack = stack

    async def open(self, section: dict[str, Any], distro: str, frame_loss: float) -> None:
        self.channel = Channel(frame_loss=frame_loss)
        self.a = await self._stack.enter_async_context(
            local_network(1, self.channel, section=section)
        )
        self.b = await self._stack.enter_async_context(
            local_network(2, self.channel, section=section)
        )
        self.domain = section["ros"].get("domain", 0)
        self.shore = self.node(1, "operator", distro=distro)
        self.auv = self.node(2, "autopilot", distro=distro)

    def node(self, address: int, name: str, *, distro: str = "jazzy") -> Node:
        """Start one more node, with a session of its own."""
        port = (self.a if address == 1 else self.b).port
        session = self._stack.enter_context(ros_session(port))
        return Node(session, name, distro=distro, domain=self.domain)


Test = Callable[[Pair], Awaitable[None]]


def with_pair(
    section: dict[str, Any] | None = None, *, distro: str = "jazzy", frame_loss: float = 0.0
) -> Callable[[Test], Callable[[], None]]:
    """Run a test with a pair of local networks."""

    def wrap(test: Test) -> Callable[[], None]:
        async def opened() -> None:
            async with AsyncExitStack() as stack:
                pair = Pair(stack)
                await pair.open(section or SECTION, distro, frame_loss)
                await test(pair)

        def runs() -> None:
            run(opened())

        runs.__name__ = test.__name__
        return runs

    return wrap


def changed(**section: Any) -> dict[str, Any]:
    """Return the section with other tables."""
    return SECTION | section
