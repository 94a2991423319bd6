"""What is heard: frames, metrics, readings, the carrier."""

import pytest
from msgspec.structs import replace

from tests.links.evologics.driver.bench import Bench, ScriptedModem
from zacoustic.core.linktypes import LinkMetrics, TransmitOutcome
from zacoustic_evologics.at.framing import Framing, Interpreter
from zacoustic_evologics.at.notifications import (
    DropCount,
    ImFlag,
    Recv,
    RecvEnd,
    RecvFailed,
    RecvIm,
    RecvIms,
    RecvPbm,
    RecvStart,
    SendEnd,
    SendStart,
)
from zacoustic_evologics.at.usbl import UsblAngles, UsblLong
from zacoustic_evologics.config import EvologicsConfig

IM = RecvIm(
    payload=b"hello", source=2, destination=1, flag=ImFlag.NOACK, duration_us=204_800,
    rssi_db=-45, integrity=133, velocity_m_s=0.0458,
)  # fmt: skip
IMS = RecvIms(
    payload=b"hello", source=2, destination=255, timestamp_us=91, duration_us=204_800,
    rssi_db=-45, integrity=133, velocity_m_s=0.0458,
)  # fmt: skip
PBM = RecvPbm(
    payload=b"hello", source=2, destination=1, duration_us=204_800,
    rssi_db=-45, integrity=133, velocity_m_s=0.0458,
)  # fmt: skip
BURST = Recv(
    payload=b"hello", source=2, destination=1, bit_rate_bps=6900, propagation_us=120_450,
    rssi_db=-45, integrity=133, velocity_m_s=0.0458,
)  # fmt: skip
OLD_IM = RecvIm(
    payload=b"hello", source=2, destination=1, flag=ImFlag.NOACK, bit_rate_bps=976,
    propagation_us=120_450, rssi_db=-45, integrity=133, velocity_m_s=0.0458,
)  # fmt: skip
FIX = UsblLong(
    clock_us=2, measured_us=1, address=2, x_m=1.0, y_m=2.0, z_m=3.0, east_m=40.0, north_m=30.0,
    up_m=-10.0, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0, propagation_us=33_993, rssi_db=-48,
    integrity=140, accuracy_m=0.9,
)  # fmt: skip
ANGLES = UsblAngles(
    clock_us=2, measured_us=1, address=2, local_bearing_rad=0.1, local_elevation_rad=0.2,
    bearing_rad=0.9, elevation_rad=-0.2, roll_rad=0.0, pitch_rad=0.0, yaw_rad=0.0, rssi_db=-48,
    integrity=140, accuracy_rad=0.015,
)  # fmt: skip


@pytest.fixture(params=list(Framing))
def bench(request: pytest.FixtureRequest) -> Bench:
    lines = request.param is Framing.LINES
    bench = Bench(ScriptedModem(Interpreter.NET if lines else Interpreter.AT, request.param))
    bench.make_ready()
    return bench


@pytest.mark.parametrize("record", [IM, IMS, PBM, BURST, OLD_IM])
def test_every_kind_of_message_is_a_frame_with_its_metrics(
    bench: Bench, record: RecvIm | RecvIms | RecvPbm | Recv
) -> None:
    bench.modem.say(record)
    (frame,) = bench.frames
    assert frame.frame_bytes == b"hello"
    assert (frame.source, frame.destination) == (2, record.destination)
    assert frame.received_at == bench.now
    delay_s = 0.12045 if getattr(record, "propagation_us", None) else None
    assert frame.metrics == LinkMetrics(
        received_level_db=-45.0, integrity=133.0, propagation_s=delay_s, range_rate_m_s=0.0458,
        range_m=180.675 if delay_s else None,
    )  # fmt: skip
    reports = bench.dialogue.capabilities.reports
    assert reports == {"received_level_db", "integrity", "range_rate_m_s"}
    assert all(getattr(frame.metrics, name) is not None for name in reports)


def test_message_for_another_is_counted_only(bench: Bench) -> None:
    bench.modem.say(replace(IM, destination=9))
    assert bench.frames == []
    assert bench.dialogue.diagnostics()["for_others"] == 1


def test_what_cannot_be_a_second_message_is_a_repetition(bench: Bench) -> None:
    bench.modem.say(IM)
    bench.run(0.15)
    bench.modem.say(IM)
    assert len(bench.frames) == 1
    assert bench.dialogue.diagnostics()["repetitions"] == 1
    bench.run(0.3)
    bench.modem.say(IM)
    bench.modem.say(replace(IM, payload=b"other"))
    bench.modem.say(replace(IM, source=3))
    assert len(bench.frames) == 4


