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
    medium = Rig(dict.fromkeys(range(1, nodes + 1), fleet(nodes)), rules=rules)
    for address in (*medium.ends, *medium.ends):
        medium.publish(address, 10, b"")
        medium.run(20)
    medium.frames.clear()
    return medium


def test_nothing_is_sent_or_armed_without_them() -> None:
    medium = acquainted(3, {})
    assert medium.run(10**6) == []
    assert all(end.engine.poll_timeout() is None for end in medium.ends.values())
    assert all(end.engine.contact.sightings() == {} for end in medium.ends.values())


def test_heartbeat_is_one_byte_after_three_quarters_to_the_whole_of_its_time() -> None:
    medium = acquainted(2, {2: beats()})
    medium.run(7200)
    assert 120 <= len(medium.frames) <= 160
    sent = {(source, each.destination, each.frame_bytes) for source, each in medium.frames}
    assert sent == {(2, BROADCAST, b"\x00")}
    ledger = {each.cause: each.transmitted_bytes for each in medium[2].engine.stats.ledger()}
    assert ledger[Cause.HEARTBEAT] == len(medium.frames)


def test_heartbeat_is_spared_where_something_else_is_said() -> None:
    medium = acquainted(3, {2: beats()})
    for _ in range(20):
        medium.publish(2, 10, b"x")
        medium.run(40)
    assert {sent.frame_bytes for _, sent in medium.frames} == {b"\x0ax"}
    medium.frames.clear()
    for _ in range(20):
        medium.publish(2, 11, b"x")  # nobody but node 1 hears it
        medium.run(40)
    assert {sent.frame_bytes for _, sent in medium.frames} == {b"\x0bx", b"\x00"}
    assert 13 <= sum(sent.frame_bytes == b"\x00" for _, sent in medium.frames) <= 18


def test_heartbeat_introduces_a_node_that_has_restarted() -> None:
    medium = acquainted(2, {2: beats()})
    medium.restart(2, fleet())
    frames = medium.run(600)
    assert frames[0].startswith(b"\xb0\x02\x00\x02")
    assert frames[-1] == b"\x00"


def test_heartbeats_begin_again_with_the_link_and_are_silent_in_silence() -> None:
    medium = acquainted(2, {2: beats()})
    engine = medium[2].engine
    engine.silence.begin(medium.now, duration_s=3600)
    assert medium.run(3599) == []
    assert medium.run(2) == [b"\x00"]
    engine.silence.begin(medium.now)
    assert medium.run(10**6) == []
    assert engine.poll_timeout() is None
    engine.silence.resume(medium.now)
    engine.handle_link_state(LinkState.DOWN, medium.now)
    assert medium.run(1000) == []
    engine.handle_link_state(LinkState.UP, medium.now, medium.capabilities)
    assert medium.run(1) == [b"\x00"]


def test_node_that_is_not_heard_is_lost_and_found_again() -> None:
    medium = acquainted(2, {1: misses(n2=300)})
    medium.publish(2, 10, b"x")
    medium.exchange()
    heard_at = medium.now
    medium.run(299)
    assert medium[1].got(PeerLost) == []
    medium.run(2)
    lost_at = heard_at + 300 * NS_PER_S
    assert medium[1].got(PeerLost) == [PeerLost(address=2, heard_at=heard_at, lost_at=lost_at)]
    assert medium[1].engine.contact.sightings()[2].is_lost
    assert medium[1].engine.poll_timeout() is None
    medium.run(10_000)
    assert len(medium[1].got(PeerLost)) == 1
    medium.publish(2, 10, b"x")
    medium.exchange()
    assert medium[1].got(PeerFound) == [PeerFound(address=2, found_at=medium.now)]
    assert not medium[1].engine.contact.sightings()[2].is_lost
    medium.run(301)
    assert len(medium[1].got(PeerLost)) == 2


def test_node_that_was_never_heard_is_lost_too() -> None:
    medium = Rig({1: fleet()}, rules={1: misses(n2=300, n1=1)})
    medium.run(301)
    (lost,) = medium[1].got(PeerLost)
    assert (lost.address, lost.heard_at, lost.lost_at) == (2, None, 300 * NS_PER_S)


def test_node_that_nobody_lists_is_missed_once_it_was_heard() -> None:
    rules = TransmitRules(contact=ContactRules(others_lost_after_s=100))
    medium = Rig({1: fleet(listed=False), 2: fleet(listed=False)}, rules={1: rules})
    assert medium[1].engine.poll_timeout() is None
    medium.publish(2, 10, b"x")
    medium.run(200)
    assert [each.address for each in medium[1].got(PeerLost)] == [2]


@pytest.mark.parametrize("addressed", [True, False])
def test_frame_for_another_node_is_a_sign_where_it_is_heard(addressed: bool) -> None:
    capabilities = link(addressed=addressed)
    medium = Rig(
        dict.fromkeys((1, 2, 3), fleet(3)), capabilities=capabilities, rules={3: misses(n2=100)}
    )
    for number in range(5):
        medium.publish(2, 11, b"for 1")
        sent = medium[2].send(medium.now)
        assert sent is not None
        assert sent.destination == 1
        medium[3].hear(sent.frame_bytes, medium.now, source=2, destination=1)
        medium.run(40 + 5 * number, lambda source, node, transmission: False)  # no period
    assert medium[3].got(PeerLost) == []


def test_lost_is_told_while_the_own_link_is_down() -> None:
    medium = acquainted(2, {1: misses(n2=300)})
    medium[1].engine.handle_link_state(LinkState.DOWN, medium.now)
    medium.run(301)
    assert len(medium[1].got(PeerLost)) == 1


def test_heartbeats_that_are_heard_keep_a_node_from_being_lost() -> None:
    rules = {2: beats(60), 1: misses(n2=180)}
    medium = acquainted(2, rules)
    medium.run(86_400)
    assert medium[1].got(PeerLost) == []
    assert all(source == 2 for source, _ in medium.frames)
