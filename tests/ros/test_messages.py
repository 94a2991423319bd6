"""ROS messages as types: CDR to values and back, for every message that there is."""

import math
import struct
from pathlib import Path
from typing import Any, Final

import pytest

from tests.ros import captures
from zacoustic.core.values.payload import CborCodec, PackedCodec
from zacoustic.errors import ConfigError, PayloadInvalidError
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.mapping import TypeMapper
from zacoustic.ros.messages import HeaderStamp, RosMessage
from zacoustic.ros.overlays import Overlay, OverlayField

JAZZY: Final = Interfaces("jazzy")
PLAIN: Final = TypeMapper(JAZZY)
BOUNDED_TWIST: Final = Overlay(
    type="geometry_msgs/msg/Twist",
    fields=(OverlayField(field="*.*", range=(-2, 2), step=0.01),),
)


def message(name: str, *overlays: Overlay, stamp: HeaderStamp = HeaderStamp.EXACT) -> RosMessage:
    return RosMessage(JAZZY, TypeMapper(JAZZY, overlays), name, stamp)


def filled(name: str, mapper: TypeMapper = PLAIN) -> dict[str, Any]:
    """Make a value of a type in which hardly anything is zero."""
    spec = mapper.map(name).spec

    def value_of(spec: Any, depth: int) -> dict[str, Any]:
        return {field.name: several(spec, field, depth) for field in spec.fields}

    def several(spec: Any, field: Any, depth: int) -> Any:
        if field.type == "bytes":
            return bytes(range(min(field.max_length or 3, 100)))
        if field.length is not None:
            return [one(spec, field, depth) for _ in range(field.length)]
        if field.is_bounded_array:
            return [one(spec, field, depth) for _ in range(min(2, field.max_length))]
        return one(spec, field, depth)

    def one(spec: Any, field: Any, depth: int) -> Any:
        if field.is_nested:
            return value_of(spec.nested_type(field.type), depth + 1)
        if field.type == "string":
            return "Grün"
        if field.type == "bool":
            return True
        return 1.5 if field.type.startswith("float") else 7

    return value_of(spec, 0)


def test_every_message_comes_back_as_it_was() -> None:
    parts = ("_Request", "_Response", "_Goal", "_Result", "_Feedback")
    names = [name for name in JAZZY._members if "/msg/" in name or name.endswith(parts)]
    assert len(names) > 230
    for name in names:
        ros = RosMessage(JAZZY, PLAIN, name)
        value = filled(name)
        cdr = ros.write(value)
        assert ros.read(cdr) == (value, None), name
        for codec in (CborCodec(ros.spec), PackedCodec(ros.spec)):
            if ros.spec.fields:
                assert ros.write(codec.decode(codec.encode(value))) == cdr, name


def test_bytes_are_those_that_were_seen() -> None:
    ros = message("std_msgs/msg/String")
    assert ros.read(captures.STRING_PAYLOAD) == ({"data": "hello"}, None)
    assert ros.write({"data": "hello"}) == captures.STRING_PAYLOAD
    twist = message("geometry_msgs/msg/Twist")
    value, _ = twist.read(captures.TWIST_PAYLOAD)
    assert value["linear"] == {"x": 1.0, "y": 0.0, "z": 0.0}
    assert twist.write(value) == captures.TWIST_PAYLOAD
    request = message("example_interfaces/srv/AddTwoInts_Request")
    assert request.read(captures.ADD_REQUEST)[0] == {"a": 2, "b": 3}
    assert request.write({"a": 2, "b": 3}) == captures.ADD_REQUEST


def test_a_message_without_members_is_one_byte_that_says_nothing() -> None:
    ros = message("std_srvs/srv/Trigger_Request")
    assert ros.write({}) == bytes.fromhex("0001000000")
    assert ros.read(bytes.fromhex("0001000000")) == ({}, None)
    assert PackedCodec(ros.spec).encode({}) == b""


def test_big_endian_is_read_too() -> None:
    cdr = bytes.fromhex("00000000") + struct.pack(">6d", 1, 2, 3, 4, 5, 6)
    value, _ = message("geometry_msgs/msg/Twist").read(cdr)
    assert value["angular"] == {"x": 4.0, "y": 5.0, "z": 6.0}


@pytest.mark.parametrize(
    "cdr",
    [b"", b"\0", bytes(4), bytes.fromhex("00010000"), captures.TWIST_PAYLOAD[:-1], b"\xff" * 80,
     captures.TWIST_PAYLOAD + bytes(8)],
)  # fmt: skip
def test_what_is_no_message_is_refused(cdr: bytes) -> None:
    with pytest.raises(PayloadInvalidError, match="geometry_msgs/msg/Twist"):
        message("geometry_msgs/msg/Twist").read(cdr)


