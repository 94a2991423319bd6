"""The bulk service: burst data in the buffer of the modem, over the guesses at what it does."""

import random
from collections import Counter

import msgspec
import pytest

from tests.links.evologics.driver.crew import CrewedSea, CrewNode
from tests.links.evologics.driver.sea import Sea
from tests.links.evologics.emulator.test_instant import lossy
from zacoustic.channel.scenario import Scenario
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.engine.events import DeliveryEnded, Event, SampleReceived
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkState,
    Service,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.session.session import MOST_OUTSTANDING
from zacoustic_evologics.emulator import Behaviour, EmulatedFleet, burst_guess, scenario_of

FRAME = random.Random("burst").randbytes(1024)


def sea_of(
    scenario: Scenario | None = None,
    *,
    behaviour: Behaviour | None = None,
    settings: dict[str, int] | None = None,
) -> Sea:
    scenario = scenario or scenario_of(2, spacing_m=500.0)
    fleet = EmulatedFleet(scenario, behaviour=behaviour, settings={"L": 0} | (settings or {}))
    sea = Sea(scenario, fleet=fleet, config=EvologicsConfig())
    sea.make_ready()
    return sea


def give(sea: Sea, number: int, *, to: int = 2, content: bytes | None = None) -> int:
    """Give a frame of the bulk service to the first node; return its id."""
    node = sea[1]
    node.transmissions += 1
    content = number.to_bytes(4, "big") + FRAME[4:] if content is None else content
    made = Transmission(
        transmission_id=node.transmissions,
        frame_bytes=content,
        destination=to,
        acknowledge=True,
        service=Service.BULK,
    )
    node.dialogue.transmit(made, sea.now)
    sea.after(0.0, lambda: None)
    sea._serve(node)
    sea._deliver()
    return node.transmissions


def reports(sea: Sea) -> dict[int, TransmitReport]:
    told = sea[1].reports
    assert max(Counter(each.transmission_id for each in told).values(), default=1) == 1
    return {each.transmission_id: each for each in told}


def numbers(sea: Sea) -> list[int]:
    frames = [each for each in sea[2].frames if each.service is Service.BULK]
    return [int.from_bytes(each.frame_bytes[:4], "big") for each in frames]


def test_capabilities_tell_the_service_where_the_settings_allow_it() -> None:
    bulk = sea_of()[1].dialogue.capabilities.bulk
    assert bulk is not None
    assert (bulk.mtu_bytes, bulk.most_outstanding) == (1024, MOST_OUTSTANDING)
    off = EvologicsConfig(bulk=False)
    for config in (off, EvologicsConfig(service="im"), EvologicsConfig(mtu=1024)):
        sea = Sea(scenario_of(2), config=config)
        assert sea[1].dialogue.capabilities.bulk is None
        sea.make_ready()
        give(sea, 1)
        assert reports(sea)[1].outcome is TransmitOutcome.REJECTED


@pytest.mark.parametrize("seed", range(12))
def test_many_are_outstanding_and_each_is_reported_once_and_arrives_in_order(seed: int) -> None:
    guess = burst_guess(seed)
    sea = sea_of(behaviour=guess.behaviour, settings=guess.settings)
    for number in range(20):
        give(sea, number)
    assert not reports(sea), "all of them are under way"
    sea.until(lambda: len(reports(sea)) == 20, limit_s=400.0)
    assert {each.outcome for each in reports(sea).values()} == {TransmitOutcome.DELIVERED}
    assert numbers(sea) == list(range(20))


@pytest.mark.parametrize("seed", range(12))
def test_what_is_lost_is_reported_and_what_is_reported_delivered_has_arrived(seed: int) -> None:
    guess = burst_guess(seed)
    scenario = msgspec.structs.replace(lossy(0.45, back=0.45, seed=seed))
    sea = sea_of(scenario, behaviour=guess.behaviour, settings=guess.settings)
    for number in range(12):
        give(sea, number)
    sea.until(lambda: len(reports(sea)) == 12, limit_s=2000.0)
    arrived = numbers(sea)
    for transmission_id, told in reports(sea).items():
        if told.outcome is TransmitOutcome.DELIVERED:
            assert transmission_id - 1 in arrived
    sea[1].reports.clear()
    give(sea, 99)
    sea.until(lambda: bool(sea[1].reports), limit_s=600.0)  # the service goes on


def shout(sea: Sea, content: bytes) -> int:
    """Give an urgent message to the first node; return its id."""
    node = sea[1]
    node.transmissions += 1
    made = Transmission(transmission_id=node.transmissions, frame_bytes=content, is_urgent=True)
    node.dialogue.transmit(made, sea.now)
    sea._serve(node)
    sea._deliver()
    return node.transmissions


