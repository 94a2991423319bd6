"""The beat, and what a publisher takes its receiver to know of it."""

from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.transport.reliable.rhythm import Beat, SendRhythm

LINK = LinkCapabilities(
    mtu_bytes=64,
    bit_rate_bps=720,
    preamble_s=0.15,
    gap_s=0.09,
    propagation_s=1.0,
    senses_carrier=True,
)
TIMES = LinkTimes(LINK)


class Publisher:
    """Sends samples for the first time, and is acknowledged or not."""

    def __init__(self, **qos: float) -> None:
        self.rhythm = SendRhythm(Qos(**({"depth": 40} | qos)))  # type: ignore[arg-type]
        self.number = 0
        self.expected = 0

    def send(self, at_s: float, *, answered: bool = True) -> bool:
        """Send the next sample; returns whether it is marked."""
        at = seconds_to_ns(at_s)
        marked = self.rhythm.marks(self.number, self.expected, at)
        self.rhythm.first_sent(self.number, self.expected, at, TIMES)
        self.number += 1
        if answered:
            self.expected = self.number
        return marked

    def series(self, *at_s: float) -> list[bool]:
        """Send several, each answered."""
        return [self.send(each) for each in at_s]

    @property
    def is_known(self) -> bool:
        """The receiver would ask for the next one."""
        return self.rhythm.is_known(self.number, self.expected)


def test_beat_goes_on_by_the_mean_of_what_it_was() -> None:
    beat = Beat()
    assert beat.due_at(1) is None
    beat.begin(0, 1000)
    beat.goes_on(2, 1200)
    assert (beat.due_at(3), beat.due_at(5)) == (1300, 1500)
    beat.goes_on(3, 1340)
    assert beat.due_at(4) == 1340 + 110
    beat.changes(4, 1400)
    assert beat.due_at(5) == 1460


def test_third_sample_in_equal_steps_is_marked_and_two_acknowledged_ones_are_known() -> None:
    publisher = Publisher()
    assert publisher.series(0, 10, 20) == [False, False, True]
    assert not publisher.is_known
    assert publisher.send(30.1) is True, "a little late"
    assert publisher.is_known


def test_samples_off_the_beat_are_not_marked_and_end_the_rhythm() -> None:
    publisher = Publisher()
    assert publisher.series(0, 10, 20, 30, 40)[2:] == [True] * 3
    assert publisher.send(43) is False
    assert not publisher.is_known
    assert publisher.series(53, 63, 73) == [False, True, True]
    assert publisher.is_known


def test_answer_is_wanted_after_a_few_unanswered_and_nothing_is_believed_after_twice_as_many() -> (
    None
):
    publisher = Publisher()
    publisher.series(0, 10, 20, 30)
    marks = [publisher.send(40 + 10 * each, answered=False) for each in range(6)]
    assert marks == [True] * 4 + [False] * 2
    assert publisher.is_known
    publisher.send(100, answered=False)
    assert not publisher.is_known


def test_own_repetition_ends_it() -> None:
    publisher = Publisher()
    publisher.series(0, 10, 20, 30)
    publisher.rhythm.end()
    assert not publisher.is_known
    assert publisher.series(40, 50) == [True, True]
    assert publisher.is_known


def test_no_rhythm_where_round_trips_do_not_fit_between_or_nobody_would_wait() -> None:
    round_trip_s = TIMES.first_round_trip_ns / NS_PER_S
    for period_s, marked in ((1.9, False), (2.1, True), (31, True), (33, False)):
        steps = [each * period_s * round_trip_s for each in range(5)]
        assert any(Publisher().series(*steps)) is marked


def test_no_rhythm_where_the_stream_keeps_too_little_to_wait() -> None:
    for qos in ({"depth": 1}, {"depth": 3}, {"lifespan_s": 35.0}):
        assert not any(Publisher(**qos).series(0, 10, 20, 30, 40)), qos
    brief = Publisher(lifespan_s=45.0)
    brief.series(0, 10, 20, 30)
    marks = [brief.send(40 + 10 * each, answered=False) for each in range(3)]
    assert marks == [True, True, False]
