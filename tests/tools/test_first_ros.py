"""The first configuration of a real ROS 2: what its tokens say, and values with dirty padding."""

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh

from tests.tools import ros2network
from zacoustic.app.cli import main
from zacoustic.app.tools.demo.networks import free_ports
from zacoustic.app.tools.design.first.guessing import quantity_of
from zacoustic.app.tools.design.first.survey import survey_network
from zacoustic.app.tools.design.first.writing import Files, Side, write_files
from zacoustic.config import Config, config_from_mapping
from zacoustic.config.json5 import parse_json5
from zacoustic.core.base.qos import Durability, Reliability
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ros2network.write_definitions(tmp_path_factory.mktemp("packages"))


@pytest.fixture(scope="module")
def both(packages: Path) -> Files:
    vessel, ship = (ros2network.survey(of_ship=of_ship) for of_ship in (False, True))
    return write_files(vessel, peer=ship, packages=packages)


def topics(config: Config) -> dict[str, TopicSpec]:
    return {each.name: each.spec for each in config.table if isinstance(each.spec, TopicSpec)}


def servers(config: Config) -> dict[str, int]:
    specs = [each.spec for each in config.table]
    return {each.name: each.server for each in specs if isinstance(each, ServiceSpec | ActionSpec)}


def test_the_distribution_is_that_whose_hashes_the_network_has(both: Files) -> None:
    assert both.config.ros is not None
    assert both.config.ros.distro in (
        "jazzy",
        "kilted",
        "lyrical",
    )  # as kilted, as far as these types go
    assert both.config.ros.domain == 0
    assert any("ROS domain 3" in reason for reason in both.left_out)


def test_each_side_publishes_what_it_published(both: Files) -> None:
    found = topics(both.config)
    assert found["auv1/fix"].publishers == (1,)
    assert found["auv1/cmd_vel"].publishers == (2,)
    assert found["auv1/plan"].publishers == (2,)
    # Its publisher said nothing, or it is subscribed alone.
    assert found["auv1/q/manual"].publishers == (1,)
    assert found["auv1/payload/gain"].publishers == (2,)


def test_services_and_actions_are_of_the_side_that_serves_them(both: Files) -> None:
    found = servers(both.config)
    assert found["auv1/arm"] == found["auv1/ping"] == found["auv1/survey"] == 1
    # What the operator calls is a part of the system, although each node has it.
    assert found["auv1/vehicle/set_parameters"] == 1
    assert "auv1/nav/pilot/get_parameters" not in found
    assert "auv1/none" not in found
    assert "/auv1/none: somebody calls it, and nobody serves it" in both.left_out
    (action,) = [each.spec for each in both.config.table if isinstance(each.spec, ActionSpec)]
    assert action.name == "auv1/survey"
    assert not [name for name in {*topics(both.config), *found} if "_action" in name]
    assert not [name for name in topics(both.config) if name.endswith("_service_event")]


def test_the_other_sides_services_are_seen_by_their_clients() -> None:
    """Who listens to the ship alone sees whom it calls; they are on the vessel."""
    files = write_files(ros2network.survey(of_ship=True))
    found = servers(files.config)
    assert found["auv1/arm"] == found["auv1/ping"] == 2
    published = topics(files.config)
    assert published["auv1/cmd_vel"].publishers == (1,)
    assert published["auv1/fix"].publishers == (2,)
    assert published["auv1/log10"].qos.durability is Durability.TRANSIENT_LOCAL


def test_latched_topics_stay_latched_with_the_depth_of_their_publishers(both: Files) -> None:
    found = topics(both.config)
    for name, depth in (("auv1/mode", 1), ("auv1/log10", 10), ("auv1/latched_be", 3)):
        qos = found[name].qos
        assert (qos.durability, qos.depth) == (Durability.TRANSIENT_LOCAL, depth)
        assert qos.reliability is Reliability.RELIABLE
        assert qos.lifespan_s is None  # it is old, and true
    assert found["auv1/text"].qos.durability is Durability.VOLATILE


def test_a_silent_network_has_the_same_topics_and_services(both: Files, packages: Path) -> None:
    silent = write_files(
        ros2network.survey(of_ship=False, silent=True),
        peer=ros2network.survey(of_ship=True, silent=True),
        packages=packages,
    )
    assert {each.name for each in silent.config.table} == {each.name for each in both.config.table}
    publishers = {name: spec.publishers for name, spec in topics(silent.config).items()}
    assert publishers == {name: spec.publishers for name, spec in topics(both.config).items()}


def test_types_that_do_not_ship_are_named_and_taken_from_a_folder(both: Files) -> None:
    files = write_files(ros2network.survey(of_ship=False))
    assert "auv1/t/strings" not in topics(files.config)
    reason = "/auv1/t/strings: the definition of test_msgs/msg/Strings is not here"
    assert any(each.startswith(reason) for each in files.left_out)
    assert "auv1/t/strings" in topics(both.config)


def test_every_value_that_was_seen_crosses(both: Files) -> None:
    """Padding is not zero, and rules of one type must not refuse values inside of another."""
    refused = [reason for reason in both.left_out if "would be refused" in reason]
    assert [each for each in refused if "diagnostic" not in each] == []
    assert {each.seen.samples > 0 for each in both.drafts if each.name == "/auv1/odom"} == {True}


