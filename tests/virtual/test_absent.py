"""A node that has crashed costs little, and gets all soon when it is back."""

import math
from collections.abc import Callable, Collection
from statistics import mean

import pytest

from tests.virtual.absent import EVERYTHING, Kind, Outcome, run
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access.spec import AccessSpec, AlohaSpec, PollingSpec, TdmaSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

DEAF = Modem(senses_carrier=False)


def outcomes(count: Callable[[int], int], kinds: Collection[Kind]) -> list[Outcome]:
    return [run(seed, kinds) for seed in range(count(500))]


def p95(values: list[float]) -> float:
    return sorted(values)[math.ceil(0.95 * len(values)) - 1]


def test_one_of_everything_costs_little_more_than_one_of_anything(
    count: Callable[[int], int],
) -> None:
    all_of_them = outcomes(count, EVERYTHING)
    assert mean(each.frames for each in all_of_them) <= 40
    assert mean(each.airtime_s for each in all_of_them) <= 30
    small = [at_s for each in all_of_them for at_s in _arrivals(each)]
    assert p95(small) <= 60
    assert max(at_s for each in all_of_them for at_s in each.arrived_s.values()) < 240


@pytest.mark.parametrize(
    ("kind", "frames"),
    [
        (Kind.SAMPLE, 18.4),
        (Kind.CALL, 18.3),
        (Kind.GOAL, 18.3),
        (Kind.COMMAND, 19.0),
        (Kind.OBJECT, 40.0),
    ],
)
def test_frames_to_a_crashed_node_are_few(
    count: Callable[[int], int], kind: Kind, frames: float
) -> None:
    alone = outcomes(count, (kind,))
    assert mean(each.frames for each in alone) <= frames
    if kind in (Kind.SAMPLE, Kind.CALL, Kind.GOAL):
        assert p95([at_s for each in alone for at_s in each.arrived_s.values()]) <= 60


def test_emergency_is_there_at_once_whatever_else_waits(count: Callable[[int], int]) -> None:
    for kinds in ((Kind.EMERGENCY,), tuple(Kind)):
        arrived_s = [each.arrived_s[Kind.EMERGENCY] for each in outcomes(count, kinds)]
        assert p95(arrived_s) <= 10


def test_node_with_a_journal_says_that_it_is_back(count: Callable[[int], int]) -> None:
    seeds = range(count(500))
    for kind in (Kind.SAMPLE, Kind.CALL, Kind.GOAL):
        alone = [run(seed, (kind,), announces=True) for seed in seeds]
        assert p95([each.arrived_s[kind] for each in alone]) <= 10
    objects = [run(seed, (Kind.OBJECT,), announces=True) for seed in seeds]
    assert p95([each.arrived_s[Kind.OBJECT] for each in objects]) <= 75
    small = [at_s for seed in seeds for at_s in _arrivals(run(seed, EVERYTHING, announces=True))]
    assert p95(small) <= 60


def test_first_start_and_a_start_without_a_journal_say_nothing() -> None:
    scenario = scenario_from_mapping(
        {"nodes": [{"address": each, "position": [0, 0, 10 * each]} for each in (1, 2)]},
        source="test",
    )
    rules = TransmitRules(contact=ContactRules(announces=True))
    network = VirtualNetwork(scenario, StreamTable([], nodes={1: "a", 2: "b"}), rules=rules)
    network.run(until_s=600.0)
    assert sum(each.frames_transmitted for each in network.stats()) == 0
    network.restart(1)
    network.run(until_s=1200.0)
    assert network.engine(1).stats.frames_transmitted == 1


def test_forged_frame_releases_a_turn_and_has_no_lasting_effect(
    count: Callable[[int], int],
) -> None:
    seeds = range(count(500))
    without = mean(run(seed, EVERYTHING).frames for seed in seeds)
    once = mean(run(seed, EVERYTHING, forged_s=(300.0,)).frames for seed in seeds)
    twice = mean(run(seed, EVERYTHING, forged_s=(300.0, 450.0)).frames for seed in seeds)
    assert once - without <= 3
    assert twice - without <= 6


@pytest.mark.parametrize(
    ("modem", "access"),
    [
        (DEAF, None),
        (DEAF, AlohaSpec()),
        (DEAF, PollingSpec(poller=1, nodes=(2,))),
        (
            DEAF,
            TdmaSpec(slots=(1, 2), slot_s=4.0, clock_error_s=0.01, max_range_m=1500.0),
        ),
    ],
)
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_on_any_medium_all_arrives(
    count: Callable[[int], int], modem: Modem, access: AccessSpec | None, loss: float
) -> None:
    latest_s = []
    for seed in range(count(100)):
        outcome = run(seed, tuple(Kind), loss=loss, modem=modem, access=access)
        latest_s.append(max(outcome.arrived_s.values()))
    # An emergency has used up the day's frames, so a node that says nothing is found by few tries.
    assert sorted(latest_s)[len(latest_s) * 9 // 10] < 1500
    assert max(latest_s) < 6 * 3600


def _arrivals(outcome: Outcome) -> list[float]:
    """Return when small ones arrived; an object takes a minute on the air."""
    return [at_s for kind, at_s in outcome.arrived_s.items() if kind is not Kind.OBJECT]
