"""A bag of ROS 2 (MCAP, CDR) is a recording: read by the types of the configuration's streams."""

import json
from pathlib import Path

import pytest

from zacoustic.app.tools.design.telemetry.recording import read_recordings
from zacoustic.app.tools.fleetfile import read_fleet
from zacoustic.errors import ConfigError

TOPIC = {"id": 10, "topic": "/auv1/fix", "type": "sensor_msgs/msg/NavSatFix", "publishers": [2]}


def bag(folder: Path, count: int = 20) -> Path:
    """Write a bag with a position a second, and return its folder."""
    import numpy as np
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    fix = types["sensor_msgs/msg/NavSatFix"]
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/auv1/fix", fix.__msgtype__, typestore=store)
        for n in range(count):
            stamp = types["builtin_interfaces/msg/Time"](sec=1_700_000_000 + n, nanosec=0)
            message = fix(
                header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="gps"),
                status=types["sensor_msgs/msg/NavSatStatus"](status=0, service=1),
                latitude=43.0 + 1e-5 * n, longitude=5.9, altitude=-3.0,
                position_covariance=np.zeros(9), position_covariance_type=0,
            )  # fmt: skip
            written = store.serialize_cdr(message, fix.__msgtype__)
            writer.write(connection, (1_700_000_000 + n) * 10**9, written)
    return folder / "bag"


def fleet(folder: Path, **more: object) -> Path:
    nodes = [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}]
    section = {"nodes": nodes, "streams": [{**TOPIC, **more}]}
    path = folder / "fleet.json5"
    path.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    return path


def test_its_messages_are_samples_of_the_topic(tmp_path: Path) -> None:
    config = read_fleet(fleet(tmp_path, ros={"stamp": "age"}, codec="packed"))
    folder = bag(tmp_path)
    for path in (folder, next(folder.glob("*.mcap"))):
        found = read_recordings(
            [str(path)], config.table, only_dense=False, window_s=10.0, ros=config.ros
        )
        (mission,) = found.missions
        assert len(mission.samples) == 20
        assert mission.samples[3][0] == 3.0
        assert mission.samples[3][2]["latitude"] == pytest.approx(43.00003)


def test_what_cannot_be_read_is_said_why(tmp_path: Path) -> None:
    config = read_fleet(fleet(tmp_path, topic="auv1/fix"))
    with pytest.raises(ConfigError, match="20 messages: CDR, and the topic has no `ros`"):
        read_recordings(
            [str(bag(tmp_path))], config.table, only_dense=False, window_s=10.0, ros=config.ros
        )
    with pytest.raises(ConfigError, match=r"a folder without \.mcap"):
        read_recordings([str(tmp_path)], config.table, only_dense=False, window_s=10.0)
