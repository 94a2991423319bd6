"""The scripted dive on real engines in virtual time, and what the shore makes of it."""

import math
from collections.abc import Callable

import msgspec
import pytest

from examples.auv.account import unaccounted
from examples.auv.dive import DEPTH_WITHIN_M, REACHED_WITHIN_M, WAYPOINTS, Dive
from examples.auv.messages import ARM, NAV, Arm, Hold, Mode, Nav
from examples.auv.shore import Answer, Shore
from examples.auv.virtual import VirtualDive
from zacoustic.core.streams.specs import TopicSpec


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.4])
def test_dive_reaches_every_way_point(loss: float, count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        water = VirtualDive(seed=seed, loss=loss)
        dive = Dive(water.shore, water)
        water.run(dive)
        assert dive.is_over, (seed, loss)
        assert not dive.problems, (seed, loss, dive.problems)
        assert len(water.missed) == len(WAYPOINTS)
        for away_m, off_m in water.missed:
            assert away_m < REACHED_WITHIN_M, (seed, loss)
            assert off_m < DEPTH_WITHIN_M, (seed, loss)
        assert water.unaccounted() == 0, (seed, loss, water.outcomes)


def test_vehicle_goes_up_when_the_shore_falls_silent() -> None:
    water = VirtualDive(seed=3)
    water.network.run(until_s=20.0)
    water.call(ARM, Arm(True))
    water.network.run(until_s=40.0)
    water.call("auv1/hold", Hold(True, 15.0, 0.0, 1.5))
    water.network.run(until_s=150.0)
    assert water.craft.mode is Mode.HOLD
    water.network.crash(1)
    modes = []
    for until_s in (300.0, 460.0):  # a short silence, and one of five minutes
        water.network.run(until_s=until_s)
        modes.append(water.craft.mode)
    assert water.craft.motion.depth_m < 0.6
    water.network.start(1)
    water.network.run(until_s=600.0)
    modes.append(water.craft.mode)
    assert modes == [Mode.HOLD, Mode.SURFACING, Mode.HOLD]


def test_samples_that_have_not_ended_or_ended_twice_are_told_of() -> None:
    def document(**counts: int) -> dict[str, object]:
        return {"streams": [{"name": "a", **counts}, {"name": "b", "waiting": 0}]}

    done, open_ = Answer(), Answer()
    done.failed("")
    assert unaccounted({}, [done], None) == []
    assert unaccounted({"a": 3}, [], document(delivered=1, superseded=2, delivering=0)) == []
    for counts in (
        {"delivered": 2, "delivering": 1},
        {"delivered": 2},
        {"delivered": 3, "expired": 1},
        {"delivered": 3, "delivering": 1},
    ):
        assert len(unaccounted({"a": 3}, [], document(**counts))) == 1, counts
    assert len(unaccounted({"a": 1}, [open_, done], None)) == 2


def nav(**changes: float) -> Nav:
    known = Nav(
        north=0.0, east=0.0, depth=10.0, heading=90.0, pitch=0.0, roll=0.0, speed=1.5, turn=0.0,
        sigma=0.5, mode=Mode.HOLD,
    )  # fmt: skip
    return msgspec.structs.replace(known, **changes)


def test_shore_predicts_the_vehicle_and_grows_uncertain() -> None:
    shore = Shore()
    assert shore.estimate(0.0) is None
    shore.hear(NAV, nav(), 10.0, age_s=0.5)
    estimate = shore.estimate(18.0)
    assert estimate is not None
    assert estimate.age_s == pytest.approx(10.0)
    assert estimate.east == pytest.approx(15.0)
    assert estimate.north == pytest.approx(0.0, abs=1e-9)
    assert estimate.sigma > 4 * nav().sigma  # test_prediction.py says how much it should be
    turning = Shore()
    turning.hear(NAV, nav(turn=4.5), 0.0, age_s=-1.5)  # made at 0
    half = turning.estimate(40.0)  # half a circle to starboard
    assert half is not None
    assert half.heading == pytest.approx(270.0)
    assert half.north == pytest.approx(-2 * 1.5 / math.radians(4.5))
    assert half.east == pytest.approx(0.0, abs=1e-6)


def test_an_old_report_does_not_replace_a_newer_one() -> None:
    shore = Shore()
    shore.hear(NAV, nav(east=50.0), 20.0)
    shore.hear(NAV, nav(east=10.0), 21.0, age_s=8.0)
    assert shore.nav == nav(east=50.0)
    assert len(shore.track) == 1


def test_nothing_is_more_urgent_than_stop() -> None:
    table = VirtualDive().table
    stop = table.by_name("auv1/stop")
    assert isinstance(stop.spec, TopicSpec)
    assert stop.qos.priority.value == min(each.qos.priority.value for each in table)


def test_the_modem_of_the_vehicle_moves_with_it() -> None:
    water = VirtualDive(seed=2)
    water.network.run(until_s=20.0)
    water.call(ARM, Arm(True))
    water.network.run(until_s=40.0)
    water.call("auv1/hold", Hold(True, 15.0, 90.0, 2.0))  # towards the shore
    water.network.run(until_s=200.0)
    place = water.craft.motion
    away_m = math.dist((place.east_m, place.north_m, place.depth_m), (1500.0, 0.0, 10.0))
    assert away_m < 1300.0
    measured = water.network.engine(1).measurements.range(2)
    assert measured is not None
    age_s = water.now_s - measured.measured_at / 1e9
    assert abs(measured.propagation_s * 1500.0 - away_m) < 5.0 + 2.2 * age_s
