"""`wire: "rmw_desert"` in the configuration: what it refuses, and its own file of topics."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.core.rmw_desert.vectors import read_vectors
from zacoustic.config import Config, config_from_mapping, read_config
from zacoustic.core.profiles.entities import DiscoverySpec
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.errors import ConfigError

PAGE = Path(__file__).parents[2] / "docs" / "rmw_desert.md"
EXAMPLE = Path(__file__).parents[2] / "examples" / "09_rmw_desert.json5"
TOPICS = {"/discovery": 1, "/discovery_request": 2, "/pose": 3, "/off": 0, "/set": 255}
SECTION: dict[str, Any] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore-1"}, {"address": 2, "name": "auv1"}],
    "links": [{"locator": "desert/127.0.0.1:4000", "wire": "rmw_desert"}],
    "types": [
        {"name": "Pose", "fields": [{"name": "x", "type": "float32"}]},
        {"name": "Empty", "fields": []},
    ],
    "streams": [
        {"id": 3, "topic": "pose", "type": "Pose"},
        {"id": 255, "service": "set", "request": "Pose", "response": "Empty", "server": 2},
    ],
}


def section(path: str = "", value: object = None) -> dict[str, Any]:
    """The section with another value at a path such as `streams.0.id`; None: without it."""
    changed: dict[str, Any] = json.loads(json.dumps(SECTION))
    if path:
        *steps, last = path.split(".")
        place: Any = changed
        for step in steps:
            place = place[int(step)] if step.isdigit() else place[step]
        key: Any = int(last) if last.isdigit() else last
        if value is None:
            del place[key]
        else:
            place[key] = value
    return changed


def read(written: dict[str, Any], folder: Path | None = None) -> Config:
    return config_from_mapping(written, source="f", folder=folder)


def refusal(written: dict[str, Any], folder: Path | None = None) -> str:
    with pytest.raises(ConfigError) as caught:
        read(written, folder)
    return str(caught.value)


def test_the_profile_is_read_and_has_ids_up_to_255() -> None:
    config = read(section())
    assert config.table.wire is WireProfile.RMW_DESERT
    assert [stream.stream_id for stream in config.table] == [3, 255]
    assert config.rules.discovery is None
    assert read(section("links.0.wire", "native") | {"streams": []}).table.wire.value == "native"


def test_another_link_given_beside_the_file_speaks_the_same() -> None:
    config = config_from_mapping(section(), source="f", locator="desert/127.0.0.1:5000")
    assert config.table.wire is WireProfile.RMW_DESERT
    assert [(each.locator, each.wire) for each in config.links] == [
        ("desert/127.0.0.1:5000", "rmw_desert")
    ]


REFUSED = (
    ("streams.0.id", 256, '.streams[0].id: 256; allowed: 1..255'),
    ("streams.0.reliability", "reliable", '.streams[0].reliability: "reliable" with wire: "rmw_'),
    ("streams.0.stamp", "age", '.streams[0].stamp: "age" with wire: "rmw_desert"; allowed: none'),
    ("streams.0.forward", "on_demand", '.streams[0].forward: "on_demand" with wire'),
    ("streams.0.codec", "packed", '.streams[0].codec: "packed" with wire: "rmw_desert"; allowed'),
    ("streams.0.codec", "dense", '.streams[0].codec: "dense" with wire: "rmw_desert"; allowed'),
    ("streams.0.topic", "fleet/{node}/pose", '.streams[0].topic: "fleet/{node}/pose" has a place'),
    ("streams.0.type", None, ".streams[0].type: is missing with wire"),
    ("streams.1.request", None, ".streams[1].request: is missing with wire"),
    ("streams.1.response", None, ".streams[1].response: is missing with wire"),
    (
        "streams.1",
        {"id": 9, "action": "goto", "server": 2},
        '.streams[1].action: "goto" with wire: "rmw_desert"; allowed: topic, service (there an',
    ),
    (
        "types.0.fields.0.optional",
        True,
        ".streams[0].type: Pose.x is optional with wire",
    ),
    ("agreement", "tag", '.agreement: "tag" with wire: "rmw_desert": its ends do not compare'),
    ("heartbeat_s", 60, '.heartbeat_s: 60 with wire: "rmw_desert": nothing on it says that a node'),
    ("lost_after_s", 60, ".lost_after_s: 60 with wire"),
    ("nodes.1.lost_after_s", 60, ".nodes[1].lost_after_s: 60 with wire"),
    ("commands_from", [2], ".commands_from: [2] with wire"),
    (
        "lost_contact",
        [{"name": "up", "lost_after_s": 9, "call": "up"}],
        '.lost_contact: [{"name": "up", "lost_after_s": 9, "call": "up"}] with wire',
    ),
    ("ranging", [{"to": 2, "every_s": 30}], '.ranging: [{"to": 2, "every_s": 30}] with wire'),
    ("objects", {"max_bytes": 1000}, '.objects: {"max_bytes": 1000} with wire'),
    (
        "links.0.access",
        {"method": "polling", "poller": 1, "nodes": [2]},
        '.links[0].access.method: "polling" with wire',
    ),
    (
        "links.0.access",
        {"method": "tdma", "slots": [1, 2], "slot_s": 3, "guard_s": 1, "clock_error_s": 0.01,
         "clock": 1},
        ".links[0].access.clock: 1 with wire",
    ),
    ("links.0.allowed_topics", "missing.conf", ".links[0].allowed_topics: missing.conf: No such"),
)  # fmt: skip


@pytest.mark.parametrize(("path", "value", "text"), REFUSED)
def test_what_has_no_counterpart_is_refused_by_its_key(
    path: str, value: object, text: str, tmp_path: Path
) -> None:
    message = refusal(section(path, value), tmp_path)
    assert message.startswith(f"f: plugins.acoustic{text}")
    assert "\n" not in message


def with_topics(folder: Path, topics: object, **streams: Any) -> dict[str, Any]:
    (folder / "t.conf").write_text(json.dumps({"topics": topics}), encoding="utf-8")
    written = section("links.0.allowed_topics", "t.conf")
    for index, (key, value) in enumerate(streams.items()):
        written["streams"][index][key] = value
    return written


def test_its_file_gives_the_ids_and_those_of_discovery(tmp_path: Path) -> None:
    written = with_topics(tmp_path, TOPICS)
    for stream in written["streams"]:
        del stream["id"]
    config = read(written, tmp_path)
    assert {stream.name: stream.stream_id for stream in config.table} == {"pose": 3, "set": 255}
    assert config.rules.discovery == DiscoverySpec(beacon_id=1, request_id=2, node_name="shore_1")
    without = {name: each for name, each in TOPICS.items() if "discovery" not in name}
    assert read(with_topics(tmp_path, without), tmp_path).rules.discovery == DiscoverySpec(
        node_name="shore_1"
    )


def test_an_id_of_its_own_must_be_that_of_the_file(tmp_path: Path) -> None:
    assert read(with_topics(tmp_path, TOPICS, id=3), tmp_path).table.by_id(3).name == "pose"
    message = refusal(with_topics(tmp_path, TOPICS, id=4), tmp_path)
    assert message == (
        "f: plugins.acoustic.streams[0].id: 4; allowed: 3, as t.conf has it (id can be left out)"
    )
    message = refusal(with_topics(tmp_path, TOPICS, topic="off"), tmp_path)
    assert message.startswith('f: plugins.acoustic.streams[0].topic: "off" is not in t.conf; allo')


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("{", "t.conf: Input data was truncated"),
        ("[]", "t.conf: no table of topics"),
        ('{"topic": {}}', "t.conf: no table of topics"),
        ('{"topics": [1]}', "t.conf: no table of topics"),
        ('{"topics": {"/a": 256}}', "t.conf: /a has id 256; allowed: 1..255, 0 for"),
        ('{"topics": {"/a": -1}}', "t.conf: /a has id -1"),
        ('{"topics": {"/a": "1"}}', 't.conf: /a has id "1"'),
        ('{"topics": {"/a": 1, "/b": 1}}', "t.conf: /b has id 1, which is that of /a"),
        ('{"topics": {"/pose": 3}}\xff', "t.conf: "),
    ],
)
def test_a_file_that_is_wrong_is_refused(content: str, text: str, tmp_path: Path) -> None:
    (tmp_path / "t.conf").write_bytes(content.encode("latin-1"))
    message = refusal(section("links.0.allowed_topics", "t.conf"), tmp_path)
    assert message.startswith(f"f: plugins.acoustic.links[0].allowed_topics: {text}")


def test_its_file_is_for_its_wire_only(tmp_path: Path) -> None:
    written = with_topics(tmp_path, TOPICS)
    written["links"][0]["wire"] = "native"
    assert "t.conf without wire" in refusal(written, tmp_path)


def test_the_example_is_valid_and_finds_its_file() -> None:
    config = read_config(EXAMPLE)
    assert {stream.stream_id: stream.name for stream in config.table} == {
        3: "turtle1/pose", 4: "turtle1/cmd_vel", 5: "turtle1/set_pen",
    }  # fmt: skip
    assert config.rules.discovery is not None
    assert config.rules.discovery.beacon_id == 1


def test_the_page_shows_a_valid_file_of_fifteen_lines_at_most(tmp_path: Path) -> None:
    page = PAGE.read_text(encoding="utf-8")
    (written,) = re.findall(r"^```json5\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (topics,) = re.findall(
        r"^```json ros_allowed_topics.conf\n(.*?)^```$", page, re.DOTALL | re.MULTILINE
    )
    (tmp_path / "shore.json5").write_text(written, encoding="utf-8")
    (tmp_path / "ros_allowed_topics.conf").write_text(topics, encoding="utf-8")
    (stream,) = read_config(tmp_path / "shore.json5").table
    assert (stream.stream_id, stream.name) == (4, "turtle1/cmd_vel")
    assert len(written.splitlines()) <= 15


def test_the_sizes_on_the_page_are_those_of_the_packets() -> None:
    page = PAGE.read_text(encoding="utf-8")
    vectors = {vector.name: vector.packet for vector in read_vectors()}
    for text, name in (("NavSatFix` with", "navsatfix"), ("Imu` with", "imu")):
        (size,) = re.findall(rf"{re.escape(text)}.*\| (\d+) \|", page)
        assert int(size) == len(vectors[name])
    assert len(vectors["twist_id4"]) == 26
    assert "26 bytes on the socket" in page
