"""`config init` is right the first time: everything crosses, in the planned airtime.

`tests/benchmarks/bench_init.py` does it with live systems; here the survey is made up and the
channel is virtual.
"""

import json
from pathlib import Path

import pytest

from tests.tools.untuned import SYSTEMS, System, survey_of
from zacoustic.app.tools.design.first.traffic import write_traffic
from zacoustic.app.tools.design.first.writing import Side, write_files
from zacoustic.app.tools.design.plan.report import plan
from zacoustic.app.tools.design.sim.simulation import simulate
from zacoustic.channel.profiles import DEFAULT_PROFILE

UNTIL_S = 900.0
ALLOWED = 0.10
"""As the bench has it for live systems; here nobody commands."""
SIDES = (
    Side(address=2, name="auv1", locator="sim/127.0.0.1:7000"),
    Side(address=1, name="shore", locator="sim/127.0.0.1:7000"),
)


@pytest.mark.parametrize("system", SYSTEMS, ids=lambda system: system.name)
def test_the_first_file_carries_every_topic_in_the_planned_airtime(
    system: System, tmp_path: Path
) -> None:
    here, there = SIDES
    files = write_files(survey_of(system), here=here, there=there)
    assert "EDIT:" not in files.text
    path = tmp_path / "auv1.json5"
    path.write_text(files.text, encoding="utf-8")
    seen = tmp_path / "traffic.json5"
    seen.write_text(
        write_traffic(files, here=here, there=there, config=path.name, profile=DEFAULT_PROFILE),
        encoding="utf-8",
    )
    planned = plan(seen, hours=0.25)
    assert planned.fits, planned.misfits
    own = [topic for topic in system.topics if not topic.is_ordered]
    traffic = [
        {
            "node": 2,
            "topic": topic.name,
            "every_s": topic.every_s,
            "first_s": round(0.37 * number % topic.every_s, 3),
            **_said(topic.value(5)),
        }
        for number, topic in enumerate(own)
    ]
    scenario = {
        "config": path.name,
        "nodes": [{"address": 1, "name": "shore", "position": [0, 0, 10]},
                  {"address": 2, "name": "auv1", "position": [1000, 0, 30]}],
        "traffic": traffic,
    }  # fmt: skip
    run = tmp_path / "water.json5"
    run.write_text(json.dumps(scenario), encoding="utf-8")
    measured = simulate(run, seed=7, until_s=UNTIL_S)
    arrived = {stream.name for stream in measured.streams if stream.delivered}
    assert arrived == {topic.name for topic in own}
    off = planned.utilisation * measured.until_s / measured.airtime_s - 1
    assert abs(off) <= ALLOWED, f"planned {off:+.1%} beside what was measured"


def _said(value: object) -> dict[str, object]:
    return {"size_bytes": len(value)} if isinstance(value, bytes) else {"value": value}
