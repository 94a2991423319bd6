"""Repeated records: sent again until stopped, a few frames at a time, and rarely to the silent."""

import random

from tests.core.rig import link
from zacoustic.core.base.parts import Part
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.timers import Timers
from zacoustic.core.linktypes import TransmitOutcome, TransmitReport
from zacoustic.core.peers.peers import Peers
from zacoustic.core.schedule.pacers import Pacers
from zacoustic.core.schedule.queue import QueuedRecord, TransmitQueue
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.transport.exchanges.repeating import Repeater, Repetition

SLOW = {"bit_rate_bps": 1000, "propagation_s": 1.0}
TIMES = LinkTimes(link(**SLOW))
ROUND_TRIP_NS = TIMES.first_round_trip_ns
FOREVER = 1 << 60


class Sea:
    """A repeater and its queue; whatever waits is sent when the test says so."""

    def __init__(self) -> None:
        self.queue = TransmitQueue()
        self.timers = Timers()
        self.queue.limit(61)
        peers = Peers()
        self.pacers = Pacers(peers)
        self.pacers.times = TIMES
        self.repeater = Repeater(self.queue, peers, self.pacers, self.timers, random.Random(1))
        self.now = 0
        self.sent: list[bytes] = []
        self.on_air: list[Part] = []

    def start(
        self, payload: bytes = b"x", *, destination: int = 2, until: int = FOREVER
    ) -> Repetition:
        record = QueuedRecord(
            stream_id=20, destination=destination, payload=payload, queued_at=self.now
        )
        qos = Qos(depth=100)
        return self.repeater.start((20, 1, destination), record, qos, until=until)

    def begin(self) -> int:
        """Begin to send all that waits; returns how many records that is."""
        candidates = self.queue.candidates(self.now)
        records = [self.queue.take(lane, self.now) for lane, _ in candidates]
        self.on_air = [record.part for record in records if record.part is not None]
        for part in self.on_air:
            part.transmitted(self.now)
        self.sent += [record.payload for record in records]
        return len(records)

    def report(self) -> None:
        outcome = TransmitOutcome.SENT
        for part in self.on_air:
            part.reported(
                TransmitReport(
                    transmission_id=1, outcome=outcome, started_at=self.now, finished_at=self.now
                ),
                self.now,
            )

    def send(self) -> int:
        count = self.begin()
        self.report()
        return count

    def wait(self) -> float:
        """Let time pass to the next instant; returns how many round trips that took."""
        due_at = self.timers.next_at()
        assert due_at is not None
        passed, self.now = due_at - self.now, max(self.now, due_at)
        self.timers.fire(self.now)
        return passed / ROUND_TRIP_NS


def test_record_is_repeated_until_it_is_stopped() -> None:
    sea = Sea()
    repetition = sea.start()
    for _ in range(5):
        assert sea.send() == 1
        assert sea.begin() == 0
        sea.wait()
    sea.send()
    sea.repeater.stop(repetition, sea.now)
    assert sea.timers.next_at() is None
    assert sea.sent == [b"x"] * 6
    assert repetition.tries == 6


def test_repetitions_are_told_apart_from_the_first_time() -> None:
    sea = Sea()
    repetition = sea.start()
    assert repetition.record.cause is None
    sea.send()
    sea.wait()
    assert repetition.record.cause is Cause.REPEAT


def test_repetitions_to_a_silent_node_become_rare_and_the_first_frame_of_it_ends_that() -> None:
    sea = Sea()
    sea.start()
    pauses = []
    for _ in range(20):
        sea.send()
        pauses.append(sea.wait())
    assert all(0.9 < pause < 1.5 for pause in pauses[:2])
    assert all(12 < pause < 23 for pause in pauses[-3:])
    sea.send()
    due_at = sea.timers.next_at()
    sea.pacers.heard(3, sea.now)
    assert sea.timers.next_at() == due_at
    sea.pacers.heard(2, sea.now)
    assert sea.wait() <= 0
    assert sea.send() == 1


