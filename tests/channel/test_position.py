import pytest

from zacoustic.channel.propagation.position import Motion, Waypoint, distance_m, path_between

SECOND = 1_000_000_000
TRACK = Motion(
    [
        Waypoint(t=10.0, position=(0.0, 0.0, 0.0)),
        Waypoint(t=20.0, position=(10.0, 20.0, 5.0)),
        Waypoint(t=40.0, position=(10.0, 0.0, 5.0)),
    ]
)


@pytest.mark.parametrize(
    ("at_s", "position"),
    [
        (0.0, (0.0, 0.0, 0.0)),
        (10.0, (0.0, 0.0, 0.0)),
        (15.0, (5.0, 10.0, 2.5)),
        (20.0, (10.0, 20.0, 5.0)),
        (30.0, (10.0, 10.0, 5.0)),
        (40.0, (10.0, 0.0, 5.0)),
        (1000.0, (10.0, 0.0, 5.0)),
    ],
)
def test_a_track_is_straight_between_way_points_and_still_beyond_them(
    at_s: float, position: tuple[float, float, float]
) -> None:
    assert TRACK.position(at_s) == pytest.approx(position)


def test_velocity_belongs_to_the_leg() -> None:
    assert TRACK.velocity_m_s(15.0) == pytest.approx((1.0, 2.0, 0.5))
    assert TRACK.velocity_m_s(30.0) == pytest.approx((0.0, -1.0, 0.0))
    assert TRACK.velocity_m_s(5.0) == TRACK.velocity_m_s(50.0) == (0.0, 0.0, 0.0)
    assert not TRACK.is_fixed


def test_fixed_nodes_are_distance_over_speed_apart() -> None:
    a, b = Motion.fixed((0.0, 0.0, 0.0)), Motion.fixed((3000.0, 4000.0, 0.0))
    path = path_between(a, b, 5 * SECOND, sound_speed_m_s=1500.0)
    assert (path.distance_m, path.range_rate_m_s) == (5000.0, 0.0)
    assert path.propagation_s == pytest.approx(10.0 / 3.0)
    assert a.is_fixed
    assert distance_m((0.0, 0.0, 0.0), (0.0, 3.0, 4.0)) == 5.0


def test_sound_has_to_follow_a_node_that_moves_away() -> None:
    still = Motion.fixed((0.0, 0.0, 0.0))
    receding = Motion(
        [
            Waypoint(t=0.0, position=(1500.0, 0.0, 0.0)),
            Waypoint(t=1000.0, position=(3500.0, 0.0, 0.0)),
        ]
    )
    path = path_between(still, receding, 0, sound_speed_m_s=1500.0)
    # 1500 t = 1500 + 2 t
    assert path.propagation_s == pytest.approx(1500.0 / 1498.0, abs=1e-9)
    assert path.distance_m == pytest.approx(1500.0 * 1500.0 / 1498.0, abs=1e-6)
    assert path.range_rate_m_s == pytest.approx(2.0)
    # In the other direction only the place of departure counts.
    back = path_between(receding, still, 0, sound_speed_m_s=1500.0)
    assert back.propagation_s == pytest.approx(1.0)
    assert back.range_rate_m_s == pytest.approx(2.0)


def test_nodes_at_one_place_have_no_range_rate() -> None:
    here = Motion.fixed((0.0, 0.0, 0.0))
    moving = Motion(
        [Waypoint(t=0.0, position=(0.0, 0.0, 0.0)), Waypoint(t=1.0, position=(1.0, 0.0, 0.0))]
    )
    path = path_between(here, moving, 0, sound_speed_m_s=1500.0)
    assert (path.propagation_s, path.range_rate_m_s) == (0.0, 0.0)


def test_who_is_steered_is_where_it_was_told_last() -> None:
    motion = Motion.fixed((100.0, 0.0, 10.0))
    motion.move((100.0, 2.0, 10.0), 50.0)
    motion.move((100.0, 4.0, 11.0), 51.0)
    assert not motion.is_fixed
    assert motion.position(51.0) == motion.position(60.0) == (100.0, 4.0, 11.0)
    assert motion.position(50.5) == pytest.approx((100.0, 3.0, 10.5))
    assert motion.velocity_m_s(50.5) == pytest.approx((0.0, 2.0, 1.0))


def test_what_was_to_come_of_a_track_is_over_when_a_node_is_moved() -> None:
    motion = Motion(
        [Waypoint(t=10.0, position=(0.0, 0.0, 0.0)), Waypoint(t=20.0, position=(10.0, 0.0, 0.0))]
    )
    motion.move((1.0, 1.0, 1.0), 15.0)
    assert motion.position(30.0) == (1.0, 1.0, 1.0)
    before = Motion([Waypoint(t=10.0, position=(0.0, 0.0, 0.0))])
    before.move((1.0, 1.0, 1.0), 5.0)
    assert before.position(0.0) == (0.0, 0.0, 0.0)
    assert before.position(9.0) == before.position(11.0) == (1.0, 1.0, 1.0)


def test_a_node_that_is_steered_for_days_takes_no_more_memory() -> None:
    motion = Motion.fixed((0.0, 0.0, 0.0))
    for second in range(1, 5000):
        motion.move((float(second), 0.0, 0.0), float(second))
    assert len(motion.places) < 100
    assert motion.position(4990.5) == pytest.approx((4990.5, 0.0, 0.0))
