"""The holes between the trains of two nodes: a third one repeats its emergencies there."""

import random
from functools import partial

import msgspec
import pytest

from tests.core.bulklink import CAPABILITIES, BulkNode, BulkSea
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.engine.events import DeliveryEnded, SampleReceived
from zacoustic.core.linktypes import LinkCapabilities, ReceivedFrame, Service
from zacoustic.core.schedule.access import Wanted
from zacoustic.core.schedule.othertrains import OtherTrains
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.objects import ListenHint

ALARM, PHOTO, NAV = 1, 2, 3
PLAIN = msgspec.structs.replace(CAPABILITIES, bulk=None)
TRAIN_S, PERIOD_S, FIRST_S = 1.0, 7.3, 10.0
ROUND_TRIP_S = ns_to_seconds(LinkTimes(CAPABILITIES).first_round_trip_ns)
NODES = {1: "shore", 2: "auv", 3: "buoy"}


def table(priority: Priority = Priority.REAL_TIME) -> StreamTable:
    return StreamTable(
        [
            TopicSpec(
                stream_id=ALARM,
                name="alarm",
                qos=Qos(priority=priority, reliability=Reliability.RELIABLE),
                publishers=(3,),
                subscribers=(2,),
            ),
            TopicSpec(
                stream_id=PHOTO,
                name="photo",
                qos=Qos(reliability=Reliability.RELIABLE),
                publishers=(1,),
                subscribers=(2,),
            ),
            TopicSpec(stream_id=NAV, name="nav", qos=Qos(depth=1)),
        ],
        nodes=NODES,
    )


def given_s(
    capabilities: LinkCapabilities, priority: Priority = Priority.REAL_TIME, holes: int = 8
) -> list[float]:
    """Let a node have an alarm for one that trains of another keep deaf; return when it goes, s."""
    sea = BulkSea(table(priority), (3,), capabilities=capabilities)
    engine = sea.nodes[3].engine

    def sound(busy: bool) -> None:
        engine.handle_carrier(busy, sea.now)

    def publish() -> None:
        engine.publish(ALARM, b"an alarm", sea.now)

    for number in range(holes):
        for is_end in (False, True):
            at_s = FIRST_S + PERIOD_S * number + TRAIN_S * is_end
            sea.at(at_s, partial(sound, not is_end))
    sea.at(FIRST_S - 0.5, publish)
    sea.at(FIRST_S + holes * PERIOD_S, lambda: None)
    sea.run(lambda: ns_to_seconds(sea.now) >= FIRST_S + holes * PERIOD_S)
    return [ns_to_seconds(at) for at, _, made in sea.given if b"an alarm" in made.frame_bytes]


def wasted(instants_s: list[float], holes: int = 7) -> int:
    """Return into how many holes it did not go twice, although no answer was to be expected."""
    count = 0
    for number in range(1, 1 + holes):  # the first sound may be a lost frame
        end_s = FIRST_S + PERIOD_S * number + TRAIN_S
        is_free = not any(end_s - ROUND_TRIP_S - 0.5 < each < end_s for each in instants_s)
        count += is_free and sum(end_s <= each < end_s + 1.0 for each in instants_s) != 2
    return count


def test_emergency_without_answer_goes_twice_into_the_next_holes() -> None:
    assert not wasted(given_s(CAPABILITIES), holes=2)


def test_emergency_to_a_node_that_is_away_does_not_go_into_every_hole_of_a_long_run() -> None:
    """Nor do those of two nodes meet in each of them."""
    its_own, all_of_it = (len(given_s(each, holes=60)) for each in (PLAIN, CAPABILITIES))
    assert its_own < all_of_it <= its_own + 2 * 6


@pytest.mark.parametrize(
    ("capabilities", "priority"),
    [(PLAIN, Priority.REAL_TIME), (CAPABILITIES, Priority.DATA)],
    ids=["no bulk service", "no emergency"],
)
def test_nothing_else_is_repeated_there(capabilities: LinkCapabilities, priority: Priority) -> None:
    assert wasted(given_s(capabilities, priority)) >= 2


def holes_s(*sounds_s: tuple[float, float], read: bool = False) -> list[float]:
    """Let sounds begin and end; return the instants at which holes begin, s."""
    trains, holes = OtherTrains(CAPABILITIES), []
    for begin_s, end_s in sounds_s:
        assert not trains.begins_hole(True, seconds_to_ns(begin_s))
        if trains.begins_hole(False, seconds_to_ns(end_s)):
            holes.append(end_s)
        if read:
            trains.heard(seconds_to_ns(end_s + 0.01))
    return holes


