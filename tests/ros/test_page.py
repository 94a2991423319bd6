"""docs/ros2.md: its file is valid, and its figures are those of the codecs."""

import json
import re
from pathlib import Path
from typing import Any, Final

import pytest

from tests.virtual.fibonacci import ORDER, Run
from zacoustic.config import config_from_mapping, read_config
from zacoustic.core.values.payload import CborCodec, PackedCodec
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.mapping import TypeMapper
from zacoustic.ros.messages import HeaderStamp, RosMessage
from zacoustic.ros.overlays import Overlay, OverlayField
from zacoustic.ros.streams import RosService

PAGE: Final = (Path(__file__).parents[2] / "docs" / "ros2.md").read_text(encoding="utf-8")
MOST_LINES: Final = 15
# Attachment, time stamp, frame and declared key, as measured for a Twist.
RMW_ZENOH_BYTES: Final = 72

STAMP: Final = {"sec": 1_700_000_000, "nanosec": 123_456_789}
TWIST: Final = {"linear": {"x": 1.25}, "angular": {"z": -0.5}}
FIX: Final = {
    "header": {"frame_id": "gps", "stamp": STAMP},
    "latitude": 43.123456,
    "longitude": 5.912345,
    "altitude": -12.3,
}
ODOMETRY: Final = {
    "header": {"frame_id": "odom", "stamp": STAMP},
    "child_frame_id": "base_link",
    "pose": {
        "pose": {
            "position": {"x": 12.3, "y": -45.6, "z": -20.1},
            "orientation": {"w": 0.968, "z": 0.247},
        }
    },
    "twist": {"twist": {"linear": {"x": 1.2}}},
}
VALUES: Final[dict[str, dict[str, Any]]] = {
    "geometry_msgs/msg/Twist": TWIST,
    "sensor_msgs/msg/NavSatFix": FIX,
    "nav_msgs/msg/Odometry": ODOMETRY,
    "std_msgs/msg/String": {"data": "hello"},
}


def bounded(path: str, low: float, high: float, step: float | None = None) -> OverlayField:
    return OverlayField(field=path, range=(low, high), step=step)


OVERLAYS: Final = (
    Overlay(type="geometry_msgs/msg/Twist", fields=(bounded("*.*", -2, 2, 0.01),)),
    Overlay(
        type="sensor_msgs/msg/NavSatFix",
        fields=(
            OverlayField(field="header.frame_id", constant="gps"),
            OverlayField(field="position_covariance*", omit=True),
            bounded("latitude", -90, 90, 1e-6),
            bounded("longitude", -180, 180, 1e-6),
            bounded("altitude", -1000, 100, 0.1),
            bounded("status.status", -2, 2),
            bounded("status.service", 0, 15),
        ),
    ),
    Overlay(
        type="nav_msgs/msg/Odometry",
        fields=(
            OverlayField(field="header.frame_id", constant="odom"),
            OverlayField(field="child_frame_id", constant="base_link"),
            OverlayField(field="*.covariance", omit=True),
            bounded("pose.pose.position.*", -5000, 5000, 0.1),
            bounded("pose.pose.orientation.*", -1, 1, 0.001),
            bounded("twist.twist.*.*", -5, 5, 0.01),
        ),
    ),
)


def test_the_way_to_the_first_message_is_short(tmp_path: Path) -> None:
    (file,) = re.findall(r"```json5\n(.*?)```", PAGE, re.DOTALL)
    assert len(file.splitlines()) <= MOST_LINES
    way = PAGE.partition("Then, on the shore:")[0]
    commands = re.findall(r"^(?:pip|zacoustic) .*$", way, re.MULTILINE)
    assert [command.split()[:2] for command in commands] == [
        ["pip", "install"],
        ["zacoustic", "config"],
        ["zacoustic", "run"],
    ]
    path = tmp_path / "fleet.json5"
    path.write_text(file)
    for address in (1, 2):
        config = read_config(path, address=address)
        assert config.ros is not None
        assert sorted(config.ros.streams) == [11, 20]


@pytest.mark.parametrize("name", VALUES)
def test_the_figures_of_messages_are_right(name: str) -> None:
    interfaces = Interfaces("jazzy")
    plain = RosMessage(interfaces, TypeMapper(interfaces), name)
    cdr = plain.write(VALUES[name])
    stamp = HeaderStamp.AGE if "header" in VALUES[name] else HeaderStamp.EXACT
    small = RosMessage(interfaces, TypeMapper(interfaces, OVERLAYS), name, stamp)
    age_bytes = stamp is HeaderStamp.AGE
    packed = 1 + age_bytes + len(PackedCodec(small.spec).encode(small.read(cdr)[0]))
    unbounded = 1 + len(CborCodec(plain.spec).encode(plain.read(cdr)[0]))
    (row,) = re.findall(rf"^\| `{name.split('/')[2]}`.*$", PAGE, re.MULTILINE)
    figures = [int(figure) for figure in re.findall(r"\b\d+\b", row.split("|", 2)[2])]
    assert len(cdr) + RMW_ZENOH_BYTES in figures
    assert packed in figures, packed
    assert unbounded in figures, unbounded


def test_the_figures_of_a_service_are_right() -> None:
    stream = {"id": 20, "service": "/add", "type": "example_interfaces/srv/AddTwoInts"}
    section = {"address": 1, "streams": [stream | {"server": 2, "ros": {}}]}
    config = config_from_mapping(json.loads(json.dumps(section)), source="test")
    assert config.ros is not None
    assert isinstance(config.ros.streams[20], RosService)
    row = config.table.by_id(20)
    # Id and number of the call before each.
    request, response = row.codec.encode({"a": 2, "b": 3}), row.response_codec.encode({"sum": 5})
    assert f"| {2 + len(request)} + {2 + len(response)} |" in PAGE


def test_the_figures_of_an_action_are_right() -> None:
    for is_cold, nodes in ((False, "know each other"), (True, "have never heard of each other")):
        (row,) = re.findall(rf"^\| that {nodes} .*$", PAGE, re.MULTILINE)
        run = Run(0, loss=0.0, cold=is_cold)
        run.check()
        assert len(run.fed) == ORDER
        assert re.search(rf"\b{run.bytes_on_link}\b", row), run.bytes_on_link
