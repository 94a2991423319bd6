"""Tracks in files: the same as way-points in the scenario, for everything that reads one."""

import csv
import json
from pathlib import Path
from typing import Any, Final

import pytest

from zacoustic.app.cli import main
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.errors import ConfigError

POINTS: Final = [(0, 1000, 0, 50), (60, 1040.5, 20, 52), (300, 1000, -300, 40)]
TRACK: Final = "t,heading,x,y,z\n" + "".join(f"{t},90,{x},{y},{z}\n" for t, x, y, z in POINTS)
SCENARIO: Final = """{
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, track: TRACK } ],
  traffic: [ { node: 2, topic: "a", every_s: 10, size_bytes: 20 } ] }"""
WAYPOINTS: Final = json.dumps([{"t": t, "position": place} for t, *place in POINTS])


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A scenario with a track file."""
    path = tmp_path / "water.json5"
    path.write_text(SCENARIO.replace("TRACK", '"auv.csv"'), encoding="utf-8")
    (tmp_path / "auv.csv").write_text(TRACK, encoding="utf-8")
    return path


def simulated(path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert main(["sim", str(path), "--until", "400", "--json"]) == 0
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    return told


def test_a_track_in_a_file_is_that_of_its_way_points(
    scenario: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_file = simulated(scenario, capsys)
    scenario.write_text(SCENARIO.replace("TRACK", WAYPOINTS), encoding="utf-8")
    assert simulated(scenario, capsys)["digest"] == of_file["digest"]
    scenario.write_text(SCENARIO.replace("TRACK", WAYPOINTS.replace("-300", "900")))
    assert simulated(scenario, capsys)["digest"] != of_file["digest"]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "auv.csv: No such file"),
        ("", "auv.csv:1: the header is nothing; allowed: a line with t, x, y, z"),
        ("t,x,y\n0,1,2\n", "auv.csv:1: the header is 't', 'x', 'y'; allowed"),
        ("t,x,y,z\n", "auv.csv: no line below the header"),
        ("t,x,y,z\n0,1,2,3\n1,1,2\n", "auv.csv:3: z is ''; allowed: a number"),
        ("t,x,y,z\n0,1,nan,3\n", "auv.csv:2: y is 'nan'; allowed: a number"),
        ("t,x,y,z\n0,1,2,3\n0,1,2,3\n", "auv.csv:3: t is 0.0; allowed: above that of the line"),
        ("t,x,y,z\n0,1e9,2,3\n", "water.json5: nodes[1].track[0].position[0] is 1000000000.0"),
        ("t,x,y,z\n0,1,2,3\n1,900,2,3\n", "which makes 899 m/s; allowed: at most 100 m/s"),
        ("\x00\x01\n", "auv.csv:1: the header is"),
    ],
)
@pytest.mark.parametrize("verb", ["sim", "plan", "medium", "emulate"])
def test_a_wrong_track_is_one_line(
    verb: str, content: str | None, expected: str, scenario: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    track = scenario.with_name("auv.csv")
    track.unlink()
    if content is not None:
        track.write_text(content, encoding="utf-8")
    words = {
        "sim": ["sim", str(scenario)],
        "plan": ["config", "plan", str(scenario)],
        "medium": ["run", "medium", str(scenario), "--listen", "127.0.0.1:0"],
        "emulate": [
            "run",
            "modems",
            "evologics",
            "--scenario",
            str(scenario),
            "--listen",
            "127.0.0.1:0",
        ],
    }
    assert main(words[verb]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1


def test_who_gives_no_folder_can_name_no_file() -> None:
    mapping = {"nodes": [{"address": 1, "track": "auv.csv"}]}
    with pytest.raises(ConfigError, match=r"nodes\[0\].track is 'auv.csv'; allowed: a list of"):
        scenario_from_mapping(mapping, source="test")


def test_the_logs_of_a_day_of_eighty_vehicles_are_soon_read(tmp_path: Path) -> None:
    """Each with every other, way-point by way-point, would be billions of distances: no end."""
    for address in range(1, 81):
        with (tmp_path / f"{address}.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("t", "x", "y", "z"))
            writer.writerows((60 * i, address * 10 + i % 300, i, 20) for i in range(1440))
    nodes = [{"address": each, "track": f"{each}.csv"} for each in range(1, 81)]
    scenario = scenario_from_mapping({"nodes": nodes}, source="test", folder=tmp_path)
    assert scenario.farthest_s * 1500.0 == pytest.approx(((790 + 299) ** 2 + 1439**2) ** 0.5)
