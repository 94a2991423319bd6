"""What anybody can say under the addresses of others takes no room for ever."""

import pytest

from tests.core.rig import End, Rig
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    SampleReceived,
    SubscribersChanged,
)
from zacoustic.core.streams.specs import ActionSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import GoalReceived
from zacoustic.core.wire.agreement import WIRE_VERSION
from zacoustic.core.wire.frame import Sync
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


DAY_S = 86_400.0
LOG = TopicSpec(
    stream_id=10, name="log", journal=True, qos=Qos(reliability=Reliability.RELIABLE, depth=8)
)


def logging() -> Rig:
    """Return two nodes that know each other; neither has logged anything."""
    news = TopicSpec(stream_id=1, name="{node}/news")
    rig = Rig({address: StreamTable([LOG, news], nodes=LISTED) for address in LISTED})
    for address in (1, 2, 1, 2):
        rig.publish(address, 1, b"news")
        rig.run(60.0)
    return rig


def forge(rig: Rig, number: int, sync: Sync | None = None) -> None:
    """Let node 1 hear a sample that node 2 has not sent."""
    frame = (sync.encode() if sync else b"") + bytes((10, number)) + b"forged"
    rig[1].hear(frame, rig.now, source=2, destination=1)


def delivers(rig: Rig, value: bytes) -> int:
    """See that one sample is delivered, and nothing else; return how many frames that takes."""
    heard, ended = len(rig[1].got(SampleReceived)), len(rig[2].got(DeliveryEnded))
    rig.publish(2, 10, value)
    frames = len(rig.run(DAY_S))
    values = [each.value for each in rig[1].got(SampleReceived)[heard:]]
    assert [each for each in values if each != b"forged"] == [value]
    outcomes = [each.outcome for each in rig[2].got(DeliveryEnded)[ended:]]
    assert outcomes == [DeliveryOutcome.DELIVERED]
    return frames


@pytest.mark.parametrize("ahead", [0, 1, 2, 31, 40])
@pytest.mark.parametrize(
    ("used", "with_sync"), [(0, True), (1, True), (2, True), (5, True), (5, False)]
)
def test_sample_that_was_never_sent_costs_none_of_those_that_follow(
    used: int, with_sync: bool, ahead: int
) -> None:
    """They come when what the frame made the receiver think was long put right."""
    rig = logging()
    for number in range(used):
        delivers(rig, b"%d" % number)
    forge(rig, used + ahead, Sync(1, used + ahead) if with_sync else None)
    rig.run(DAY_S)
    for value in (b"first", b"second", b"third"):
        assert delivers(rig, value) <= 2  # it, and what acknowledges it


@pytest.mark.parametrize("former", [0, 3])
def test_sample_of_a_life_that_has_sent_none_costs_none(former: int) -> None:
    """The lineage that this life would begin is not used, since others have."""
    rig = logging()
    for number in range(former):
        delivers(rig, b"%d" % number)
    epoch = rig[2].engine.epoch
    if former:
        rig.restart(2, StreamTable([LOG], nodes=LISTED), keeps=True)
        epoch += 1
        rig.run(DAY_S)
    forge(rig, former, Sync(epoch, former))
    rig.run(DAY_S)
    for value in (b"first", b"second", b"third"):
        delivers(rig, value)


def test_acknowledgements_of_nothing_cost_one_sync_and_no_memory() -> None:
    rig = logging()
    for number in range(5):
        delivers(rig, b"%d" % number)
    before = dict(rig[2].journal)
    for number in range(2_000):
        sync = Sync(number % 7 and 30_000 + number, 99).encode() if number % 2 else b""
        rig[2].hear(sync + b"\xb9\x0a\x1e", rig.now, source=1, destination=2)
    assert rig[2].journal.keys() == before.keys()
    assert max(map(len, rig[2].journal.values())) <= max(map(len, before.values())) + 16
    for value in (b"first", b"second", b"third"):
        assert delivers(rig, value) <= 2
    assert rig.run(DAY_S) == []
