"""A plan says what takes longer than its period, what it costs, and where moving nodes go."""

import json
from pathlib import Path

import pytest

from zacoustic.app.cli import main
from zacoustic.app.tools.design.plan.report import PlanReport, plan
from zacoustic.app.tools.design.schedule import ScheduleOptions

LINK = '{ locator: "sim/127.0.0.1:7000" }'
CONFIG = """{ plugins: { acoustic: { address: 1, links: [ LINK ],
  nodes: [ { address: 1, name: "buoy" }, { address: 2, name: "auv1" } ],
  streams: [ { id: 21, topic: "tile", publishers: [2], subscribers: [1],
               reliability: "reliable", priority: "background" } ] } } }"""
SCENE = """{ config: "fleet.json5", profile: "evologics_s2c_18_34",
  nodes: [ { address: 1, position: [0, 0, 5] },
           { address: 2, track: [ { t: 0, position: [100, 0, 20] },
                                  { t: 1200, position: [FAR, 0, 20] } ] } ],
  traffic: [ { node: 2, topic: "tile", every_s: EVERY, first_s: 10, size_bytes: 3000 } ] }"""


def fleet(folder: Path, *, every_s: float, link: str = LINK, far_m: float = 900.0) -> Path:
    (folder / "fleet.json5").write_text(CONFIG.replace("LINK", link))
    path = folder / "water.json5"
    path.write_text(SCENE.replace("FAR", str(far_m)).replace("EVERY", str(every_s)))
    return path


def planned(folder: Path, every_s: float) -> PlanReport:
    return plan(fleet(folder, every_s=every_s), hours=0.5)


def test_what_takes_longer_than_its_period_does_not_fit(tmp_path: Path) -> None:
    assert planned(tmp_path, 900.0).fits
    found = planned(tmp_path, 20.0)
    assert not found.fits
    assert any("takes " in each and "after 20 s" in each for each in found.misfits)


def test_the_price_of_the_only_link_is_named_by_plan_and_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    link = '{ name: "sat", locator: "sim/127.0.0.1:7000", cost: { per_byte: 0.01, quantum: 50 } }'
    path = fleet(tmp_path, every_s=900.0, link=link)
    (sat,) = plan(path, hours=0.5).links
    assert sat.name == "sat"
    assert sat.paid_per_day is not None
    assert sat.paid_per_day > 0
    config = tmp_path / "fleet.json5"
    text = config.read_text().replace(
        'id: 21, topic: "tile",', 'id: 21, topic: "tile", type: "Tile",'
    )
    kind = '{ name: "Tile", fields: [ { name: "row", type: "uint64", length: 8 } ] }'
    config.write_text(text.replace("streams:", f"types: [ {kind} ], streams:"))
    assert main(["config", "check", str(config), "--json"]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert any("by sat" in each and "times 50" in each for each in notes)


def test_a_schedule_reaches_as_far_as_a_moving_node_goes(tmp_path: Path) -> None:
    found = plan(
        fleet(tmp_path, every_s=900.0, far_m=1400.0), hours=0.5, schedule=ScheduleOptions()
    )
    assert found.schedule is not None
    assert max(slot["range_m"] for slot in found.schedule.access["slots"]) >= 1390
