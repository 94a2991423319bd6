"""The station: set-points, orders, values with their ages."""

import math
from typing import Any

import pytest

from examples.auv import readout
from examples.auv.controlstation import CONFIRMED, ControlStation, Press
from examples.auv.fates import Fate
from examples.auv.look import orders_table
from examples.auv.messages import (
    NAV,
    PHOTO,
    RUDDER,
    STATUS,
    STOP,
    TAKE_PHOTO,
    THRUST,
    Done,
    Mode,
    Status,
    Waypoint,
)
from examples.auv.setpoints import LEAST_PERIOD_S, Setpoints
from examples.auv.shore import Answer, Shore
from tests.auv.stations import LINK, Clock, nav, station_at, streams, topics
from zacoustic.app.tools.pages.truth import Alarm


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
    assert setpoints.due_in_s(9.9) == pytest.approx(2.1)
    assert setpoints.poll(9.9 + LEAST_PERIOD_S) == {RUDDER: 0.099}
    assert not setpoints.waiting
    assert setpoints.poll(100.0) == {}  # it holds: nothing is repeated


def test_what_moves_together_goes_together() -> None:
    setpoints = Setpoints()
    setpoints.set(RUDDER, 0.1)
    setpoints.set(THRUST, -15.0)
    assert setpoints.poll(0.0) == {RUDDER: 0.1, THRUST: -15.0}


def test_a_set_point_tells_what_became_of_it() -> None:
    """Waits here, given away, on its way, there; the next one is lost in an outage."""
    clock = Clock()
    station, _ = station_at(clock)
    watch = station.watch
    watch.take("streams", streams(THRUST, published=7, delivered=7), clock.now_s)
    assert readout.setpoint_line(station, THRUST) == ""
    station.setpoints.set(THRUST, -15.0)
    assert readout.setpoint_line(station, THRUST) == "goes in 0 s"
    station.tick()
    assert readout.setpoint_line(station, THRUST) == Fate.GIVEN.value
    watch.take("streams", streams(THRUST, published=8, delivering=1, delivered=7), clock.now_s)
    assert readout.setpoint_line(station, THRUST) == Fate.UNDER_WAY.value
    watch.take("streams", streams(THRUST, published=8, delivered=8), clock.now_s)
    assert readout.setpoint_line(station, THRUST) == Fate.THERE.value
    station.setpoints.set(THRUST, -10.0)
    clock.now_s += 1.0
    assert readout.setpoint_line(station, THRUST) == "goes in 2 s"
    clock.now_s += 5.0
    station.tick()
    # The gateway has counted and given up within the second between two of its documents.
    watch.take("streams", streams(THRUST, published=9, delivered=8, expired=1), clock.now_s)
    assert readout.setpoint_line(station, THRUST) == Fate.LOST.value


def test_a_superseded_set_point_is_not_taken_for_a_lost_one() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    station.setpoints.set(THRUST, -15.0)
    station.tick()
    station.watch.take("streams", streams(THRUST, published=1, delivering=1), 0.0)
    station.setpoints.set(THRUST, -10.0)
    clock.now_s += 4.0
    station.tick()
    station.watch.take("streams", streams(THRUST, published=2, superseded=1, delivering=1), 0.0)
    assert readout.setpoint_line(station, THRUST) == Fate.UNDER_WAY.value
    station.watch.take("streams", streams(THRUST, published=2, superseded=1, delivered=1), 0.0)
    assert readout.setpoint_line(station, THRUST) == Fate.THERE.value


def test_a_gateway_that_was_restarted_leaves_nothing_on_its_way() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    station.watch.take("streams", streams(STOP, published=3), 0.0)
    station.stop()
    station.watch.take("streams", streams(STOP), 0.0)
    assert station.watch.fates.of(STOP) is Fate.LOST


