"""Interfaces of ROS as rmw_desert has them: the packets that left its socket, by their types."""

import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from tests.core.rmw_desert import vectors
from zacoustic.config import config_from_mapping
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import ConfigError
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.mapping import TypeMapper
from zacoustic.ros.overlays import Overlay, OverlayField

JAZZY: Final = Interfaces("jazzy")
MAPPER: Final = TypeMapper(JAZZY, wire=WireProfile.RMW_DESERT)
WRITTEN: Final = json.loads(
    (Path(vectors.__file__).parent / "vectors.json").read_text(encoding="utf-8")
)
KNOWN: Final = [
    each for each in WRITTEN if each["ros_type"] in JAZZY and each["name"] != "string_invalid_utf8"
]


def filled(spec: TypeSpec, flat: Iterator[Any]) -> dict[str, Any]:
    """A value of a type with flattened scalars and lists in the order of its fields."""
    value: dict[str, Any] = {}
    for field in spec.fields:
        if not field.is_nested:
            value[field.name] = next(flat)
        elif field.is_array:
            inner = spec.nested_type(field.type)
            value[field.name] = [{inner.fields[0].name: each} for each in next(flat)]
        else:
            value[field.name] = filled(spec.nested_type(field.type), flat)
    return value


@pytest.mark.parametrize("written", KNOWN, ids=lambda each: each["name"])
def test_an_interface_makes_the_packet_of_rmw_desert(written: dict[str, Any]) -> None:
    vector = vectors._vector(written)
    spec = MAPPER.map(written["ros_type"]).spec
    codec = RmwDesertCodec(spec)
    flat = [
        [vectors._number(each) for each in content]
        if isinstance(content, list)
        else vectors._number(content)
        for _, content in written["fields"]
    ]
    value = filled(spec, iter(flat)) if spec.fields else {}
    fields = codec.write(codec.normalised(value))
    assert vector.payload.endswith(fields)
    head_bytes = len(vector.payload) - len(fields)
    assert 2 <= head_bytes <= 11
    assert codec.decode(fields).keys() == value.keys()


def test_the_large_ones_and_services_are_among_them() -> None:
    names = {each["ros_type"] for each in KNOWN}
    assert len(KNOWN) > 60
    assert {"nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState"} <= names
    assert {"example_interfaces/srv/AddTwoInts_Request", "std_srvs/srv/Trigger_Response"} <= names


