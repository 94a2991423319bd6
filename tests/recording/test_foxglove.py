"""What Foxglove's panels show of a recording, by the schemas that Foxglove has published."""

import base64
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import jsonschema
import pytest

from tests.recording.memory import BEGAN_NS, MemorySink, recorded
from tests.recording.test_formats import rows_of
from tests.virtual.fleet import line
from zacoustic.app.cli import main
from zacoustic.core.base.qos import Qos, Reliability, Stamp
from zacoustic.core.linktypes import LinkMetrics, PeerMeasured
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.run.recording.channels import Channel
from zacoustic.run.recording.foxglove import PREFIX, SCHEMAS, TRACK_POSES, FoxgloveWriter
from zacoustic.testing.virtual import VirtualNetwork

FILE: Final = Path(__file__).with_name("foxglove_schemas.json")
PUBLISHED: Final[dict[str, Any]] = {
    each["title"]: each for each in json.loads(FILE.read_text(encoding="utf-8"))["schemas"]
}
JPEG: Final = b"\xff\xd8\xff\xe0" + bytes(60)
NS: Final = 10**9


def number(name: str, **given: Any) -> FieldSpec:
    return FieldSpec(name=name, type=given.pop("type", "float64"), **given)


def type_of(*fields: FieldSpec) -> TypeSpec:
    return TypeTable([TypeSpec(name="T", fields=fields)])["T"]


def all_in(unit: str, *names: str, **given: Any) -> TypeSpec:
    return type_of(*(number(name, unit=unit, **given) for name in names))


class Panels:
    """A writer and what it wrote, each message checked."""

    def __init__(self) -> None:
        self.sink = MemorySink()
        self.writer = FoxgloveWriter(self._put)
        self.kinds: list[str] = []

    def _put(self, channel: Channel, utc_ns: int, data: bytes) -> None:
        check(channel.schema_name, json.loads(data))
        self.kinds.append(channel.schema_name.removeprefix("foxglove."))
        self.sink.put(channel, utc_ns, data)

    def show(self, value: object, spec: TypeSpec | None = None, at_s: int = 1) -> list[str]:
        """Write a value of node 2; return the kinds of what came of it."""
        self.kinds.clear()
        self.writer.value("/k", value, at_s * NS, made_ns=at_s * NS, node=2, spec=spec)
        return [*self.kinds]

    def last(self, ending: str) -> Any:
        return json.loads(self.sink.of(ending)[-1].data)


def check(name: str, message: Any) -> None:
    """Check a message by its published schema, which has all of its members."""
    jsonschema.Draft202012Validator(PUBLISHED[name]).validate(message)
    assert set(message) <= set(PUBLISHED[name]["properties"])