def test_every_value_says_how_old_it_is_at_the_source() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    assert readout.values(station) == []
    assert readout.is_report_old(station)
    station.watch.take("link", LINK, clock.now_s)  # 0.2 s + 256 bits of 640, and 1.5 s of water
    assert station.watch.way_s == pytest.approx(2.1)
    station.watch.take("peers", {"2": {"metrics": {"propagation_s": 1.0}}}, clock.now_s)
    assert station.watch.way_s == pytest.approx(1.6)
    station.shore.hear(NAV, nav(), clock.now_s, age_s=0.5, way_s=station.watch.way_s)
    station.shore.hear(STATUS, Status(97.0, 61.0, 2), clock.now_s, age_s=20.0, way_s=1.6)
    ages = {each.name: each.age_s for each in readout.values(station)}
    assert set(ages) == {
        "depth", "position", "heading", "speed", "turning", "pitch, roll", "above the bed",
        "battery",
    }  # fmt: skip
    assert ages["depth"] == pytest.approx(2.1)
    assert ages["battery"] == pytest.approx(21.6)
    assert not any(each.is_old for each in readout.values(station))
    clock.now_s += 30
    depth = readout.values(station)[0]
    assert depth.age_s == pytest.approx(32.1)
    assert depth.is_old
    assert not readout.values(station)[-1].is_old  # the battery is reported more seldom


def test_an_age_is_said_as_people_say_it() -> None:
    said = [readout.ago(seconds) for seconds in (-1.0, 0.4, 59.4, 61.0, 3599.0, 7260.0)]
    assert said == ["0 s", "0 s", "59 s", "1 min 01 s", "59 min 59 s", "2 h 01 min"]


def test_what_is_predicted_stands_apart_from_what_was_reported() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    station.shore.hear(NAV, nav(), clock.now_s, way_s=0.0)
    clock.now_s += 10.0
    position = next(each for each in readout.values(station) if each.name == "position")
    assert position.reported == "10 N 30 E ± 0.5 m"
    assert position.now.startswith("10 N 45 E ± ")  # 1.5 m/s to the east for ten seconds
    assert next(each for each in readout.values(station) if each.name == "speed").now == ""


def test_an_order_is_done_when_the_vehicle_says_so() -> None:
    clock = Clock()
    station, carrier = station_at(clock)
    station.arm(True)
    first = readout.order_lines(station)[0]
    assert (first.text, first.outcome, first.state) == ("arm", "not answered yet", "waiting")
    carrier.answers[0].answered(Done(True))
    clock.now_s += 4
    first = readout.order_lines(station)[0]
    assert (first.age_s, first.outcome, first.state) == (4.0, "done", "good")
    station.hold(10.0, 90.0, 1.5)
    carrier.answers[1].answered(Done(False, "not <b>armed</b>"))
    first = readout.order_lines(station)[0]
    assert (first.outcome, first.state) == ("not <b>armed</b>", "bad")
    assert "&lt;b&gt;armed" in orders_table(readout.order_lines(station))


def test_a_way_point_says_how_far_it_probably_is() -> None:
    clock = Clock()
    station, carrier = station_at(clock)
    station.shore.hear(NAV, nav(), clock.now_s, way_s=0.0)
    station.goto(Waypoint(10.0, 130.0, 12.0))
    carrier.answers[0].accepted = True
    clock.now_s += 10.0
    outcome = readout.order_lines(station)[0].outcome
    assert outcome == "accepted, under way, about 85 m left"


def test_to_give_up_a_way_point_is_an_order_like_others() -> None:
    station, _ = station_at(Clock())
    station.cancel_goal()  # there is none
    assert readout.order_lines(station) == []
    answer = Answer()
    station.cancel = lambda: answer
    station.cancel_goal()
    answer.answered(Done(False, "it was over"))
    first = readout.order_lines(station)[0]
    assert (first.text, first.outcome) == ("give up the way-point", "it was over")