@pytest.mark.parametrize("seed", range(30))
def test_urgent_message_overtakes_burst_data_and_a_message_that_waits_for_them(seed: int) -> None:
    guess = burst_guess(seed)
    sea = sea_of(behaviour=guess.behaviour, settings=guess.settings)
    for number in range(12):
        give(sea, number)
    sea.run(random.Random(seed).uniform(1.0, 6.0))
    node = sea[1]
    node.transmissions += 1
    waiting = node.transmissions
    plain = Transmission(transmission_id=waiting, frame_bytes=b"position")
    node.dialogue.transmit(plain, sea.now)
    given_at = sea.now
    urgent = shout(sea, b"abort")
    sea.until(lambda: urgent in reports(sea))
    assert reports(sea)[urgent].outcome is TransmitOutcome.SENT
    sea.run(1.0)
    heard = {each.frame_bytes: each.received_at for each in sea[2].frames}
    # A train that is on the air goes on to its end, then its receiver acknowledges it.
    assert (heard[b"abort"] - given_at) / 1e9 < guess.behaviour.train_s + 3.4 + 2.5
    sea.until(lambda: len(reports(sea)) == 14, limit_s=400.0)
    outcomes = {reports(sea)[each].outcome for each in range(1, 13)}
    assert outcomes <= {TransmitOutcome.DELIVERED, TransmitOutcome.ABORTED}
    assert reports(sea)[waiting].outcome is TransmitOutcome.SENT
    sea[1].reports.clear()
    give(sea, 99)
    sea.until(lambda: bool(sea[1].reports), limit_s=400.0)  # the service goes on
    assert sea[1].reports[0].outcome is TransmitOutcome.DELIVERED


@pytest.mark.parametrize("at_s", [2.0, 2.5, 3.0, 3.5, 4.0])
def test_message_that_the_modem_has_is_heard_when_burst_data_make_way(at_s: float) -> None:
    """Without burst data it goes at once: the receiver of the last train must hear again."""
    sea = sea_of(behaviour=Behaviour(im_in_train="queued", train_s=4.0))
    for number in range(30):
        give(sea, number)
    sea.run(at_s)
    plain = sea.transmit(1, b"position")
    sea.run(0.3)
    urgent = shout(sea, b"abort")
    sea.until(lambda: {plain, urgent} <= reports(sea).keys())
    sea.run(1.0)
    heard = [each.frame_bytes for each in sea[2].frames if each.service is not Service.BULK]
    assert heard == [b"position", b"abort"]


def test_message_has_its_own_time_once_the_burst_data_have_gone() -> None:
    sea = sea_of(behaviour=Behaviour(im_in_train="queued", train_s=0.75))
    for number in range(30):
        give(sea, number)
    sea.run(2.0)
    plain = sea.transmit(1, b"position")
    given_at = sea.now
    sea.until(lambda: plain in reports(sea))
    assert sea.now - given_at > 15_000_000_000
    assert reports(sea)[plain].outcome is TransmitOutcome.SENT


@pytest.mark.parametrize("seed", range(30))
def test_second_urgent_message_waits_for_one_more_train(seed: int) -> None:
    guess = burst_guess(seed)
    sea = sea_of(behaviour=guess.behaviour, settings=guess.settings)
    for number in range(20):
        give(sea, number)
    rng = random.Random(seed)
    sea.run(rng.uniform(1.0, 6.0))
    first = shout(sea, b"abort")
    sea.until(lambda: first in reports(sea))
    for number in range(20, 32):
        give(sea, number)
    sea.run(rng.uniform(0.5, 4.0))
    given_at = sea.now
    second = shout(sea, b"again")
    sea.until(lambda: second in reports(sea))
    sea.run(1.0)
    heard = {each.frame_bytes: each.received_at for each in sea[2].frames}
    assert (heard[b"again"] - given_at) / 1e9 < 7.0
    sea.until(lambda: len(reports(sea)) == 34, limit_s=400.0)


def test_only_one_urgent_message_overtakes() -> None:
    sea = sea_of()
    for number in range(12):
        give(sea, number)
    sea.run(2.0)
    first, second = shout(sea, b"abort"), shout(sea, b"again")
    third = shout(sea, b"and again")
    assert reports(sea)[third].outcome is TransmitOutcome.REJECTED
    sea.until(lambda: {first, second} <= reports(sea).keys())
    assert {reports(sea)[each].outcome for each in (first, second)} == {TransmitOutcome.SENT}
    sea.until(lambda: len(reports(sea)) == 15, limit_s=400.0)


