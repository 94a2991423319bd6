"""The console: the desk by itself, and its page in this process, without a browser."""

import asyncio
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from examples.auv.desk import Desk
from examples.auv.drawing import attitude_of, map_of, profile_of
from examples.auv.messages import (
    ARM,
    HOLD,
    NAV,
    RUDDER,
    STOP,
    THRUST,
    Done,
    Mode,
    Nav,
    Setpoint,
    Waypoint,
)
from examples.auv.setpoints import LEAST_PERIOD_S, Setpoints
from examples.auv.shore import Answer, Carrier, Shore


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


class Recorder(Carrier):
    """Keeps what is ordered."""

    def __init__(self) -> None:
        self.said: list[tuple[str, msgspec.Struct]] = []
        self.answers: list[Answer] = []

    def put(self, topic: str, value: msgspec.Struct) -> None:
        self.said.append((topic, value))

    def call(self, service: str, value: msgspec.Struct) -> Answer:
        self.said.append((service, value))
        self.answers.append(Answer())
        return self.answers[-1]

    def send_goal(self, waypoint: Waypoint) -> Answer:
        return self.call("goto", waypoint)


def desk_at(clock: Clock) -> tuple[Desk, Recorder]:
    desk, carrier = Desk(Shore(), clock), Recorder()
    desk.carrier = carrier
    return desk, carrier


def nav(east: float = 30.0) -> Nav:
    return Nav(
        north=10.0, east=east, depth=12.34, heading=90.0, pitch=-3.0, roll=1.0, speed=1.5,
        turn=0.0, sigma=0.5, mode=Mode.GOTO,
    )  # fmt: skip


def test_set_points_go_at_once_then_seldom_and_the_last_one_wins() -> None:
    setpoints = Setpoints()
    sent: list[tuple[float, dict[str, float]]] = []
    for tick in range(100):  # a slider that moves for ten seconds
        now_s = tick / 10
        setpoints.set(RUDDER, tick / 1000)
        if said := setpoints.poll(now_s):
            sent.append((now_s, said))
    assert sent[0] == (0.0, {RUDDER: 0.0})
    assert len(sent) == 4
    assert setpoints.waiting
    assert setpoints.poll(9.9 + LEAST_PERIOD_S) == {RUDDER: 0.099}
    assert not setpoints.waiting
    assert setpoints.poll(100.0) == {}  # it holds: nothing is repeated


def test_what_moves_together_goes_together() -> None:
    setpoints = Setpoints()
    setpoints.set(RUDDER, 0.1)
    setpoints.set(THRUST, -15.0)
    assert setpoints.poll(0.0) == {RUDDER: 0.1, THRUST: -15.0}


def test_desk_says_how_old_everything_is() -> None:
    clock = Clock()
    desk, _ = desk_at(clock)
    assert desk.vehicle_lines() == ["not heard yet"]
    desk.shore.hear(NAV, nav(), clock.now_s, age_s=0.5)
    assert desk.vehicle_lines()[0] == "reported 2 s ago"
    clock.now_s += 30
    assert desk.vehicle_lines()[0] == "reported 32 s ago — OLD"
    assert "± 10 m" in desk.vehicle_lines()[3]


def test_an_order_is_done_when_the_vehicle_says_so() -> None:
    clock = Clock()
    desk, carrier = desk_at(clock)
    desk.arm(True)
    assert desk.order_lines() == ["   0 s ago: arm: not answered yet"]
    carrier.answers[0].answered(Done(True))
    clock.now_s += 4
    assert desk.order_lines() == ["   4 s ago: arm: done"]
    desk.hold(10.0, 90.0, 1.5)
    carrier.answers[1].answered(Done(False, "not armed"))
    assert desk.order_lines()[0].endswith("not armed")


def test_stop_forgets_the_set_points_that_wait() -> None:
    clock = Clock()
    desk, carrier = desk_at(clock)
    desk.setpoints.set(THRUST, -15.0)
    desk.stop()
    clock.now_s += 60
    desk.tick()
    assert [topic for topic, _ in carrier.said] == [STOP]


def test_drawings_show_track_uncertainty_and_depth() -> None:
    shore = Shore()
    assert "<svg" in map_of(shore, None)
    for second in range(0, 60, 5):
        shore.hear(NAV, nav(float(second)), float(second))
    near, far = shore.estimate(60.0), shore.estimate(120.0)
    assert near is not None
    assert far is not None
    drawn = map_of(shore, near, [Waypoint(50.0, 50.0, 12.0)])
    assert drawn.count("<circle") == 3
    assert "12 m" in drawn
    assert map_of(shore, near) != map_of(shore, far)
    assert profile_of(shore, 60.0) != profile_of(shore, 90.0)
    assert "rotate(-1 60 60)" in attitude_of(nav())


def test_page_moves_sliders_shows_the_vehicle_and_stops() -> None:
    pytest.importorskip("nicegui")
    from nicegui import ui
    from nicegui.testing.user_simulation import user_simulation

    from examples.auv.page import Page

    clock = Clock()
    desk, carrier = desk_at(clock)

    pages: list[Page] = []

    async def visit() -> None:
        def root() -> None:
            pages.append(Page(desk))

        async with user_simulation(root) as user:
            await user.open("/")
            await user.should_see("not heard yet")
            user.find("arm").click()
            assert await until(lambda: ARM in topics(carrier))
            slider: Any = next(iter(user.find(marker="thrust N", kind=ui.slider).elements))
            slider.value = 15.0
            desk.tick()
            assert (THRUST, Setpoint(-15.0)) in carrier.said
            user.find("hold").click()
            assert await until(lambda: HOLD in topics(carrier))
            desk.shore.hear(NAV, nav(), clock.now_s)
            pages[0].refresh()
            assert slider.value == 0  # the autopilot steers: what it showed does not hold
            assert not desk.setpoints.wanted
            await user.should_see("auv1: goto")
            await user.should_see("depth 12.3 m")
            user.find("STOP").click()
            assert await until(lambda: STOP in topics(carrier))
            pages[0].refresh()
            await user.should_see("STOP: sent")

    asyncio.run(visit())


def topics(carrier: Recorder) -> list[str]:
    return [topic for topic, _ in carrier.said]


async def until(condition: Callable[[], bool]) -> bool:
    """Give the page's tasks their turns."""
    for _ in range(200):
        if condition():
            return True
        await asyncio.sleep(0)
    return condition()
