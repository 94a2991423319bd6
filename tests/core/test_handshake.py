"""The handshake: what is decoded, what is asked and said, and when it falls silent."""

import pytest

from tests.core.rig import Rig, link
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.events import PeerSeen, SampleReceived, StreamsDiffer
from zacoustic.core.linktypes import Transmission
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.core.wire.agreement import ASSURED, WIRE_VERSION, Confirm, Hello, TableRow, Tag

NODES = {1: "shore", 2: "auv"}


def table(
    name: str = "depth", *, nodes: dict[int, str] | None = None, other: str = "agreed"
) -> StreamTable:
    """Return a table whose stream 10 may be called otherwise, and whose stream 11 is the same."""
    return StreamTable(
        [
            TopicSpec(stream_id=10, name=name, qos=Qos(depth=100)),
            TopicSpec(stream_id=11, name=other, qos=Qos(depth=100)),
        ],
        nodes=NODES if nodes is None else nodes,
    )


def values(rig: Rig, address: int) -> list[bytes]:
    return [event.value for event in rig[address].got(SampleReceived)]


def settled(rig: Rig, source: int = 1) -> None:
    """Publish until frames of `source` begin with nothing."""
    rig.publish(source, 11, b"hello")
    rig.run(1)
    rig.publish(source, 11, b"again")
    assert rig.exchange() == [b"\x0bagain"]


def test_a_sample_costs_one_byte_once_the_other_end_has_confirmed() -> None:
    rig = Rig({1: table(), 2: table()})
    rig.publish(1, 10, b"a")
    first = rig.exchange()
    assert first == [Hello(WIRE_VERSION, 1, table().digest).encode() + b"\x0aa"]
    confirms = rig.run(1)
    assert confirms == [Confirm(1, 1).encode()]
    rig.publish(1, 10, b"b")
    assert rig.exchange() == [b"\x0ab"]
    assert values(rig, 2) == [b"a", b"b"]


def test_confirmation_waits_until_no_duplicate_of_a_former_life_can_arrive() -> None:
    rig = Rig({1: table(), 2: table()})
    rig.publish(1, 10, b"a")
    rig.exchange()
    unit_ns = rig.capabilities.airtime_ns(rig.capabilities.mtu_bytes)
    assert rig.run(3.9 * unit_ns / 1e9) == []
    assert rig.run(20 * unit_ns / 1e9) == [Confirm(1, 1).encode()]


def test_confirmation_goes_behind_a_frame_of_its_peer_not_when_one_may_be_on_its_way() -> None:
    both = StreamTable(
        [
            TopicSpec(stream_id=10, name="report"),
            TopicSpec(stream_id=11, name="command", subscribers=(1,)),
        ],
        nodes=NODES,
    )
    rig = Rig({1: both, 2: both})
    unit_s = rig.capabilities.airtime_ns(rig.capabilities.mtu_bytes) / 1e9
    rig.publish(1, 10, b"first")
    rig.run(unit_s)
    rig.publish(2, 11, b"too soon to carry a confirmation")
    assert len(rig.run(9 * unit_s)) == 1
    rig.publish(1, 10, b"second")
    # Node 1 has confirmed node 2 with its second frame.
    assert rig.run(2.1 * unit_s)[1:] == [Confirm(ASSURED, 1).encode()]


def test_late_frame_of_a_former_life_is_not_decoded_by_the_new_table() -> None:
    rig = Rig({1: table("depth"), 2: table("depth")})
    settled(rig)
    rig.publish(1, 10, b"old")
    rig.exchange()
    late = rig.frames[-1][1]
    assert late.frame_bytes == b"\x0aold"
    rig.restart(1, table("height"))
    rig.restart(2, table("height"))
    rig.publish(1, 11, b"new")
    rig.exchange()
    rig.deliver(1, late)
    assert values(rig, 2) == [b"new"]
    rig.run(1)
    rig.publish(1, 10, b"fresh")
    assert rig.exchange() == [b"\x0afresh"]
    assert values(rig, 2) == [b"new", b"fresh"]


def test_late_hello_does_not_make_a_restarted_hearer_trust_the_present_life() -> None:
    rig = Rig({1: table("depth"), 2: table("height")})
    rig.publish(1, 11, b"x")
    rig.exchange()
    late = rig.frames[0][1]
    rig.restart(1, table("height"))
    rig.publish(1, 11, b"y")
    rig.exchange()
    # Within the time in which the late copy can arrive, node 2 confirms nothing.
    rig.restart(2, table("depth"))
    rig.deliver(1, late)
    for _ in range(3):
        rig.publish(1, 10, b"height!")
        rig.run(1)
    assert values(rig, 2) == [b"x"]
    assert [event.stream_id for event in rig[2].got(StreamsDiffer)] == [10]


