"""Clock: seconds outside, integer nanoseconds inside."""

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.clock import ns_to_seconds, seconds_to_ns


@given(st.integers(0, 10**15))
def test_instants_survive_the_way_through_seconds_to_a_microsecond(instant: int) -> None:
    assert abs(seconds_to_ns(ns_to_seconds(instant)) - instant) <= 1000


def test_seconds_become_the_nearest_nanosecond() -> None:
    assert seconds_to_ns(0.1) == 100_000_000
    assert seconds_to_ns(1.2e-9) == 1
