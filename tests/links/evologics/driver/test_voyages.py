"""Engine over dialogue over emulated modem, in virtual time: see `voyages`."""

from collections.abc import Callable

from tests.links.evologics.driver.voyages import HELD_LIMIT, held_by, sail
from zacoustic_evologics.at.framing import Interpreter


def test_whole_nodes_come_through_a_minute_of_faults(count: Callable[[int], int]) -> None:
    for seed in range(count(1000)):
        sail(seed)


def test_courses_are_of_all_kinds() -> None:
    courses = [sail(seed).course for seed in range(10)]
    assert {course.nodes for course in courses} == {2, 3}
    assert {course.interpreter for course in courses} == set(Interpreter)
    assert {course.is_serial for course in courses} == {False, True}
    assert {course.config.check for course in courses} == {False, True}
    assert {course.acknowledge for course in courses} == {0.0, 0.5, 1.0}


def test_ten_minutes_of_faults_leave_no_more_than_one() -> None:
    for seed in (1, 4):
        for node in sail(seed, 600.0).crew:
            assert held_by(node.dialogue) <= HELD_LIMIT
            assert node.dialogue.poll_timeout() is None


def test_same_seed_is_the_same_voyage() -> None:
    once, again = sail(3), sail(3)
    assert once.emitted == again.emitted
    assert once.arrived == again.arrived
    assert once.samples == again.samples