def test_late_hello_does_not_silence_a_stream_for_ever() -> None:
    rig = Rig({1: table(), 2: table()})
    rig.publish(1, 11, b"x")
    rig.exchange()
    late = rig.frames[0][1]
    rig.restart(1, table())
    settled(rig)
    rig.deliver(1, late)
    for number in range(5):
        rig.publish(1, 11, bytes((number,)))
        rig.run(1)
    assert values(rig, 2)[-1] == b"\x04"


def test_late_confirmation_does_not_silence_a_restarted_hearer_for_ever() -> None:
    rig = Rig({1: table(), 2: table()})
    settled(rig)
    late = next(sent for source, sent in rig.frames if source == 2)
    rig.restart(2, table("height"))
    rig.publish(2, 11, b"I am new")
    rig.exchange()
    rig.deliver(2, late)
    for number in range(5):
        rig.publish(1, 11, bytes((number,)))
        rig.run(1)
    assert values(rig, 2)[-1] == b"\x04"


@pytest.mark.parametrize("lost_frames", range(12))
def test_restart_with_another_table_is_never_misread_whichever_frames_are_lost(
    lost_frames: int,
) -> None:
    rig = Rig({1: table("depth"), 2: table("depth")})
    settled(rig)
    rig.restart(1, table("height"))
    left = [lost_frames]

    def passes(source: int, node: int, transmission: Transmission) -> bool:
        left[0] -= 1
        return left[0] < 0

    for number in range(20):
        rig.publish(1, 10, b"height%d" % number)
        rig.publish(1, 11, b"same%d" % number)
        rig.run(0.1, passes)
    heard = values(rig, 2)
    assert not [value for value in heard if value.startswith(b"height")]
    assert heard[-1] == b"same19"
    assert [event.stream_id for event in rig[2].got(StreamsDiffer)] == [10]
    assert [event.stream_id for event in rig[1].got(StreamsDiffer)] == [10]


def test_restarted_hearer_with_another_table_misreads_nothing() -> None:
    rig = Rig({1: table("depth"), 2: table("depth")})
    settled(rig)
    rig.restart(2, table("height"))
    for number in range(10):
        rig.publish(1, 10, b"depth")
        rig.publish(1, 11, bytes((number,)))
        rig.run(0.1)
    heard = values(rig, 2)
    assert b"depth" not in heard
    assert heard[-1] == b"\x09"


def test_missing_stream_differs_and_is_reported_at_both_ends() -> None:
    lacking = StreamTable([TopicSpec(stream_id=11, name="agreed")], nodes=NODES)
    rig = Rig({1: table(), 2: lacking})
    rig.publish(1, 10, b"x")
    rig.publish(1, 11, b"y")
    rig.run(5)
    rig.publish(1, 11, b"z")
    rig.publish(1, 10, b"x")
    rig.run(5)
    assert values(rig, 2) == [b"z"]
    for address in (1, 2):
        assert [event.stream_id for event in rig[address].got(StreamsDiffer)] == [10]


def test_table_with_another_list_of_nodes_still_exchanges_the_streams_that_agree() -> None:
    rig = Rig({1: table(), 2: table(nodes=NODES | {3: "glider"})})
    for _ in range(3):
        rig.publish(1, 11, b"x")
        rig.run(1)
    assert values(rig, 2)[-1:] == [b"x"]
    assert rig[2].got(StreamsDiffer) == []


def test_node_without_a_list_of_nodes_tags_its_broadcasts_for_ever() -> None:
    rig = Rig({1: table(nodes={}), 2: table(nodes={})})
    for _ in range(3):
        rig.publish(1, 11, b"x")
        rig.run(1)
    rig.publish(1, 11, b"x")
    assert rig.exchange() == [Tag(1).encode() + b"\x0bx"]


def test_on_broadcast_one_frame_of_eight_carries_a_hello_until_all_have_confirmed() -> None:
    nodes = {1: "shore", 2: "auv", 3: "absent"}
    rig = Rig({1: table(nodes=nodes), 2: table(nodes=nodes)})
    heads: list[int] = []
    for _ in range(24):
        rig.publish(1, 11, b"x")
        heads.append(rig.exchange()[0][0])
        rig.run(0.9)  # faster than what is spread
    assert heads == ([0xB0] + [0xB1] * 7) * 3


