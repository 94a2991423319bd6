"""What the package says fits together, and fits the gateway; ROS need not be there."""

import ast
import importlib.util
import json
import re
import runpy
import sys
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any, Final
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

from tests.bringup.conftest import PACKAGE
from tests.bringup.rosstandin import (
    DeclareLaunchArgument,
    ExecuteProcess,
    LaunchConfiguration,
    LaunchNode,
)
from zacoustic.app.cli import parse
from zacoustic.config import Config, read_config
from zacoustic.ros.streams import RosService

NAME: Final = "zacoustic_bringup"
FLEET: Final = PACKAGE / "config" / "fleet.json5"
SOURCES: Final = sorted(PACKAGE.rglob("*.py"))
_TOPIC: Final = re.compile(r"/auv1/[a-z_/]+")


def yaml(path: Path) -> Any:
    return YAML(typ="safe").load(StringIO(path.read_text(encoding="utf-8")))


def parameters() -> dict[str, Any]:
    (node,) = yaml(PACKAGE / "config" / "lost_contact.yaml").values()
    found: dict[str, Any] = node["ros__parameters"]
    return found


def config(address: int = 2) -> Config:
    return read_config(FLEET, address=address)


def fields(node: ElementTree.Element, name: str) -> list[str]:
    return [each.text or "" for each in node.iter(name)]


