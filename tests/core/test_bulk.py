"""Large samples to one node by a bulk service: several frames under way, repair, pauses, fallback.

The modem of `bulklink` sends 8 kbit/s in trains of three frames; each train costs a round trip.
"""

import itertools
import random
from collections.abc import Callable

import msgspec
import pytest

from tests.core.bulklink import CAPABILITIES, BulkSea
from tests.virtual.sealed import SealedFleet
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    BulkChanged,
    DeliveryEnded,
    DeliveryOutcome,
    ObjectProgress,
    SampleReceived,
)
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.linktypes import LinkCapabilities, LinkState, ReceivedFrame, Service
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

PHOTO, NAV, BACK = 1, 2, 3
KIB = random.Random("photo").randbytes(32 << 10)
RIDES = msgspec.structs.replace(
    CAPABILITIES,
    bulk=msgspec.structs.replace(CAPABILITIES.bulk, rides_back=True),  # type: ignore[type-var]
)
NODES = {1: "shore", 2: "auv", 3: "buoy"}


def table(nodes: int = 2, *, subscribers: tuple[int, ...] = (2,)) -> StreamTable:
    return StreamTable(
        [
            TopicSpec(
                stream_id=PHOTO,
                name="photo",
                qos=Qos(reliability=Reliability.RELIABLE, depth=4),
                publishers=(1,),
                subscribers=subscribers,
                journal=True,
            ),
            TopicSpec(stream_id=NAV, name="nav", qos=Qos(depth=1)),
            TopicSpec(
                stream_id=BACK,
                name="map",
                qos=Qos(reliability=Reliability.RELIABLE),
                publishers=(2,),
                subscribers=(1,),
            ),
        ],
        nodes={address: NODES[address] for address in range(1, nodes + 1)},
    )


def got(sea: BulkSea, address: int) -> list[object]:
    events = sea.nodes[address].events
    return [
        each.value
        for each in events
        if isinstance(each, SampleReceived) and each.stream_id == PHOTO
    ]


def publish(sea: BulkSea, payload: bytes = KIB) -> None:
    sea.nodes[1].engine.publish(PHOTO, payload, sea.now)
    sea.nodes[1].serve()


def is_delivered(sea: BulkSea) -> bool:
    return any(
        isinstance(each, DeliveryEnded) and each.outcome is DeliveryOutcome.DELIVERED
        for each in sea.nodes[1].events
    )


def bulk_bytes(sea: BulkSea) -> int:
    return sum(len(made.frame_bytes) for _, _, made in sea.given if made.service is Service.BULK)


def test_large_sample_goes_by_the_bulk_service_as_fast_as_the_device_sends() -> None:
    sea = BulkSea(table())
    publish(sea)
    lasted_s = sea.run(lambda: is_delivered(sea))
    assert got(sea, 2) == [KIB]
    # Eleven trains of 3.4 s and a round trip of 1.2 s, two pauses of a second, the answer.
    assert lasted_s < 60.0
    assert sea.nodes[1].most_outstanding > 3, "the buffer of the modem must not run dry"
    assert bulk_bytes(sea) < 1.03 * len(KIB)


@pytest.mark.parametrize("seed", range(6))
def test_only_what_was_reported_lost_is_sent_again(seed: int) -> None:
    sea = BulkSea(table(), loss=0.5, seed=seed)
    publish(sea)
    sea.run(lambda: is_delivered(sea))
    assert got(sea, 2) == [KIB]
    # What the engine gives again is what failed with a connection, and a question or two.
    failed = [made for _, _, made in sea.given if made.service is Service.BULK]
    assert len(failed) <= 33 + 6 * 16


def test_without_bulk_service_nothing_changes() -> None:
    plain = msgspec.structs.replace(CAPABILITIES, bulk=None)
    sea = BulkSea(table(), capabilities=plain)
    publish(sea, KIB[:2000])
    sea.run(lambda: is_delivered(sea))
    assert got(sea, 2) == [KIB[:2000]]
    assert not bulk_bytes(sea)


def test_sample_for_several_nodes_goes_by_broadcast() -> None:
    sea = BulkSea(table(3, subscribers=(2, 3)), (1, 2, 3))
    publish(sea, KIB[:1000])
    sea.run(lambda: is_delivered(sea))
    assert got(sea, 2) == got(sea, 3) == [KIB[:1000]]
    assert not bulk_bytes(sea)


