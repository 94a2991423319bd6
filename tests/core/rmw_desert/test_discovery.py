"""Beacons and requests: only where they have ids, and as rmw_desert writes them."""

from collections import Counter

from tests.core.rmw_desert.peer import SAMPLE, Heard, Peer, packet
from tests.core.rmw_desert.vectors import read_vectors
from tests.core.rmw_desert.vehicle import SHORE, VEHICLE, node, said
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.profiles.entities import DiscoverySpec, EntityKind, RosEntitySeen
from zacoustic.core.profiles.rules import TransmitRules

RULES = TransmitRules(discovery=DiscoverySpec(beacon_id=1, request_id=2, node_name="shore"))
VECTORS = {vector.name: vector for vector in read_vectors()}
REQUEST = VECTORS["discovery_request"].packet


def kinds(heard: list[Heard]) -> Counter[int]:
    return Counter(each.items[2] for each in heard)


def test_without_ids_there_is_no_discovery() -> None:
    shore = node(SHORE)
    assert said(shore, 0) == b""
    shore.hear(REQUEST + VECTORS["discovery_beacon"].packet, 0, source=0)
    assert said(shore, 0) == b""
    assert shore.events[1:] == []
    assert shore.engine.stats.dropped == {"unknown_stream": 2}


def test_a_node_asks_once_and_says_what_it_has() -> None:
    shore, vehicle = node(SHORE, rules=RULES), Peer()
    data = said(shore, 0)
    request, *beacons = vehicle.hear(data)
    assert data.startswith(REQUEST)
    assert request == Heard(SAMPLE, 2, [])
    assert kinds(beacons) == {
        EntityKind.PUBLISHER: 5, EntityKind.SUBSCRIPTION: 6,
        EntityKind.CLIENT: 1, EntityKind.SERVICE: 1,
    }  # fmt: skip
    assert all(each.stream_id == 1 and len(each.items) == 23 for each in beacons)
    service = next(each for each in beacons if each.items[2] == EntityKind.SERVICE)
    gid = [SHORE, 3, 254, *[0] * 13]
    assert service.items == ["shore", "/", 3, 16, *gid, "/trigger", "TriggerResponse", False]
    assert len({tuple(each.items[4:20]) for each in beacons}) == len(beacons)
    assert said(shore, 3600 * NS_PER_S) == b""


def test_a_request_is_answered_with_all_beacons_once() -> None:
    shore, vehicle = node(SHORE, rules=RULES), Peer()
    first = said(shore, 0)
    shore.hear(REQUEST * 3, 0, source=0)
    assert said(shore, 0) == first.removeprefix(REQUEST)
    assert len(vehicle.hear(first)) == 14


def test_a_new_connection_does_not_announce_again() -> None:
    shore = node(SHORE, rules=RULES)
    said(shore, 0)
    shore.engine.handle_link_state(shore.engine.link_state.DOWN, 0)
    shore.engine.handle_link_state(shore.engine.link_state.UP, 0, shore.capabilities)
    assert said(shore, 0) == b""


def test_beacons_of_others_are_told() -> None:
    shore = node(SHORE, rules=RULES)
    shore.hear(VECTORS["discovery_beacon"].packet, 5, source=0)
    gone = packet(SAMPLE, 1, "talker", "/", 0, 16, *range(16), "", "", True)
    shore.hear(gone, 6, source=0)
    here, left = shore.got(RosEntitySeen)
    assert (here.node, here.namespace, here.kind) == ("talker", "/", EntityKind.PUBLISHER)
    assert (here.topic, here.type, here.leaves) == ("/turtle1/pose", "turtlesim/msg/Pose", False)
    assert here.gid == bytes.fromhex("010fc855999900000000000000000000")
    assert (left.leaves, left.gid, left.seen_at) == (True, bytes(range(16)), 6)


def test_two_engines_find_each_other_and_come_to_rest() -> None:
    shore, vehicle = node(SHORE, rules=RULES), node(VEHICLE, rules=RULES)
    for _ in range(5):
        vehicle.hear(said(shore, 0), 0, source=0)
        shore.hear(said(vehicle, 0), 0, source=0)
    assert said(shore, NS_PER_S) == said(vehicle, NS_PER_S) == b""
    seen = {each.topic for each in shore.got(RosEntitySeen)}
    assert {"/turtle1/pose", "/add", "/note"} <= seen


def test_what_is_no_beacon_is_dropped() -> None:
    shore = node(SHORE, rules=RULES)
    shore.hear(packet(SAMPLE, 1, "talker", "/", 4, 1, 0, "", "", True), 0, source=0)
    shore.hear(packet(2, 1, 5, 0), 0, source=0)
    assert shore.got(RosEntitySeen) == []
    assert shore.engine.stats.dropped == {"payload": 1, "unknown_stream": 1}