@pytest.fixture
def setup(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run setup.py, and return what it tells setuptools."""
    said: dict[str, Any] = {}
    tools = ModuleType("setuptools")
    tools.__dict__["setup"] = lambda **given: said.update(given)
    monkeypatch.setitem(sys.modules, "setuptools", tools)
    monkeypatch.chdir(PACKAGE)
    runpy.run_path(str(PACKAGE / "setup.py"))
    return said


def test_it_is_a_package_of_ament(setup: dict[str, Any]) -> None:
    root = ElementTree.parse(PACKAGE / "package.xml").getroot()
    assert root.get("format") == "3"
    assert fields(root, "name") == [NAME] == [setup["name"]]
    assert fields(root, "version") == [setup["version"]]
    assert fields(root, "license") == [setup["license"]]
    assert fields(root, "build_type") == ["ament_python"]
    marker = f"resource/{NAME}"
    assert (PACKAGE / marker).is_file()
    assert ("share/ament_index/resource_index/packages", [marker]) in setup["data_files"]
    installed = [PACKAGE / each for _, files in setup["data_files"] for each in files]
    assert all(each.is_file() for each in installed)
    shipped = {
        path
        for path in PACKAGE.rglob("*")
        if path.parent.name in ("launch", "config", "layouts") and path.is_file()
    }
    assert shipped <= {*installed}
    places = re.findall(r"\$base/lib/(\w+)", (PACKAGE / "setup.cfg").read_text(encoding="utf-8"))
    assert places == [NAME, NAME]


def test_it_depends_on_all_that_it_imports_and_carries() -> None:
    root = ElementTree.parse(PACKAGE / "package.xml").getroot()
    depends = {*fields(root, "exec_depend")} | {NAME}
    imported = {
        name.partition(".")[0]
        for path in SOURCES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        for name in (
            [node.module or ""] if isinstance(node, ast.ImportFrom)
            else [each.name for each in node.names] if isinstance(node, ast.Import) else []
        )
    } - sys.stdlib_module_names  # fmt: skip
    assert imported - {"setuptools"} - {"yaml"} <= depends
    assert "python3-yaml" in depends
    found = config().ros
    assert found is not None
    for stream in found.streams.values():
        interface = stream.interface
        assert interface.partition("/")[0] in depends


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_its_python_is_that_of_humble(path: Path) -> None:
    ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 10))


def test_both_sides_have_one_table() -> None:
    assert config(1).table.digest == config(2).table.digest


def test_the_gateway_calls_the_node_and_the_node_watches_the_gateway() -> None:
    (action,) = config().lost_contact
    assert action.key == "auv1/lost_contact"
    assert action.is_ros
    assert action.rule.lost_after_s > 45  # an answer of `Aborting` counts for one loss only
    assert config(1).lost_contact == ()
    assert parameters()["gateway"] == f"/acoustic_gateway_{config().address}"
    ros = config().ros
    assert ros is not None
    names = {
        stream.name
        for stream in config().table
        if isinstance(ros.streams[stream.stream_id], RosService)
    }
    assert names == {"auv1/lost_contact", f"auv1/{parameters()['abort_service']}"}


def launched(side: str) -> Iterator[tuple[Any, dict[str, str | None]]]:
    """Yield the actions of a launch file, with the defaults of its arguments."""
    path = PACKAGE / "launch" / f"{side}.launch.py"
    spec = importlib.util.spec_from_file_location("launched", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    entities = module.generate_launch_description().entities
    declared = {
        each.name: each.default for each in entities if isinstance(each, DeclareLaunchArgument)
    }
    for each in entities:
        if not isinstance(each, DeclareLaunchArgument):
            yield each, declared


def said(value: Any, declared: dict[str, str | None]) -> str:
    if not isinstance(value, LaunchConfiguration):
        return str(value)
    default = declared[value.name]  # an undeclared argument is an error
    return "evologics/serial:/dev/ttyUSB0" if default is None else default


@pytest.mark.parametrize(("side", "address"), [("shore", 1), ("vehicle", 2)])
def test_a_launch_file_starts_a_gateway_that_takes_its_arguments(side: str, address: int) -> None:
    ((process, declared),) = [
        each for each in launched(side) if isinstance(each[0], ExecuteProcess)
    ]
    assert [name for name, default in declared.items() if default is None] == ["link"]
    program, *arguments = [said(each, declared) for each in process.cmd]
    assert program == "zacoustic"
    verb, parsed = parse(arguments)
    assert verb.name == "gateway"
    assert (parsed.address, parsed.file) == (address, str(FLEET))
    assert Path(parsed.journal).is_absolute()
    assert process.environment == {"PYTHONPATH": ""}
    assert process.respawn


@pytest.mark.parametrize("side", ["shore", "vehicle"])
def test_a_launch_file_starts_nodes_that_are_there(side: str, setup: dict[str, Any]) -> None:
    scripts = [each.partition(" = ") for each in setup["entry_points"]["console_scripts"]]
    own = {name: importlib.import_module(place.partition(":")[0]) for name, _, place in scripts}
    assert all(callable(module.main) for module in own.values())
    nodes = [(each, declared) for each, declared in launched(side) if isinstance(each, LaunchNode)]
    for node, declared in nodes:
        if node.package == NAME:
            assert node.executable in own
            assert said(node.namespace, declared) == "auv1"
            (given,) = node.parameters
            assert said(given, declared) == str(PACKAGE / "config" / "lost_contact.yaml")
        if node.condition is not None:
            assert said(node.condition.predicate, declared) in ("true", "false")
    found = [node.executable for node, _ in nodes]
    assert (
        found == {"shore": ["rmw_zenohd", "rviz2"], "vehicle": ["rmw_zenohd", "lost_contact"]}[side]
    )
    assert all(node.respawn for node, _ in nodes if node.executable != "rviz2")


def streams() -> dict[str, str]:
    ros = config().ros
    assert ros is not None
    return {f"/{each.name}": ros.streams[each.stream_id].interface for each in config().table}


def test_rviz_shows_topics_that_come_up() -> None:
    displays = yaml(PACKAGE / "layouts" / "shore.rviz")["Visualization Manager"]["Displays"]
    shown = {
        each["Class"].rpartition("/")[2]: each["Topic"]["Value"]
        for each in displays
        if "Topic" in each
    }
    expected = {"Odometry": "nav_msgs/msg/Odometry", "Image": "sensor_msgs/msg/CompressedImage"}
    assert {kind: streams()[topic] for kind, topic in shown.items()} == expected


def test_foxglove_shows_panels_of_what_crosses() -> None:
    layout = json.loads((PACKAGE / "layouts" / "shore.foxglove.json").read_text(encoding="utf-8"))

    def panels(part: Any) -> list[str]:
        return (
            [part] if isinstance(part, str) else [*panels(part["first"]), *panels(part["second"])]
        )

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])
    shown = {*_TOPIC.findall(json.dumps(layout["configById"]))}
    assert shown <= {*streams()}
    topics = {name for name, kind in streams().items() if "/msg/" in kind}
    assert shown >= topics