def test_any_cut_of_a_message_is_refused_or_read() -> None:
    ros = message("diagnostic_msgs/msg/DiagnosticArray")
    cdr = ros.write(filled("diagnostic_msgs/msg/DiagnosticArray"))
    for length in range(len(cdr) - 4):
        with pytest.raises(PayloadInvalidError):
            ros.read(cdr[:length])


def test_an_overlay_makes_a_twist_small() -> None:
    ros = message("geometry_msgs/msg/Twist", BOUNDED_TWIST)
    value, _ = ros.read(captures.TWIST_PAYLOAD)
    packed = PackedCodec(ros.spec)
    assert packed.largest_bytes == 7
    assert ros.write(packed.decode(packed.encode(value))) == captures.TWIST_PAYLOAD


def test_an_overlay_holds_wherever_its_type_is_used_and_that_of_an_outer_type_first() -> None:
    header = Overlay(
        type="std_msgs/msg/Header", fields=(OverlayField(field="frame_id", constant="map"),)
    )
    odometry = Overlay(
        type="nav_msgs/msg/Odometry",
        fields=(
            OverlayField(field="header.frame_id", values=("map", "odom")),
            OverlayField(field="child_frame_id", constant="base_link"),
            OverlayField(field="*.covariance", omit=True),
            OverlayField(field="pose.pose.position.*", range=(-1000, 1000), step=0.1),
        ),
    )
    mapper = TypeMapper(JAZZY, [header, odometry])
    pose = mapper.map("geometry_msgs/msg/PoseStamped").spec
    assert [field.name for field in pose.nested_type("std_msgs/msg/Header").fields] == ["stamp"]
    spec = mapper.map("nav_msgs/msg/Odometry").spec
    assert [field.name for field in spec.fields] == ["header", "pose", "twist"]
    assert spec.nested_type("nav_msgs/msg/Odometry.header").fields[1].type == "enum"
    ros = RosMessage(JAZZY, mapper, "nav_msgs/msg/Odometry", HeaderStamp.DROP)
    plain = message("nav_msgs/msg/Odometry")
    value = filled("nav_msgs/msg/Odometry")
    value["header"]["frame_id"], value["child_frame_id"] = "map", "base_link"
    read, _ = ros.read(plain.write(value))
    again, _ = plain.read(ros.write(ros.spec.validate(read)))
    assert again["child_frame_id"] == "base_link"
    assert again["header"]["frame_id"] == "map"
    assert again["pose"]["covariance"] == [0.0] * 36
    assert again["pose"]["pose"] == value["pose"]["pose"]


def test_a_constant_that_differs_is_refused_and_not_rewritten() -> None:
    header = Overlay(
        type="std_msgs/msg/Header", fields=(OverlayField(field="frame_id", constant="map"),)
    )
    ros, plain = message("std_msgs/msg/Header", header), message("std_msgs/msg/Header")
    value = filled("std_msgs/msg/Header") | {"frame_id": "odom"}
    with pytest.raises(PayloadInvalidError, match=r"frame_id is 'odom'; allowed: 'map'"):
        ros.read(plain.write(value))


def test_a_text_with_few_values_is_an_enum() -> None:
    header = Overlay(
        type="std_msgs/msg/Header",
        fields=(OverlayField(field="frame_id", values=("map", "odom")),),
    )
    ros = message("std_msgs/msg/Header", header, stamp=HeaderStamp.EXACT)
    assert ros.spec.fields[1].type == "enum"
    value = filled("std_msgs/msg/Header") | {"frame_id": "odom"}
    assert ros.read(ros.write(value))[0] == value


@pytest.mark.parametrize(
    ("field", "expected"),
    [
        (OverlayField(field="linear.x", range=(2, -2)), "range: .* allowed: low < high"),
        (OverlayField(field="linear", constant=1), "constant; allowed: for single values"),
        (OverlayField(field="linear.x", constant="a"), "constant: .* is 'a'"),
        (OverlayField(field="linear.x", max_length=3, values=("a",)), "values: not for type"),
    ],
)
def test_a_rule_that_does_not_fit_is_refused(field: OverlayField, expected: str) -> None:
    overlay = Overlay(type="geometry_msgs/msg/Twist", fields=(field,))
    with pytest.raises(ConfigError, match=expected):
        TypeMapper(JAZZY, [overlay]).map("geometry_msgs/msg/Twist")


