"""What other programs find in a recording: MCAP, JSON by its schema, CDR by its definition."""

import base64
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.recording.memory import recorded
from tests.recording.test_exact import run_survey, survey
from tests.virtual.fleet import line
from zacoustic.app.cli import main
from zacoustic.app.tools.design.sim.recorder import recorded_to
from zacoustic.config import config_from_mapping
from zacoustic.core.base.qos import Qos
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.run.recording.schemas import as_json, schema_of_type
from zacoustic.testing.virtual import VirtualNetwork

Row = tuple[Schema | None, Channel, Message]


def rows_of(path: Path) -> list[Row]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        rows: list[Row] = list(reader.iter_messages())
        assert summary.statistics.message_count == len(rows)
        assert [row[2].log_time for row in rows] == sorted(row[2].log_time for row in rows)
        return rows


def test_every_json_message_is_as_its_schema_says(trial: Path) -> None:
    topics: dict[str, int] = {}
    validators: dict[int, jsonschema.Draft202012Validator] = {}
    for schema, channel, message in rows_of(trial):
        topics[channel.topic] = topics.get(channel.topic, 0) + 1
        if channel.message_encoding == "json":
            assert schema is not None
            assert schema.encoding == "jsonschema"
            if schema.id not in validators:
                described = json.loads(schema.data)
                assert described["type"] == "object"  # what Foxglove asks for
                jsonschema.Draft202012Validator.check_schema(described)
                validators[schema.id] = jsonschema.Draft202012Validator(described)
            validators[schema.id].validate(json.loads(message.data))
    assert topics["/2/published/auv1/nav"] == 31
    assert 20 <= topics["/1/received/auv1/nav"] <= 30
    assert topics["/1/received/auv1/raw"]
    for name in ("engine", "frames", "reports", "links", "events", "ledger"):
        assert topics[f"/1/{name}"], topics
        assert topics[f"/2/{name}"], topics


def test_values_and_instants_are_those_of_the_trial(trial: Path) -> None:
    rows = rows_of(trial)
    (first, *_) = [row for row in rows if row[1].topic == "/1/received/auv1/nav"]
    schema, channel, message = first
    assert json.loads(message.data) == {"depth": pytest.approx(4.2), "mode": "survey"}
    assert schema is not None
    assert schema.name == "Nav"
    assert json.loads(schema.data)["properties"]["depth"] == {
        "type": "number",
        "description": "m",
    }
    assert channel.metadata == {"stream_id": "10", "stream": "auv1/nav"}
    began = 1_767_225_600 * 10**9  # 2026-01-01, when scenarios begin
    assert began < message.log_time < began + 30 * 10**9
    raws = [json.loads(row[2].data) for row in rows if row[1].topic == "/2/published/auv1/raw"]
    assert {len(base64.b64decode(raw["data"])) for raw in raws} == {10}
    frames = [json.loads(row[2].data) for row in rows if row[1].topic == "/1/frames"]
    heard = [frame for frame in frames if frame["direction"] == "received"]
    assert heard
    assert all(len(base64.b64decode(each["frame"])) == each["size_bytes"] for each in frames)


def test_types_of_every_kind_have_a_schema() -> None:
    inner = TypeSpec(name="In", fields=(FieldSpec(name="t", type="string", max_length=9),))
    outer = TypeSpec(
        name="Out",
        fields=(
            FieldSpec(name="flag", type="bool"),
            FieldSpec(name="count", type="uint16"),
            FieldSpec(name="x", type="float64", optional=True),
            FieldSpec(name="raw", type="bytes", max_length=4),
            FieldSpec(name="kind", type="enum", values=("a", "b")),
            FieldSpec(name="parts", type="In", max_length=3),
            FieldSpec(name="fixed", type="float32", length=2),
        ),
    )
    spec = TypeTable([inner, outer])["Out"]
    schema = json.loads(schema_of_type(spec))
    value: dict[str, Any] = {
        "flag": True, "count": 3, "x": None, "raw": b"\xff", "kind": "b", "parts": [{"t": "é"}],
        "fixed": [1.5, float("nan")],
    }  # fmt: skip
    written = json.loads(as_json(value))
    assert "x" not in written
    assert written["raw"] == "/w=="
    written["fixed"] = [1.5, 2.0]
    jsonschema.validate(written, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**written, "count": "3"}, schema)