@pytest.mark.parametrize("name", ["std_msgs/msg/Byte", "own/msg/Flags", "own/msg/Deep"])
def test_a_message_of_octets_alone_has_no_field_and_no_zero(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "own" / "msg"
    folder.mkdir(parents=True)
    (folder / "Flags.msg").write_text("byte flag\nbyte[] flags\nbyte[3] more\n", encoding="utf-8")
    (folder / "Deep.msg").write_text("own/Flags flags\nbyte last\n", encoding="utf-8")
    (folder / "Whole.msg").write_text("own/Flags flags\nuint8 last\n", encoding="utf-8")
    interfaces = Interfaces("jazzy", tmp_path)
    mapper = TypeMapper(interfaces, wire=WireProfile.RMW_DESERT)
    codec = RmwDesertCodec(mapper.map(name).spec)
    assert codec.encode({}) == b""
    assert codec.decode(b"") == {}
    assert (codec.smallest_bytes, codec.largest_bytes) == (0, 0)
    with pytest.raises(PayloadError):
        codec.decode(b"\x00")
    assert RmwDesertCodec(mapper.map("own/msg/Whole").spec).encode({"last": 5}) == b"\x05"
    # Where there is no member at all, ROS gives it one.
    assert RmwDesertCodec(mapper.map("std_msgs/msg/Empty").spec).encode({}) == b"\x00"


def test_octets_cross_as_a_packet_of_kind_and_id() -> None:
    """Driven as a program does: a vehicle's packet becomes a sample, a sample its packet."""
    section = {
        "address": 1,
        "links": [{"locator": "desert/127.0.0.1:4000", "wire": "rmw_desert"}],
        "streams": [{"id": 5, "topic": "/flag", "type": "std_msgs/msg/Byte", "ros": {}}],
        "ros": {"distro": "jazzy"},
    }
    table = config_from_mapping(section, source="test").table
    link = LinkCapabilities(mtu_bytes=512, bit_rate_bps=1000.0, addressed=False)
    engine = Engine(address=1, table=table, epoch=1, rng=random.Random(1))
    engine.handle_link_state(LinkState.UP, 0, link)
    engine.publish(5, {}, 0)
    for write in iter(engine.poll_journal, None):
        engine.handle_journal_committed(write.write_id, 0)
    engine.handle_timeout(NS_PER_S)
    sent = engine.poll_transmit(NS_PER_S)
    assert sent is not None
    assert sent.frame_bytes == b"\x00\x05"
    report = TransmitReport(
        transmission_id=sent.transmission_id, outcome=TransmitOutcome.SENT,
        started_at=NS_PER_S, finished_at=2 * NS_PER_S,
    )  # fmt: skip
    engine.handle_transmit_report(report, 2 * NS_PER_S)
    heard = ReceivedFrame(frame_bytes=b"\x00\x05", received_at=3 * NS_PER_S)
    engine.handle_frame(heard, 3 * NS_PER_S)
    events = iter(engine.poll_event, None)
    assert [each.value for each in events if isinstance(each, SampleReceived)] == [{}]
    assert not engine.stats.dropped


def test_fixed_arrays_of_octets_are_listed_and_bytes_are_left_out(tmp_path: Path) -> None:
    folder = tmp_path / "own" / "msg"
    folder.mkdir(parents=True)
    lines = ("uint8[3] key", "uint8[] raw", "byte flag", "byte[] flags", "char letter")
    (folder / "Odd.msg").write_text("\n".join(lines) + "\n", encoding="utf-8")
    mapped = TypeMapper(Interfaces("jazzy", tmp_path), wire=WireProfile.RMW_DESERT).map(
        "own/msg/Odd"
    )
    assert [field.name for field in mapped.spec.fields] == ["key", "raw", "letter"]
    value = {"key": [1, 2, 3], "raw": b"\x04\x05", "letter": 6}
    codec = RmwDesertCodec(mapped.spec)
    assert codec.encode(value) == bytes.fromhex("010203 020405 06")
    assert mapped.read(mapped.write(value)) == value


def test_what_an_overlay_leaves_out_has_no_counterpart() -> None:
    for rule in (
        OverlayField(field="frame_id", constant="map"),
        OverlayField(field="*", omit=True),
    ):
        overlay = Overlay(type="std_msgs/msg/Header", fields=(rule,))
        mapper = TypeMapper(JAZZY, [overlay], wire=WireProfile.RMW_DESERT)
        with pytest.raises(ConfigError, match=r"left out by an overlay with wire: \"rmw_desert\""):
            mapper.map("std_msgs/msg/Header")


def test_the_file_says_it_for_ros_streams_too() -> None:
    section: dict[str, Any] = {
        "address": 1,
        "links": [{"locator": "desert/127.0.0.1:4000", "wire": "rmw_desert"}],
        "ros": {"distro": "jazzy"},
        "streams": [
            {"id": 3, "topic": "/fix", "type": "sensor_msgs/msg/NavSatFix", "ros": {}},
            {"id": 4, "service": "/arm", "type": "std_srvs/srv/SetBool", "server": 2, "ros": {}},
        ],
    }
    assert len(config_from_mapping(section, source="f").table) == 2
    section["streams"][0]["ros"] = {"stamp": "drop"}
    with pytest.raises(ConfigError, match=r"streams\[0\].* with wire: \"rmw_desert\""):
        config_from_mapping(section, source="f")
