"""Large samples between small ones, engines driven by hand: one order, each once, or told why not.

Where a frame is shown by its first bytes: `ba` is a fragment, `ba..ffff` something about an object.
"""

import itertools
import random
from typing import Any

import pytest

from tests.core.rig import End, Pass, Rig, link
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    SampleReceived,
)
from zacoustic.core.linktypes import LinkState, Transmission
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.wire.objects import FRAGMENT_CODE
from zacoustic.errors import PayloadTooLargeError, QueueFullError

LOG, KEPT, LAST, BRIEF = 1, 2, 3, 4
NODES = {1: "shore", 2: "auv", 3: "buoy"}
PHOTO = random.Random("photo").randbytes(500)


def topic(stream_id: int, name: str, *, journal: bool = False, **settings: Any) -> TopicSpec:
    qos = Qos(reliability=Reliability.RELIABLE, **({"depth": 8} | settings))
    return TopicSpec(stream_id=stream_id, name=name, qos=qos, journal=journal, publishers=(1,))


def fleet(count: int = 2, **changed: Any) -> StreamTable:
    return StreamTable(
        [
            topic(LOG, "log"),
            topic(KEPT, "kept", journal=True, **changed),
            topic(LAST, "last", depth=1),
            topic(BRIEF, "brief", lifespan_s=5.0),
        ],
        nodes={address: NODES[address] for address in range(1, count + 1)},
    )


def ends(count: int = 2) -> Rig:
    capabilities = link(bit_rate_bps=2000, propagation_s=0.1)
    rig = Rig(dict.fromkeys(range(1, count + 1), fleet(count)), capabilities=capabilities)
    for stream_id in (LOG, KEPT):
        publish(rig, stream_id, b"hello")
    rig.run(30)
    for end in rig.ends.values():
        end.events.clear()
    rig.frames.clear()
    return rig


def publish(rig: Rig, stream_id: int, value: bytes, **settings: Any) -> int:
    end = rig[1]
    end.now = rig.now
    delivery_id = end.engine.publish(stream_id, value, rig.now, **settings)
    end.settle()
    return delivery_id


def values(rig: Rig, address: int = 2) -> list[object]:
    return [event.value for event in rig[address].got(SampleReceived)]


def outcomes(rig: Rig) -> list[DeliveryOutcome]:
    return [event.outcome for event in rig[1].got(DeliveryEnded)]


def is_fragment(sent: Transmission) -> bool:
    return sent.frame_bytes[0] == FRAGMENT_CODE


def is_about_an_object(sent: Transmission) -> bool:
    return is_fragment(sent) and sent.frame_bytes[2:4] == b"\xff\xff"


def some_fragments(count: int) -> Pass:
    """Let so many fragments pass, and no others."""

    def passes(source: int, node: int, sent: Transmission) -> bool:
        nonlocal count
        count -= is_fragment(sent)
        return not is_fragment(sent) or count >= 0

    return passes


def mostly(rng: random.Random, share: float) -> Pass:
    """Let that share of the frames pass."""
    return lambda source, node, sent: rng.random() < share


def no_fragments(source: int, node: int, sent: Transmission) -> bool:
    return not is_fragment(sent)


@pytest.mark.parametrize("stream_id", [LOG, KEPT])
def test_small_and_large_samples_arrive_in_their_order(stream_id: int) -> None:
    for seed in range(20):
        rig = ends()
        rng = random.Random(seed)
        expected = [
            PHOTO + bytes((number,)) if rng.random() < 0.4 else b"%d" % number
            for number in range(8)
        ]
        for value in expected:
            publish(rig, stream_id, value)
            rig.run(rng.choice((0.1, 1.0)), mostly(rng, 0.6))
        rig.run(100, mostly(rng, 0.6))
        rig.run(500)
        assert values(rig) == expected
        assert outcomes(rig) == [DeliveryOutcome.DELIVERED] * 8
        assert rig[1].engine.is_idle


