"""When it is time to repeat: from airtimes, then from what was measured."""

import random

import msgspec
import pytest

from zacoustic.core.base.qos import Priority
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.timing import LinkTimes, Pacer

LINK = LinkCapabilities(
    mtu_bytes=64,
    bit_rate_bps=720,
    preamble_s=0.15,
    gap_s=0.09,
    propagation_s=1.0,
    senses_carrier=True,
)
TIMES = LinkTimes(LINK)


def pause_s(
    timing: Pacer, rank: int = 0, spread_ns: int = 0, priority: Priority = Priority.DATA
) -> float:
    """The shortest pause that is drawn."""
    rng = random.Random(1)
    drawn = [timing.pause_ns(TIMES, rank, rng, priority, spread_ns=spread_ns) for _ in range(1000)]
    assert max(drawn) - min(drawn) >= 0.98 * TIMES.doubt_ns
    return min(drawn) / NS_PER_S


def unanswered(timing: Pacer, times: int, *, since: int = 0) -> None:
    for number in range(since, since + times):
        timing.unanswered(number * TIMES.first_round_trip_ns, TIMES)


def test_first_guess_is_what_the_link_says() -> None:
    first_s = pause_s(Pacer())
    ack_s = LINK.airtime_ns(5) / NS_PER_S
    assert first_s == pytest.approx(2 + 0.09 + 0.075 + ack_s + 0.09 + 0.15 + 8 * 8 / 720, abs=1e-2)
    assert pause_s(Pacer(), rank=3) == pytest.approx(first_s + 3 * (ack_s + 0.09), abs=1e-2)


def test_link_without_carrier_sense_lets_the_next_frame_pass() -> None:
    deaf = LinkTimes(LinkCapabilities(mtu_bytes=64, bit_rate_bps=720, propagation_s=1.0))
    assert deaf.next_frame_ns == pytest.approx(64 * 8 / 720 * NS_PER_S)
    assert TIMES.next_frame_ns == 0


def test_pause_follows_what_was_measured() -> None:
    timing = Pacer()
    for _ in range(50):
        timing.measured(500_000_000, TIMES)
    assert pause_s(timing) == pytest.approx(0.5 + TIMES.doubt_ns / NS_PER_S, abs=1e-2)
    timing.measured(1_500_000_000, TIMES)
    assert pause_s(timing) > 1.5


def test_spread_is_waited_for_on_top() -> None:
    assert pause_s(Pacer(), spread_ns=NS_PER_S) == pytest.approx(pause_s(Pacer()) + 1, abs=1e-2)


def test_repetitions_to_a_silent_node_become_rare_and_stay_finite() -> None:
    timing, pauses = Pacer(), []
    for number in range(40):
        pauses.append(pause_s(timing))
        timing.unanswered(number * TIMES.first_round_trip_ns, TIMES)
    assert pauses[2] == pytest.approx(pauses[0], abs=1e-2)
    assert pauses[5:20] == sorted(pauses[5:20])
    assert pauses[-1] == pytest.approx(0.75 * 17.5 * pauses[0], rel=1e-2)


def test_repetitions_stay_frequent_where_answers_usually_take_several() -> None:
    timing = Pacer()
    for turn in range(6):  # the sixth is answered, again and again
        unanswered(timing, 5, since=100 * turn)
        timing.answered(in_crowd=False)
    for number in range(14):
        assert not timing.is_silent, number
        unanswered(timing, 1, since=1000 + number)
    unanswered(timing, 20, since=2000)
    assert timing.is_silent


def test_node_that_was_away_for_long_teaches_nothing() -> None:
    timing = Pacer()
    for turn in range(3):
        unanswered(timing, 40, since=100 * turn)
        timing.answered(in_crowd=False)
    unanswered(timing, 5, since=1000)
    assert timing.is_silent


@pytest.mark.parametrize("in_vain", [0, 1, 2, 3, 8, 20])
@pytest.mark.parametrize("senses_carrier", [True, False])
def test_what_is_drawn_is_as_long_as_what_may_be_under_way(
    senses_carrier: bool, in_vain: int
) -> None:
    times = LinkTimes(msgspec.structs.replace(LINK, senses_carrier=senses_carrier))
    timing, rng = Pacer(), random.Random(1)
    for number in range(in_vain):
        timing.unanswered(number * times.first_round_trip_ns, times)
    for frames in (1, 2):
        for at_most_ns in (None, NS_PER_S, 60 * NS_PER_S):
            drawn = [
                timing.pause_ns(times, 0, rng, Priority.DATA, frames=frames, at_most_ns=at_most_ns)
                for _ in range(1000)
            ]
            least_ns = frames * (LINK.airtime_ns(64) + times.gap_ns)
            if senses_carrier and in_vain < 2:
                least_ns = times.doubt_ns
            assert max(drawn) - min(drawn) >= 0.98 * least_ns
            assert min(drawn) >= times.first_round_trip_ns


