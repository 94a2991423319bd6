"""Fixes follow the geometry of the scenario."""

import math

import pytest

from tests.links.evologics.emulator.sea import Sea
from zacoustic.channel.propagation.position import Waypoint
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic_evologics.at.notifications import DeliveredIm, RecvIm
from zacoustic_evologics.at.usbl import UsblAngles, UsblLong, UsblPhyD, UsblPhyP

SCENARIO = Scenario(
    nodes=(
        NodeSpec(address=1, position=(0.0, 0.0, 5.0)),
        NodeSpec(address=2, position=(300.0, -400.0, 55.0)),
    ),
    channel="none",
)
DISTANCE_M = math.hypot(300, 400, 50)


def test_acknowledgement_gives_a_position_with_its_accuracy_a_little_later() -> None:
    sea = Sea(SCENARIO, settings={"ZU": 1})
    near, far = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIM,1,2,ack,x\n")
    sea.run()
    fix = near.first(UsblLong)
    assert (fix.east_m, fix.north_m, fix.up_m) == pytest.approx((300, -400, -50), abs=5)
    assert fix.propagation_us == round(DISTANCE_M / 1500 * 1e6)
    assert fix.accuracy_m == pytest.approx(0.008 * DISTANCE_M, rel=1e-3)
    assert fix.clock_us - fix.measured_us == pytest.approx(457_376, abs=1)
    assert near.at(UsblLong) - near.at(DeliveredIm) == pytest.approx(0.318)
    assert near.all_of(UsblPhyD)
    assert near.all_of(UsblPhyP)
    angles = far.first(UsblAngles)
    assert angles.bearing_rad == pytest.approx(math.atan2(400, -300), abs=0.02)
    assert angles.elevation_rad == pytest.approx(math.asin(50 / DISTANCE_M), abs=0.02)
    assert near.say(b"AT?T\n") == [str(fix.propagation_us)]


def test_set_sound_speed_scales_the_range() -> None:
    sea = Sea(SCENARIO, settings={"ZU": 1, "CA": 1400})
    near, _ = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIM,1,2,ack,x\n")
    sea.run()
    fix = near.first(UsblLong)
    distance_m = math.hypot(fix.x_m, fix.y_m, fix.z_m)
    assert distance_m == pytest.approx(DISTANCE_M * 1400 / 1500, rel=1e-4)


def test_fixes_follow_a_modem_that_moves_and_its_velocity_is_reported() -> None:
    track = (Waypoint(t=0, position=(100.0, 0, 5)), Waypoint(t=100, position=(300.0, 0, 5)))
    nodes = (
        NodeSpec(address=1, position=(0.0, 0.0, 5.0)),
        NodeSpec(address=2, track=track),
    )
    sea = Sea(Scenario(nodes=nodes, channel="none"), settings={"ZU": 1})
    near, far = sea.host(1), sea.host(2)
    for at_s in (0.0, 50.0, 110.0):
        sea.run(at_s)
        near.say(b"AT*SENDIM,1,2,ack,x\n")
    sea.run()
    assert [fix.east_m for fix in near.all_of(UsblLong)] == pytest.approx([100, 200, 300], abs=3)
    assert [m.velocity_m_s for m in far.all_of(RecvIm)] == pytest.approx([2.0, 2.0, 0.0])


def test_without_the_option_there_are_no_fixes() -> None:
    sea = Sea(SCENARIO)
    near, _ = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIM,1,2,ack,x\n")
    sea.run()
    assert near.lines() == ["DELIVEREDIM,2"]
