"""The vehicle's mechanics against the check values of the paper's model."""

import math

import pytest

from examples.auv import hull
from examples.auv.dynamics import Body, Controls, Motion, facing
from examples.auv.world import World

WITHIN = 0.005
"""What the figures have to hold, as a share."""


def run(
    controls: Controls,
    seconds: float,
    *,
    body: Body | None = None,
    start: Motion | None = None,
    step_s: float = 0.1,
) -> Motion:
    mechanics = body or Body()
    motion = start or facing(0.0, north_m=0.0, east_m=0.0, depth_m=30.0)
    for _ in range(round(seconds / step_s)):
        motion = mechanics.step(motion, controls, step_s)
    return motion


def test_masses_and_boxes_are_those_of_the_paper() -> None:
    assert pytest.approx(148.3571, abs=1e-9) == hull.MASS_KG
    assert pytest.approx(0.1483571, abs=1e-12) == hull.VOLUME_M3


def test_vehicle_is_neutral_under_water_and_heavy_above_it() -> None:
    assert hull.net_weight_n(30.0) == pytest.approx(0.0, abs=1e-9)
    assert hull.net_weight_n(-1.0) == pytest.approx(148.3571 * 9.8)
    resting = run(Controls(), 600.0)
    assert resting.depth_m == pytest.approx(30.0, abs=1e-6)
    assert resting.speed_m_s == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("thrust_n", "speed_m_s"), [(15.0, 1.5519), (31.0, 2.2310)])
def test_terminal_speed(thrust_n: float, speed_m_s: float) -> None:
    motion = run(Controls(thrust_n=-thrust_n), 300.0)
    assert motion.speed_m_s == pytest.approx(speed_m_s, rel=WITHIN)


def test_time_constant_of_the_speed_is_11_03_s() -> None:
    # From rest u = u∞ tanh(t/τ): after τ it is 0.7616 of the terminal speed.
    motion = run(Controls(thrust_n=-31.0), 11.03, step_s=11.03 / 110)
    assert motion.speed_m_s == pytest.approx(2.2310 * math.tanh(1.0), rel=WITHIN)


@pytest.mark.parametrize("thrust_n", [15.0, 31.0])
@pytest.mark.parametrize("ballast_m", [0.0, hull.BALLAST_M])
def test_turn_radius(ballast_m: float, thrust_n: float) -> None:
    controls = Controls(thrust_n=-thrust_n, rudder_rad=-0.17)
    motion = run(controls, 200.0, body=Body(ballast_m=ballast_m))
    assert motion.speed_m_s / abs(motion.velocity[5]) == pytest.approx(24.53, rel=WITHIN)
    if thrust_n == 31.0:
        assert math.degrees(motion.velocity[5]) == pytest.approx(-4.9134, rel=WITHIN)


def test_current_carries_and_does_nothing_else() -> None:
    controls = Controls(thrust_n=-31.0, rudder_rad=0.1)
    still = run(controls, 60.0, body=Body(World(relief_m=0.0)))
    drifting = run(controls, 60.0, body=Body(World(relief_m=0.0, current_m_s=(0.5, -0.3))))
    assert drifting.velocity == pytest.approx(still.velocity, abs=1e-9)
    assert drifting.north_m - still.north_m == pytest.approx(30.0, abs=1e-6)
    assert drifting.east_m - still.east_m == pytest.approx(-18.0, abs=1e-6)


def test_positive_angles_turn_to_starboard_and_lower_the_bow() -> None:
    assert 0 < run(Controls(thrust_n=-31.0, rudder_rad=0.1), 10.0).heading_rad < math.pi
    dived = run(Controls(thrust_n=-31.0, elevator_rad=0.1), 10.0)
    assert dived.pitch_rad < -0.05
    assert dived.depth_m > 30.0


def test_joints_go_no_further_than_they_can() -> None:
    far = run(Controls(thrust_n=-500.0, rudder_rad=2.0, elevator_rad=-2.0), 5.0)
    limit = run(Controls(thrust_n=-60.0, rudder_rad=0.261799, elevator_rad=-0.261799), 5.0)
    assert far == limit


def test_ballast_rights_the_vehicle() -> None:
    rolled = Motion(depth_m=30.0, quaternion=(math.cos(0.25), math.sin(0.25), 0.0, 0.0))
    rolls = []
    for _ in range(600):
        rolled = run(Controls(), 0.1, start=rolled)
        rolls.append(rolled.roll_rad)
    assert min(rolls) < -0.3  # it swings through
    assert max(abs(roll) for roll in rolls[-100:]) < 0.45


def test_a_vehicle_stays_between_the_surface_and_the_bed() -> None:
    up = run(Controls(thrust_n=-31.0, elevator_rad=-0.1), 120.0)
    assert up.depth_m > -0.5
    grounded = facing(0.0, north_m=0.0, east_m=0.0, depth_m=79.5)
    down = run(
        Controls(thrust_n=-31.0, elevator_rad=0.05), 20.0, start=grounded, body=Body(World())
    )
    assert down.depth_m < World().bed_depth_m(down.north_m, down.east_m) + 0.5


def test_a_loop_does_no_harm() -> None:
    motion = run(Controls(thrust_n=-31.0, elevator_rad=-0.2), 300.0)
    assert math.isfinite(motion.north_m)
    assert motion.speed_m_s < 3.0


def test_same_inputs_give_the_same_motion_and_halved_steps_nearly_so() -> None:
    controls = Controls(thrust_n=-31.0, rudder_rad=0.15, elevator_rad=0.02)
    coarse, again = run(controls, 60.0), run(controls, 60.0)
    fine = run(controls, 60.0, step_s=0.05)
    assert coarse == again
    assert math.dist((coarse.north_m, coarse.east_m), (fine.north_m, fine.east_m)) < 0.01