def test_what_was_published_before_the_link_was_ever_up_goes_as_an_object() -> None:
    rig = ends()
    rig.ends[1] = End(1, fleet(), epoch=2, is_up=False)
    first = publish(rig, LOG, PHOTO, encoding="image/png")
    publish(rig, LOG, b"small")
    kept = publish(rig, KEPT, PHOTO)
    with pytest.raises(PayloadTooLargeError, match="an object has at most 1048576"):
        publish(rig, LOG, bytes((1 << 20) + 1))
    rig[1].engine.handle_link_state(LinkState.UP, rig.now, rig.capabilities)
    rig.run(60)
    arrived = rig[2].got(SampleReceived)
    assert [event.value for event in arrived if event.stream_id == LOG] == [PHOTO, b"small"]
    assert [event.value for event in arrived if event.stream_id == KEPT] == [PHOTO]
    assert next(each.encoding for each in arrived if each.stream_id == LOG) == "image/png"
    assert outcomes(rig) == [DeliveryOutcome.DELIVERED] * 3
    assert [each.delivery_id for each in rig[1].got(DeliveryStored)] == [kept]
    assert first < kept
    assert not [key for key in rig[1].journal if key.startswith(("object/out", "out/2//"))]


def test_a_large_sample_that_is_kept_survives_until_the_link_is_up() -> None:
    rig = ends()
    last = rig[1]
    rig.ends[1] = End(1, fleet(), epoch=2, journal=last.journal, is_up=False)
    publish(rig, KEPT, PHOTO)
    publish(rig, KEPT, b"small")
    rig.restart(1, fleet(), keeps=True)
    rig.run(60)
    assert values(rig) == [PHOTO, b"small"]


def test_more_large_samples_than_may_wait() -> None:
    rig = ends()
    rules = TransmitRules(objects=ObjectLimits(most_outgoing=2))
    rig.ends[1] = End(1, fleet(), epoch=2, rules=rules, is_up=False)
    for _ in range(3):
        publish(rig, LOG, PHOTO)
    rig[1].engine.handle_link_state(LinkState.UP, rig.now, rig.capabilities)
    rig[1].settle()
    assert outcomes(rig) == [DeliveryOutcome.CANCELLED]
    assert rig[1].got(DeliveryEnded)[0].detail == "2 objects are on their way already"
    with pytest.raises(QueueFullError):
        publish(rig, LOG, PHOTO)
    publish(rig, LOG, b"small")
    rig.run(60)
    assert values(rig) == [PHOTO, PHOTO, b"small"]


@pytest.mark.parametrize("stream_id", [LOG, KEPT])
def test_what_is_behind_a_cancelled_one_is_not_held_back(stream_id: int) -> None:
    rig = ends()
    large = publish(rig, stream_id, PHOTO)
    publish(rig, stream_id, b"behind")
    rig.run(20, no_fragments)
    assert values(rig) == []
    assert rig[1].engine.cancel_delivery(large, rig.now)
    assert not rig[1].engine.cancel_delivery(large, rig.now)
    rig.run(60)
    assert values(rig) == [b"behind"]
    assert outcomes(rig) == [DeliveryOutcome.CANCELLED, DeliveryOutcome.DELIVERED]
    assert rig[1].engine.is_idle


def test_a_gap_between_what_is_acknowledged_and_what_is_held() -> None:
    """A receiver that has told to await a number before the gap is told of it all the same."""
    rig = ends()
    rng = random.Random(1)
    before = publish(rig, LOG, b"before")
    middle = publish(rig, LOG, PHOTO)
    publish(rig, LOG, b"behind")
    # What is behind arrives, and what is before it not.
    rig.run(3, lambda source, node, sent: source == 2 or b"behind" in sent.frame_bytes)
    assert rig[1].engine.cancel_delivery(middle, rig.now)
    rig.run(60, mostly(rng, 0.7))
    assert values(rig) == [b"before", b"behind"]
    assert before in [each.delivery_id for each in rig[1].got(DeliveryEnded)]


def test_a_small_sample_is_cancelled_too() -> None:
    rig = ends()
    small = publish(rig, LOG, b"small")
    assert rig[1].engine.cancel_delivery(small, rig.now)
    assert not rig[1].engine.cancel_delivery(small, rig.now)
    publish(rig, LOG, b"next")
    rig.run(60)
    assert values(rig) == [b"next"]
    assert outcomes(rig) == [DeliveryOutcome.CANCELLED, DeliveryOutcome.DELIVERED]


