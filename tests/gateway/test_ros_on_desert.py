"""ROS 2 on rmw_zenoh on the shore, ROS 2 on rmw_desert under water."""

import asyncio
from typing import Any

import pytest
import zenoh

from tests.core.rmw_desert.peer import REQUEST, RESPONSE, SAMPLE, Heard, packet
from tests.gateway.networks import LocalNetwork, fence, matched
from tests.gateway.rosnode import Node, ros_session
from tests.gateway.test_rmw_desert import on_desert
from tests.links.desert.test_rmw_desert import Vehicle

TWIST = "geometry_msgs/msg/Twist"
STRING = "std_msgs/msg/String"
ADD = "example_interfaces/srv/AddTwoInts"
SECTION: dict[str, Any] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "links": [{"locator": "desert/127.0.0.1:4000", "wire": "rmw_desert"}],
    "ros": {"distro": "jazzy", "domain": 0},
    "streams": [
        {"id": 3, "topic": "/log", "type": STRING, "publishers": [2], "ros": {}},
        {"id": 4, "topic": "/turtle1/cmd_vel", "type": TWIST, "publishers": [1], "ros": {}},
        {"id": 20, "service": "/add", "type": ADD, "server": 2, "ros": {}},
    ],
}


def test_unmodified_nodes_of_both_middlewares_meet() -> None:
    async def body(found: LocalNetwork, client: zenoh.Session, vehicle: Vehicle) -> None:
        with ros_session(found.port) as session:
            node = Node(session, "shore")
            told = node.subscribe("/log", STRING)
            await fence(session)
            vehicle.say(packet(SAMPLE, 3, "diving"))
            assert (await told.next())[0] == {"data": "diving"}
            await matched(session, str(node.key("/turtle1/cmd_vel", TWIST)))
            still = {"x": 0.0, "y": 0.0, "z": 0.0}
            twist = {"linear": still | {"x": 2.0}, "angular": still | {"z": 1.8}}
            node.publisher("/turtle1/cmd_vel", TWIST)(twist)
            heard = await vehicle.hear()
            assert heard == Heard(SAMPLE, 4, [2.0, 0.0, 0.0, 0.0, 0.0, pytest.approx(1.8)])
            call = asyncio.create_task(node.client("/add", ADD).call({"a": 2, "b": 40}))
            kind, stream_id, (sequence, a, b) = await vehicle.hear()
            assert (kind, stream_id) == (REQUEST, 20)
            vehicle.say(packet(RESPONSE, 20, sequence, a + b))
            ((answer, _),) = await call
            assert answer == {"sum": 42}

    on_desert(body, section=SECTION)
