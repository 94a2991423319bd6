"""Measurements: of each peer the newest of everything, whatever comes late."""

from zacoustic.core.base.linktypes import ONE_LINK, LinkMetrics, ModemRead, PeerMeasured
from zacoustic.core.peers.measurements import Measurements
from zacoustic.core.peers.peers import Peers

FIX = LinkMetrics(propagation_s=0.1, range_m=150.0, east_m=90.0, north_m=120.0, up_m=0.0)


def test_newest_value_of_each_field_is_kept() -> None:
    known = Measurements(Peers())
    known.note(2, LinkMetrics(snr_db=10.0, integrity=120.0), 1)
    known.note(2, LinkMetrics(), 2)
    known.handle(PeerMeasured(address=2, measured_at=3, metrics=LinkMetrics(snr_db=8.0)), ONE_LINK)
    assert known.metrics(2) == LinkMetrics(snr_db=8.0, integrity=120.0)
    assert known.addresses() == [2]
    assert (known.metrics(3), known.range(2), known.position(2)) == (None, None, None)


def test_what_comes_late_replaces_nothing_newer() -> None:
    known = Measurements(Peers())
    known.note(2, LinkMetrics(propagation_s=0.2, integrity=99.0), 10**9)
    known.note(2, FIX, 5 * 10**8)
    found = known.range(2)
    assert found is not None
    assert (found.propagation_s, found.range_m, found.integrity) == (0.2, None, 99.0)
    assert found.age_s(3 * 10**9) == 2.0
    position = known.position(2)
    assert position is not None
    assert (position.east_m, position.north_m, position.measured_at) == (90.0, 120.0, 5 * 10**8)


def test_direction_and_position_are_kept_apart() -> None:
    known = Measurements(Peers())
    known.note(2, FIX, 1)
    known.note(2, LinkMetrics(bearing_rad=1.5, elevation_rad=0.0, accuracy_rad=0.01), 2)
    direction, position = known.direction(2), known.position(2)
    assert direction is not None
    assert position is not None
    assert (direction.bearing_rad, direction.measured_at, position.measured_at) == (1.5, 2, 1)


def test_modem_is_what_it_last_said() -> None:
    known = Measurements(Peers())
    for battery_v in (24.0, 23.5):
        known.handle(ModemRead(read_at=1, battery_v=battery_v), ONE_LINK)
    known.handle(ModemRead(read_at=2), "radio")
    assert known.modems[ONE_LINK] == ModemRead(read_at=1, battery_v=23.5)