def test_other_wire_version_is_reported_and_the_rest_of_its_frame_dropped() -> None:
    rig = Rig({1: table(), 2: table()})
    strange = Hello(9, 1, table().digest).encode() + b"\x0bx"
    rig[2].hear(strange, 0, source=1)
    seen = rig[2].got(PeerSeen)
    assert [(event.wire_version, event.same_table) for event in seen] == [(9, False)]
    assert values(rig, 2) == []
    assert rig[2].engine.stats.dropped == {"version": 1}
    rig[2].hear(b"\x0bx", 0, source=1)
    assert values(rig, 2) == []


def test_differing_ends_fall_silent_and_stay_so() -> None:
    rig = Rig({1: table("depth"), 2: table("height")})
    rig.publish(1, 10, b"x")
    rig.publish(2, 10, b"x")
    frames = rig.run(3600)
    assert len(frames) <= 12
    assert rig[1].engine.is_idle
    assert rig[2].engine.is_idle


def test_one_way_traffic_between_differing_ends_ends_the_answers() -> None:
    rig = Rig({1: table("depth"), 2: table("height")})
    for _ in range(500):
        rig.publish(1, 11, b"x")
        rig.run(0.1)
    answers = [sent for source, sent in rig.frames if source == 2]
    assert len(answers) <= 12
    assert len(values(rig, 2)) >= 498


def test_question_that_may_not_be_repeated_yet_does_not_spin() -> None:
    rig = Rig({1: table(), 2: table()}, capabilities=link(bit_rate_bps=512, propagation_s=1.0))
    # Node 2 asks; the question is lost; meanwhile it has something to say to node 1 again.
    for number in range(8):
        rig[2].hear(b"\x0b" + bytes((number,)), rig.now, source=1)
        rig.ends[2].engine.publish(11, b"x", rig.now)
        rig.run(3, lambda source, node, transmission: False)


def test_declared_stream_begins_a_new_epoch_and_is_understood_when_both_have_it() -> None:
    rig = Rig({1: table(), 2: table()})
    settled(rig)
    spec = TopicSpec(stream_id=12, name="new")
    rig[1].engine.declare(spec, rig.now)
    rig[1].settle()
    rig.publish(1, 12, b"x")
    rig.publish(1, 11, b"y")
    rig.run(1)
    assert rig[1].engine.epoch == 2
    assert set(values(rig, 2)[2:]) <= {b"y"}
    rig[2].engine.declare(spec, rig.now)
    rig[2].settle()
    for _ in range(4):
        rig.publish(1, 12, b"z")
        rig.run(0.9)  # faster than what is spread
    assert values(rig, 2)[-1] == b"z"
    rig.publish(1, 12, b"z")
    assert rig.exchange() == [b"\x0cz"]


def test_asked_rows_of_impossible_streams_change_nothing() -> None:
    rig = Rig({1: table(), 2: table("height")})
    rig.publish(1, 11, b"x")
    rig.exchange()
    for stream_id in (0, 176, 255):
        rig[2].hear(TableRow(1, stream_id, b"abcd").encode(), rig.now, source=1)
    assert rig[2].got(StreamsDiffer) == []


@pytest.mark.parametrize("mtu_bytes", [8, 11, 16, 32, 64])
def test_saturated_sender_still_answers_and_asks(mtu_bytes: int) -> None:
    rig = Rig({1: table("depth"), 2: table("height")}, capabilities=link(mtu_bytes=mtu_bytes))
    full = bytes(mtu_bytes - 4)
    for _ in range(200):
        for _ in range(3):
            rig.publish(2, 10, full)
        rig.publish(1, 11, b"x")
        # Node 2 never has an empty queue.
        for _ in range(2):
            for address in (1, 2):
                sent = rig[address].send(rig.now)
                if sent is not None:
                    rig.deliver(address, sent)
        rig.now += 1_000_000
    assert b"x" in values(rig, 2)


def test_typed_and_opaque_definitions_of_one_stream_never_meet() -> None:
    types = TypeTable([TypeSpec(name="N", fields=(FieldSpec(name="n", type="uint8"),))])
    typed = StreamTable(
        [TopicSpec(stream_id=10, name="depth", type_name="N")], types=types, nodes=NODES
    )
    rig = Rig({1: typed, 2: table()})
    for number in range(20):
        rig.publish(1, 10, {"n": number})
        rig.publish(2, 10, bytes((number,)))
        rig.run(1)
    assert values(rig, 1) == []
    assert values(rig, 2) == []