def test_message_without_a_sound_is_a_repetition_where_sounds_are_told(bench: Bench) -> None:
    end = RecvEnd(clock_us=1, duration_us=2, rssi_db=-40, integrity=100)
    bench.modem.say(IM)
    bench.run(5.0)
    bench.modem.say(IM)
    assert len(bench.frames) == 2, "this firmware may not tell of sounds"
    bench.modem.say(end)
    bench.modem.say(IM)
    assert len(bench.frames) == 2, "sooner than it can be"
    bench.run(5.0)
    bench.modem.say(IM)
    assert len(bench.frames) == 2
    bench.modem.say(RecvStart())
    bench.modem.say(end)
    bench.modem.say(IM)
    assert len(bench.frames) == 2
    bench.run(5.0)
    bench.modem.say(end)
    bench.modem.say(IM)
    assert len(bench.frames) == 3


def test_synchronous_message_with_the_same_start_is_a_repetition(bench: Bench) -> None:
    bench.modem.say(IMS)
    bench.run(50.0)
    bench.modem.say(IMS)
    bench.modem.say(replace(IMS, timestamp_us=92))
    assert len(bench.frames) == 2


def test_carrier_follows_what_begins_and_ends(bench: Bench) -> None:
    end = RecvEnd(clock_us=1, duration_us=2, rssi_db=-40, integrity=100)
    bench.modem.say(RecvStart())
    bench.modem.say(RecvStart())
    assert bench.carrier == [True]
    bench.modem.say(end)
    bench.modem.say(IM)
    assert bench.carrier == [True, False]
    bench.modem.say(RecvStart())
    bench.modem.say(RecvFailed(velocity_m_s=0.0, rssi_db=-70, integrity=40))
    assert bench.carrier == [True, False] * 2
    assert bench.dialogue.diagnostics()["receptions_failed"] == 1
    bench.modem.say(SendStart(destination=2, kind="ack", duration_us=139_376, delay_us=0))
    bench.modem.say(SendEnd(destination=2, kind="ack", clock_us=1, duration_us=139_376))
    assert bench.carrier == [True, False] * 3


def test_own_frame_is_no_carrier(bench: Bench) -> None:
    assert bench.send(b"own").outcome is TransmitOutcome.SENT
    assert bench.carrier == []


def test_carrier_whose_end_is_not_told_ends_by_itself(bench: Bench) -> None:
    bench.modem.say(RecvStart())
    bench.run(2.9)
    assert bench.carrier == [True]
    bench.run(0.2)
    assert bench.carrier == [True, False]
    assert bench.dialogue.poll_timeout() is None


def test_carrier_ends_with_the_link(bench: Bench) -> None:
    bench.modem.say(RecvStart())
    bench.cut()
    assert bench.carrier == [True, False]


def test_without_extended_notifications_there_is_no_carrier() -> None:
    bench = Bench(config=EvologicsConfig(extended_notifications=False))
    bench.make_ready()
    assert not bench.dialogue.capabilities.senses_carrier
    bench.modem.say(RecvStart())
    assert bench.carrier == []


def test_fixes_and_signal_are_among_the_readings(bench: Bench) -> None:
    bench.modem.say(FIX)
    bench.modem.say(ANGLES)
    bench.modem.say(DropCount(64))
    bench.modem.say(IM)
    assert bench.frames[-1].metrics.propagation_s is None
    told = bench.dialogue.diagnostics()
    expected = {
        "peer_2_east_m": 40.0, "peer_2_north_m": 30.0, "peer_2_up_m": -10.0,
        "peer_2_accuracy_m": 0.9, "peer_2_bearing_rad": 0.9, "peer_2_elevation_rad": -0.2,
        "peer_2_propagation_s": 0.033993, "peer_2_range_m": 50.99, "battery_v": 24.1,
        "source_level": 3, "received_level_db_re_1v": -45, "integrity": 133,
        "range_rate_m_s": 0.0458, "raw_bytes_dropped": 64,
        "firmware": "1.9", "address": 1, "highest_address": 14,
    }  # fmt: skip
    assert {name: told.get(name) for name in expected} == expected
    assert all(isinstance(value, int | float | str) for value in told.values())


def test_angles_without_a_fix_are_not_taken(bench: Bench) -> None:
    bench.modem.say(replace(ANGLES, accuracy_rad=-1.0))
    assert not any(name.endswith("bearing_rad") for name in bench.dialogue.diagnostics())


def test_rest_of_a_record_that_never_comes_does_not_hold_up_the_next() -> None:
    bench = Bench()
    bench.make_ready()
    bench.to_dialogue(b"RECVIM,64,2,1,ack,204800,-45,133,0.0458,hel")
    assert bench.dialogue.poll_timeout() is not None
    bench.run(1.5)
    assert bench.dialogue.poll_timeout() is None
    bench.modem.say(IM)
    assert [each.frame_bytes for each in bench.frames] == [b"hello"]
    assert bench.dialogue.diagnostics()["unrecognised"] == 1