def test_other_end_is_heard_in_the_pauses_of_a_transfer() -> None:
    sea = BulkSea(table())
    big = KIB * 4

    def report(address: int) -> None:
        sea.nodes[address].engine.publish(NAV, b"position!", sea.now)
        if not is_delivered(sea):
            sea.at(25.0, lambda: report(address))

    report(1)
    report(2)
    sea.run(lambda: sea.now > 60 * 10**9)
    publish(sea, big)
    for node in sea.nodes.values():
        node.events.clear()
    lasted_s = sea.run(lambda: is_delivered(sea))
    assert got(sea, 2) == [big]
    for address in (1, 2):
        reports = [
            each.received_at / 1e9
            for each in sea.nodes[address].events
            if isinstance(each, SampleReceived) and each.stream_id == NAV
        ]
        gaps_s = [later - before for before, later in itertools.pairwise(reports)]
        assert len(reports) >= 0.7 * lasted_s / 25.0, (address, gaps_s)
        assert max(gaps_s) < 55.0, (address, gaps_s)


BARE = b"\0"
"""A frame that only asks for a pause."""


def said_beside(sea: BulkSea, address: int) -> list[tuple[int, bytes]]:
    """Return destination and content of the plain frames that a node has sent."""
    return [
        (made.destination, made.frame_bytes)
        for _, source, made in sea.given
        if source == address and made.service is Service.PLAIN
    ]


def delays_of_reports_s(sea: BulkSea) -> dict[int, float]:
    """Publish at node 2 every seven seconds while it gets a photo; return delays by number, s."""
    at_s: list[float] = []

    def report() -> None:
        if not is_delivered(sea):
            at_s.append(sea.now / 1e9)
            sea.nodes[2].engine.publish(NAV, b"here %d" % len(at_s), sea.now)
            sea.at(7.0, report)

    publish(sea)
    sea.at(7.0, report)
    sea.run(lambda: is_delivered(sea))
    assert got(sea, 2) == [KIB]
    heard = {
        each.value: each.received_at / 1e9
        for each in sea.nodes[1].events
        if isinstance(each, SampleReceived)
    }
    return {
        number: heard[b"here %d" % number] - published_s
        for number, published_s in enumerate(at_s, 1)
        if b"here %d" % number in heard
    }


@pytest.mark.parametrize("build", [Engine, SealedFleet()], ids=["plain", "sealed"])
def test_what_the_receiver_says_rides_back_with_the_acknowledgements(build: MakeEngine) -> None:
    sea = BulkSea(table(), capabilities=RIDES, build=build)
    delays_s = delays_of_reports_s(sea)
    assert list(delays_s)[:5] == [1, 2, 3, 4, 5]
    # A train, its acknowledgement, and a quarter of the period by which reports are spread.
    assert max(delays_s.values()) < 5.5 + 7.0 / 4
    said = said_beside(sea, 2)
    assert BARE not in [content for _, content in said]
    # The others go in the pauses that the sender announces by itself.
    ridden = [made for _, address, made in sea.given if made.rides_back]
    assert len(ridden) >= 4
    assert {made.destination for made in ridden} == {1}


@pytest.mark.parametrize("capabilities", [CAPABILITIES, RIDES], ids=["pauses", "rides"])
def test_a_large_sample_the_other_way_has_its_turn(capabilities: LinkCapabilities) -> None:
    sea = BulkSea(table(), capabilities=capabilities)
    publish(sea, KIB * 4)
    sea.run(lambda: sea.now > 10 * 10**9)
    sea.nodes[2].engine.publish(BACK, KIB[:4000], sea.now)
    sea.nodes[2].serve()

    def has_map() -> bool:
        return any(
            isinstance(each, SampleReceived) and each.stream_id == BACK
            for each in sea.nodes[1].events
        )

    assert sea.run(has_map) < 120.0
    assert not is_delivered(sea), "it did not have to wait for the end"
    sea.run(lambda: is_delivered(sea))


def test_what_others_want_too_does_not_ride_but_asks_for_a_pause() -> None:
    sea = BulkSea(table(3), (1, 2, 3), capabilities=RIDES)
    assert delays_of_reports_s(sea)
    said = said_beside(sea, 2)
    assert (1, BARE) in said
    assert {to for to, content in said if b"here" in content} == {255}
    others = [each for each in sea.nodes[3].events if isinstance(each, SampleReceived)]
    assert others, "the third node hears them"


def test_what_waits_for_the_fleet_does_not_ride_back_to_a_stranger() -> None:
    """One forged bulk frame must not take a sample away from the node that wants it."""
    sea = BulkSea(table(), capabilities=RIDES)
    publish(sea, KIB * 2)
    sea.run(lambda: sea.now > 10 * 10**9)
    fragment = next(made for _, _, made in sea.given if made.service is Service.BULK)
    victim = sea.nodes[2]
    victim.engine.publish(NAV, b"here 1", sea.now)
    forged = ReceivedFrame(
        frame_bytes=fragment.frame_bytes,
        received_at=sea.now,
        source=77,
        destination=2,
        service=Service.BULK,
    )
    victim.engine.handle_frame(forged, sea.now)
    victim.serve()
    assert not [
        made for _, _, made in sea.given if made.destination == 77 and len(made.frame_bytes) > 1
    ]
    sea.run(lambda: is_delivered(sea))
    values = [each.value for each in sea.nodes[1].events if isinstance(each, SampleReceived)]
    assert values == [b"here 1"]


