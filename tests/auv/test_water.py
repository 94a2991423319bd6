"""What the console tells of link, queue and water; map, profile and attitude."""

import pytest

from examples.auv import readout
from examples.auv.drawing import attitude_of, map_of, profile_of, view_of
from examples.auv.ladder import MISSION, OTHER, PICTURE, STOPPING, kind_of, ladder_of
from examples.auv.linkwatch import Frame, LinkWatch
from examples.auv.messages import (
    GOTO,
    NAV,
    PHOTO,
    RUDDER,
    STATUS,
    STOP,
    THRUST,
    Waypoint,
)
from examples.auv.shore import Shore
from examples.auv.start import NAV_PERIOD_S
from tests.auv.stations import LINK, UNIX_S, Clock, frame, nav, station_at, streams


def test_what_is_in_the_water_is_told_until_it_has_arrived() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    station.watch.take("link", LINK, clock.now_s)
    station.watch.take("peers", {"2": {"metrics": {"propagation_s": 1.0}}}, clock.now_s)
    own = frame("out", clock.now_s, STOP)
    station.watch.take("channel", {"transmitting": own, "last": []}, clock.now_s)
    clock.now_s += 0.5
    heard = frame("in", clock.now_s - 0.4, NAV)
    told = {"transmitting": None, "last": [own | {"outcome": "sent"}, heard]}
    station.watch.take("channel", told, clock.now_s)
    lines = [(each.name, each.text) for each in readout.water_lines(station)]
    assert lines == [("stop, 12 bytes", "in the water, there in 0.9 s")]
    assert len(station.watch.frames(station.unix_s)) == 2  # told twice, there once
    clock.now_s += 1.0
    assert readout.water_lines(station) == []
    clock.now_s += 100.0
    assert station.watch.frames(station.unix_s) == []


def test_what_was_rejected_never_was_on_the_channel() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    last = [frame("out", clock.now_s, STOP, outcome="rejected")]
    station.watch.take("channel", {"transmitting": None, "last": last}, clock.now_s)
    assert station.watch.in_water(station.unix_s) == []


def test_what_waits_is_told() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    both = streams(STOP, waiting=1, delivering=1)["streams"]
    both += streams(RUDDER, waiting=0, delivering=1)["streams"]
    station.watch.take("streams", {"streams": both}, clock.now_s)
    station.setpoints.set(THRUST, -15.0)
    said = {each.name: each.text for each in readout.water_lines(station)}
    assert said == {
        "stop": "1 in the queue",
        "rudder": "waits for its acknowledgement",
        "thrust -15": "waits here: one set-point in 3 s",
    }


def test_the_link_is_told_with_the_age_of_each_measurement() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    assert [each.text for each in readout.link_lines(station)] == ["not heard yet"]
    watch = station.watch
    watch.take("link", LINK, clock.now_s)
    metrics = {"received_level_db": -96.0, "integrity": 143.0, "snr_db": None}
    peer = {"heard_at_unix_s": UNIX_S + 98.0, "metrics": metrics, "per": 0.25}
    watch.take("peers", {"2": peer}, clock.now_s)
    measured = {"range_m": 1500.3, "propagation_s": 1.0, "measured_at_unix_s": UNIX_S + 70.0}
    watch.take("peer/2/range", measured, clock.now_s)
    lines = {each.name: each for each in readout.link_lines(station)}
    assert (lines["range"].text, lines["range"].age_s) == ("1500 m, 1.00 s", 30.0)
    assert (lines["signal"].text, lines["signal"].age_s) == ("-96 dB, integrity 143", 2.0)
    assert lines["frames"].text == "3 sent, 9 heard, 25% of ours lost"
    assert "own airtime" not in lines  # too early to tell
    clock.now_s += 60.0
    watch.take("link", LINK | {"airtime_s": 6.0, "state": "down"}, clock.now_s)
    watch.take("peer/2/lost", {"lost": True, "since_unix_s": UNIX_S + 150.0}, clock.now_s)
    lines = {each.name: each for each in readout.link_lines(station)}
    assert lines["own airtime"].text == "10% of a minute"
    assert lines["modem"].is_bad
    assert (lines["vehicle"].text, lines["vehicle"].age_s) == ("LOST", 10.0)