def test_trains_are_long_sounds_with_holes_between_them_that_give_no_frame() -> None:
    assert holes_s((1, 2), (4, 5), (7, 8)) == [5, 8]
    assert not holes_s((1, 2), (2.1, 3.1), (3.2, 4.2)), "plain frames in a row"
    assert not holes_s((1, 1.3), (4, 4.3), (7, 7.3)), "short frames"
    assert not holes_s((1, 2), (200, 201)), "a long frame now and then"
    assert holes_s((1, 2), read=True) == holes_s((1, 2), (9, 9.3), read=True) == []
    assert not holes_s((1, 2), (4, 4.3), (31, 32), (61, 61.3), read=True)[1:]


def test_calls_of_a_sender_without_answer_have_holes_but_acknowledgements_have_none() -> None:
    acknowledged = (1, 2), (4, 5), (6, 6.2)
    assert holes_s(*acknowledged) == [5]
    assert holes_s(*acknowledged, (12, 12.2), (20, 20.2)) == [5, 12.2, 20.2]
    assert holes_s(*acknowledged, (400, 400.2)) == [5], "that run is long over"


def test_ends_of_the_trains_have_their_own_ways() -> None:
    for is_end in (False, True):
        port, told = LinkPort(CAPABILITIES, 2, random.Random(1)), list[int]()
        port.hole_begins.connect(told.append)
        for at_s in (1, 4):
            if is_end:
                port.handle_call(1, ListenHint.NONE, bulk_frame(at_s), seconds_to_ns(at_s))
            port.handle_carrier(True, seconds_to_ns(at_s))
            port.handle_carrier(False, seconds_to_ns(at_s + 1))
        assert told == ([] if is_end else [seconds_to_ns(5)])


def free_at(port: LinkPort, wanted: Wanted, now: int) -> int | None:
    """Return when all that the port knows allows a frame."""
    at = port.after_burst(wanted, port.after_gap(wanted, wanted.due_at, now), now)
    return port.by_access(wanted, port.after_pause(wanted, at, now), now)


def bulk_frame(at_s: float) -> ReceivedFrame:
    return ReceivedFrame(
        frame_bytes=b"fragment",
        received_at=seconds_to_ns(at_s),
        source=1,
        destination=2,
        service=Service.BULK,
    )


def test_channel_is_not_free_after_an_answer_that_asks_for_more() -> None:
    port, now = LinkPort(CAPABILITIES, 2, random.Random(1)), seconds_to_ns(5)
    port.handle_call(1, ListenHint.ANSWER, bulk_frame(5), now)
    assert free_at(port, Wanted(now), now) == now, "the answer itself"
    port.bulk_goes_on(1, now)
    waits_until = free_at(port, Wanted(now), now)
    assert waits_until is not None
    assert waits_until > now + seconds_to_ns(5)
    assert free_at(port, Wanted(now, is_for_others=True), now) == now
    # It has not got that answer, and asks again, perhaps by a plain frame.
    asked = msgspec.structs.replace(bulk_frame(5), service=Service.PLAIN)
    port.handle_call(1, ListenHint.ANSWER, asked, now)
    assert free_at(port, Wanted(now), now) == now
    port.bulk_goes_on(1, now)
    assert free_at(port, Wanted(now), now) == now, "no train of it has asked"


def test_reports_of_the_receiver_wait_from_its_answer_to_the_next_train(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sea = BulkSea(table(), (1, 2))
    answered_at: list[int] = []
    tell = LinkPort.bulk_goes_on

    def spy(port: LinkPort, source: int, now: int) -> None:
        answered_at.append(now)
        tell(port, source, now)

    monkeypatch.setattr(LinkPort, "bulk_goes_on", spy)
    sea.nodes.clear()
    for address in (1, 2):
        sea.nodes[address] = BulkNode(sea, address, 1, {})
    sea.nodes[1].engine.publish(PHOTO, random.Random("photo").randbytes(256 << 10), sea.now)
    sea.nodes[1].serve()
    receiver = sea.nodes[2]
    sea.run(lambda: bool(answered_at))
    assert not any(isinstance(each, SampleReceived) for each in receiver.events)
    answer_ends_at, trains = receiver.sounds_until, sea.trains[1]
    sea.at(ns_to_seconds(answer_ends_at - sea.now) + 0.2, lambda: None)
    sea.run(lambda: sea.now > answer_ends_at)
    receiver.engine.publish(NAV, b"here", sea.now)
    sea.run(lambda: any(b"here" in made.frame_bytes for _, _, made in sea.given))
    assert sea.trains[1] > trains
    sea.run(lambda: any(isinstance(each, SampleReceived) for each in receiver.events))
    sea.run(lambda: any(isinstance(each, DeliveryEnded) for each in sea.nodes[1].events))
    count = len(answered_at)
    receiver.engine.publish(NAV, b"then", sea.now)
    published_at = sea.now
    sea.run(lambda: any(b"then" in made.frame_bytes for _, _, made in sea.given))
    assert sea.now - published_at < seconds_to_ns(1), "it has all: nothing to wait for"
    assert len(answered_at) == count