def test_what_rides_back_keeps_to_the_cap_of_the_node() -> None:
    capped = {2: TransmitRules(max_airtime=0.01)}
    sea = BulkSea(table(), capabilities=RIDES, rules=capped)
    node = sea.nodes[2]

    def report() -> None:
        node.engine.publish(NAV, bytes(20), sea.now)
        node.serve()
        sea.at(2.0, report)

    report()
    sea.run(lambda: sea.now > 120 * 10**9)
    before = len(sea.given)
    publish(sea, KIB * 4)
    sea.run(lambda: sea.now > 240 * 10**9)
    beside = [made for _, address, made in sea.given[before:] if address == 2]
    sound_ns = sum(CAPABILITIES.airtime_ns(len(made.frame_bytes)) for made in beside)
    # A hundredth of two minutes, and the frame that makes the debt.
    assert sound_ns < 1.2e9 + 0.6e9
    assert bulk_bytes(sea) > 2 * len(KIB)


def test_where_bulk_data_do_not_get_through_the_plain_service_carries_them_with_an_event() -> None:
    sea = BulkSea(table(), broken=True)

    def report() -> None:
        sea.nodes[2].engine.publish(NAV, b"position!", sea.now)
        sea.at(20.0, report)

    report()
    publish(sea, KIB[:4000])
    sea.run(lambda: is_delivered(sea))
    assert got(sea, 2) == [KIB[:4000]]
    [event] = [each for each in sea.nodes[1].events if isinstance(each, BulkChanged)]
    assert (event.address, event.works) == (2, False)
    # The next one does not try again, so soon.
    trains = sea.trains[1]
    sea.nodes[1].events.clear()
    publish(sea, KIB[:500])
    sea.run(lambda: is_delivered(sea))
    assert sea.trains[1] == trains


def test_node_out_of_range_costs_few_trains_and_gets_the_rest_when_it_is_back() -> None:
    sea = BulkSea(table())
    publish(sea)
    sea.run(lambda: sea.now > 20 * 10**9)
    sea.broken, sea.loss = True, 1.0
    before = sea.trains[1]
    sea.run(lambda: sea.now > 260 * 10**9)
    assert sea.trains[1] - before <= 40  # ten connections, four times tried
    sea.broken, sea.loss = False, 0.0
    sea.run(lambda: is_delivered(sea), 300.0)
    assert got(sea, 2) == [KIB]
    assert not any(isinstance(each, BulkChanged) for each in sea.nodes[1].events)


@pytest.mark.parametrize("rides", [False, True])
@pytest.mark.parametrize("killed", [1, 2])
def test_killed_and_resumed_it_sends_little_again(
    killed: int, rides: bool, count: Callable[[int], int]
) -> None:
    big, points = KIB * 3, count(200)
    for point in range(points):
        sea = BulkSea(table(), capabilities=RIDES if rides else CAPABILITIES, seed=point)
        publish(sea, big)
        killed_at = round((3.0 + 85.0 * (point + 0.5) / points) * 10**9)
        sea.run(lambda sea=sea, at=killed_at: sea.now > at)  # type: ignore[misc]
        sea.restart(killed)
        sea.run(
            lambda sea=sea: (  # type: ignore[misc]
                bool(got(sea, 2))
                and any(isinstance(each, DeliveryEnded) for each in sea.nodes[1].events)
            )
        )
        assert got(sea, 2) == [big], point
        assert bulk_bytes(sea) <= 1.05 * len(big), point


def test_progress_counts_what_the_other_modem_has() -> None:
    sea = BulkSea(table())
    publish(sea)
    sea.run(lambda: sea.now > 25 * 10**9)
    told = [each for each in sea.nodes[1].events if isinstance(each, ObjectProgress)][-1]
    assert told.total_bytes == len(KIB)
    arrived = [each for each in sea.nodes[2].events if isinstance(each, ObjectProgress)][
        -1
    ].done_bytes
    assert abs(told.done_bytes - arrived) <= 6 * 1024


def test_nothing_goes_while_the_link_is_down_and_the_rest_afterwards() -> None:
    sea = BulkSea(table())
    publish(sea)
    sea.run(lambda: sea.now > 12 * 10**9)
    node = sea.nodes[1]
    node.engine.handle_link_state(LinkState.DOWN, sea.now)
    node.serve()
    before = [made for _, address, made in sea.given if address == 1]
    sea.at(30.0, lambda: None)
    sea.run(lambda: sea.now > 35 * 10**9)
    given = [made for _, address, made in sea.given if address == 1]
    assert given == before, "nothing goes while the link is down"
    node.engine.handle_link_state(LinkState.UP, sea.now, sea.capabilities)
    node.serve()
    sea.run(lambda: is_delivered(sea))
    assert got(sea, 2) == [KIB]
