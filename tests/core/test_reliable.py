"""Reliable topics, engines driven by hand: what is told, what is refused, what survives."""

import random
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import msgspec
import pytest

from tests.core.rig import End, Rig, link
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    JournalStateChanged,
    SampleReceived,
)
from zacoustic.core.linktypes import LinkState
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.frame import Control
from zacoustic.errors import JournalUnavailableError, LocalError

NODES = {1: "shore", 2: "auv", 3: "buoy"}


def topic(stream_id: int, name: str, *, journal: bool = False, **settings: Any) -> TopicSpec:
    subscribers = {
        key: settings.pop(key) for key in ("publishers", "subscribers") if key in settings
    }
    qos = Qos(reliability=Reliability.RELIABLE, **({"depth": 8} | settings))
    return TopicSpec(stream_id=stream_id, name=name, qos=qos, journal=journal, **subscribers)


def fleet(nodes: Mapping[int, str] = MappingProxyType({1: "shore", 2: "auv"})) -> StreamTable:
    return StreamTable(
        [
            topic(1, "orders"),
            topic(2, "target", depth=1),
            topic(3, "log", journal=True),
            topic(4, "brief", lifespan_s=10.0),
            topic(5, "own", subscribers=(1,)),
            topic(6, "brieflog", journal=True, lifespan_s=10.0),
        ],
        nodes=nodes,
    )


def ends(count: int = 2) -> Rig:
    nodes = {address: NODES[address] for address in range(1, count + 1)}
    rig = Rig(dict.fromkeys(nodes, fleet(nodes)))
    rig.publish(1, 1, b"hello")
    rig.run(20)
    for end in rig.ends.values():
        end.events.clear()
    rig.frames.clear()
    return rig


def values(rig: Rig, address: int) -> list[object]:
    return [event.value for event in rig[address].got(SampleReceived)]


def outcomes(rig: Rig, address: int = 1) -> list[DeliveryOutcome]:
    return [event.outcome for event in rig[address].got(DeliveryEnded)]


def publish(rig: Rig, stream_id: int, value: bytes, **settings: Any) -> int:
    end = rig[1]
    delivery_id = end.engine.publish(stream_id, value, rig.now, **settings)
    end.now = rig.now
    end.settle()
    return delivery_id


def test_sample_between_two_that_know_each_other_costs_two_bytes_and_its_ack_three() -> None:
    rig = ends()
    for _ in range(4):  # until the count is known
        publish(rig, 1, b"x")
        rig.run(5)
    rig.frames.clear()
    delivery_id = publish(rig, 1, b"payload")
    rig.run(5)
    sizes = [(source, len(sent.frame_bytes)) for source, sent in rig.frames]
    assert sizes == [(1, 2 + len(b"payload")), (2, 3)]
    assert rig.frames[1][1].frame_bytes[0] == Control.ACK
    assert rig[1].got(DeliveryEnded)[-1].delivery_id == delivery_id


def test_lost_frame_and_lost_ack_are_made_good_and_nothing_comes_twice() -> None:
    rig = ends()
    rng = random.Random(4)
    for number in range(20):
        publish(rig, 1, b"%d" % number)
        rig.run(3, lambda source, node, sent: rng.random() < 0.5)
    rig.run(200)
    assert values(rig, 2) == [b"%d" % number for number in range(20)][-len(values(rig, 2)) :]
    assert set(outcomes(rig)) <= {DeliveryOutcome.DELIVERED, DeliveryOutcome.SUPERSEDED}
    assert len(outcomes(rig)) == 20
    assert rig[1].engine.delivering(1) == 0


def test_delete_and_encoding_are_delivered_too() -> None:
    rig = ends()
    publish(rig, 1, b"{}", encoding="application/json")
    publish(rig, 1, b"", delete=True)
    rig.run(20)
    first, second = rig[2].got(SampleReceived)
    assert (first.encoding, first.deleted, second.deleted) == ("application/json", False, True)
    assert outcomes(rig) == [DeliveryOutcome.DELIVERED] * 2


def test_newer_target_supersedes_and_is_the_one_that_arrives() -> None:
    rig = ends()
    for number in range(5):
        publish(rig, 2, b"%d" % number)
    rig.run(20)
    assert values(rig, 2) == [b"4"]
    assert sorted(each.value for each in outcomes(rig)) == ["delivered"] + ["superseded"] * 4