def parts(schema: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Yield the place and the type of each part of a schema."""
    if "type" in schema:
        yield place, schema["type"]
    for name, part in schema.get("properties", {}).items():
        yield from parts(part, f"{place}.{name}")
    if "items" in schema:
        yield from parts(schema["items"], f"{place}[]")


@pytest.mark.parametrize("name", SCHEMAS)
def test_our_schema_is_a_part_of_the_published_one(name: str) -> None:
    published = {*parts(PUBLISHED[name])} | {(".position_covariance_type", "integer")}
    assert {*parts(SCHEMAS[name])} <= published
    assert set(PUBLISHED[name]["required"]) <= set(SCHEMAS[name]["properties"])


@pytest.mark.parametrize(
    ("value", "spec", "expected"),
    [
        ({"lat": 43.5, "lon": 5.25, "depth": 12}, None, (43.5, 5.25, -12, None)),
        ({"Latitude": 43.5, "LONGITUDE": 5.25, "alt": 3}, None, (43.5, 5.25, 3, None)),
        ({"lat": 43.5, "lng": 5.25, "heading_deg": 90}, None, (43.5, 5.25, 0, math.pi / 2)),
        ({"fix": {"lat": 43.5, "lon": 5.25}}, None, (43.5, 5.25, 0, None)),
        (
            {"lat": math.radians(43.5), "lon": math.radians(5.25), "heading": 1.0},
            all_in("rad", "lat", "lon", "heading"),
            (43.5, 5.25, 0, 1.0),
        ),
        (
            {"lat": 435000000, "lon": 52500000},
            all_in("degE7", "lat", "lon", type="int32"),
            (43.5, 5.25, 0, None),
        ),
        (
            {"lat": 43.5, "lon": 5.25, "heading": 180},
            type_of(number("lat"), number("lon"), number("heading", range=(0, 360), step=1)),
            (43.5, 5.25, 0, math.pi),
        ),
        ({"lat": 43.5, "lon": 5.25, "heading": 3}, None, (43.5, 5.25, 0, None)),  # in what unit?
    ],
)  # fmt: skip
def test_a_place_is_found_by_its_members(
    value: Any, spec: TypeSpec | None, expected: tuple[float, float, float, float | None]
) -> None:
    panels = Panels()
    assert panels.show(value, spec) == ["LocationFix"]
    found = panels.last("/k/location")
    seen = (found["latitude"], found["longitude"], found["altitude"], found.get("heading"))
    assert seen == tuple(None if each is None else pytest.approx(each) for each in expected)
    assert found["timestamp"] == {"sec": 1, "nsec": 0}
    assert found["frame_id"] == "node_2"


@pytest.mark.parametrize(
    "value",
    [
        None, 5, "text", b"", b"\xff\xd8", {}, {"lat": 1}, {"lat": "1", "lon": "2"},
        {"lat": math.nan, "lon": 1}, {"lat": 10**400, "lon": 1}, {"lat": 91, "lon": 0},
        {"lat": True, "lon": False}, {1: 2}, {"x": 1, "y": 2, "z": 3}, [1, 2],
        {"linear": {"x": 1, "y": 2, "z": 3}}, {"north": 1, "east": math.inf},
        {"position": {"x": 1, "y": 2}},
    ],
)  # fmt: skip
def test_nothing_is_made_of_what_is_no_place(value: object) -> None:
    assert Panels().show(value) == []


@pytest.mark.parametrize(
    ("value", "position", "yaw_deg"),
    [
        ({"north": 3, "east": 4, "depth": 5, "heading_deg": 0}, (4, 3, -5), 90),
        ({"north": 3, "east": 4, "heading_deg": 90}, (4, 3, 0), 0),
        ({"pose": {"pose": {"position": {"x": 1, "y": 2, "z": 3}}}}, (1, 2, 3), 0),
        (
            {"position": {"x": 1, "y": 2, "z": 3}, "orientation": {"x": 0, "y": 0, "z": 1, "w": 0}},
            (1, 2, 3),
            180,
        ),
    ],
)
def test_a_pose_is_found_and_gives_a_track(
    value: Any, position: tuple[float, float, float], yaw_deg: float
) -> None:
    panels = Panels()
    assert panels.show(value) == ["PoseInFrame", "PosesInFrame"]
    pose = panels.last("/k/pose")["pose"]
    assert tuple(pose["position"].values()) == position
    turn = pose["orientation"]
    assert math.degrees(2 * math.atan2(turn["z"], turn["w"])) == pytest.approx(yaw_deg)
    for _ in range(TRACK_POSES + 5):
        panels.show(value)
    track = panels.last("/k/track")
    assert len(track["poses"]) == TRACK_POSES
    assert track["poses"][-1] == pose


@pytest.mark.parametrize(
    ("octets", "form"),
    [
        (JPEG, "jpeg"),
        (b"\x89PNG\r\n\x1a\n" + bytes(9), "png"),
        (b"RIFF\x00\x00\x00\x00WEBPVP8 ", "webp"),
        (b"\x00\x00\x00\x20ftypavif", "avif"),
    ],
)
@pytest.mark.parametrize("is_member", [False, True])
def test_an_image_is_found_by_its_first_bytes(octets: bytes, form: str, is_member: bool) -> None:
    panels = Panels()
    assert panels.show({"a": 1, "data": octets} if is_member else octets) == ["CompressedImage"]
    found = panels.last("/k/image")
    assert (base64.b64decode(found["data"]), found["format"]) == (octets, form)


def test_a_range_is_a_ring_around_the_end_whose_place_is_known() -> None:
    panels = Panels()
    panels.writer.measured_range(1, 2, 1000.0, NS)
    assert panels.kinds == []
    panels.show({"lat": 60.0, "lon": 179.999})
    panels.writer.measured_range(1, 2, 1000.0, NS)
    shape = json.loads(panels.last("/1/range_to_2")["geojson"])
    assert shape["properties"]["name"] == "node 1: 1000 m from node 2"
    ring = shape["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    assert all(-180 <= longitude < 180 for longitude, _ in ring)
    for longitude, latitude in ring:
        north_m = (latitude - 60) * 111_195
        east_m = ((longitude - 179.999 + 180) % 360 - 180) * 111_195 * math.cos(math.radians(60))
        assert math.hypot(north_m, east_m) == pytest.approx(1000, rel=0.01)
    panels.show({"lat": 10, "lon": 20})
    panels.writer.value("/me", {"lat": 1, "lon": 2}, NS, made_ns=NS, node=1)
    panels.writer.measured_range(1, 2, 5.0, NS)
    shape = json.loads(panels.last("/1/range_to_2")["geojson"])
    assert shape["properties"]["name"] == "node 2: 5 m from node 1"
    panels.writer.measured_position(1, 2, 30.0, 40.0, -5.0, NS)
    found = panels.last("/1/position_of_2/location")
    assert found["latitude"] == pytest.approx(1 + 40 / 111_195, abs=1e-7)
    assert found["altitude"] == -5
    assert panels.last("/1/position_of_2/pose")["pose"]["position"] == {"x": 30, "y": 40, "z": -5}


def test_a_recorded_trial_is_on_the_panels_of_both_ends() -> None:
    degrees = {"unit": "deg", "step": 1e-6}
    fields = (
        number("lat", range=(-90, 90), **degrees), number("lon", range=(-180, 180), **degrees),
        number("depth", range=(0, 100), step=0.1), number("heading", range=(0, 360), step=1),
    )  # fmt: skip
    types = TypeTable([TypeSpec(name="Nav", fields=fields)])
    photo = Qos(reliability=Reliability.RELIABLE)
    specs = [
        TopicSpec(stream_id=10, name="auv1/nav", type_name="Nav", qos=Qos(stamp=Stamp.AGE)),
        TopicSpec(stream_id=11, name="auv1/photo", qos=photo),
    ]
    table = StreamTable(specs, types=types, nodes={1: "shore", 2: "auv1"})
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 1500, channel="none"), table, build=recorder.make)
    nav = {"lat": 43.5, "lon": 5.25, "depth": 12.0, "heading": 90.0}
    network.at(5, lambda: network.publish(2, 10, nav))
    network.at(10, lambda: network.publish(2, 11, JPEG * 20))
    metrics = LinkMetrics(propagation_s=1.0)
    measured = PeerMeasured(address=2, metrics=metrics, measured_at=60 * NS)
    network.at(60, lambda: network.engine(1).handle_measurement(measured, 60 * NS))
    network.run(until_s=120)
    recorder.finish()
    shown = [each for each in sink.messages if each.topic.startswith(PREFIX)]
    for each in shown:
        check(sink.channels[each.topic].schema_name, json.loads(each.data))
    assert {each.topic.removeprefix(PREFIX) for each in shown} == {
        "/2/published/auv1/nav/location", "/2/published/auv1/photo/image",
        "/1/received/auv1/nav/location", "/1/received/auv1/photo/image", "/1/range_to_2",
        "/2/range_to_1",
    }  # fmt: skip
    (sent,) = sink.of("/published/auv1/nav/location")
    (heard,) = sink.of("/received/auv1/nav/location")
    assert json.loads(sent.data)["heading"] == pytest.approx(math.pi / 2)
    # By its age it was made when it was published, and not when it arrived.
    stamp = json.loads(heard.data)["timestamp"]
    made_ns = stamp["sec"] * NS + stamp["nsec"]
    assert BEGAN_NS + 5 * NS - NS // 10 <= made_ns <= heard.utc_ns  # an age is in steps of 0.1 s
    assert base64.b64decode(json.loads(sink.of("photo/image")[-1].data)["data"]) == JPEG * 20


def test_a_file_has_them_with_their_schemas(tmp_path: Path) -> None:
    angles = [("lat", 90), ("lon", 180)]
    fields = [
        {"name": name, "type": "float64", "range": [-most, most], "step": 1e-6}
        for name, most in angles
    ]
    section = {
        "address": 1,
        "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
        "types": [{"name": "Nav", "fields": fields}],
        "streams": [{"id": 10, "topic": "auv1/nav", "type": "Nav", "publishers": [2]}],
    }
    traffic = {"node": 2, "topic": "auv1/nav", "every_s": 20, "value": {"lat": 43, "lon": 5}}
    scenario = {
        "config": "fleet.json5",
        "nodes": [{"address": each, "position": [800 * each, 0, 10]} for each in (1, 2)],
        "traffic": [traffic],
    }
    file, channel = tmp_path / "trial.mcap", tmp_path / "channel.json5"
    channel.write_text(json.dumps(scenario), encoding="utf-8")
    fleet = json.dumps({"plugins": {"acoustic": section}})
    (tmp_path / "fleet.json5").write_text(fleet, encoding="utf-8")
    command = ["sim", str(channel), "--until", "100", "--record", str(file)]
    assert main(command) == 0
    found = [row for row in rows_of(file) if row[1].topic.startswith(PREFIX)]
    assert {row[1].topic for row in found} >= {
        f"{PREFIX}/2/published/auv1/nav/location", f"{PREFIX}/1/received/auv1/nav/location"
    }  # fmt: skip
    for schema, described, message in found:
        assert schema is not None
        expected = "LocationFix" if described.topic.endswith("location") else "GeoJSON"
        assert (schema.name, schema.encoding) == (f"foxglove.{expected}", "jsonschema")
        assert described.message_encoding == "json"
        check(schema.name, json.loads(message.data))
