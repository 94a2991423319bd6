"""The lane of a publisher: numbers, the window, the pace, SYNC."""

import random

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.base.sizes import SIZES
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.reliable.sending.sendlane import (
    JournalledSample,
    OutgoingSample,
    SendLane,
    Stage,
)
from zacoustic.core.transport.reliable.spans import Span, Spans
from zacoustic.core.values.types import TypeTable
from zacoustic.core.wire.frame import Sync
from zacoustic.core.wire.numbers import NUMBERS, WINDOW

STREAM = Stream(TopicSpec(stream_id=7, name="a"), TypeTable(), {})
SETTLING_NS = 1000


def lane(*receivers: int, is_journalled: bool = False, next_number: int = 0) -> SendLane:
    return SendLane(
        (7, 3), receivers or (2,), Spans([Span(0, 5)]), next_number, is_journalled=is_journalled
    )


def add(to: SendLane, count: int = 1) -> list[OutgoingSample]:
    ids = range(to.next_number + 1, to.next_number + 1 + count)
    kept = [JournalledSample(each, b"", b"x", False) for each in ids]
    return [to.add(STREAM, each, queued_at=0, expires_at=None) for each in kept]


def numbers(of: SendLane) -> list[int]:
    return [sample.number for sample in of.active()]


def test_no_more_numbers_are_in_use_than_the_window_has() -> None:
    full = lane()
    samples = add(full, WINDOW + 5)
    assert full.open(0, SETTLING_NS) is None
    assert numbers(full) == list(range(WINDOW))
    full.remove(samples[0])
    full.open(0, SETTLING_NS)
    assert numbers(full) == list(range(WINDOW)), "nothing was sent: the others moved up"


def test_window_moves_when_the_oldest_has_ended() -> None:
    moving = lane()
    samples = add(moving, WINDOW + 2)
    moving.open(0, SETTLING_NS)
    for sample in moving.active():
        sample.tries = 1
    moving.remove(samples[0])
    moving.open(0, SETTLING_NS)
    assert numbers(moving) == list(range(1, WINDOW + 1))


def test_numbers_come_into_use_no_faster_than_the_pace() -> None:
    fast = lane()
    opened = 0
    for now in range(10):
        samples = add(fast, WINDOW)
        again_at = fast.open(now, SETTLING_NS)
        active = list(fast.active())
        opened += len(active)
        for sample in active:
            sample.tries = 1
            fast.remove(sample)
        for sample in samples:
            if sample not in active:
                fast.remove(sample)
        assert opened <= SIZES.samples.pace
        if again_at is not None:
            assert again_at == SETTLING_NS
    assert opened == SIZES.samples.pace
    add(fast, 1)
    assert fast.open(SETTLING_NS, SETTLING_NS) is None
    assert len(list(fast.active())) == 1


def test_unsent_sample_leaves_its_number_to_the_next() -> None:
    unsent = lane()
    first, second, third = add(unsent, 3)
    assert unsent.remove(second) is False
    assert [first.number, third.number, unsent.next_number] == [0, 1, 2]
    assert third.waiting.head == bytes((1,))


def test_number_that_was_sent_or_kept_is_not_given_away() -> None:
    for is_journalled in (False, True):
        sent = lane(is_journalled=is_journalled)
        first, second, third = add(sent, 3)
        if not is_journalled:
            sent.open(0, SETTLING_NS)
            third.stage = Stage.ON_AIR
        assert sent.remove(first) is True
        assert [second.number, third.number, sent.next_number] == [1, 2, 3]


def test_record_for_one_receiver_in_sync_has_no_sync() -> None:
    known = lane(2)
    (sample,) = add(known)
    known.receptions[2].in_sync = True
    known.address(sample, [2])
    assert (sample.waiting.destination, sample.waiting.sync) == (2, b"")
    assert not sample.waiting.for_one_node


def test_receiver_that_is_not_in_sync_is_told_where_to_begin() -> None:
    two = lane(2, 3)
    samples = add(two, 3)
    two.receptions[2].in_sync = True
    two.address(samples[0], [2, 3])
    assert samples[0].waiting.destination == BROADCAST
    assert samples[0].waiting.sync == Sync(5, 0).encode()
    two.receptions[3].expected = 2
    two.address(samples[2], [3])
    assert samples[2].waiting.sync == Sync(5, 2).encode(), "it has what the other one lacks"
    assert samples[2].waiting.for_one_node, "and the other one must not believe that"


def test_receiver_a_window_behind_is_out_of_sync() -> None:
    late = lane(2)
    late.receptions[2].in_sync = True
    samples = add(late, WINDOW + 1)
    late.address(samples[WINDOW - 1], [2])
    assert samples[WINDOW - 1].waiting.sync == b""
    late.address(samples[WINDOW], [2])
    assert samples[WINDOW].waiting.sync != b""


def test_receiver_that_has_forgotten_lacks_it_again() -> None:
    two = lane(2, 3)
    samples = add(two, 3)
    two.open(0, SETTLING_NS)
    for sample in samples:
        sample.acknowledged.add(2)
    two.receptions[2].expected = 3
    two.regress(2, 1)
    assert [two.missing(sample) for sample in samples] == [[3], [2, 3], [2, 3]]
    samples[1].held.add(3)
    assert two.lacking(samples[1]) == [2]
    two.lose_sync(3)
    assert two.lacking(samples[1]) == [2, 3]


@given(st.integers(0, 1 << 32), st.lists(st.sampled_from(["add", "end", "send", "wait"])))
def test_numbers_in_use_are_always_told_apart(seed: int, steps: list[str]) -> None:
    rng, tried, now = random.Random(seed), lane(next_number=100), 0
    for step in steps:
        now += rng.randrange(SETTLING_NS) if step == "wait" else 0
        if step == "add":
            add(tried, rng.randrange(50))
        elif step == "end" and tried.samples:
            tried.remove(rng.choice(list(tried.samples)))
        elif step == "send":
            for sample in tried.active():
                sample.tries += 1
        tried.open(now, SETTLING_NS)
        in_use = numbers(tried)
        assert len({number % NUMBERS for number in in_use}) == len(in_use)
        assert not in_use or in_use[-1] - tried.floor < WINDOW
        assert [each.number for each in tried.samples] == sorted(
            each.number for each in tried.samples
        )
        heads = [each.waiting.head[-1] for each in tried.samples]
        assert heads == [each.number % NUMBERS for each in tried.samples]