@pytest.mark.parametrize("stream_id", [4, 6])
def test_expired_sample_does_not_hold_back_those_behind_it(stream_id: int) -> None:
    rig = ends()

    def silence(*_: object) -> bool:
        return False

    publish(rig, stream_id, b"old")
    rig.run(6, silence)
    publish(rig, stream_id, b"younger")
    rig.run(5, silence)
    assert outcomes(rig) == [DeliveryOutcome.EXPIRED]
    assert rig[1].got(DeliveryEnded)[0].missing == (2,)
    rig.run(4)
    assert values(rig, 2) == [b"younger"]
    publish(rig, stream_id, b"young")
    rig.run(5)
    assert values(rig, 2) == [b"younger", b"young"]


def test_sample_that_expires_unsent_leaves_no_gap() -> None:
    rig = ends()
    rig[1].engine.handle_link_state(LinkState.DOWN, rig.now)
    publish(rig, 6, b"never sent")
    rig.now += seconds_to_ns(11)
    rig[1].engine.handle_timeout(rig.now)
    rig[1].settle()
    assert outcomes(rig) == [DeliveryOutcome.EXPIRED]
    publish(rig, 6, b"sent")
    rig[1].engine.handle_link_state(LinkState.UP, rig.now, link())
    rig.run(9)
    assert values(rig, 2) == [b"sent"]


def test_nobody_else_to_deliver_to_is_delivered_at_once() -> None:
    rig = ends()
    publish(rig, 5, b"x")
    assert outcomes(rig) == [DeliveryOutcome.DELIVERED]
    assert rig.run(60) == []


def test_nobody_listed_is_refused() -> None:
    end = End(1, StreamTable([topic(1, "orders")]))
    with pytest.raises(LocalError, match="orders: nobody is listed who could acknowledge"):
        end.engine.publish(1, b"x", 0)


def test_nothing_is_accepted_while_the_journal_cannot_be_written() -> None:
    rig = ends()
    end = rig[1]
    end.commits = False
    publish(rig, 3, b"waits")
    assert rig.run(5) == [], "nothing is sent before it is written down"
    end.engine.handle_journal_state("no space left", rig.now)
    end.settle()
    assert end.got(JournalStateChanged)[-1].failure == "no space left"
    with pytest.raises(JournalUnavailableError, match=r"log: not accepted: .*: no space left"):
        end.engine.publish(3, b"x", rig.now)
    publish(rig, 1, b"needs no journal")
    end.engine.handle_journal_state("", rig.now)
    end.commits = True
    end.settle()
    assert len(end.got(DeliveryStored)) == 1
    publish(rig, 3, b"goes")
    rig.run(20)
    assert sorted(map(str, values(rig, 2))) == ["b'goes'", "b'needs no journal'", "b'waits'"]


def stored_of(rig: Rig, commits: int) -> dict[str, bytes]:
    """Publish that many samples to the log of a node without a link; return its journal."""
    engine = Engine(address=1, table=fleet(), epoch=7, rng=random.Random(1))
    entries: dict[str, bytes] = {}
    for number in range(commits):
        engine.publish(3, b"%d" % number, 0)
    while (write := engine.poll_journal()) is not None:
        if write.value is None:
            entries.pop(write.key)
        else:
            entries[write.key] = write.value
        engine.handle_journal_committed(write.write_id, 0)
    return entries


class Reborn(End):
    """A node in its next life."""

    def __init__(self, table: StreamTable, stored: Mapping[str, bytes], now: int) -> None:
        super().__init__(1, table)
        self.engine = Engine(address=1, table=table, epoch=8, rng=random.Random(2), stored=stored)
        self.events.clear()
        self.now = now
        self.engine.handle_link_state(LinkState.UP, now, self.capabilities)
        self.settle()


def test_next_life_sends_what_was_stored_and_goes_on_counting() -> None:
    rig = ends()
    rig.ends[1] = Reborn(fleet(), stored_of(rig, 3), rig.now)
    rig.run(20)
    assert values(rig, 2) == [b"0", b"1", b"2"]
    first, second, third = (event.delivery_id for event in rig[1].got(DeliveryEnded))
    assert publish(rig, 3, b"3") > third > second > first
    rig.run(20)
    assert values(rig, 2) == [b"0", b"1", b"2", b"3"]


