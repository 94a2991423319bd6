"""Schedules from distances: short tours, slots that are shared where nobody hears both."""

import itertools
import json
import math
import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.app.cli import main
from zacoustic.app.tools.design.schedule import ScheduleWish, distance_of, make_schedule
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.config import read_config
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.access import ScheduleSpec
from zacoustic.testing.virtual import Modem

LINK: LinkCapabilities = Modem().capabilities(profile_named(DEFAULT_PROFILE), 1.0)
Place = tuple[float, float, float]
PLACES = st.lists(
    st.tuples(*[st.integers(-3000, 3000).map(float)] * 3), min_size=1, max_size=7, unique=True
)


def schedule(places: list[Place], **settings: object) -> ScheduleSpec:
    positions = dict(enumerate(places, 1))
    wish = {"frames": dict.fromkeys(positions, 1), "clock_error_s": 0.0} | settings
    return make_schedule(ScheduleWish(**wish), distance_of(positions), LINK)  # type: ignore[arg-type]


@given(PLACES)
def test_every_node_has_one_slot_and_each_guard_reaches_the_next(places: list[Place]) -> None:
    slots = schedule(places, open_slots=0).slots
    assert sorted(slot.owners for slot in slots) == [(each,) for each in range(1, len(places) + 1)]
    for slot, following in zip(slots, (*slots[1:], slots[0]), strict=True):
        apart_m = math.dist(places[slot.owners[0] - 1], places[following.owners[0] - 1])
        assert apart_m <= slot.range_m <= apart_m + 1


def test_the_order_is_near_that_of_the_shortest_tour() -> None:
    rng = random.Random(1)
    longer = []
    for _ in range(30):
        places = [(rng.uniform(0, 3000), rng.uniform(0, 3000), 10.0) for _ in range(7)]
        found_m = sum(slot.range_m for slot in schedule(places, open_slots=0).slots)
        best_m = min(
            sum(math.dist(a, b) for a, b in zip(tour, (*tour[1:], tour[0]), strict=True))
            for rest in itertools.permutations(places[1:])
            for tour in [(places[0], *rest)]
        )
        longer.append(found_m / best_m)
    assert sum(longer) / len(longer) < 1.03


def test_nodes_that_nobody_hears_together_share_a_slot() -> None:
    places = [(0.0, 0.0, 0.0), (800.0, 0.0, 0.0), (9000.0, 0.0, 0.0), (9800.0, 0.0, 0.0)]
    shared = schedule(places, open_slots=0, hearing_m=1000.0)
    assert sorted(slot.owners for slot in shared.slots) == [(1, 3), (2, 4)]
    # Node 2 would hear both 1 and 3.
    close = [(0.0, 0.0, 0.0), (900.0, 0.0, 0.0), (1800.0, 0.0, 0.0)]
    assert len(schedule(close, open_slots=0, hearing_m=1000.0).slots) == 3


def test_nodes_that_move_get_wider_guards() -> None:
    places = [(0.0, 0.0, 0.0), (1000.0, 0.0, 0.0)]
    assert [slot.range_m for slot in schedule(places, open_slots=0, drift_m=50).slots] == [1100] * 2


SCENARIO = {
    "nodes": [{"address": address, "position": [300 * address, 0, 10]} for address in (1, 2, 3, 4)],
    "traffic": [
        {"node": 2, "topic": "t", "every_s": 20, "size_bytes": 20},
        {"node": 3, "topic": "t", "every_s": 6, "size_bytes": 40},
    ],
}
CONFIG = """{ mode: "client", connect: { endpoints: ["tcp/localhost:1"] }, plugins: { acoustic: {
  address: 1, nodes: [ %s ], links: [ { locator: "sim/127.0.0.1:7000", access: %s } ],
  streams: [ { id: 1, topic: "t" } ] } } }"""


def test_plan_prints_a_schedule_that_a_config_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = tmp_path / "scenario.json5"
    scenario.write_text(json.dumps(SCENARIO))
    arguments = ["plan", str(scenario), "--schedule", "--clock", "2", "--hours", "0.5"]
    assert main(arguments) == 0
    table = capsys.readouterr().out.split("\naccess: ", 1)[1]
    assert main([*arguments, "--json"]) == 0
    made = json.loads(capsys.readouterr().out)["schedule"]
    frames = {tuple(slot["owners"]): slot["for_s"] for slot in made["access"]["slots"]}
    assert frames[3,] > 2 * frames[1,]  # it has ten times as much to say
    assert made["cycle_s"] < made["uniform_s"]
    config = tmp_path / "fleet.json5"
    nodes = ", ".join(f'{{ address: {each}, name: "n{each}" }}' for each in (1, 2, 3, 4))
    config.write_text(CONFIG % (nodes, table))
    access = read_config(config).rules.access
    assert isinstance(access, ScheduleSpec)
    assert access.cycle_s == pytest.approx(made["cycle_s"])
    assert access.clock == 2


def test_settings_of_a_schedule_need_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "plan", "scenario.json5", "--drift", "10"]) == 2
    assert "--schedule" in capsys.readouterr().err