def test_stop_is_confirmed_by_a_later_report_only() -> None:
    clock = Clock()
    station, carrier = station_at(clock)
    station.shore.hear(NAV, nav(mode=Mode.STOPPED), clock.now_s, way_s=0.0)  # of the stop before
    clock.now_s += 1
    station.stop()
    station.tick()
    assert readout.order_lines(station)[0].outcome == Fate.GIVEN.value
    station.watch.take("streams", streams(STOP, published=1, delivered=1), clock.now_s)
    station.tick()
    assert readout.order_lines(station)[0].outcome == Fate.THERE.value
    clock.now_s += 5
    station.shore.hear(NAV, nav(mode=Mode.STOPPED), clock.now_s, way_s=0.0)
    station.tick()
    assert readout.order_lines(station)[0].outcome == CONFIRMED
    # It stays so when the vehicle is armed anew.
    clock.now_s += 5
    station.shore.hear(NAV, nav(mode=Mode.MANUAL), clock.now_s, way_s=0.0)
    station.tick()
    assert readout.order_lines(station)[0].outcome == CONFIRMED
    assert [topic for topic, _ in carrier.said] == [STOP]


def test_stop_forgets_the_set_points_that_wait() -> None:
    clock = Clock()
    station, carrier = station_at(clock)
    station.setpoints.set(THRUST, -15.0)
    station.stop()
    clock.now_s += 60
    station.tick()
    assert [topic for topic, _ in carrier.said] == [STOP]


def test_a_photo_is_followed_from_the_order_to_the_picture() -> None:
    clock = Clock()
    station, carrier = station_at(clock)
    station.photo()
    assert carrier.said[0][0] == TAKE_PHOTO
    carrier.answers[0].answered(Done(True))

    def objects(done_bytes: int) -> dict[str, Any]:
        return {"receiving": [{"source": 2, "transfer": 3, "stream": PHOTO,
                               "done_bytes": done_bytes, "total_bytes": 10_000}]}  # fmt: skip

    assert readout.photo_share(station) is None
    for step in range(5):
        station.watch.take("objects", objects(1000 * step), clock.now_s)
        clock.now_s += 10
    # The fourth step was ten seconds ago, and each takes ten.
    assert readout.photo_share(station) == pytest.approx(0.5)
    assert readout.photo_progress(station) == "4.0 of 10.0 kB, about 50 s left"
    clock.now_s += 60  # one that does not come is waited for, not counted
    assert readout.photo_share(station) == pytest.approx(0.5)
    assert readout.photo_progress(station) == "4.0 of 10.0 kB, about 50 s left"
    clock.now_s -= 60
    assert readout.photo_line(station) == ""
    assert any(each.name == "photo" for each in readout.water_lines(station))
    station.watch.take("objects", {"receiving": []}, clock.now_s)
    station.shore.hear(PHOTO, b"picture", clock.now_s)
    station.tick()
    clock.now_s += 5
    assert readout.photo_line(station) == "came 5 s ago, asked for 55 s ago"
    assert readout.photo_progress(station) == ""
    # Two are asked for: nobody can tell which one the next is.
    for _ in range(2):
        station.photo()
        carrier.answers[-1].answered(Done(True))
    station.shore.hear(PHOTO, b"another", clock.now_s)
    station.tick()
    assert readout.photo_line(station) == "came 0 s ago"