def test_what_was_stored_for_another_stream_is_given_up_and_told() -> None:
    rig = ends()
    stored = stored_of(rig, 2)
    other = [
        msgspec.structs.replace(stream.spec, name="another")
        if stream.stream_id == 3
        else stream.spec
        for stream in fleet()
    ]
    table = StreamTable(other, nodes=fleet().nodes)
    rig.ends[1] = Reborn(table, stored, rig.now)
    ended = rig[1].got(DeliveryEnded)
    assert [event.outcome for event in ended] == [DeliveryOutcome.CANCELLED] * 2
    assert ended[0].detail == "the stream is defined in another way now"
    assert publish(rig, 3, b"x") > ended[1].delivery_id


def test_stream_that_is_not_journalled_any_more_still_sends_what_was_stored() -> None:
    rig = ends()
    specs = [
        msgspec.structs.replace(stream.spec, journal=False)
        if isinstance(stream.spec, TopicSpec)
        else stream.spec
        for stream in fleet()
    ]
    stored = stored_of(rig, 2)
    rig.ends[1] = Reborn(StreamTable(specs, nodes=fleet().nodes), stored, rig.now)
    rig.run(20)
    publish(rig, 3, b"2")
    rig.run(20)
    assert values(rig, 2) == [b"0", b"1", b"2"]


def test_one_subscriber_that_is_out_of_range_does_not_hold_back_the_other() -> None:
    rig = ends(3)
    rng = random.Random(3)
    for number in range(8):
        publish(rig, 1, b"%d" % number)
        rig.run(5, lambda source, node, sent: 3 not in (source, node) and rng.random() < 0.6)
    assert values(rig, 2) == [b"%d" % number for number in range(len(values(rig, 2)))]
    assert len(values(rig, 2)) >= 7
    assert outcomes(rig) == []
    rig.run(2000)
    assert values(rig, 3) == [b"%d" % number for number in range(8)]
    assert outcomes(rig) == [DeliveryOutcome.DELIVERED] * 8


def test_receiver_that_has_forgotten_is_brought_up_though_another_is_out_of_range() -> None:
    rig = ends(3)

    def without_3(source: int, node: int, sent: object) -> bool:
        return 3 not in (source, node)

    for number in range(4):
        publish(rig, 1, b"%d" % number)
        rig.run(5, without_3)
    rig.restart(2, fleet({address: NODES[address] for address in (1, 2, 3)}))
    publish(rig, 1, b"4")
    rig.run(40, without_3)
    assert values(rig, 2)[-1] == b"4"


def test_transmission_without_a_report_is_repeated_on_the_next_link() -> None:
    rig = ends()
    publish(rig, 1, b"x")
    assert rig[1].poll(rig.now) is not None, "under way when the modem is unplugged"
    rig[1].engine.handle_link_state(LinkState.DOWN, rig.now)
    rig[1].engine.handle_link_state(LinkState.UP, rig.now, link(mtu_bytes=32))
    rig.run(20)
    assert values(rig, 2) == [b"x"]


def test_sample_that_fits_no_frame_of_the_next_link_goes_as_an_object() -> None:
    rig = ends()
    rig[1].engine.handle_link_state(LinkState.DOWN, rig.now)
    publish(rig, 1, bytes(40))
    publish(rig, 1, b"small")
    rig[1].engine.handle_link_state(LinkState.UP, rig.now, link(mtu_bytes=32))
    rig.run(40)
    assert values(rig, 2) == [bytes(40), b"small"]
    assert outcomes(rig) == [DeliveryOutcome.DELIVERED] * 2


def test_idle_once_all_is_delivered() -> None:
    rig = ends()
    publish(rig, 1, b"x")
    rig.run(30)
    assert rig[1].engine.is_idle
    assert rig[2].engine.is_idle


def test_sample_that_will_expire_has_a_last_repetition_however_rare_they_have_become() -> None:
    slow = link(bit_rate_bps=720, preamble_s=0.15, propagation_s=1.0, senses_carrier=True)
    rig = Rig(dict.fromkeys((1, 2), fleet()), capabilities=slow)
    publish(rig, 1, b"nobody hears")
    rig.run(1800, silence)
    begin = rig.now
    publish(rig, 4, b"for ten seconds")
    sent_at: list[float] = []
    for _ in range(120):
        rig.frames.clear()
        rig.run(0.1, silence)
        if any(sent.frame_bytes.endswith(b"seconds") for _, sent in rig.frames):
            sent_at.append((rig.now - begin) / NS_PER_S)
    first_s, last_s = sent_at
    assert first_s < 0.2
    assert 7 < last_s < 8, "there is time for an answer"
    assert outcomes(rig)[-1] is DeliveryOutcome.EXPIRED


def silence(*_: object) -> bool:
    return False
