"""What the configuration says of ROS."""

from typing import Any

import pytest

from zacoustic.config import Config, config_from_mapping
from zacoustic.core.base.qos import Stamp
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.errors import ConfigError
from zacoustic.ros.qos import RosDurability, RosReliability
from zacoustic.ros.streams import RosAction, RosService, RosTopic

STRING = "std_msgs/msg/String"


def read(*streams: dict[str, Any], **section: Any) -> Config:
    nodes = [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}]
    written = {"address": 1, "nodes": nodes, "streams": list(streams), **section}
    return config_from_mapping(written, source="test")


def topic(**keys: Any) -> dict[str, Any]:
    return {"id": 1, "topic": "/chat", "type": STRING, "ros": {}, **keys}


def test_names_are_in_the_namespace_unless_they_begin_with_a_slash() -> None:
    ros = {"namespace": "/auv1"}
    streams = topic(topic="chat"), topic(id=2, topic="/chat")
    names = [stream.name for stream in read(*streams, ros=ros).table]
    assert names == ["auv1/chat", "chat"]


def test_the_domain_is_that_of_the_environment_unless_it_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "17")
    assert read(topic()).ros.domain == 17  # type: ignore[union-attr]
    assert read(topic(), ros={"domain": 3}).ros.domain == 3  # type: ignore[union-attr]
    for text in ("x", "233"):
        monkeypatch.setenv("ROS_DOMAIN_ID", text)
        with pytest.raises(ConfigError, match=r"ros\.domain: .* in \$ROS_DOMAIN_ID; allowed: a"):
            read(topic())
    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert read(topic()).ros.domain == 0  # type: ignore[union-attr]


def test_a_file_without_streams_of_ros_has_none() -> None:
    assert read({"id": 1, "topic": "chat"}).ros is None
    assert read({"id": 1, "topic": "chat", "type": STRING}).ros is None


def test_what_a_stream_is_in_ros_follows_from_its_table() -> None:
    config = read(
        topic(durability="transient_local", reliability="reliable", depth=3),
        topic(id=2, topic="/fix", type="sensor_msgs/msg/NavSatFix", ros={"stamp": "age"}),
        {"id": 3, "service": "/arm", "type": "std_srvs/srv/SetBool", "server": 2, "ros": {}},
        {
            "id": 4,
            "action": "/fibonacci",
            "type": "example_interfaces/action/Fibonacci",
            "server": 2,
            "ros": {},
        },
    )
    assert config.ros is not None
    chat, fix, arm, fibonacci = (config.ros.streams[number] for number in (1, 2, 3, 4))
    assert isinstance(chat, RosTopic)
    assert (chat.qos.reliability, chat.qos.durability, chat.qos.depth) == (
        RosReliability.RELIABLE,
        RosDurability.TRANSIENT_LOCAL,
        3,
    )
    assert str(chat.key(0, "chat")).startswith("0/chat/std_msgs::msg::dds_::String_/RIHS01_")
    assert isinstance(fix, RosTopic)
    spec = config.table.by_id(2).spec
    assert isinstance(spec, TopicSpec)
    assert spec.qos.stamp is Stamp.AGE
    assert spec.type_name == "sensor_msgs/msg/NavSatFix.unstamped"
    assert isinstance(arm, RosService)
    assert isinstance(fibonacci, RosAction)
    assert fibonacci.send_goal.interface == "example_interfaces/action/Fibonacci_SendGoal"


def test_ros_does_not_change_what_crosses() -> None:
    plain = {"id": 1, "topic": "chat", "type": STRING}
    assert read(topic()).table.digest == read(plain).table.digest
    other = read(topic(), ros={"distro": "humble", "domain": 9})
    assert other.table.digest == read(plain).table.digest


@pytest.mark.parametrize(
    ("stream", "expected"),
    [
        (topic(type=None), "type: is missing; allowed: a ROS type, such as"),
        (topic(type="std_srvs/srv/SetBool"), 'type: "std_srvs/srv/SetBool" for a topic; allowed:'),
        (topic(ros={"stamp": "now"}), r"ros\.stamp: \"now\"; allowed: exact, drop, age"),
        (
            topic(ros={"stamp": "drop"}),
            r'ros\.stamp: "drop"; allowed: exact: std_msgs/msg/String has no header',
        ),
        (topic(topic="/a/*"), r"topic: \"/a/\*\"; allowed: a ROS name"),
        (
            topic(durability="for_ever"),
            'durability: "for_ever"; allowed: volatile, transient_local',
        ),
        (
            topic(topic="/a/{b}", wildcards=[{"name": "b", "values": ["c"]}]),
            r"wildcards: with ros; allowed: \{node\} alone",
        ),
        (
            {"id": 3, "service": "arm", "type": "Nav", "server": 2},
            'type: "Nav"; allowed: a ROS type, such as "std_srvs/srv/SetBool"',
        ),
        (
            {"id": 3, "service": "/arm", "type": STRING, "server": 2, "ros": {}},
            "for a service; allowed: PACKAGE/srv/Name",
        ),
        (
            {
                "id": 3,
                "service": "/arm",
                "type": "std_srvs/srv/SetBool",
                "request": STRING,
                "server": 2,
            },
            "request: beside type; allowed: one of them",
        ),
    ],
)
def test_what_cannot_be_is_one_line(stream: dict[str, Any], expected: str) -> None:
    stream = {key: value for key, value in stream.items() if value is not None}
    with pytest.raises(ConfigError, match=expected):
        read(stream)


def test_of_an_action_only_what_crosses_is_a_type_of_the_config() -> None:
    streams = [
        {"id": 3, "service": "/arm", "type": "std_srvs/srv/SetBool", "server": 2, "ros": {}},
        {
            "id": 4,
            "action": "/fibonacci",
            "type": "example_interfaces/action/Fibonacci",
            "server": 2,
            "ros": {},
        },
    ]
    section = {"address": 1, "streams": streams}
    assert [spec.name for spec in config_from_mapping(section, source="test").types] == [
        "std_srvs/srv/SetBool_Request",
        "std_srvs/srv/SetBool_Response",
        "example_interfaces/action/Fibonacci_Goal",
        "example_interfaces/action/Fibonacci_Feedback",
        "example_interfaces/action/Fibonacci_Result",
    ]
