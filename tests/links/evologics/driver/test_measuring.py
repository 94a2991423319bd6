"""What the driver measures: delays of exchanges, fixes of a head, readings of the modem."""

import math
from functools import partial

import pytest
from msgspec.structs import replace

from tests.links.evologics.driver.bench import IGNORED, Bench
from tests.links.evologics.driver.crew import CrewedSea, CrewNode
from tests.links.evologics.driver.sea import Sea
from tests.links.evologics.driver.test_reception import ANGLES, FIX, IM
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event
from zacoustic.core.linktypes import LinkMetrics, ModemRead, PeerMeasured, TransmitOutcome
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.streams.table import StreamTable
from zacoustic_evologics.at.notifications import SourceLevel
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import EmulatedFleet, scenario_of

DELIVERED, NOT_DELIVERED = TransmitOutcome.DELIVERED, TransmitOutcome.NOT_DELIVERED


def bench(config: EvologicsConfig | None = None) -> Bench:
    made = Bench(config=config)
    made.make_ready()
    return made


def of_peers(bench: Bench) -> list[PeerMeasured]:
    return [each for each in bench.measurements if isinstance(each, PeerMeasured)]


def of_modem(bench: Bench) -> list[ModemRead]:
    return [each for each in bench.measurements if isinstance(each, ModemRead)]


def test_capabilities_tell_what_is_measured() -> None:
    told = bench().dialogue.capabilities
    assert told.measures_range
    assert {"propagation_s", "range_m", "east_m", "bearing_rad"} <= told.measures
    told = bench(EvologicsConfig(usbl=False)).dialogue.capabilities
    assert told.measures == {"propagation_s", "range_m", "received_level_db", "integrity"}
    told = bench(EvologicsConfig(service="ims", usbl=False)).dialogue.capabilities
    assert not told.measures_range
    assert told.measures == frozenset()


def test_acknowledged_exchange_is_followed_by_its_delay_with_the_signal_of_the_answer() -> None:
    medium = bench()
    medium.modem.settings["T"] = 100_000
    report = medium.send(b"far?", 2, acknowledge=True)
    assert of_peers(medium) == []
    medium.run(0.1)
    assert of_peers(medium) == [
        PeerMeasured(
            address=2,
            measured_at=report.finished_at,
            metrics=LinkMetrics(
                propagation_s=0.1, range_m=150.0, received_level_db=-36.0, integrity=77.0
            ),
        )
    ]


def test_exchange_that_brought_nothing_is_followed_by_nothing() -> None:
    medium = bench()
    medium.send(b"all", 255)
    medium.send(b"two", 2)
    medium.modem.delivers = False
    assert medium.send(b"far?", 2, acknowledge=True).outcome is NOT_DELIVERED
    medium.run(2.0)
    assert "?T" not in medium.modem.names()
    assert of_peers(medium) == []


@pytest.mark.parametrize("delay_us", [0, -1, 9_000_000])
def test_delay_that_cannot_be_that_of_the_exchange_is_not_told(delay_us: int) -> None:
    medium = bench()
    medium.modem.settings["T"] = delay_us
    medium.send(b"far?", 2, acknowledge=True)
    medium.run(0.1)
    assert of_peers(medium) == []


def test_delay_is_not_told_if_a_message_of_another_has_come_before_the_answer() -> None:
    medium = bench()
    medium.modem.answers["?T"] = [IGNORED]
    medium.send(b"far?", 2, acknowledge=True)
    medium.run(0.01)
    medium.modem.say(replace(IM, source=3))
    medium.modem.schedule(0.0, lambda: medium.modem.write(b"4321\r\n"))
    medium.run(0.1)
    assert of_peers(medium) == []
    medium.send(b"far?", 2, acknowledge=True)
    medium.run(0.1)
    assert len(of_peers(medium)) == 1


def test_late_answer_is_not_taken_for_that_of_the_next_exchange() -> None:
    medium = bench()
    medium.modem.answers["?T"] = [IGNORED]
    medium.send(b"far?", 2, acknowledge=True)
    medium.run(5.0)
    assert of_peers(medium) == []
    medium.modem.settings["T"] = 50_000
    medium.send(b"far?", 2, acknowledge=True)
    medium.run(0.1)
    assert [each.metrics.propagation_s for each in of_peers(medium)] == [0.05]


def test_fix_becomes_a_position_at_the_instant_of_its_sound() -> None:
    medium = bench()
    medium.modem.say(replace(FIX, clock_us=10_457_376, measured_us=10_000_000))
    (found,) = of_peers(medium)
    assert found.measured_at == medium.now - 457_376_000
    assert found.metrics == LinkMetrics(
        propagation_s=0.033993, range_m=50.99, received_level_db=-48.0, integrity=140.0,
        east_m=40.0, north_m=30.0, up_m=-10.0, accuracy_m=0.9,
    )  # fmt: skip


def test_clock_that_was_set_meanwhile_is_not_believed() -> None:
    medium = bench()
    medium.modem.say(replace(FIX, clock_us=1_464_207_778_000_000, measured_us=455_600_823))
    medium.modem.say(replace(FIX, clock_us=1, measured_us=1_464_207_778_000_000))
    assert [each.measured_at for each in of_peers(medium)] == [medium.now] * 2


