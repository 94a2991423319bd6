import itertools
import random

import pytest

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import LinkCapabilities, Transmission, TransmitOutcome
from zacoustic_desert.config import DesertConfig
from zacoustic_desert.pacing import Pacer

MS = NS_PER_S // 1000
CAPABILITIES = LinkCapabilities(mtu_bytes=64, bit_rate_bps=8000.0, preamble_s=0.2)
SENT, ABORTED, REJECTED = (
    TransmitOutcome.SENT,
    TransmitOutcome.ABORTED,
    TransmitOutcome.REJECTED,
)


def frame(number: int, size: int = 10) -> Transmission:
    return Transmission(transmission_id=number, frame_bytes=bytes(size))


def test_frame_is_written_at_once_and_reported_when_its_time_is_over() -> None:
    pacer = Pacer(CAPABILITIES)
    assert pacer.poll_timeout() is None
    pacer.submit(frame(1), 5 * MS)
    assert pacer.poll_write(5 * MS) == bytes(10)
    assert pacer.poll_write(5 * MS) is None
    assert pacer.poll_timeout() == 215 * MS
    assert pacer.poll_report(215 * MS - 1) is None
    report = pacer.poll_report(300 * MS)
    assert report is not None
    assert (report.outcome, report.started_at, report.finished_at) == (SENT, 5 * MS, 215 * MS)
    assert pacer.poll_report(300 * MS) is None
    assert pacer.poll_timeout() is None


def test_second_frame_is_rejected_and_the_first_goes_on() -> None:
    pacer = Pacer(CAPABILITIES)
    pacer.submit(frame(1), 0)
    pacer.submit(frame(2), 1)
    assert pacer.poll_timeout() == 0, "a report waits"
    report = pacer.poll_report(1)
    assert report is not None
    assert (report.transmission_id, report.outcome) == (2, REJECTED)
    assert report.detail == "transmission 1 is outstanding"
    assert pacer.poll_write(1) == bytes(10)


def test_pace_holds_across_a_lost_connection() -> None:
    pacer = Pacer(CAPABILITIES)
    pacer.submit(frame(1), 0)
    pacer.poll_write(0)
    pacer.abort("closed by the other side", 10 * MS)
    pacer.abort("again", 11 * MS)
    report = pacer.poll_report(11 * MS)
    assert report is not None
    assert (report.outcome, report.finished_at) == (ABORTED, 10 * MS)
    pacer.submit(frame(2), 20 * MS)
    assert pacer.poll_write(209 * MS) is None
    assert pacer.poll_timeout() == 210 * MS
    assert pacer.poll_write(210 * MS) == bytes(10)


@pytest.mark.parametrize("seed", range(20))
def test_each_transmission_has_one_report_and_writes_keep_their_distance(seed: int) -> None:
    rng = random.Random(seed)
    pacer, now = Pacer(CAPABILITIES), 0
    reported: list[int] = []
    writes: list[tuple[int, int]] = []
    for number in range(300):
        match rng.randrange(4):
            case 0:
                pacer.abort("lost", now)
            case 1:
                pacer.refuse(frame(number + 1000), REJECTED, "no", now)
            case _:
                pass
        pacer.submit(frame(number, rng.randint(1, 64)), now)
        now += rng.randrange(150 * MS)
        written = pacer.poll_write(now)
        if written is not None:
            writes.append((now, len(written)))
        while (report := pacer.poll_report(now)) is not None:
            assert report.started_at <= report.finished_at <= now
            reported.append(report.transmission_id)
    pacer.abort("closed", now)
    while (report := pacer.poll_report(now)) is not None:
        reported.append(report.transmission_id)
    assert len(reported) == len(set(reported))
    assert {number for number in reported if number < 1000} == set(range(300))
    for (before, size), (after, _) in itertools.pairwise(writes):
        assert after - before >= CAPABILITIES.airtime_ns(size)


def test_pace_of_the_defaults_is_what_the_sample_script_carries() -> None:
    told = DesertConfig().capabilities()
    # Measured at saturation: 2.77 packets of 64 bytes and 2.21 of 512 bytes in a second.
    assert 2.2 < NS_PER_S / told.airtime_ns(64) < 2.77
    assert 1.8 < NS_PER_S / DesertConfig(max_read_length=512).capabilities().airtime_ns(512) < 2.21
    assert DesertConfig(listen_s=0.0).capabilities().airtime_ns(64) >= 200 * MS
    assert DesertConfig(period_s=10.0).capabilities().airtime_ns(1) >= 10 * NS_PER_S


WRONG = [
    ({"max_read_length": 16}, r"max_read_length is 16; allowed: a number, 17\.\.4096"),
    ({"max_read_length": 4097}, r"max_read_length is 4097; allowed: a number, 17\.\.4096"),
    ({"max_read_length": 17, "framing": "rmw_desert"}, r"allowed: 18\.\.4096"),
    ({"period_s": 0.0}, "period_s is 0.0; allowed: seconds, above 0"),
    ({"period_s": float("nan")}, "period_s is nan"),
    ({"listen_s": -1.0}, "listen_s is -1"),
    ({"latency_s": float("inf")}, "latency_s is inf"),
    ({"bit_rate_bps": 0.0}, "bit_rate_bps is 0"),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "message"), WRONG)
def test_settings_outside_their_range_are_named(settings: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DesertConfig(**settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("settings", "mtu_bytes", "framed"),
    [
        ({}, 64, False),
        ({"max_read_length": 17}, 17, False),
        ({"max_read_length": 4096}, 4096, False),
        ({"framing": "rmw_desert"}, 60, True),
        ({"framing": "rmw_desert", "max_read_length": 18}, 14, True),
        ({"framing": "rmw_desert", "max_read_length": 512}, 255, True),
    ],
)
def test_link_tells_what_it_lacks(
    settings: dict[str, object], mtu_bytes: int, framed: bool
) -> None:
    told = DesertConfig(**settings).capabilities()  # type: ignore[arg-type]
    assert (told.mtu_bytes, told.framed) == (mtu_bytes, framed)
    assert (told.addressed, told.checked, told.acknowledges) == (False, False, False)
    assert told.controls_access
