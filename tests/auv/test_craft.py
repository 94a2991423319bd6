"""The vehicle as a whole: who steers, what it refuses, what it does when the shore is lost."""

import math

import pytest

from examples.auv.craft import Craft
from examples.auv.hydrodynamics import FIN_LIMIT_RAD
from examples.auv.messages import ELEVATOR, RUDDER, THRUST, Hold, Mode, Waypoint
from examples.auv.picture import LEAST_BYTES
from examples.auv.start import START
from examples.auv.world import World


def armed(seed: int = 1) -> Craft:
    craft = Craft(START, seed=seed)
    assert craft.arm(True).accepted
    return craft


def test_nothing_moves_before_it_is_armed() -> None:
    craft = Craft(START, World())
    craft.set_joint(THRUST, -31.0)
    craft.advance(60.0)
    assert craft.motion.speed_m_s < 0.01
    assert craft.ignored == 1
    assert not craft.hold(Hold(True, 10.0, 0.0, 1.0)).accepted
    assert craft.goto(Waypoint(10, 10, 10)) == "not armed"
    assert craft.arm(True).accepted
    assert not craft.arm(True).accepted


def test_set_points_hold_and_stay_within_the_limits() -> None:
    craft = armed()
    craft.set_joint(THRUST, -15.0)
    craft.set_joint(RUDDER, 5.0)
    craft.set_joint(ELEVATOR, math.nan)
    craft.advance(30.0)
    assert craft.controls.rudder_rad == FIN_LIMIT_RAD
    assert craft.controls.elevator_rad == 0.0
    assert craft.motion.speed_m_s > 1.0
    assert craft.nav().turn > 3.0


@pytest.mark.parametrize("seed", range(5))
def test_autopilot_holds_depth_heading_and_speed(seed: int) -> None:
    craft = armed(seed)
    assert craft.hold(Hold(True, 12.0, 250.0, 1.5)).accepted
    craft.advance(150.0)
    assert craft.motion.depth_m == pytest.approx(12.0, abs=0.5)
    assert math.degrees(craft.motion.heading_rad) == pytest.approx(250.0, abs=3.0)
    assert craft.motion.speed_m_s == pytest.approx(1.5, abs=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_way_points_all_around_are_reached(seed: int) -> None:
    craft = armed(seed)
    now_s = 0.0
    for bearing in range(0, 360, 60):
        # 20 m beside the vehicle is inside of its turning circle.
        for distance_m in (20.0, 120.0):
            place = craft.motion
            waypoint = Waypoint(
                place.north_m + distance_m * math.cos(math.radians(bearing)),
                place.east_m + distance_m * math.sin(math.radians(bearing)),
                10.0 + bearing / 30.0,
            )
            assert craft.goto(waypoint) == ""
            while (ended := craft.poll_goal()) is None:
                now_s += 1.0
                craft.advance(now_s)
            assert ended.reached, (bearing, distance_m, ended)
            assert ended.result.distance < 5.0
            assert abs(craft.motion.depth_m - waypoint.depth) < 0.5


def test_stop_ends_everything_and_outlives_a_lost_shore() -> None:
    craft = armed()
    craft.goto(Waypoint(200.0, 0.0, 20.0))
    craft.advance(60.0)
    craft.stop()
    ended = craft.poll_goal()
    assert ended is not None
    assert not ended.reached
    assert ended.text == "stopped"
    craft.shore_lost()
    craft.set_joint(THRUST, -31.0)
    craft.advance(200.0)
    assert craft.mode is Mode.STOPPED
    assert craft.motion.speed_m_s < 0.2
    assert craft.controls.thrust_n == 0.0


def test_a_vehicle_that_has_lost_the_shore_goes_up_and_waits() -> None:
    craft = armed()
    craft.hold(Hold(True, 25.0, 0.0, 1.5))
    craft.advance(150.0)
    assert craft.motion.depth_m > 24.0
    craft.shore_lost()
    craft.advance(300.0)
    assert craft.motion.depth_m < 0.6
    craft.advance(400.0)
    assert craft.motion.depth_m < 0.6
    craft.shore_found()
    assert craft.mode is Mode.HOLD


def test_it_keeps_off_the_sea_bed_and_refuses_what_is_too_deep() -> None:
    craft = Craft(START, World(bed_m=30.0))
    craft.arm(True)
    assert not craft.hold(Hold(True, 99.0, 0.0, 1.5)).accepted
    assert craft.hold(Hold(True, 60.0, 0.0, 1.5)).accepted
    for now_s in range(10, 300, 10):
        craft.advance(float(now_s))
        place = craft.motion
        assert World(bed_m=30.0).bed_depth_m(place.north_m, place.east_m) - place.depth_m > 1.0


def test_a_photo_is_a_large_object() -> None:
    craft = armed()
    first, second = craft.take_photo(), craft.take_photo()
    assert first.startswith(b"\x89PNG")
    assert len(first) >= LEAST_BYTES
    assert first != second
    assert craft.status().photos == 2


def test_same_seed_same_reports() -> None:
    craft, again, other = armed(), armed(), armed(2)
    for each in (craft, again, other):
        each.advance(33.3)
    assert craft.nav() == again.nav()
    assert craft.nav() != other.nav()
    assert craft.status().battery < 100.0