@pytest.mark.parametrize("accuracy_m", [51.0, 47.0, -1.0])
def test_fix_as_uncertain_as_it_is_far_is_a_range_only(accuracy_m: float) -> None:
    medium = bench()
    medium.modem.say(replace(FIX, accuracy_m=accuracy_m))
    (found,) = of_peers(medium)
    assert (found.metrics.propagation_s, found.metrics.range_m) == (0.033993, 50.99)
    assert (found.metrics.east_m, found.metrics.accuracy_m) == (None, None)


def test_angles_become_a_direction_counted_from_the_north() -> None:
    medium = bench()
    for towards, expected in ((0.0, 90.0), (90.0, 0.0), (180.0, 270.0), (-90.0, 180.0)):
        medium.modem.say(replace(ANGLES, bearing_rad=math.radians(towards)))
        bearing_rad = of_peers(medium)[-1].metrics.bearing_rad
        assert bearing_rad is not None
        assert 0.0 <= bearing_rad < math.tau
        assert math.cos(bearing_rad - math.radians(expected)) == pytest.approx(1.0)
    assert of_peers(medium)[-1].metrics.elevation_rad == -0.2
    medium.modem.say(replace(ANGLES, accuracy_rad=-1.0))
    assert len(of_peers(medium)) == 4


def test_modem_tells_of_itself_at_the_start_and_when_its_level_changes() -> None:
    medium = bench()
    (first,) = of_modem(medium)
    assert (first.firmware, first.battery_v, first.relative_source_level_db) == ("1.9", 24.1, -20.0)
    medium.modem.say(SourceLevel(1))
    assert [each.relative_source_level_db for each in of_modem(medium)] == [-20.0, -6.0]


def test_supply_is_read_again_behind_a_frame_now_and_then() -> None:
    medium = bench()
    read = medium.modem.names().count("?BV")
    medium.send(b"one")
    medium.send(b"two")
    assert medium.modem.names().count("?BV") == read
    medium.run(400.0)
    assert medium.modem.names().count("?BV") == read
    medium.modem.answers["?BV"] = ["22.5000"]
    for _ in range(3):
        medium.send(b"three")
        medium.run(0.1)
    assert medium.modem.names().count("?BV") == read + 1
    assert of_modem(medium)[-1].battery_v == 22.5
    assert medium.dialogue.poll_timeout() is None


# On emulated modems

USBL = Scenario(
    nodes=(
        NodeSpec(address=1, position=(0.0, 0.0, 5.0)),
        NodeSpec(address=2, position=(300.0, -400.0, 55.0)),
    ),
    channel="none",
)


def test_emulated_head_gives_range_position_and_direction() -> None:
    sea = Sea(USBL)
    sea.make_ready()
    report = sea.send(1, b"where?", 2, acknowledge=True)
    sea.run(5.0)
    found = [each for each in sea[1].measurements if isinstance(each, PeerMeasured)]
    delay, fix = found
    distance_m = math.hypot(300, 400, 50)
    assert delay.metrics.range_m == pytest.approx(distance_m, abs=0.01)
    assert delay.measured_at == report.finished_at
    place = (fix.metrics.east_m, fix.metrics.north_m, fix.metrics.up_m)
    assert place == pytest.approx((300, -400, -50), abs=5)
    assert fix.metrics.accuracy_m == pytest.approx(0.008 * distance_m, rel=1e-3)
    assert report.started_at < fix.measured_at < report.finished_at
    (heard,) = [each for each in sea[2].measurements if isinstance(each, PeerMeasured)]
    bearing_rad, elevation_rad = heard.metrics.bearing_rad, heard.metrics.elevation_rad
    assert bearing_rad is not None
    assert math.degrees(bearing_rad) == pytest.approx(
        math.degrees(math.atan2(-300, 400)) % 360, abs=1.2
    )
    assert elevation_rad == pytest.approx(math.asin(50 / distance_m), abs=0.02)


def test_engine_on_driver_on_emulator_gets_a_range_or_a_failure_in_time() -> None:
    told: list[tuple[int, Event]] = []

    def ask(peer: int, engine: Engine, now: int) -> int:
        return engine.ranging.request(peer, now, timeout_s=40)

    def deliver(node: CrewNode, event: Event) -> None:
        told.append((node.address, event))

    fleet = EmulatedFleet(scenario_of(2, spacing_m=1500.0))
    table = StreamTable(nodes={1: "shore", 2: "auv1", 3: "absent"})
    sea = CrewedSea(fleet, table, deliver, config=EvologicsConfig())
    sea.make_ready()
    node = sea.crew[0]
    for peer in (2, 3):
        asked_at = sea.now
        sea.apply(node, partial(ask, peer))
        sea.run(45.0)
        assert sea.now - asked_at == 45 * NS_PER_S
    (measured,) = [event for _, event in told if isinstance(event, RangeMeasured)]
    assert measured.range.range_m == pytest.approx(1500.0, rel=0.01)
    assert measured.range.integrity is not None
    (failed,) = [event for _, event in told if isinstance(event, RangeFailed)]
    assert failed.text == "no range within 40 s: not delivered (FAILEDIM,3)"
    assert node.engine.is_idle
    assert seconds_to_ns(1) < sea.now
