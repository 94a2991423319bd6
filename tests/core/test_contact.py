"""Heartbeats and lost nodes: nothing without them, and no more than was asked for."""

import pytest

from tests.core.rig import Rig, link
from zacoustic.core.base.stats import Cause
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import PeerFound, PeerLost
from zacoustic.core.linktypes import BROADCAST, LinkState
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable


def fleet(nodes: int = 2, *, listed: bool = True) -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=10, name="all"),
            TopicSpec(stream_id=11, name="to1", subscribers=(1,)),
            ServiceSpec(stream_id=20, name="arm", server=1),
        ],
        nodes={address: f"n{address}" for address in range(1, nodes + 1)} if listed else {},
    )


def beats(heartbeat_s: float = 60.0) -> TransmitRules:
    return TransmitRules(contact=ContactRules(heartbeat_s=heartbeat_s))


def misses(**lost_after_s: float) -> TransmitRules:
    """Return rules by which ``n2=300`` makes node 2 lost after 300 s."""
    after = {int(name[1:]): each for name, each in lost_after_s.items()}
    return TransmitRules(contact=ContactRules(lost_after_s=after))


def acquainted(nodes: int, rules: dict[int, TransmitRules]) -> Rig:
    water = Rig(dict.fromkeys(range(1, nodes + 1), fleet(nodes)), rules=rules)
    for address in (*water.ends, *water.ends):
        water.publish(address, 10, b"")
        water.run(20)
    water.frames.clear()
    return water


def test_nothing_is_sent_or_armed_without_them() -> None:
    water = acquainted(3, {})
    assert water.run(10**6) == []
    assert all(end.engine.poll_timeout() is None for end in water.ends.values())
    assert all(end.engine.contact.sightings() == {} for end in water.ends.values())


def test_heartbeat_is_one_byte_after_three_quarters_to_the_whole_of_its_time() -> None:
    water = acquainted(2, {2: beats()})
    water.run(7200)
    assert 120 <= len(water.frames) <= 160
    sent = {(source, each.destination, each.frame_bytes) for source, each in water.frames}
    assert sent == {(2, BROADCAST, b"\x00")}
    ledger = {each.cause: each.transmitted_bytes for each in water[2].engine.stats.ledger()}
    assert ledger[Cause.HEARTBEAT] == len(water.frames)


def test_heartbeat_is_spared_where_something_else_is_said() -> None:
    water = acquainted(3, {2: beats()})
    for _ in range(20):
        water.publish(2, 10, b"x")
        water.run(40)
    assert {sent.frame_bytes for _, sent in water.frames} == {b"\x0ax"}
    water.frames.clear()
    for _ in range(20):
        water.publish(2, 11, b"x")  # nobody but node 1 hears it
        water.run(40)
    assert {sent.frame_bytes for _, sent in water.frames} == {b"\x0bx", b"\x00"}
    assert 13 <= sum(sent.frame_bytes == b"\x00" for _, sent in water.frames) <= 18


def test_heartbeat_introduces_a_node_that_has_restarted() -> None:
    water = acquainted(2, {2: beats()})
    water.restart(2, fleet())
    frames = water.run(600)
    assert frames[0].startswith(b"\xb0\x01\x00\x02")
    assert frames[-1] == b"\x00"


def test_heartbeats_begin_again_with_the_link_and_are_silent_in_silence() -> None:
    water = acquainted(2, {2: beats()})
    engine = water[2].engine
    engine.silence.begin(water.now, duration_s=3600)
    assert water.run(3599) == []
    assert water.run(2) == [b"\x00"]
    engine.silence.begin(water.now)
    assert water.run(10**6) == []
    assert engine.poll_timeout() is None
    engine.silence.resume(water.now)
    engine.handle_link_state(LinkState.DOWN, water.now)
    assert water.run(1000) == []
    engine.handle_link_state(LinkState.UP, water.now, water.capabilities)
    assert water.run(1) == [b"\x00"]


def test_node_that_is_not_heard_is_lost_and_found_again() -> None:
    water = acquainted(2, {1: misses(n2=300)})
    water.publish(2, 10, b"x")
    water.exchange()
    heard_at = water.now
    water.run(299)
    assert water[1].got(PeerLost) == []
    water.run(2)
    lost_at = heard_at + 300 * NS_PER_S
    assert water[1].got(PeerLost) == [PeerLost(address=2, heard_at=heard_at, lost_at=lost_at)]
    assert water[1].engine.contact.sightings()[2].is_lost
    assert water[1].engine.poll_timeout() is None
    water.run(10_000)
    assert len(water[1].got(PeerLost)) == 1
    water.publish(2, 10, b"x")
    water.exchange()
    assert water[1].got(PeerFound) == [PeerFound(address=2, found_at=water.now)]
    assert not water[1].engine.contact.sightings()[2].is_lost
    water.run(301)
    assert len(water[1].got(PeerLost)) == 2


def test_node_that_was_never_heard_is_lost_too() -> None:
    water = Rig({1: fleet()}, rules={1: misses(n2=300, n1=1)})
    water.run(301)
    (lost,) = water[1].got(PeerLost)
    assert (lost.address, lost.heard_at, lost.lost_at) == (2, None, 300 * NS_PER_S)


def test_node_that_nobody_lists_is_missed_once_it_was_heard() -> None:
    rules = TransmitRules(contact=ContactRules(others_lost_after_s=100))
    water = Rig({1: fleet(listed=False), 2: fleet(listed=False)}, rules={1: rules})
    assert water[1].engine.poll_timeout() is None
    water.publish(2, 10, b"x")
    water.run(200)
    assert [each.address for each in water[1].got(PeerLost)] == [2]


@pytest.mark.parametrize("addressed", [True, False])
def test_frame_for_another_node_is_a_sign_where_it_is_heard(addressed: bool) -> None:
    capabilities = link(addressed=addressed)
    water = Rig(
        dict.fromkeys((1, 2, 3), fleet(3)), capabilities=capabilities, rules={3: misses(n2=100)}
    )
    for _ in range(5):
        water.publish(2, 11, b"for 1")
        sent = water[2].send(water.now)
        assert sent is not None
        assert sent.destination == 1
        water[3].hear(sent.frame_bytes, water.now, source=2, destination=1)
        water.run(50, lambda source, node, transmission: False)
    assert water[3].got(PeerLost) == []


def test_lost_is_told_while_the_own_link_is_down() -> None:
    water = acquainted(2, {1: misses(n2=300)})
    water[1].engine.handle_link_state(LinkState.DOWN, water.now)
    water.run(301)
    assert len(water[1].got(PeerLost)) == 1


def test_heartbeats_that_are_heard_keep_a_node_from_being_lost() -> None:
    rules = {2: beats(60), 1: misses(n2=180)}
    water = acquainted(2, rules)
    water.run(86_400)
    assert water[1].got(PeerLost) == []
    assert all(source == 2 for source, _ in water.frames)