def test_what_is_too_old_holds_nothing_back() -> None:
    rig = ends()
    publish(rig, BRIEF, PHOTO)
    rig.run(3, no_fragments)
    publish(rig, BRIEF, b"behind")
    rig.run(4, no_fragments)
    assert outcomes(rig)[0] is DeliveryOutcome.EXPIRED
    rig.run(60)
    assert values(rig) == [b"behind"]


@pytest.mark.parametrize("newer", [b"newer", PHOTO[1:]])
def test_a_newer_sample_waits_for_a_large_one_that_crosses(newer: bytes) -> None:
    rig = ends()
    publish(rig, LAST, PHOTO)
    rig.run(1, some_fragments(3))
    old, new = publish(rig, LAST, b"older"), publish(rig, LAST, newer)
    assert [each.delivery_id for each in rig[1].got(DeliveryEnded)] == [old]
    assert outcomes(rig) == [DeliveryOutcome.SUPERSEDED]
    assert rig[1].engine.is_delivering(new)
    rig.run(60)
    assert values(rig) == [PHOTO, newer]
    assert outcomes(rig)[1:] == [DeliveryOutcome.DELIVERED] * 2
    assert not rig[1].engine.is_delivering(new)
    assert rig[1].engine.is_idle


@pytest.mark.parametrize("newer", [b"newer", PHOTO[1:]])
def test_a_newer_sample_pushes_out_a_large_one_that_nobody_answers(newer: bytes) -> None:
    rig = ends()
    publish(rig, LAST, PHOTO)
    rig.run(5, no_fragments)
    publish(rig, LAST, newer)
    rig.run(60)
    assert values(rig) == [newer]
    assert outcomes(rig) == [DeliveryOutcome.SUPERSEDED, DeliveryOutcome.DELIVERED]
    told = rig[1].got(ObjectProgress)
    assert ObjectState.SUPERSEDED in [each.state for each in told]
    assert rig[1].engine.is_idle


def test_what_waits_for_a_large_one_goes_when_nobody_answers_any_more() -> None:
    rig = ends()
    publish(rig, LAST, PHOTO)
    rig.run(1, some_fragments(3))
    publish(rig, LAST, PHOTO[1:])
    assert outcomes(rig) == []
    rig.run(20, no_fragments)
    assert outcomes(rig) == [DeliveryOutcome.SUPERSEDED]
    rig.run(60)
    assert values(rig) == [PHOTO[1:]]


def test_what_waits_for_a_large_one_may_be_cancelled() -> None:
    rig = ends()
    publish(rig, LAST, PHOTO)
    rig.run(1, some_fragments(3))
    waiting = publish(rig, LAST, b"cancelled")
    assert rig[1].engine.cancel_delivery(waiting, rig.now)
    assert not rig[1].engine.cancel_delivery(waiting, rig.now)
    rig.run(60)
    assert values(rig) == [PHOTO]
    assert outcomes(rig) == [DeliveryOutcome.CANCELLED, DeliveryOutcome.DELIVERED]


def test_what_waits_for_the_minimum_interval_expires() -> None:
    table = StreamTable([topic(BRIEF, "brief", min_interval_s=100.0, lifespan_s=5.0)], nodes=NODES)
    rig = Rig(dict.fromkeys(NODES, table), capabilities=link(bit_rate_bps=5000))
    publish(rig, BRIEF, PHOTO)
    rig.run(20)
    publish(rig, BRIEF, PHOTO[1:])
    rig.run(4.5)
    assert outcomes(rig) == [DeliveryOutcome.DELIVERED]
    rig.run(1)
    assert outcomes(rig) == [DeliveryOutcome.DELIVERED, DeliveryOutcome.EXPIRED]
    rig.run(200)
    assert values(rig) == [PHOTO]


