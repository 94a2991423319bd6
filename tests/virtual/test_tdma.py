"""TDMA: nothing collides, whatever the geometry inside the guard and whatever the clocks do."""

import math
import random
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import pytest

from tests.conftest import SOAK
from tests.virtual.survey import survey
from zacoustic.app.tools.design.schedule import ScheduleWish, distance_of, make_schedule
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import ClockStateChanged
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import ScheduleSpec, TdmaSpec
from zacoustic.core.schedule.access.spec import SLOWEST_SOUND_M_S
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

FRAME_S = 0.951
LINK = Modem().capabilities(profile_named(DEFAULT_PROFILE), 1.0)


class Fleet:
    """Nodes at random places that talk at random, on a schedule.

    Args:
        seed: Everything follows from it.
        wrong: How many times the stated error the clocks are really off.
        clocks: What is wrong with clocks besides, by node.
        scheduled: The slots are those of a schedule that was made for the places.
        joins: Node 1 has no slot in that schedule: it has just come.
        settings: Replace those of the schedule.
    """

    def __init__(
        self,
        seed: int,
        *,
        wrong: float = 1.0,
        clocks: dict[int, dict[str, Any]] | None = None,
        scheduled: bool = False,
        joins: bool = False,
        **settings: Any,
    ) -> None:
        self.rng = rng = random.Random(seed)
        count = rng.randint(2, 6)
        range_m = rng.choice((200.0, 800.0, 1500.0, 3000.0))
        error_s = rng.choice((0.0, 0.002, 0.02, 0.1))
        self.addresses = range(1, count + 1)
        slots = [rng.choice(self.addresses) for _ in range(rng.randint(0, count))]
        slots += self.addresses
        rng.shuffle(slots)
        guard_s = range_m / SLOWEST_SOUND_M_S + 2 * error_s
        defaults: dict[str, Any] = {
            "slots": tuple(slots),
            "slot_s": rng.randint(1, 3) * FRAME_S + guard_s + 0.01,
            "clock_error_s": error_s,
            "max_range_m": range_m,
        }
        self.spec: TdmaSpec | ScheduleSpec = TdmaSpec(**(defaults | settings))
        stated = {
            node: {
                "node": node,
                "error_s": error_s,
                "offset_s": wrong * error_s * rng.uniform(-1, 1),
                **(clocks or {}).get(node, {}),
            }
            for node in self.addresses
        }
        places = {node: _place(rng, range_m) for node in self.addresses}
        if scheduled:
            own = [node for node in self.addresses if node != 1 or not joins]
            frames = {node: rng.randint(1, 3) for node in own}
            wish = ScheduleWish(frames=frames, clock_error_s=error_s, newcomer_m=range_m)
            self.spec = make_schedule(wish, distance_of(places), LINK)
        scenario = scenario_from_mapping(
            {
                "nodes": [{"address": node, "position": place} for node, place in places.items()],
                "seed": seed,
                "channel": "none",
                "collisions": "protocol",
                "sound_speed_m_s": rng.uniform(1410, 1550),
                "faults": {"clocks": list(stated.values())},
            },
            source="test",
        )
        topics = [
            TopicSpec(stream_id=number, name=f"t{number}", qos=Qos(depth=20))
            for number in range(1, 4)
        ]
        self.sent: list[tuple[float, int]] = []
        self.network = VirtualNetwork(
            scenario,
            StreamTable(topics, nodes={node: f"n{node}" for node in self.addresses}),
            rules=TransmitRules(access=self.spec),
            digest=False,
            trace=self._trace,
        )

    def talk(self, minutes: float) -> None:
        """Let everybody talk for so long."""
        for node in self.addresses:
            self.network.at(self.rng.uniform(0, 10), partial(self._say, node))
        self.network.run(until_s=minutes * 60)

    @property
    def collided(self) -> int:
        """Frames that did not arrive somewhere."""
        return sum(self.network.losses.values())

    def _say(self, node: int) -> None:
        payload = self.rng.randbytes(self.rng.randint(0, 50))
        self.network.publish(node, self.rng.randint(1, 3), payload)
        now_s = self.network.now / NS_PER_S
        self.network.at(now_s + self.rng.expovariate(0.3), partial(self._say, node))

    def _trace(self, record: TraceRecord) -> None:
        if record.what == "transmit":
            self.sent.append((record.at / NS_PER_S, record.node))


def _place(rng: random.Random, range_m: float) -> tuple[float, float, float]:
    """A place in a ball of that diameter."""
    while True:
        place = [rng.uniform(-0.5, 0.5) * range_m for _ in range(3)]
        if math.dist(place, (0, 0, 0)) <= range_m / 2:
            return place[0], place[1], place[2] + range_m / 2


def test_nothing_collides_for_any_geometry_inside_the_guard(count: Callable[[int], int]) -> None:
    for seed in range(count(400)):
        fleet = Fleet(seed)
        fleet.talk(10)
        assert len(fleet.sent) > 20, seed
        assert fleet.collided == 0, seed


def test_nothing_collides_on_a_schedule_for_these_places(count: Callable[[int], int]) -> None:
    for seed in range(count(400)):
        fleet = Fleet(seed, scheduled=True)
        fleet.talk(10)
        assert len(fleet.sent) > 20, seed
        assert fleet.collided == 0, seed