def test_what_is_dead_is_said_and_what_it_means_for_an_order() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    watch = station.watch
    watch.answered('{"now_unix_s": 5000.0}', clock.now_s)
    watch.take("link", LINK, clock.now_s)
    watch.take("streams", streams(STOP), clock.now_s)
    assert station.unix_s == 5000.0
    station.stop()
    station.tick()
    assert readout.alarm(station) is None
    # Never counted: after three seconds it was not sent, whoever is to blame.
    clock.now_s += 1.0
    watch.answered("no JSON", clock.now_s)
    clock.now_s += 2.1
    watch.answered("{}", clock.now_s)
    station.tick()
    assert readout.order_lines(station)[0].outcome == Fate.NOT_SENT.value
    assert readout.order_lines(station)[0].state == "bad"
    # Counted late it is on its way; then the link goes, and another stop waits in the gateway.
    watch.take("streams", streams(STOP, published=1, delivering=1), clock.now_s)
    station.tick()
    assert readout.order_lines(station)[0].outcome == Fate.UNDER_WAY.value
    clock.now_s += 1.0
    watch.take("link", LINK | {"state": "down"}, clock.now_s)
    assert readout.alarm(station) == Alarm("NOT SENT: link down", 0.0)
    assert readout.why_disabled(station) == "link down"
    assert readout.order_lines(station)[0].outcome.startswith("not known: it was on its way")
    clock.now_s += 1.0
    station.stop()
    watch.take("streams", streams(STOP, published=2, delivering=1), clock.now_s)
    watch.answered("{}", clock.now_s)
    station.tick()
    assert readout.order_lines(station)[0].outcome == "NOT SENT: link down; the gateway keeps it"
    # One state in all places, and the earlier press is the same command.
    state = "NOT SENT: link down; the gateway keeps it"
    assert [line.outcome for line in readout.order_lines(station)] == [state, state]
    assert [line.text for line in readout.water_lines(station) if line.name == "stop"] == [state]
    said = readout.banner(station)
    assert said is not None
    assert said.text == f"STOP: {state} · link down"
    assert readout.stop_note(station) == "the gateway keeps it"
    # The gateway goes as well: nothing of what it said last is known any more.
    clock.now_s += 1.7
    station.tick()
    gone = readout.alarm(station)
    assert gone is not None
    assert gone.text == "NOT SENT: gateway gone"
    assert readout.stop_note(station) == "will not be sent"
    assert gone.since_s == pytest.approx(1.7)
    assert readout.link_state(station).startswith("not known")
    assert [line.is_bad for line in readout.link_lines(station)] == [True]
    station.arm(True)
    assert readout.order_lines(station)[0].outcome == "not known: the gateway is gone"
    watch.answered("{}", clock.now_s)
    watch.take("link", LINK | {"silent": True, "why_silent": "until 12:00"}, clock.now_s)
    station.tick()
    assert readout.alarm(station) == Alarm("NOT SENT: silence is kept, until 12:00")


def test_all_places_say_the_same_of_a_stop_that_was_on_its_way_when_the_link_went() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    station.watch.take("link", LINK, clock.now_s)
    station.stop()
    station.watch.take("streams", streams(STOP, published=1, waiting=1, delivering=1), clock.now_s)
    clock.now_s += 1.0
    station.watch.take("link", LINK | {"state": "down"}, clock.now_s)
    station.tick()
    state = "not known: it was on its way when this began: link down"
    assert readout.order_lines(station)[0].outcome == state
    assert [(each.name, each.text) for each in readout.water_lines(station)] == [("stop", state)]
    said = readout.banner(station)
    assert said is not None
    assert said.text == f"STOP: {state} · link down"


def test_a_press_is_taken_once_by_whichever_page_it_comes() -> None:
    clock = Clock()
    station, carrier = station_at(clock)
    station.stop(Press("a"))
    station.stop(Press("b", 45_000.0))
    station.stop(Press("a", 3_000.0))
    assert topics(carrier) == [STOP, STOP]
    texts = [line.text for line in readout.order_lines(station)]
    assert texts == ["STOP, pressed 45 s before it came", "STOP"]
    assert [*station.presses_taken] == ["a", "b"]


@pytest.mark.parametrize("press", [("",), ("a b",), ("x" * 65,), ("a", -1.0), ("a", math.nan)])
def test_a_press_that_is_none_is_refused(press: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match="press"):
        Press(*press)


def test_a_stop_before_anything_runs_was_not_sent() -> None:
    station = ControlStation(Shore(), Clock())
    station.stop()
    station.tick()
    assert readout.order_lines(station)[0].outcome == Fate.NOT_SENT.value
    assert readout.why_disabled(station)
    station.trouble = "gateway 1 is not ready"
    assert readout.alarm(station) == Alarm("NOT SENT: gateway 1 is not ready")