def test_link_that_comes_up_makes_everything_due() -> None:
    sea = Sea()
    for _ in range(3):
        sea.start()
    sea.send()
    sea.pacers.link_up(sea.now)
    assert sea.wait() <= 0
    assert sea.send() == 3


def test_no_more_than_a_few_frames_go_before_an_answer_is_awaited() -> None:
    sea = Sea()
    for number in range(20):
        sea.start(bytes((number,)) * 30)
    sea.send()
    sea.wait()
    batch = sea.send()
    assert batch * 31 <= TIMES.batch_bytes < (batch + 1) * 31
    waited = sea.wait()
    assert waited > 0.9
    assert sea.send() == batch


def test_waiting_for_one_node_does_not_hold_back_another() -> None:
    sea = Sea()
    sea.start(destination=2)
    sea.send()
    sea.now += round(0.9 * ROUND_TRIP_NS)
    sea.start(destination=3)
    assert sea.send() == 1
    sea.now = 2 * ROUND_TRIP_NS
    sea.timers.fire(sea.now)
    assert sea.send() >= 1


def test_record_whose_time_is_over_is_not_repeated() -> None:
    sea = Sea()
    sea.start(until=3 * ROUND_TRIP_NS)
    while sea.timers.next_at() is not None:
        sea.send()
        sea.wait()
    assert sea.now == 3 * ROUND_TRIP_NS
    assert sea.begin() == 0
    assert 2 <= len(sea.sent) <= 3


def test_what_waits_is_taken_back_when_it_is_stopped() -> None:
    sea = Sea()
    repetition = sea.start()
    other = sea.start(b"other")
    sea.repeater.stop(repetition, 0)
    assert sea.send() == 1
    assert sea.sent == [b"other"]
    sea.repeater.again(repetition)
    assert sea.begin() == 0
    assert (repetition.tries, other.tries) == (0, 1)


def test_it_is_repeated_at_once_when_the_node_shows_that_it_lacks_it() -> None:
    sea = Sea()
    repetition = sea.start()
    sea.repeater.again(repetition)
    assert sea.send() == 1
    sea.repeater.again(repetition)
    sea.repeater.again(repetition)
    assert sea.send() == 1


def pause_after(round_trip: float, *, prompt: bool, tries: int = 1) -> float:
    """Return the pause, in first round trips, after an answer that took so many."""
    sea = Sea()
    first = sea.start()
    for _ in range(tries):
        sea.send()
        if tries > 1:
            sea.wait()
    sea.send()
    sea.now += round(round_trip * ROUND_TRIP_NS)
    sea.repeater.stop(first, sea.now, answered=True, prompt=prompt)
    sea.start()
    sea.send()
    return sea.wait()


def test_round_trip_is_measured_where_it_is_one() -> None:
    assert 1.4 < pause_after(1.0, prompt=True) < 2.0
    assert 7 < pause_after(5.0, prompt=True) < 8
    # The handler took its time, and its answer came without a confirm before.
    assert 0.9 < pause_after(5.0, prompt=False) < 1.5
    assert 1.4 < pause_after(1.0, prompt=False) < 2.0
    # Of several transmissions nobody knows which one was answered.
    assert 0.9 < pause_after(5.0, prompt=True, tries=2) < 1.5


def test_record_that_is_stopped_on_the_air_settles_after_its_end() -> None:
    sea = Sea()
    repetition = sea.start()
    assert repetition.is_settled(0, 10)
    sea.begin()
    sea.repeater.stop(repetition, 0)
    sea.now = 1000
    assert not repetition.is_settled(1000, 10)
    sea.report()
    assert not repetition.is_settled(1009, 10)
    assert repetition.is_settled(1010, 10)
    assert sea.timers.next_at() is None


def test_record_that_fits_no_frame_any_more_is_given_up() -> None:
    sea = Sea()
    repetition = sea.start(bytes(40))
    sea.send()
    sea.queue.limit(29)
    sea.wait()
    assert sea.begin() == 0
    assert sea.timers.next_at() is None
    assert repetition.tries == 1