def test_one_that_has_just_come_speaks_in_the_open_slot(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        fleet = Fleet(seed, scheduled=True, joins=True)
        fleet.talk(10)
        assert isinstance(fleet.spec, ScheduleSpec)
        assert fleet.collided == 0, seed
        assert min(at_s for at_s, node in fleet.sent if node == 1) < 10 * fleet.spec.cycle_s + 60


def test_clocks_that_are_worse_than_stated_do_collide() -> None:
    """The test above can see collisions."""

    def collided(seed: int) -> int:
        fleet = Fleet(seed, wrong=15.0)
        fleet.talk(10)
        return fleet.collided

    assert any(map(collided, range(12)))


@pytest.mark.parametrize("drift_ppm", [pytest.param(40.0, marks=pytest.mark.soak), -3000.0])
def test_drifting_clock_that_knows_its_error_mutes_in_time(
    drift_ppm: float, count: Callable[[int], int]
) -> None:
    for seed in range(count(100)):
        # Each host begins right and is told of nothing: what it believes is off grows truly.
        clocks = {2: {"drift_ppm": drift_ppm, "error_s": 0.0, "offset_s": 0.0}}
        fleet = Fleet(seed, clocks=clocks, drift_ppm=abs(drift_ppm))
        fleet.talk(60 if SOAK else 20)
        assert fleet.collided == 0, seed
        if fleet.spec.clock_error_s == 0.0:
            assert [at_s for at_s, node in fleet.sent if node == 2 and at_s > 60.0] == []
        assert len([node for _, node in fleet.sent if node != 2]) > 100


def test_jump_mutes_a_node_until_its_clock_has_settled(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        years_s = 3.0e8
        jumps = [{"at_s": 300.0, "by_s": years_s}, {"at_s": 305.0, "by_s": -years_s}]
        fleet = Fleet(seed, clocks={1: {"jumps": jumps}})
        fleet.talk(20)
        assert fleet.collided == 0, seed
        own = [at_s for at_s, node in fleet.sent if node == 1]
        assert [at_s for at_s in own if 300.0 < at_s < 314.9] == []
        assert [at_s for at_s in own if at_s > 330.0]


def test_computer_that_starts_in_the_seventies_speaks_in_nobodys_slot(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(100)):
        years_s = random.Random(seed).uniform(3.0e8, 1.75e9)
        jumps = [{"at_s": 300.0, "by_s": years_s}]
        fleet = Fleet(seed, clocks={1: {"offset_s": -years_s, "jumps": jumps}})
        fleet.talk(20)
        assert fleet.collided == 0, seed
        own = [at_s for at_s, node in fleet.sent if node == 1]
        assert min(own) >= 300.0, seed  # at once, where its slot is then
        doubts = [
            each.doubt
            for node, each in fleet.network.events
            if node == 1 and isinstance(each, ClockStateChanged)
        ]
        assert doubts == ["UTC is not known: the clock of this computer is not set", ""], seed


def test_steps_of_the_clock_of_the_node_that_tells_the_time_move_no_slot(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(100)):
        rng = random.Random(seed)
        jumps = [
            {"at_s": at_s, "by_s": rng.choice((1e-1, 3.0, 1e9)) * rng.choice((-1, 1))}
            for at_s in (300.0, 600.0, 900.0)
        ]
        clocks: dict[int, dict[str, Any]] = {node: {"error_s": None} for node in range(2, 7)}
        clocks[1] = {"offset_s": rng.uniform(-1.7e9, 500), "jumps": jumps}
        fleet = Fleet(
            seed, clocks=clocks, clock=1, clock_error_s=0.02, beacon_s=120.0, slot_s=5.0,
        )  # fmt: skip
        fleet.talk(30 if SOAK else 20)
        assert fleet.collided == 0, seed
        for node in fleet.addresses:
            times = [at_s for at_s, sender in fleet.sent if sender == node and at_s > 300.0]
            assert max(after - before for before, after in pairwise(times)) < 300.0, seed


def test_one_node_tells_the_others_the_time(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        # Everybody's own clock is wrong by minutes, and nobody but node 1 is asked for it.
        rng = random.Random(seed)
        clocks: dict[int, dict[str, Any]] = {
            node: {"offset_s": rng.uniform(-500, 500), "drift_ppm": rng.uniform(-20, 20)}
            for node in range(1, 7)
        }
        fleet = Fleet(
            seed, clocks=clocks, clock=1, clock_error_s=0.02, beacon_s=120.0, slot_s=5.0,
        )  # fmt: skip
        fleet.talk(30 if SOAK else 20)
        assert fleet.collided == 0, seed
        assert {node for at_s, node in fleet.sent} == set(fleet.addresses), seed
        first_s = min(at_s for at_s, node in fleet.sent if node == 1)
        assert min(at_s for at_s, node in fleet.sent if node != 1) > first_s


def test_idle_nodes_send_nothing_and_have_no_timer() -> None:
    fleet = Fleet(1)
    assert fleet.network.is_quiet
    fleet.network.run(until_s=24 * 3600)
    assert fleet.sent == []
    assert all(fleet.network.engine(node).is_idle for node in fleet.addresses)


def test_five_nodes_publish_for_a_day_and_nothing_is_lost(count: Callable[[int], int]) -> None:
    hours = count(2400) / 100  # a day in full size
    result = survey(hours)
    assert result.losses == {}
    # The last ones of each node may still be on their way.
    assert result.delivered >= 0.99 * result.published - 5
    assert result.longest_s < 20.0
