"""What anybody can say under the addresses of others takes no room for ever."""

from tests.core.rig import End, Rig
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import SampleReceived, SubscribersChanged
from zacoustic.core.streams.specs import ActionSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import GoalReceived
from zacoustic.core.wire.agreement import WIRE_VERSION
from zacoustic.core.wire.subscriptions import Subscribe

SOURCES = range(2, 254)
LISTED = {1: "shore", 2: "vehicle"}


def introduced(table: StreamTable, records: bytes) -> bytes:
    """Return a frame that begins as that of any node with this table."""
    return bytes((0xB0, WIRE_VERSION)) + (7).to_bytes(2, "big") + table.digest + records


def test_subscribe_of_nobody_is_not_written_down() -> None:
    view = TopicSpec(stream_id=5, name="view", qos=Qos(forward=Forward.ON_DEMAND))
    table = StreamTable([view], nodes=LISTED)
    end = End(1, table)
    for source in SOURCES:
        for page in range(22):
            message = bytes((0xBC,)) + Subscribe(page, source % 100, 0xFF).body
            end.hear(introduced(table, message), source * NS_PER_S, source=source, destination=1)
    kept = [key for key in end.journal if key.startswith("demand/")]
    assert kept == []  # none has shown to have heard this node
    # Of the one node that is listed, the one page that has a topic.
    assert [event.subscribers for event in end.got(SubscribersChanged)] == [(2,)]
    # What a version before has written down is deleted by the next life.
    entry = bytes((0, 7, 2, 0xFF)) + table.digest
    end.journal |= {"demand/2/0": entry} | {f"demand/{source}/3": entry for source in SOURCES}
    after = End(1, table, epoch=2, journal=end.journal)
    assert [key for key in after.journal if key.startswith("demand/")] == ["demand/2/0"]


def test_goals_of_nobody_are_not_taken_and_those_of_all_are_bounded() -> None:
    goto = ActionSpec(stream_id=30, name="goto", server=1, timeout_s=3600.0)
    for nodes, most in ((LISTED, 12), ({}, 1024)):
        table = StreamTable([goto], nodes=nodes)
        end = End(1, table)
        for source in SOURCES:
            for number in range(12):  # none closes another one
                goal = bytes((30, number)) + b"go"
                end.hear(introduced(table, goal), source * NS_PER_S, source=source, destination=1)
        taken = end.got(GoalReceived)
        assert len(taken) == most
        dropped = end.engine.stats.dropped
        assert (
            dropped.get("too_many_goals", 0) + dropped.get("stranger", 0)
            == 12 * len(SOURCES) - most
        )
        assert len(end.journal) <= most + 10
        if nodes:
            assert {event.goal.client for event in taken} == {2}


def test_number_far_ahead_does_not_stop_a_reliable_topic_for_ever() -> None:
    """What lies behind it is given up, and the publisher hears of that, so it can go on."""
    log = TopicSpec(
        stream_id=10, name="log", journal=True, qos=Qos(reliability=Reliability.RELIABLE, depth=8)
    )
    tables = {address: StreamTable([log], nodes=LISTED) for address in LISTED}
    rig = Rig(tables)
    rig.publish(2, 10, b"first")
    rig.run(60.0)
    assert [event.value for event in rig[1].got(SampleReceived)] == [b"first"]
    # Number 30 of the same count, with nothing behind it that could be handed on.
    rig[1].hear(bytes((10, 30)) + b"forged", rig.now, source=2, destination=1)
    for _ in range(3):
        rig.publish(2, 10, b"next")
        rig.run(600.0)
    rig.run(3600.0)
    assert rig[2].engine.delivering(10) == 0
    assert rig.run(3600.0) == []  # nobody repeats anything
    assert rig[1].got(SampleReceived)[-1].value == b"next"
