"""Queue: who goes first, what is dropped, and that nobody starves."""

import random

import pytest

from zacoustic.core.base.qos import PATIENCE_NS, Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.schedule.queue import QueuedRecord, TransmitQueue
from zacoustic.errors import PayloadTooLargeError

SECOND = seconds_to_ns(1)


def item(
    stream_id: int, text: bytes = b"x", at: int = 0, expires_at: int | None = None
) -> QueuedRecord:
    return QueuedRecord(
        stream_id=stream_id,
        destination=BROADCAST,
        payload=text,
        queued_at=at,
        expires_at=expires_at,
    )


def drain(queue: TransmitQueue, now: int) -> list[tuple[int, bytes]]:
    taken = []
    for lane, waiting in queue.candidates(now):
        assert queue.take(lane, now) is waiting
        taken.append((waiting.stream_id, waiting.payload))
    return taken


def first(queue: TransmitQueue, now: int) -> int:
    return next(waiting.stream_id for _, waiting in queue.candidates(now))


def test_fresh_payloads_go_in_the_order_of_their_priorities() -> None:
    queue = TransmitQueue()
    for priority in reversed(Priority):
        queue.push((priority,), item(priority), Qos(priority=priority))
    assert [stream_id for stream_id, _ in drain(queue, 0)] == list(Priority)


def test_equals_go_in_the_order_of_publication() -> None:
    queue = TransmitQueue()
    for number in range(10):
        queue.push((10 - number,), item(10 - number, at=number), Qos())
    assert [stream_id for stream_id, _ in drain(queue, 10)] == list(range(10, 0, -1))


PAIRS = [(slow, fast) for slow in Priority for fast in Priority if Priority.REAL_TIME < fast < slow]


@pytest.mark.parametrize(("slow", "fast"), PAIRS)
def test_waiting_overtakes_a_higher_priority_after_the_difference_of_patience(
    slow: Priority, fast: Priority
) -> None:
    wait = PATIENCE_NS[slow] - PATIENCE_NS[fast]
    for published_at, expected in ((wait - 1, 2), (wait + 1, 1)):
        queue = TransmitQueue()
        queue.push((1,), item(1), Qos(priority=slow))
        queue.push((2,), item(2, at=published_at), Qos(priority=fast))
        assert first(queue, published_at) == expected


def test_nothing_overtakes_real_time_however_long_it_waits() -> None:
    queue = TransmitQueue()
    queue.push((1,), item(1), Qos(priority=Priority.INTERACTIVE_HIGH))
    queue.push((2,), item(2, at=10**18), Qos(priority=Priority.REAL_TIME))
    assert first(queue, 10**18) == 2


def test_background_does_not_starve_behind_a_flood_of_commands() -> None:
    queue = TransmitQueue()
    queue.push((1,), item(1), Qos(priority=Priority.BACKGROUND))
    for second in range(2000):
        queue.push((2,), item(2, at=second * SECOND), Qos(priority=Priority.INTERACTIVE_HIGH))
        lane, waiting = next(iter(queue.candidates(second * SECOND)))
        queue.take(lane, second * SECOND)
        if waiting.stream_id == 1:
            assert second in (900, 901)
            return
    raise AssertionError("it starves")


def test_newer_samples_push_out_the_oldest_beyond_the_depth() -> None:
    queue = TransmitQueue()
    for number in range(10):
        queue.push((1,), item(1, bytes((number,)), at=number), Qos(depth=3))
    assert queue.pending(1) == len(queue) == 3
    assert queue.superseded == {1: 7}
    assert drain(queue, 10) == [(1, b"\x07"), (1, b"\x08"), (1, b"\x09")]


def test_depth_is_that_of_one_key() -> None:
    queue = TransmitQueue()
    for key in range(5):
        queue.push((1, 0, key), item(1, bytes((key,))), Qos(depth=1))
    assert queue.pending(1) == 5


def test_expired_sample_is_never_offered() -> None:
    queue = TransmitQueue()
    queue.push((1,), item(1, b"old", expires_at=5), Qos(depth=2))
    queue.push((1,), item(1, b"new", at=3, expires_at=9), Qos(depth=2))
    assert queue.due_at(4) == 0
    assert drain(queue, 5) == [(1, b"new")]
    assert queue.expired == {1: 1}
    assert queue.due_at(5) is None


def test_to_ask_drops_nothing_and_to_decide_drops_what_has_expired() -> None:
    queue = TransmitQueue()
    queue.push((1,), item(1, b"old", expires_at=5), Qos(depth=2))
    queue.push((2,), item(2, b"new", at=3), Qos())
    assert queue.due_at(5) == 3
    assert len(queue) == 2
    queue.settle(5, (2,))
    assert len(queue) == 2
    queue.settle(5)
    assert (len(queue), queue.expired) == (1, {1: 1})