def test_a_stamp_is_exact_dropped_or_an_age() -> None:
    name = "sensor_msgs/msg/NavSatFix"
    plain, value = message(name), filled(name)
    value["header"]["stamp"] = {"sec": 1_700_000_000, "nanosec": 5}
    cdr = plain.write(value)
    dropped = message(name, stamp=HeaderStamp.DROP)
    read, stamp_ns = dropped.read(cdr)
    assert stamp_ns is None
    assert read["header"] == {"frame_id": "Grün"}
    assert plain.read(dropped.write(read))[0]["header"]["stamp"] == {"sec": 0, "nanosec": 0}
    aged = message(name, stamp=HeaderStamp.AGE)
    read, stamp_ns = aged.read(cdr)
    assert stamp_ns == 1_700_000_000_000_000_005
    again, _ = plain.read(aged.write(read, stamp_ns - 1_000_000_000))
    assert again["header"]["stamp"] == {"sec": 1_699_999_999, "nanosec": 5}
    assert again["header"]["frame_id"] == "Grün"
    with pytest.raises(ConfigError, match="has no header"):
        message("geometry_msgs/msg/Twist", stamp=HeaderStamp.DROP)


STAMP_S: Final = 1_800_000_000


def transforms(*stamps_s: float) -> dict[str, Any]:
    found = []
    for stamp_s in stamps_s:
        each = filled("geometry_msgs/msg/TransformStamped")
        stamp = {"sec": int(stamp_s), "nanosec": round(stamp_s % 1 * 1e9)}
        found.append(each | {"header": each["header"] | {"stamp": stamp}})
    return {"transforms": found}


def some_time_before(newest_s: float, before_s: list[float | None]) -> dict[str, Any]:
    return transforms(*(0.0 if each is None else newest_s - each for each in before_s))


@pytest.mark.parametrize(
    ("before_s", "crossing"),
    [
        ([], []),
        ([0.0], []),
        ([0.0, 0.0, 0.0], []),
        ([0.0, 12.5, 3600.0], [0, 12_500, 3_600_000]),
        ([None, 0.0], [2**32 - 1, 0]),
        ([None, None], []),
    ],
)
def test_stamps_in_a_list_become_one_age(before_s: list[float | None], crossing: list[int]) -> None:
    name = "tf2_msgs/msg/TFMessage"
    plain, aged = message(name), message(name, stamp=HeaderStamp.AGE)
    read, stamp_ns = aged.read(plain.write(some_time_before(STAMP_S, before_s)))
    assert read["stamps_before_ms"] == crossing
    if not before_s:
        assert stamp_ns is None
    else:
        assert stamp_ns == (0 if set(before_s) == {None} else STAMP_S * 10**9)
    assert "stamp" not in str([each["header"] for each in read["transforms"]])
    for codec in (CborCodec(aged.spec), PackedCodec(aged.spec)):
        crossed = codec.decode(codec.encode(aged.spec.validate(read)))
        later_ns = (STAMP_S + 100) * 10**9 if stamp_ns else None
        written, _ = plain.read(aged.write(crossed, later_ns))
        wanted, _ = plain.read(plain.write(some_time_before(STAMP_S + 100, before_s)))
        assert written == wanted
    unknown, _ = plain.read(aged.write(aged.spec.validate(read), None))
    assert all(each["header"]["stamp"]["sec"] == 0 for each in unknown["transforms"])


def test_stamps_in_a_list_that_contradict_it_are_refused() -> None:
    name = "tf2_msgs/msg/TFMessage"
    plain, aged = message(name), message(name, stamp=HeaderStamp.AGE)
    value, _ = aged.read(plain.write(transforms(STAMP_S)))
    with pytest.raises(PayloadInvalidError, match="1 of transforms, 2 stamps"):
        aged.write(value | {"stamps_before_ms": [1, 0]}, 5 * 10**18)
    with pytest.raises(PayloadInvalidError, match="20833 days apart; allowed: 49"):
        aged.read(plain.write(transforms(1, STAMP_S)))
    with pytest.raises(ConfigError, match="has no header"):
        message("tf2_msgs/msg/TFMessage", stamp=HeaderStamp.DROP)


def test_a_fixed_array_of_bytes_has_its_length() -> None:
    ros = message("unique_identifier_msgs/msg/UUID")
    assert ros.read(ros.write({"uuid": bytes(range(16))}))[0] == {"uuid": bytes(range(16))}
    with pytest.raises(PayloadInvalidError, match="uuid has 3 bytes; allowed: 16"):
        ros.write({"uuid": b"abc"})