def test_both_files_are_read_with_the_packages_where_they_lie(tmp_path: Path) -> None:
    ros2network.write_definitions(tmp_path / "definitions")
    here = Side(address=1, name="auv1", folder=tmp_path)
    there = Side(address=2, name="ship", folder=tmp_path / "ship")
    there.folder.mkdir()
    files = write_files(
        ros2network.survey(of_ship=False), here=here, there=there,
        packages=tmp_path / "definitions",
    )  # fmt: skip
    digests = set()
    for side, text in ((here, files.text), (there, files.peer_text)):
        whole: Any = parse_json5(text, source="file")
        section = whole["plugins"]["acoustic"]
        read = config_from_mapping(section, source="file", folder=side.folder)
        digests.add(read.table.digest)
    assert len(digests) == 1


def stamped(survey_ns: int | None, **replaced: Any) -> str:
    survey = ros2network.survey(of_ship=False)
    survey = msgspec.structs.replace(survey, ended_utc_ns=survey_ns, **replaced)
    return next(
        line
        for line in write_files(survey).text.splitlines()
        if 'topic: "/auv1/fix"' in line
    )  # fmt: skip


def test_a_stamp_that_is_no_time_of_day_crosses_as_it_is() -> None:
    """Stamps of a simulation, or of a node that sets none, have no age."""
    assert 'ros: { stamp: "age" }' in stamped(None)
    assert "ros: {} }" in stamped(1 << 62)


@pytest.mark.parametrize(
    ("name", "values", "unit"),
    [
        ("angular_velocity_z", [0.01, -0.2], "rad/s"),
        ("angular_velocity_z", [0.0, 0.0], "rad/s"),
        ("angular_x", [0.0], "rad/s"),
        ("yaw_rate", [0.1], "rad/s"),
        ("yaw_rate", [-12.0, 3.0], "deg/s"),
        ("rollspeed", [0.01], "rad/s"),
        ("linear_acceleration_x", [9.81], "m/s^2"),
        ("acceleration_linear_x", [0.5], "m/s^2"),
        ("linear_x", [0.5], "m/s"),
        ("position_x", [10.0], "m"),
    ],
)
def test_units_of_motion(name: str, values: list[float], unit: str) -> None:
    found = quantity_of(name, values)
    assert found is not None
    assert found.unit == unit


@pytest.mark.parametrize(
    ("name", "values"),
    [("magnetic_field_x", [3e-5, 2e-5]), ("force_x", [12.0]), ("angular_acceleration_x", [0.1])],
)
def test_axes_of_what_is_no_place_have_no_metres(name: str, values: list[float]) -> None:
    assert quantity_of(name, values) is None


def test_a_step_is_never_coarser_than_the_values() -> None:
    assert quantity_of("depth", [0.001, 0.004]) is None
    assert quantity_of("rotation_x", [0.0, 0.7]) == quantity_of("orientation_x", [0.0])


@pytest.fixture
def vessel() -> Iterator[str]:
    """A router of the vessel: tokens, a latched topic, one at 50 Hz; gives its endpoint."""
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    settings = {
        "mode": "router",
        "listen": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},
        "adminspace": {"enabled": True},
    }
    seen = ros2network.samples(of_ship=False)
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        kept = [
            session.liveliness().declare_token(key) for key in ros2network.tokens(of_ship=False)
        ]
        latched = next(key for key in seen if key.startswith("0/auv1/log10/"))
        publisher = zenoh.ext.declare_advanced_publisher(
            session, latched, cache=zenoh.ext.CacheConfig(max_samples=10), publisher_detection=True
        )
        for _, payload in seen[latched]:
            publisher.put(payload)
        ended = threading.Event()
        fix = next(key for key in seen if key.startswith("0/auv1/fix/"))

        def publish() -> None:
            while not ended.wait(0.02):
                session.put(fix, seen[fix][0][1])

        thread = threading.Thread(target=publish)
        thread.start()
        yield endpoint
        ended.set()
        thread.join()
        del kept


def test_what_was_latched_before_is_asked_for(vessel: str) -> None:
    survey = survey_network(vessel, listen_s=0.4)
    log = next(each for each in survey.topics if each.key.startswith("0/auv1/log10/"))
    assert (log.samples, log.kept) == (0, len(log.payloads))
    assert log.kept > 1
    found = topics(write_files(survey).config)
    assert found["auv1/log10"].qos.depth == 10
    assert survey.has_router


def test_the_port_on_which_this_side_listens_is_not_the_other_sides(
    vessel: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = write_files(ros2network.survey(of_ship=False))
    assert 'listen: { endpoints: ["tcp/127.0.0.1:7448"] }' in files.peer_text
    peer = write_files(ros2network.survey(of_ship=False), peer=ros2network.survey(of_ship=True))
    assert 'mode: "client"' in peer.peer_text
    assert 'connect: { endpoints: ["tcp/10.0.0.2:7447"] }' in peer.peer_text
    monkeypatch.chdir(tmp_path)
    words = ["config", "init", "--connect", vessel, "--listen-s", "0.3"]
    assert main([*words, "--output", "auv1.json5", "--peer", "ship.json5"]) == 0
    for name in ("auv1.json5", "ship.json5"):
        assert main(["config", "check", name]) == 0