def test_minimum_interval_holds_a_key_back_and_the_newest_wins() -> None:
    queue = TransmitQueue()
    qos = Qos(min_interval_s=10)
    queue.push((1,), item(1, b"a"), qos)
    assert drain(queue, 0) == [(1, b"a")]
    queue.push((1,), item(1, b"b", at=SECOND), qos)
    queue.push((1,), item(1, b"c", at=2 * SECOND), qos)
    assert queue.due_at(3 * SECOND) == 10 * SECOND
    assert drain(queue, 10 * SECOND - 1) == []
    assert drain(queue, 10 * SECOND) == [(1, b"c")]


def test_lingering_sample_may_ride_but_is_no_reason_to_send() -> None:
    queue = TransmitQueue()
    queue.push((1,), item(1), Qos(linger_s=5))
    assert queue.due_at(0) == 5 * SECOND
    assert drain(queue, 0) == [(1, b"x")]


def test_a_topic_published_more_often_than_it_lingers_goes_when_its_first_sample_is_due() -> None:
    queue = TransmitQueue()
    for second in range(5):
        queue.push((1,), item(1, b"%d" % second, at=second * SECOND), Qos(linger_s=5))
        assert queue.due_at(second * SECOND) == 5 * SECOND
    assert drain(queue, 5 * SECOND) == [(1, b"4")]
    queue.push((1,), item(1, b"5", at=6 * SECOND), Qos(linger_s=5))
    assert queue.due_at(6 * SECOND) == 11 * SECOND


@pytest.mark.parametrize("seed", range(20))
def test_of_equal_topics_none_waits_longer_than_the_others_need(seed: int) -> None:
    """More is published than the link takes, a frame per second: nobody waits more than a round."""
    rng, queue, topics = random.Random(seed), TransmitQueue(), random.Random(seed).randrange(2, 9)
    periods_ns = [seconds_to_ns(rng.uniform(0.2, 5)) for _ in range(topics)]
    next_ns = [rng.randrange(each) for each in periods_ns]
    gone_ns = [0] * topics
    for second in range(1, 500):
        now = second * SECOND
        for topic, period_ns in enumerate(periods_ns):
            while next_ns[topic] <= now:
                queue.push((topic,), item(topic, at=next_ns[topic]), Qos())
                next_ns[topic] += period_ns
        found = next(queue.candidates(now), None)
        if found is not None:
            topic = queue.take(found[0], now).stream_id
            assert now - gone_ns[topic] <= periods_ns[topic] + (topics + 1) * SECOND
            gone_ns[topic] = now
    assert all(499 * SECOND - at <= max(periods_ns) + (topics + 1) * SECOND for at in gone_ns)


def test_minimum_interval_thins_what_is_new_and_no_repetitions() -> None:
    queue, qos = TransmitQueue(), Qos(min_interval_s=10, depth=4)
    queue.push((1,), item(1, b"a"), qos)
    assert drain(queue, 0) == [(1, b"a")]
    queue.push((1,), item(1, b"b", at=SECOND), qos)
    again = item(1, b"a", at=2 * SECOND)
    again.cause = Cause.REPEAT
    queue.push((1,), again, qos)
    assert drain(queue, 3 * SECOND) == [(1, b"a")]
    assert drain(queue, 10 * SECOND - 1) == []
    assert drain(queue, 10 * SECOND) == [(1, b"b")]


def test_payload_that_is_not_taken_holds_back_its_lane_only() -> None:
    queue = TransmitQueue()
    for number in range(3):
        queue.push((1,), item(1, bytes((number,)), at=number), Qos(depth=9))
        queue.push((2,), item(2, bytes((number,)), at=number), Qos(depth=9))
    taken = []
    for lane, waiting in queue.candidates(9):
        if waiting.stream_id == 2:
            taken.append(queue.take(lane, 9).payload)
    assert taken == [b"\x00", b"\x01", b"\x02"]
    assert queue.pending(1) == 3


def test_payload_taken_back_by_its_head_is_gone() -> None:
    queue = TransmitQueue()
    waiting = QueuedRecord(stream_id=1, destination=2, payload=b"x", head=b"\x05", queued_at=0)
    queue.push((1, 1, 2), waiting, Qos())
    assert not queue.remove((1, 1, 2), b"\x06")
    assert not queue.remove((9, 1, 2), b"\x05")
    assert queue.remove((1, 1, 2), b"\x05")
    assert not queue.remove((1, 1, 2), b"\x05")
    assert len(queue) == 0


def test_dropped_lane_is_empty_and_may_be_used_again() -> None:
    queue = TransmitQueue()
    queue.drop_lane((1,))
    queue.push((1,), item(1), Qos())
    queue.drop_lane((1,))
    assert len(queue) == 0
    queue.push((1,), item(1), Qos())
    assert drain(queue, 0) == [(1, b"x")]


def test_smaller_link_drops_what_does_not_fit_any_more() -> None:
    queue = TransmitQueue()
    for size in (3, 30, 5):
        queue.push((1,), item(1, bytes(size)), Qos(depth=9))
    assert [item.size_bytes > 10 for item in queue.limit(10)] == [True]
    assert [len(text) for _, text in drain(queue, 0)] == [3, 5]
    with pytest.raises(PayloadTooLargeError, match=r"nav: the record is 11 bytes; .* for 10"):
        queue.check_size("nav", 11)
    queue.check_size("nav", 10)
