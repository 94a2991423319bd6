"""Network time: an offset, its error, and doubt after a jump."""

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.schedule.access.networktime import SETTLING_NS, NetworkTime

MS = NS_PER_S // 1000


def test_error_grows_by_drift_until_it_is_told_again() -> None:
    time = NetworkTime(drift_ppm=50)
    assert time.error_at(0) is None
    time.tell(7, MS, 0)
    assert time.offset_ns == 7
    assert time.error_at(0) == MS
    assert time.error_at(100 * NS_PER_S) == MS + 5 * MS
    time.tell(7 + 2 * MS, MS, 100 * NS_PER_S)
    assert time.offset_ns == 7 + 2 * MS
    assert time.error_at(100 * NS_PER_S) == MS


def test_statement_that_is_worse_than_what_is_known_changes_nothing() -> None:
    time = NetworkTime(drift_ppm=50)
    time.tell(0, MS, 0)
    time.tell(10 * MS, 20 * MS, NS_PER_S)
    assert time.offset_ns == 0


def test_jump_is_doubted_until_a_later_statement_agrees() -> None:
    time = NetworkTime(drift_ppm=0)
    time.tell(0, MS, 0)
    assert time.sure_at is None
    time.tell(10**18, MS, NS_PER_S)
    assert time.error_at(NS_PER_S) is None
    assert time.sure_at == NS_PER_S + SETTLING_NS
    time.tell(10**18, MS, 2 * NS_PER_S)
    assert time.error_at(2 * NS_PER_S) is None
    time.tell(10**18, MS, NS_PER_S + SETTLING_NS)
    assert time.error_at(NS_PER_S + SETTLING_NS) == MS


def test_clock_that_jumps_again_and_again_is_never_trusted() -> None:
    time = NetworkTime(drift_ppm=0)
    for step in range(20):
        time.tell(step * NS_PER_S, MS, step * 6 * NS_PER_S)
        assert step == 0 or time.error_at(step * 6 * NS_PER_S) is None
