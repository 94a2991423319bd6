"""Durations: the published table, and what lies between its rows."""

import pytest

from zacoustic_evologics.airtime import (
    ACKNOWLEDGEMENT_NS,
    burst_airtime_ns,
    equivalent_bytes,
    im_airtime_ns,
    service_airtime_ns,
)


@pytest.mark.parametrize(
    ("size", "duration_us"),
    [(1, 172_102), (4, 196_696), (20, 368_760), (53, 745_623), (64, 860_338)],
)
def test_published_durations_are_met(size: int, duration_us: int) -> None:
    assert im_airtime_ns(size) == duration_us * 1000


def test_durations_grow_with_every_byte_and_are_whole_microseconds() -> None:
    durations = [im_airtime_ns(size) for size in range(1, 129)]
    assert durations == sorted(set(durations))
    assert all(duration % 1000 == 0 for duration in durations)
    assert im_airtime_ns(7) == pytest.approx(229_376_000, rel=1e-3)  # a vendor's example
    assert all(abs(im_airtime_ns(n) / 1e9 - (0.1503 + 0.01109 * n)) < 0.02 for n in range(1, 65))


def test_other_signals_are_as_vulnerable_as_the_message_of_their_length() -> None:
    assert service_airtime_ns(0) == ACKNOWLEDGEMENT_NS
    assert service_airtime_ns(7) == im_airtime_ns(7)
    assert equivalent_bytes(ACKNOWLEDGEMENT_NS) == 1
    assert equivalent_bytes(im_airtime_ns(40)) == 40
    assert equivalent_bytes(burst_airtime_ns(1024, 2400)) == 64