def test_reports_that_did_not_come_are_counted() -> None:
    clock = Clock()
    station, _ = station_at(clock)
    station.watch.take("link", LINK, clock.now_s)
    for tick in range(60):
        clock.now_s += NAV_PERIOD_S
        if tick % 4:
            station.shore.hear(NAV, nav(float(tick)), clock.now_s, way_s=1.0)
    line = next(each for each in readout.link_lines(station) if each.name == "reports")
    assert line.text == "18 of 24 in 2 min"
    assert not line.is_bad


def test_memory_of_the_link_is_bounded() -> None:
    watch = LinkWatch()
    for second in range(5000):
        last = [frame("in", second + part / 10, NAV) for part in range(8)]
        watch.take("channel", {"transmitting": None, "last": last}, float(second))
        watch.take("link", LINK | {"airtime_s": second / 10}, float(second))
        watch.take("objects", {"receiving": [{"source": 2, "transfer": second % 250,
                   "done_bytes": second, "total_bytes": None}]}, float(second))  # fmt: skip
    sizes = [len(each) for each in (watch._frames, watch._airtimes, watch._progress)]
    assert max(sizes) <= 256


def test_drawings_show_track_uncertainty_and_depth() -> None:
    shore = Shore()
    assert "<svg" in map_of(shore, None)
    for second in range(0, 60, 5):
        shore.hear(NAV, nav(float(second)), float(second))
    near, far = shore.estimate(60.0), shore.estimate(120.0)
    assert near is not None
    assert far is not None
    drawn = map_of(shore, near, [Waypoint(50.0, 50.0, 12.0)])
    assert drawn.count('fill-opacity="0.10"') == 2  # one and two standard deviations
    assert "12 m" in drawn
    assert map_of(shore, near) != map_of(shore, far)
    assert profile_of(shore, 60.0) != profile_of(shore, 90.0)
    assert profile_of(shore, 60.0) != profile_of(shore, 60.0, 20.0)
    assert "rotate(-1 60 60)" in attitude_of(nav())


def test_a_click_on_the_map_is_the_place_that_is_drawn_there() -> None:
    shore = Shore()
    shore.hear(NAV, nav(), 0.0)
    for size in ((640, 470), (300, 900)):
        view = view_of(shore, shore.estimate(1.0), [Waypoint(400.0, -30.0, 5.0)], size)
        x, y = view.place(400.0, -30.0)
        assert 0 <= x <= size[0]
        assert 0 <= y <= size[1]
        assert view.where(x, y) == pytest.approx((400.0, -30.0))


def test_a_long_track_is_drawn_thin() -> None:
    shore = Shore()
    for tick in range(2000):
        shore.hear(NAV, nav(tick / 10), 5.0 * tick)
    assert len(map_of(shore, shore.estimate(10_000.0))) < 20_000
    assert len(profile_of(shore, 10_000.0)) < 10_000


def test_each_frame_is_a_stripe_of_the_colour_of_what_matters_most_in_it() -> None:
    def of(*names: str) -> Frame:
        return Frame("out", 12, list(names), 0.0, 0.4)

    assert kind_of(of(NAV, STOP)) is STOPPING
    assert kind_of(of(STATUS, GOTO)) is MISSION
    assert kind_of(of(PHOTO)) is PICTURE
    assert kind_of(of()) is kind_of(of("what/nobody/knows")) is OTHER
    drawn = ladder_of([of(STOP), of(PHOTO)], 1.0, 10.0)
    assert drawn.count("<polygon") == 2
    assert STOPPING.colour in drawn