DELEGATED = LinkTimes(
    LinkCapabilities(mtu_bytes=64, bit_rate_bps=48_000, preamble_s=0.4, controls_access=True)
)


def test_guess_about_a_device_that_controls_access_is_doubted_until_it_is_measured() -> None:
    timing, rng, pauses = Pacer(), random.Random(1), []
    for number in range(6):
        pauses.append(timing.pause_ns(DELEGATED, 0, rng, Priority.DATA))
        timing.unanswered(number * DELEGATED.first_round_trip_ns, DELEGATED)
    guess_ns = DELEGATED.first_round_trip_ns
    for number, pause_ns in enumerate(pauses[1:], 1):
        assert 0.75 * 2**number <= pause_ns / guess_ns <= 1.5 * 2**number
    # An answer to what went several times does not end that, and nor does a further record.
    timing.answered(in_crowd=False)
    timing.begin(NS_PER_S)
    assert timing.pause_ns(DELEGATED, 0, rng, Priority.DATA) > 0.75 * 16 * guess_ns
    timing.measured(3 * guess_ns, DELEGATED)
    timing.answered(in_crowd=False)
    assert timing.pause_ns(DELEGATED, 0, rng, Priority.DATA) < 12 * guess_ns


def test_round_trip_that_took_long_makes_repetitions_no_rarer_than_a_silent_node_does() -> None:
    timing = Pacer()
    timing.measured(20 * TIMES.first_round_trip_ns, TIMES)
    usual_s = pause_s(timing)
    for number in range(40):
        timing.unanswered(number * TIMES.first_round_trip_ns, TIMES)
    assert pause_s(timing) == pytest.approx(0.75 * 4 * usual_s, rel=1e-2)


def test_what_is_due_together_counts_once() -> None:
    timing = Pacer()
    for _ in range(40):
        timing.unanswered(5, TIMES)
    assert pause_s(timing) == pytest.approx(pause_s(Pacer()), abs=1e-2)


def test_first_frame_of_a_silent_node_releases_a_turn_and_little_more() -> None:
    timing = Pacer()
    assert not timing.heard(0)
    unanswered(timing, 14)
    assert timing.is_doubtful(TIMES)
    assert timing.heard(0)
    timing.unanswered(20 * TIMES.first_round_trip_ns, TIMES)
    assert pause_s(timing) == pytest.approx(0.75 * 9 * pause_s(Pacer()), rel=1e-2)
    timing.answered(in_crowd=False)
    assert pause_s(timing) == pytest.approx(pause_s(Pacer()), abs=1e-2)


def test_answer_ends_the_doubt_except_in_a_crowd() -> None:
    alone, crowded = Pacer(), Pacer()
    for timing in (alone, crowded):
        unanswered(timing, 14)
    alone.answered(in_crowd=False)
    crowded.answered()
    assert not alone.is_doubtful(TIMES)
    assert crowded.is_doubtful(TIMES)


def test_emergency_does_not_become_rare_while_the_node_is_heard() -> None:
    timing = Pacer()
    first_s = pause_s(timing)
    for number in range(14):
        timing.unanswered(number * TIMES.first_round_trip_ns, TIMES)
        timing.heard(0)
    assert pause_s(timing) > 8 * first_s
    for _ in range(2):  # nor while it is not
        rng = random.Random(1)
        drawn = [timing.pause_ns(TIMES, 0, rng, Priority.REAL_TIME) for _ in range(1000)]
        assert 1.4 * first_s * NS_PER_S < min(drawn) < max(drawn) <= 10 * NS_PER_S
        assert timing.is_doubtful(TIMES)
        unanswered(timing, 28, since=100)


def test_emergency_does_not_wait_for_the_answer_to_something_else() -> None:
    timing = Pacer()
    timing.await_answer(5 * NS_PER_S, 100 * NS_PER_S)
    assert timing.ready_at(TIMES, Priority.DATA) == 100 * NS_PER_S
    ready_at = 5 * NS_PER_S + TIMES.first_round_trip_ns
    for priority, in_haste in ((Priority.REAL_TIME, False), (Priority.DATA, True)):
        at = timing.ready_at(TIMES, priority, in_haste=in_haste)
        assert at == pytest.approx(ready_at, abs=TIMES.doubt_ns)


def test_what_comes_sooner_than_the_link_allows_is_no_round_trip() -> None:
    pacer = Pacer()
    pacer.measured(TIMES.first_round_trip_ns // 65, TIMES)
    assert (pacer.shortest_ns, pacer.smooth_ns) == (None, 0)
    pacer.measured(TIMES.first_round_trip_ns // 2, TIMES)
    assert pacer.smooth_ns == TIMES.first_round_trip_ns // 2
