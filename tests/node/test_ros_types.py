"""ROS types without ROS: dictionaries and generated classes, with and without a configuration."""

from typing import Any

import msgspec
import pytest

from tests.gateway import networks
from tests.node.fleet import channel
from tests.runtime.loop_checks import run
from zacoustic import ConfigError, LocalError, Node, PayloadInvalidError
from zacoustic.config import Config, config_from_mapping
from zacoustic.core.values.types import struct_from_type, type_from_struct
from zacoustic.ros import message_class, ros_type
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.mapping import TypeMapper

TWIST = "geometry_msgs/msg/Twist"
ADD = "example_interfaces/srv/AddTwoInts"
FIBONACCI = "example_interfaces/action/Fibonacci"
ZERO = {"x": 0.0, "y": 0.0, "z": 0.0}


def config() -> Config:
    section = {
        "address": 1,
        "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
        "overlays": [
            {"type": TWIST, "fields": [{"field": "*.*", "range": [-2, 2], "step": 0.01}]},
        ],
        "streams": [
            {"id": 11, "topic": "auv/cmd_vel", "type": TWIST, "codec": "packed"},
            {"id": 12, "topic": "/odom", "type": "nav_msgs/msg/Odometry", "ros": {"stamp": "age"}},
            {"id": 20, "service": "add", "type": ADD, "server": 2},
            {"id": 30, "action": "fibonacci", "type": FIBONACCI, "server": 2},
        ],
    }
    return config_from_mapping(section, source="fleet.json5")


def test_values_are_dicts_or_instances_of_a_generated_class() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node("shore", config=config(), link=medium.link(1))
            auv = Node("auv1", config=config(), link=medium.link(2))
            async with shore, auv:
                subscription = auv.subscribe(TWIST, "auv/cmd_vel")
                publisher = shore.create_publisher(TWIST, "auv/cmd_vel")
                twist: Any = message_class(TWIST)
                moved = {"linear": ZERO | {"x": 1.25}, "angular": ZERO}
                publisher.publish(moved)
                assert (await subscription.receive()).value == moved
                with pytest.raises(PayloadInvalidError, match=r"linear\.x is 3\.0; allowed: -2"):
                    publisher.publish({"linear": ZERO | {"x": 3.0}, "angular": ZERO})
                other = shore.create_publisher(twist, "auv/cmd_vel")
                value = twist()
                value.linear.x = 0.5
                other.publish(value)
                assert (await subscription.receive()).value["linear"]["x"] == 0.5

    run(main())


def test_without_a_config_the_name_of_a_ros_type_is_enough() -> None:
    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node(1, link=medium.link(1)) as shore, auv:
                subscription = auv.subscribe(TWIST, "auv/cmd_vel", stream_id=11)
                publisher = shore.create_publisher(TWIST, "auv/cmd_vel", stream_id=11)
                value = {"linear": ZERO | {"x": 1.5}, "angular": ZERO}
                publisher.publish(value)
                assert (await subscription.receive()).value == value
                with pytest.raises(ConfigError, match="no interface of jazzy"):
                    shore.create_publisher("geometry_msgs/msg/Twst", "other", stream_id=12)

    run(main())


def test_services_are_called_by_the_name_of_their_type() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node("shore", config=config(), link=medium.link(1))
            auv = Node("auv1", config=config(), link=medium.link(2))
            async with shore, auv:
                auv.create_service(ADD, "add", lambda asked: {"sum": asked["a"] + asked["b"]})
                client = shore.create_client(ADD, "add")
                assert await client.call({"a": 40, "b": 2}) == {"sum": 42}

    run(main())


def test_a_node_on_a_link_takes_part_in_topics_of_ros() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node("shore", config=config(), link=medium.link(1))
            async with shore:
                publisher = shore.create_publisher("nav_msgs/msg/Odometry", "odom")
                cls: Any = config().class_of("nav_msgs/msg/Odometry.unstamped")
                publisher.publish(msgspec.to_builtins(cls(), builtin_types=(bytes,)))
                assert not hasattr(cls().header, "stamp")

    run(main())


def test_classes_say_what_the_types_say() -> None:
    interfaces = Interfaces("jazzy")
    mapper = TypeMapper(interfaces)
    names = [name for name in interfaces._members if "/msg/" in name]
    for name in names:
        spec = mapper.map(name).spec
        cls = struct_from_type(spec)
        assert type_from_struct(cls).canonical() == spec.canonical(), name
        cls()
    assert struct_from_type(ros_type(TWIST)) is message_class(TWIST)


def test_a_class_of_the_config_has_its_bounds() -> None:
    known = config()
    cls = known.class_of(TWIST)
    assert type_from_struct(cls).canonical() == known.types[TWIST].canonical()
    with pytest.raises(ConfigError, match="is not known"):
        known.class_of("Nav")


def test_on_zenoh_a_topic_of_ros_is_for_ros_clients() -> None:
    async def main(port: int) -> None:
        node = Node("shore", config=config(), connect=f"tcp/127.0.0.1:{port}")
        async with node:
            with pytest.raises(LocalError, match="odom is a topic of ROS 2 on this local network"):
                node.subscribe("nav_msgs/msg/Odometry", "odom")

    with networks.zenoh_router() as port:
        networks.run(main(port))
