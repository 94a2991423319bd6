"""Names, keys, tokens and attachments against what nodes on rmw_zenoh were seen to say."""

import pytest

from tests.ros import captures
from zacoustic.errors import ConfigError
from zacoustic.ros.attachment import Attachment, read_attachment
from zacoustic.ros.names import RosKey, dds_type, interface_of, is_interface, read_key, stream_name
from zacoustic.ros.qos import RosDurability, RosQos, RosReliability, read_qos
from zacoustic.ros.tokens import Entity, RosNode, Token, gid_of, read_token


@pytest.mark.parametrize("text", captures.TOKENS)
def test_a_token_is_read_and_written_as_it_was_seen(text: str) -> None:
    token = read_token(text)
    assert token is not None
    assert str(token) == text


def test_the_parts_of_a_token_are_what_they_were() -> None:
    node = RosNode(
        domain=0,
        zid="2dcf8fcb480dbe6b1a9d54957ccd6595",
        number=1,
        name="ctl",
        namespace="/robot1",
    )
    token = Token(
        node=node,
        number=1,
        kind=Entity.PUBLISHER,
        topic="/robot1/cmd_vel",
        type=dds_type("geometry_msgs/msg/Twist"),
        hash=captures.TWIST_HASH,
        qos=RosQos(
            reliability=RosReliability.BEST_EFFORT,
            durability=RosDurability.TRANSIENT_LOCAL,
            depth=1,
        ),
    )
    assert str(token) == captures.LATCHED_TOKEN
    assert read_token(captures.LATCHED_TOKEN) == token
    assert token.full_node_name == "/robot1/ctl"


def test_what_newer_versions_append_to_a_token_is_passed_over() -> None:
    token = read_token(captures.PUBLISHER_TOKEN)
    assert read_token(f"{captures.PUBLISHER_TOKEN}/buffers%cpu") == token


@pytest.mark.parametrize(
    "text",
    [
        "",
        "@ros2_lv",
        "@ros2_lv/0/a/0/0/NN/%/%",
        "@ros2_lv/x/a/0/0/NN/%/%/talker",
        "@ros2_lv/0/a/0/0/XX/%/%/talker",
        "@ros2_lv/0/a/0/0/MP/%/%/talker/%chatter/type/hash",
        "@ros2_lv/0/a/0/0/MP/%/%/talker/%chatter/type/hash/nonsense",
        "@acoustic/0/a/0/0/NN/%/%/talker",
    ],
)
def test_what_is_no_token_is_none(text: str) -> None:
    assert read_token(text) is None


@pytest.mark.parametrize("text", ["::,10:,:,:,,", "2:1:,1:,:,:,,", "::2,:,:,:,,", ":::", "::,x:"])
def test_a_profile_is_read_and_written_as_it_was_seen(text: str) -> None:
    qos = read_qos(text)
    assert qos is None or str(qos) == text
    assert (qos is None) == (text in (":::", "::,x:"))


def test_a_key_is_read_from_both_ends() -> None:
    key = read_key(captures.TWIST_KEY)
    assert key == RosKey(
        domain=0,
        name="robot1/cmd_vel",
        type="geometry_msgs::msg::dds_::Twist_",
        hash=captures.TWIST_HASH,
    )
    assert str(key) == captures.TWIST_KEY
    assert interface_of(key.type) == "geometry_msgs/msg/Twist"
    for text in ("", "0", "0/a", "0/a/b", "x/a/b/c", "0//b/c"):
        assert read_key(text) is None


def test_attachments_are_what_was_seen() -> None:
    seen = read_attachment(captures.ADD_ATTACHMENT)
    assert seen == Attachment(
        sequence=1,
        stamp_ns=int.from_bytes(captures.ADD_ATTACHMENT[8:16], "little"),
        gid=bytes.fromhex("0421d488e49f4a81b7da0c4e348cc877"),
    )
    for content in (captures.ADD_ATTACHMENT, captures.STRING_ATTACHMENT):
        read = read_attachment(content)
        assert read is not None
        assert read.encode() == content
        assert read_attachment(content + b"more") == read
    assert read_attachment(captures.ADD_ATTACHMENT[:32]) is None
    assert read_attachment(bytes(33)) is None


def test_a_gid_is_the_hash_of_the_token() -> None:
    # XXH3-128 of the token with seed 0, the low half first, each half little endian.
    assert gid_of("").hex() == "7f498d4624c30160d8984701d306aa99"
    token = read_token(captures.PUBLISHER_TOKEN)
    assert token is not None
    assert gid_of(token) == gid_of(captures.PUBLISHER_TOKEN)
    assert len(gid_of(token)) == 16
    assert gid_of(token) != gid_of(captures.LATCHED_TOKEN)


def test_names_of_streams_have_no_leading_slash() -> None:
    assert stream_name("/auv/cmd_vel") == "auv/cmd_vel"
    assert stream_name("cmd_vel", "/auv") == "auv/cmd_vel"
    assert stream_name("/cmd_vel", "auv") == "cmd_vel"
    assert stream_name("/fleet/{node}/status") == "fleet/{node}/status"
    for name in ("", "/", "a//b", "~/x", "/a b", "/1a", "/a/*"):
        with pytest.raises(ConfigError, match="a ROS name"):
            stream_name(name)


def test_an_interface_is_told_from_other_types() -> None:
    assert is_interface("geometry_msgs/msg/Twist")
    assert is_interface("std_srvs/srv/SetBool_Request")
    for name in ("Nav", "a/b", "geometry_msgs/Twist", "Geometry/msg/Twist", "a/msg/b"):
        assert not is_interface(name)