def test_topics_of_ros_are_cdr_by_their_definition(tmp_path: Path) -> None:
    stream = {"id": 1, "topic": "/cmd_vel", "type": "geometry_msgs/msg/TwistStamped", "ros": {}}
    config = config_from_mapping({"address": 1, "ros": {}, "streams": [stream]}, source="test")
    assert config.ros is not None
    path = tmp_path / "ros.mcap"
    with recorded_to(path) as recorder:
        assert recorder is not None
        recorder.ros = config.ros.streams
        network = VirtualNetwork(line(0, 500), config.table, build=recorder.make)
        recorder.network = network
        value = {
            "header": {"stamp": {"sec": 5, "nanosec": 6}, "frame_id": "base"},
            "twist": {
                "linear": {"x": 1.5, "y": 0.0, "z": 0.0},
                "angular": {"x": 0.0, "y": 0.0, "z": -0.25},
            },
        }
        network.publish(1, 1, value)
        network.run(until_s=60)
    found = [row for row in rows_of(path) if row[1].topic == "/2/received/cmd_vel"]
    assert len(found) == 1
    schema, channel, message = found[0]
    assert schema is not None
    assert (schema.encoding, schema.name) == ("ros2msg", "geometry_msgs/msg/TwistStamped")
    assert channel.message_encoding == "cdr"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.data.decode(), schema.name))
    read: Any = store.deserialize_cdr(message.data, schema.name)
    assert (read.header.stamp.sec, read.header.frame_id) == (5, "base")
    assert (read.twist.linear.x, read.twist.angular.z) == (1.5, -0.25)


def test_frames_of_a_recording_are_said_in_words(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["decode", str(trial)]) == 0
    said = capsys.readouterr().out
    assert "HELLO version 2" in said
    assert 'auv1/nav, 0 s old: {"depth": 4.2' in said
    assert "heard by node 1" in said
    assert "request of call 0" in said
    assert "does not decode" not in said
    assert "STRAY" not in said
    assert main(["decode", str(trial), "--json", "--source", "1"]) == 0
    frames = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {frame["source"] for frame in frames} == {1}
    assert all(frame["items"] for frame in frames)


def test_dense_strings_and_objects_are_said_in_words(tmp_path: Path) -> None:
    from zacoustic.app.tools.inspect.recordings.replaying.frames import FrameReader

    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800, 1500), survey(), build=recorder.make)
    run_survey(network, until_s=300)
    recorder.finish()
    reader = FrameReader()
    frames = [frame for message in sink.messages for frame in reader.read(message)]
    kinds = {item.kind for frame in frames for item in frame.items}
    assert {"hello", "dense", "sample", "fragment", "feedback", "subscribe", "ack"} & kinds >= {
        "hello", "dense", "sample", "fragment", "subscribe",
    }  # fmt: skip
    sent = [frame for frame in frames if frame.direction == "sent"]
    faults = [item.fault for frame in sent for item in frame.items if item.kind == "dense"]
    assert faults.count("") == len(faults)


def test_modems_without_addresses_and_check_are_opened(tmp_path: Path) -> None:
    from zacoustic.app.tools.inspect.recordings.replaying.frames import FrameReader
    from zacoustic.testing.virtual import Modem

    table = StreamTable([TopicSpec(stream_id=1, name="a", qos=Qos(depth=9))])
    modem = Modem(addressed=False, checked=False, framed=False)
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), table, modem=modem, build=recorder.make)
    network.publish(1, 1, b"hello")
    network.run(until_s=60)
    reader = FrameReader()
    frames = [frame for message in sink.messages for frame in reader.read(message)]
    heard = [frame for frame in frames if frame.direction == "received" and frame.node == 2]
    assert heard
    assert {frame.source for frame in heard} == {1}
    assert [item.text for item in heard[0].items][-1].endswith('"68656c6c6f"')