@pytest.mark.parametrize(("rate_bps", "packets"), [(31_200, 10), (9200, 4), (4000, 2), (2400, 1)])
def test_trains_are_as_long_as_others_can_wait(rate_bps: int, packets: int) -> None:
    sea = sea_of(behaviour=Behaviour(burst_rates_bps=((-1000.0, rate_bps),), train_s=7.5))
    for number in range(30):
        give(sea, number)
    sea.until(lambda: len(reports(sea)) == 30, limit_s=400.0)
    # The first train begins as the modem tells the bit rate.
    arrived = [each.received_at for each in sea[2].frames if each.service is Service.BULK][10:]
    assert max(Counter(arrived).values()) == packets


def test_trains_are_longer_where_many_are_lost_and_short_again_when_none_are() -> None:
    behaviour = Behaviour(burst_rates_bps=((-1000.0, 9200),), train_s=7.5)
    longest = []
    for loss in (0.0, 0.3):
        sea = sea_of(lossy(loss, back=loss, seed=3), behaviour=behaviour, settings={"RC": 5})
        for _ in range(4):
            sea[1].reports.clear()
            for number in range(30):
                give(sea, number)
            sea.until(lambda: len(sea[1].reports) == 30, limit_s=2000.0)  # noqa: B023
        bulk = [each.received_at for each in sea[2].frames if each.service is Service.BULK]
        longest.append(max(Counter(bulk[30:]).values()))
    assert longest[0] == 4
    assert 6 <= longest[1] <= 8


@pytest.mark.parametrize("fate", ["taken", "queued", "refused"])
def test_instant_message_goes_while_burst_data_are_under_way(fate: str) -> None:
    behaviour = Behaviour(im_in_train=fate)  # type: ignore[arg-type]
    sea = sea_of(behaviour=behaviour)
    for number in range(12):
        give(sea, number)
    sea.run(1.5)
    report = sea.send(1, b"position", BROADCAST)
    assert report.outcome is TransmitOutcome.SENT
    sea.until(lambda: len(reports(sea)) == 13)
    if fate == "taken":
        assert report.finished_at < max(each.finished_at for each in sea[1].reports)
    sea.run(1.0)
    assert b"position" in [each.frame_bytes for each in sea[2].frames]
    assert numbers(sea) == list(range(12))


def test_small_buffer_is_kept_full_and_the_rest_waits_in_the_driver() -> None:
    sea = sea_of(settings={"ZL": 8096})
    for number in range(MOST_OUTSTANDING):
        give(sea, number)
    give(sea, 99)
    assert reports(sea)[MOST_OUTSTANDING + 1].outcome is TransmitOutcome.REJECTED
    sea.until(lambda: len(reports(sea)) == MOST_OUTSTANDING + 1, limit_s=300.0)
    assert numbers(sea) == list(range(MOST_OUTSTANDING))


@pytest.mark.parametrize(
    ("to", "content"), [(BROADCAST, FRAME), (1, FRAME), (200, FRAME), (2, b""), (2, FRAME + b"x")]
)
def test_what_no_burst_can_carry_is_rejected(to: int, content: bytes) -> None:
    sea = sea_of()
    give(sea, 1, to=to, content=content)
    assert reports(sea)[1].outcome is TransmitOutcome.REJECTED


def test_nobody_there_fails_all_of_them_and_the_back_off_is_waited_for() -> None:
    sea = sea_of(lossy(1.0), settings={"RC": 1})
    for number in range(3):
        give(sea, number)
    sea.until(lambda: len(reports(sea)) == 3)
    assert {each.outcome for each in reports(sea).values()} == {TransmitOutcome.NOT_DELIVERED}
    give(sea, 4)  # the modem is in its back-off
    sea.until(lambda: len(reports(sea)) == 4)
    assert reports(sea)[4].outcome is TransmitOutcome.NOT_DELIVERED


def test_lost_connection_reports_all_of_them_after_the_link_is_down() -> None:
    sea = sea_of()
    for number in range(10):
        give(sea, number)
    sea.run(2.0)
    before = len(reports(sea))
    sea.cut(1)
    assert len(reports(sea)) == 10
    aborted = [each.outcome for each in sea[1].reports[before:]]
    assert set(aborted) == {TransmitOutcome.ABORTED}
    assert sea[1].changes[-1][1] is LinkState.DOWN
    sea.until(lambda: sea[1].is_ready, limit_s=60.0)
    give(sea, 77)
    sea.until(lambda: len(reports(sea)) == 11, limit_s=200.0)
    assert 77 in numbers(sea)


