"""A link on which everything is sent and nothing is heard says so, once."""

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.events import NothingHeard
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

TABLE = StreamTable(
    [TopicSpec(stream_id=1, name="t", qos=Qos(depth=50))], nodes={1: "shore", 2: "auv"}
)


def told(*, alone: bool) -> list[NothingHeard]:
    """Let node 1 talk for a while; return what it was told."""
    medium = VirtualNetwork(line(0, 500, channel="none"), TABLE)
    if alone:
        medium.crash(2)
    medium.every(10, lambda: medium.publish(1, 1, b"hello"))
    medium.run(until_s=900)
    heard = [event for node, event in medium.events if node == 1]
    return [event for event in heard if isinstance(event, NothingHeard)]


def test_who_is_alone_is_told_once() -> None:
    (event,) = told(alone=True)
    assert event.frames == 20
    assert event.changed_at > event.up_at


def test_who_is_answered_is_told_nothing() -> None:
    assert told(alone=False) == []


def test_link_that_comes_up_again_counts_anew() -> None:
    medium = VirtualNetwork(line(0, 500, channel="none"), TABLE)
    medium.crash(2)
    medium.every(10, lambda: medium.publish(1, 1, b"hello"))
    medium.at(150, lambda: medium.set_link(1, up=False))
    medium.at(155, lambda: medium.set_link(1, up=True))
    medium.run(until_s=300)
    assert not any(isinstance(event, NothingHeard) for _, event in medium.events)
    medium.run(until_s=600)
    assert sum(isinstance(event, NothingHeard) for _, event in medium.events) == 1