def test_all_bounds_of_a_definition_are_in_the_type(tmp_path: Path) -> None:
    """What could not be written at the other end is refused before it is sent."""
    (tmp_path / "my_msgs/msg").mkdir(parents=True)
    text = "uint8[4] id\nbyte[<=3] few\nstring<=5 name\nfloat32[<=2] two\nstring<=2[<=2] words\n"
    (tmp_path / "my_msgs/msg/Bounded.msg").write_text(text)
    own = Interfaces("jazzy", tmp_path)
    ros = RosMessage(own, TypeMapper(own), "my_msgs/msg/Bounded")
    value = {"id": bytes(4), "few": b"abc", "name": "abcde", "two": [1.0] * 2}
    value["words"] = [{"text": "ab"}] * 2
    codec = PackedCodec(ros.spec)
    assert ros.read(ros.write(codec.decode(codec.encode(value))))[0] == value
    for field, wrong in (
        ("id", bytes(3)),
        ("id", bytes(5)),
        ("few", b"abcd"),
        ("name", "abcdef"),
        ("two", [1.0] * 3),
        ("words", [{"text": "ab"}] * 3),
        ("words", [{"text": "abc"}]),
    ):
        with pytest.raises(PayloadInvalidError, match=f"{field}.* has .* allowed: "):
            codec.encode(value | {field: wrong})
    longer = Overlay(type="my_msgs/msg/Bounded", fields=(OverlayField(field="few", max_length=4),))
    with pytest.raises(ConfigError, match="few: max_length: 4; allowed: at most 3"):
        TypeMapper(own, [longer]).map("my_msgs/msg/Bounded")


def test_a_member_without_a_value_crosses_beside_its_bounds() -> None:
    name = "sensor_msgs/msg/BatteryState"
    rule = OverlayField(field="*e", range=(-500, 500), step=0.01, nan=True)
    ros, plain = message(name, Overlay(type=name, fields=(rule,))), message(name)
    value = plain.read(plain.write({}))[0] | {"voltage": 24.5, "charge": math.nan}
    value["temperature"] = -math.inf
    for codec in (CborCodec(ros.spec), PackedCodec(ros.spec)):
        got = ros.write(codec.decode(codec.encode(ros.read(plain.write(value))[0])))
        assert got == plain.write(value)


def test_a_single_byte_is_an_octet_both_ways() -> None:
    ros = message("std_msgs/msg/Byte")
    for octet in (0, 127, 128, 200, 255):
        cdr = bytes.fromhex("00010000") + bytes((octet,))
        assert ros.read(cdr)[0] == ros.spec.validate({"data": octet}) == {"data": octet}
        assert ros.write({"data": octet}) == cdr
    level = OverlayField(field="data", constant=200)
    always = message("std_msgs/msg/Byte", Overlay(type="std_msgs/msg/Byte", fields=(level,)))
    cdr = bytes.fromhex("00010000c8")
    assert always.write(always.read(cdr)[0]) == cdr
    with pytest.raises(PayloadInvalidError, match="data is 201; allowed: 200"):
        always.read(bytes.fromhex("00010000c9"))


def test_of_a_sequence_of_messages_without_members_the_number_crosses(tmp_path: Path) -> None:
    for name, text in (
        ("Nothing", "uint8 SOME=1\n"),
        ("Several", "Nothing[] all\nNothing[<=3] few\nNothing[2] two\nbool last\n"),
    ):
        (tmp_path / "my_msgs/msg").mkdir(parents=True, exist_ok=True)
        (tmp_path / f"my_msgs/msg/{name}.msg").write_text(text)
    own = Interfaces("jazzy", tmp_path)
    ros = RosMessage(own, TypeMapper(own), "my_msgs/msg/Several")
    value = {"all": 5, "few": 3, "last": True}
    assert [(field.name, field.range) for field in ros.spec.fields[:2]] == [
        ("all", (0, 65535)),
        ("few", (0, 3)),
    ]
    assert ros.read(ros.write(value))[0] == value
    with pytest.raises(PayloadInvalidError, match=r"few is 4; allowed: 0\.\.3"):
        ros.spec.validate(value | {"few": 4})


def test_a_sequence_whose_elements_are_left_out_has_their_number_and_constants() -> None:
    fields = (
        OverlayField(field="values.key", constant="V"),
        OverlayField(field="values.value", omit=True),
    )
    name = "diagnostic_msgs/msg/DiagnosticStatus"
    ros, plain = message(name, Overlay(type=name, fields=fields)), message(name)
    value = filled(name) | {"values": [{"key": "V", "value": ""}] * 2}
    read = ros.read(plain.write(value))[0]
    assert read["values"] == 2
    assert plain.read(ros.write(read))[0] == value
    with pytest.raises(PayloadInvalidError, match="key is 'A'"):
        ros.read(plain.write(value | {"values": [{"key": "A", "value": ""}]}))