def test_data_of_another_program_in_the_buffer_do_not_stay_in_the_way() -> None:
    sea = sea_of(lossy(0.0))
    other = sea.fleet.open_port(1, now=sea.now)
    sea.fleet.handle_bytes(other, b"AT*SEND,4,2,abcd\n", sea.now)
    give(sea, 5)
    sea.until(lambda: len(reports(sea)) == 1)
    assert reports(sea)[1].outcome is TransmitOutcome.DELIVERED
    assert 5 in numbers(sea)


PHOTO, URGENT = 10, 12


@pytest.mark.parametrize("seed", [1, 3, 5, 7])
def test_what_the_receiver_says_rides_back_with_the_trains(seed: int) -> None:
    """A piggyback message that misses one acknowledgement goes with that of the next train."""
    guess = burst_guess(seed)
    at_s: dict[object, float] = {}
    """When what has arrived at the publisher of the photo, and when the photo has, s."""
    fleet = EmulatedFleet(
        scenario_of(2, spacing_m=1500.0), behaviour=guess.behaviour, settings=guess.settings
    )
    table = StreamTable(
        [
            TopicSpec(
                stream_id=PHOTO,
                name="photo",
                publishers=(1,),
                subscribers=(2,),
                qos=Qos(reliability=Reliability.RELIABLE),
            ),
            TopicSpec(stream_id=URGENT, name="urgent", qos=Qos(priority=Priority.REAL_TIME)),
        ],
        nodes={1: "shore", 2: "vehicle"},
    )

    def deliver(node: CrewNode, event: Event) -> None:
        if isinstance(event, SampleReceived):
            at_s["photo" if event.stream_id == PHOTO else event.value] = sea.now / 1e9
        elif isinstance(event, DeliveryEnded):
            at_s["known"] = sea.now / 1e9

    sea = CrewedSea(fleet, table, deliver, config=EvologicsConfig())
    sea.until(lambda: all(node.is_up for node in sea.crew))

    def publish(source: int, stream_id: int, value: bytes) -> None:
        node = sea.crew[source - 1]
        sea.apply(node, lambda engine, now: engine.publish(stream_id, value, now))

    publish(1, PHOTO, random.Random(seed).randbytes(64 << 10))
    published_s = {}
    for number in range(1, 6):
        sea.run(9.0)
        published_s[bytes(number)] = sea.now / 1e9
        publish(2, URGENT, bytes(number))
    sea.run(30.0)
    delays_s = [at_s[each] - said_s for each, said_s in published_s.items() if each in at_s]
    assert len(delays_s) >= 4  # best effort: one may get lost
    assert max(delays_s) < 9.0
    sea.until(lambda: "known" in at_s, limit_s=600.0)
    # No train follows the last one: what answers it does not wait for an acknowledgement.
    assert at_s["known"] - at_s["photo"] < 3.0


@pytest.mark.parametrize("seed", range(3))
def test_urgent_samples_in_a_row_leave_time_for_a_large_one(seed: int) -> None:
    guess = burst_guess(seed)
    scenario = scenario_of(2, spacing_m=1500.0, seed=seed + 1)
    fleet = EmulatedFleet(scenario, behaviour=guess.behaviour, settings=guess.settings)
    arrived: list[int] = []
    table = StreamTable(
        [
            TopicSpec(
                stream_id=10,
                name="photo",
                publishers=(1,),
                subscribers=(2,),
                qos=Qos(reliability=Reliability.RELIABLE),
            ),
            TopicSpec(stream_id=12, name="urgent", qos=Qos(priority=Priority.REAL_TIME)),
        ],
        nodes={1: "vehicle", 2: "shore"},
    )

    def deliver(node: CrewNode, event: Event) -> None:
        if isinstance(event, SampleReceived):
            arrived.append(event.stream_id)

    sea = CrewedSea(fleet, table, deliver, config=EvologicsConfig())
    sea.until(lambda: all(node.is_up for node in sea.crew))
    vehicle = sea.crew[0]
    photo = random.Random(seed).randbytes(13_000)
    sea.apply(vehicle, lambda engine, now: engine.publish(10, photo, now))
    for _ in range(60):
        sea.apply(vehicle, lambda engine, now: engine.publish(12, b"set-point", now))
        sea.run(5.0)
    assert arrived.count(10) == 1
    assert arrived.count(12) >= 50