@pytest.mark.parametrize("victim", [1, 2])
def test_what_waits_for_a_large_one_survives_a_restart(victim: int) -> None:
    rig = ends()
    table = fleet(depth=1)
    for address in (1, 2):
        rig.restart(address, table, keeps=True)
    publish(rig, KEPT, b"hello again")
    rig.run(60)
    publish(rig, KEPT, PHOTO)
    rig.run(1, some_fragments(3))
    waiting = [publish(rig, KEPT, value) for value in (b"older", b"newest")]
    stored = [each.delivery_id for each in rig[1].got(DeliveryStored)]
    assert stored[-2:] == waiting
    rig.restart(victim, table, keeps=True)
    rig.run(120)
    assert values(rig)[-1] == b"newest"
    assert not [key for key in rig[1].journal if key.startswith("next/")]
    ended = {each.delivery_id: each.outcome for each in rig[1].got(DeliveryEnded)}
    assert ended[waiting[1]] is DeliveryOutcome.DELIVERED


def test_a_power_cut_while_what_waited_gets_its_number_doubles_nothing() -> None:
    rig = ends()
    table = fleet(depth=1)
    for address in (1, 2):
        rig.restart(address, table, keeps=True)
    publish(rig, KEPT, b"hello again")
    rig.run(60)
    for newest in (b"newest", PHOTO[1:]):
        publish(rig, KEPT, PHOTO)
        rig.run(1, some_fragments(3))
        waiting = publish(rig, KEPT, newest)
        before = dict(rig[1].journal)
        assert any(key.startswith("next/") for key in before)
        rig.run(20, lambda *_: False)  # asked in vain, so it displaces the photo
        assert not any(key.startswith("next/") for key in rig[1].journal)
        rig[1].journal |= {key: each for key, each in before.items() if key.startswith("next/")}
        told = [each.delivery_id for each in rig[1].got(DeliveryStored)]
        assert told.count(waiting) == 1
        rig.restart(1, table, keeps=True)
        rig.run(120)
        assert values(rig).count(newest) == 1
        assert not any(key.startswith("next/") for key in rig[1].journal)


def test_memory_for_what_waits_for_large_ones_is_bounded() -> None:
    table = StreamTable([topic(LAST, "last", depth=64, min_interval_s=1000.0)], nodes=NODES)
    rules = TransmitRules(objects=ObjectLimits(most_outgoing=3))
    rig = Rig(dict.fromkeys((1, 2, 3), table), capabilities=link(bit_rate_bps=5000))
    rig.ends[1] = End(1, table, epoch=2, rules=rules, now=rig.now)
    rig[1].engine.handle_link_state(LinkState.UP, rig.now, rig.capabilities)
    publish(rig, LAST, PHOTO)
    rig.run(20)
    for _ in range(3):
        publish(rig, LAST, PHOTO)
    with pytest.raises(QueueFullError):
        publish(rig, LAST, PHOTO)
    assert rig[1].engine.delivering(LAST) == 3


def test_large_samples_keep_the_minimum_interval() -> None:
    table = StreamTable([topic(LAST, "last", depth=1, min_interval_s=100.0)], nodes=NODES)
    rig = Rig(dict.fromkeys((1, 2, 3), table), capabilities=link(bit_rate_bps=5000))
    arrived: list[float] = []
    for second in range(0, 600, 10):
        publish(rig, LAST, bytes((second // 10,)) + PHOTO)
        before = len(values(rig))
        rig.run(10)
        arrived += [second] * (len(values(rig)) - before)
    assert len(arrived) == 6
    assert min(b - a for a, b in itertools.pairwise(arrived)) >= 90
    assert values(rig) == [bytes((number,)) + PHOTO for number in (0, 10, 20, 30, 40, 50)]


def test_who_refuses_a_large_sample_gets_what_is_behind_it() -> None:
    rig = ends(3)
    rules = TransmitRules(objects=ObjectLimits(largest_bytes=100))
    rig.ends[3] = End(3, fleet(3), epoch=2, rules=rules, now=rig.now)
    publish(rig, LOG, b"before")
    publish(rig, LOG, PHOTO)
    publish(rig, LOG, b"behind")
    # The other one is out of range for a while.
    rig.run(60, lambda source, node, sent: 2 not in (source, node))
    assert values(rig, 3) == [b"before", b"behind"]
    rig.run(300)
    assert values(rig, 2) == [b"before", PHOTO, b"behind"]
    ended = {each.outcome: each.missing for each in rig[1].got(DeliveryEnded)}
    assert ended == {DeliveryOutcome.DELIVERED: (), DeliveryOutcome.REFUSED: (3,)}


def test_a_receiver_that_has_forgotten_all_is_told_when_it_is_its_turn() -> None:
    rig = ends()
    publish(rig, LOG, b"before")
    rig.run(10)
    publish(rig, LOG, PHOTO)
    rig.run(1, some_fragments(3))
    rig.restart(2, fleet())
    rig.run(100)
    assert values(rig) == [PHOTO]
    assert any(is_about_an_object(sent) for source, sent in rig.frames)
    assert outcomes(rig)[-1] is DeliveryOutcome.DELIVERED
    publish(rig, LOG, b"behind")
    rig.run(20)
    assert values(rig) == [PHOTO, b"behind"]


def test_a_publisher_that_has_forgotten_all_begins_anew() -> None:
    rig = ends()
    publish(rig, LOG, PHOTO)
    rig.run(1, some_fragments(3))
    rig.restart(1, fleet())
    publish(rig, LOG, PHOTO[1:])
    publish(rig, LOG, b"behind")
    rig.run(100)
    assert values(rig) == [PHOTO[1:], b"behind"]


@pytest.mark.parametrize("after_s", [0.0, 0.5, 2.0])
def test_order_survives_both_ends(after_s: float) -> None:
    for seed in range(10):
        rng = random.Random(seed)
        rig = ends()
        expected = [PHOTO, b"1", PHOTO[:300], b"3", b"4"]
        for value in expected:
            publish(rig, KEPT, value)
        for _ in range(4):
            rig.run(after_s, mostly(rng, 0.7))
            victim = rng.choice((1, 2))
            handed_on = rig[2].got(SampleReceived)
            rig.restart(victim, fleet(), keeps=True)
            if victim == 2:
                rig[2].events[:0] = handed_on
        rig.run(300)
        assert values(rig) == expected, seed


def test_restarted_receiver_holds_what_is_behind_an_object_of_which_nothing_more_comes() -> None:
    rig = ends()
    publish(rig, KEPT, PHOTO)
    rig.run(1, some_fragments(4))
    rig.restart(2, fleet(), keeps=True)
    # In a rhythm; the publisher marks none as long as the object is on its way, so that nothing
    # is learned, and nothing asked for.
    behind = [b"%d" % number for number in range(7)]
    for value in behind:
        publish(rig, KEPT, value)
        rig.run(10, some_fragments(0))
    assert values(rig) == []
    sent = rig[2].engine.stats.frames_transmitted
    rig.run(100, some_fragments(0))
    assert values(rig) == []
    assert rig[2].engine.stats.frames_transmitted <= sent + 1
    rig.run(300)
    assert values(rig) == [PHOTO, *behind]


def test_a_large_sample_of_a_stream_that_is_defined_in_another_way_now() -> None:
    rig = ends()
    publish(rig, KEPT, PHOTO)
    rig.restart(1, fleet(depth=9), keeps=True)
    rig.run(60)
    ended = rig[1].got(DeliveryEnded)
    assert [each.outcome for each in ended] == [DeliveryOutcome.CANCELLED]
    assert ended[0].detail == "the stream is defined in another way now"
    assert not [key for key in rig[1].journal if key.startswith("object/")]


def test_an_acknowledgement_of_what_is_behind_ends_an_object() -> None:
    """The receiver has said that it is complete, and that was lost."""
    rig = ends()
    publish(rig, LOG, PHOTO)
    publish(rig, LOG, b"behind")
    rig.run(5, lambda source, node, sent: source == 1 or sent.frame_bytes[:1] != b"\xbb")
    assert values(rig) == [PHOTO, b"behind"]
    assert outcomes(rig) == [DeliveryOutcome.DELIVERED] * 2


def test_many_numbers_go_to_large_samples_alone() -> None:
    """Short acknowledgements are understood when 100 objects lie between two small samples."""
    rig = ends()
    expected = []
    for number in range(100):
        expected.append(bytes((number,)) * 80)
        publish(rig, LOG, expected[-1])
        rig.run(2)
    expected.append(b"small")
    publish(rig, LOG, b"small")
    rig.run(10)
    assert values(rig) == expected
    assert rig.now < seconds_to_ns(300)
