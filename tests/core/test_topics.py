"""Topics: who may publish and listen, and what a record becomes."""

import pytest

from tests.core.rig import Rig
from zacoustic.core.base.qos import Qos, Stamp
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello

NODES = {1: "shore", 2: "auv"}
TYPES = TypeTable([TypeSpec(name="N", fields=(FieldSpec(name="n", type="uint8", range=(0, 9)),))])


def fleet() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="opaque"),
            TopicSpec(stream_id=2, name="typed", type_name="N"),
            TopicSpec(stream_id=3, name="old", qos=Qos(stamp=Stamp.AGE, linger_s=0)),
            TopicSpec(
                stream_id=4,
                name="v/{k}/{node}",
                type_name="N",
                wildcards=(Wildcard(name="k", values=("a", "b")),),
            ),
            TopicSpec(stream_id=5, name="from1", publishers=(1,)),
            TopicSpec(stream_id=6, name="to3", subscribers=(3,)),
            TopicSpec(stream_id=7, name="to1and3", subscribers=(1, 3)),
        ],
        types=TYPES,
        nodes=NODES,
    )


def ends() -> Rig:
    return Rig({1: fleet(), 2: fleet()})


def last(rig: Rig, address: int) -> SampleReceived:
    return rig[address].got(SampleReceived)[-1]


def inject(rig: Rig, records: bytes) -> dict[str, int]:
    """Let node 2 hear a hand-made frame of node 1; returns what was dropped."""
    rig[2].hear(Hello(WIRE_VERSION, 1, fleet().digest).encode() + records, rig.now, source=1)
    return rig[2].engine.stats.dropped


def test_sample_arrives_as_it_was_with_its_source_and_encoding() -> None:
    rig = ends()
    rig.publish(1, 2, {"n": 7})
    rig.exchange()
    event = last(rig, 2)
    assert (event.stream_id, event.source, event.value, event.deleted) == (2, 1, {"n": 7}, False)
    assert (event.instance, event.encoding, event.age_s) == ((), "application/cbor", None)


@pytest.mark.parametrize("encoding", ["application/json", "image/png", "my/own;schema"])
def test_other_encoding_of_a_sample_crosses_as_a_prefix(encoding: str) -> None:
    rig = ends()
    rig.publish(1, 1, b"{}", encoding=encoding)
    rig.exchange()
    assert (last(rig, 2).encoding, last(rig, 2).value) == (encoding, b"{}")


def test_encoding_of_the_stream_costs_nothing() -> None:
    rig = ends()
    rig.publish(1, 1, b"x", encoding="zenoh/bytes")
    assert rig.exchange()[0].endswith(Hello(WIRE_VERSION, 1, fleet().digest).encode() + b"\x01x")


def test_delete_crosses_without_payload() -> None:
    rig = ends()
    rig.publish(1, 4, None, instance=(1,), delete=True)
    rig.publish(1, 3, None, delete=True)
    rig.exchange()
    valve, old = sorted(rig[2].got(SampleReceived), key=lambda event: -event.stream_id)
    assert (valve.deleted, valve.value, valve.instance) == (True, None, (1,))
    assert (old.deleted, old.value, old.age_s) == (True, None, None)


def test_age_counts_until_the_frame_begins_and_on_its_way() -> None:
    rig = ends()
    rig.publish(1, 3, b"x")
    rig.now = seconds_to_ns(4.2)
    rig.exchange()
    assert last(rig, 2).age_s == pytest.approx(4.2, abs=0.001)
    assert last(rig, 2).age_error_s == pytest.approx(0.05, abs=0.01)
    rig.publish(1, 3, b"y", queued_at=rig.now - seconds_to_ns(3.0))
    rig.now += seconds_to_ns(1)
    rig.exchange()
    assert last(rig, 2).age_s == pytest.approx(4.0, abs=0.001)
    rig.publish(1, 3, b"z", queued_at=rig.now - seconds_to_ns(4000))
    rig.exchange()
    assert last(rig, 2).age_s == pytest.approx(4000, rel=0.041)


def test_age_saturates_at_thirty_days_and_an_unknown_one_stays_unknown() -> None:
    rig = ends()
    rig.publish(1, 3, b"x", queued_at=rig.now - seconds_to_ns(31 * 86_400))
    rig.exchange()
    assert last(rig, 2).age_s == pytest.approx(30 * 86_400, abs=0.001)
    assert last(rig, 2).age_error_s is None
    rig.publish(1, 3, b"y", is_dated=False)
    rig.exchange()
    assert (last(rig, 2).age_s, last(rig, 2).age_error_s) == (None, None)


def test_sample_of_the_future_is_one_of_now() -> None:
    rig = ends()
    rig.publish(1, 3, b"x", queued_at=seconds_to_ns(100))
    rig.exchange()
    assert last(rig, 2).age_s == pytest.approx(0.0, abs=0.001)


@pytest.mark.parametrize(
    ("records", "reason"),
    [
        (b"\x02", "payload"),
        (b"\x02\x0a", "payload"),
        (b"\x02\x05\x05", "payload"),
        (b"\x03", "payload"),
        (b"\x04", "payload"),
        (b"\x04\x02\x05", "payload"),
        (b"\x06x", "not_subscriber"),
        (b"\x07x", "not_subscriber"),
        (b"\xb2\x02\x63x", "unknown_stream"),
        (b"\x63x", "unknown_stream"),
        (b"\xc0x", "dense"),
    ],
)
def test_record_that_is_none_is_dropped_for_a_reason(records: bytes, reason: str) -> None:
    rig = ends()
    assert inject(rig, records) == {reason: 1}
    assert rig[2].got(SampleReceived) == []


def test_sample_of_a_node_that_may_not_publish_is_dropped() -> None:
    rig = ends()
    rig[1].hear(Hello(WIRE_VERSION, 1, fleet().digest).encode() + b"\x05x", 0, source=2)
    assert rig[1].engine.stats.dropped == {"not_publisher": 1}


def test_key_of_an_unnamed_node_is_dropped() -> None:
    rig = ends()
    rig[1].hear(Hello(WIRE_VERSION, 1, fleet().digest).encode() + b"\x04\x00\x05", 0, source=9)
    assert rig[1].engine.stats.dropped == {"payload": 1}


def test_only_other_subscriber_is_the_destination() -> None:
    rig = ends()
    rig.publish(1, 7, b"x")
    rig.publish(1, 6, b"y")
    rig.exchange()
    assert {sent.destination for source, sent in rig.frames if source == 1} == {3}
    rig.frames.clear()
    rig.publish(2, 7, b"x")
    rig.exchange()
    assert {sent.destination for source, sent in rig.frames if source == 2} == {255}


def test_counters_follow_a_sample() -> None:
    rig = ends()
    rig.publish(1, 1, b"x")
    rig.publish(1, 1, b"y")
    rig.exchange()
    assert rig[1].engine.stats.published == {1: 2}
    assert rig[1].engine.stats.transmitted == {1: 1}
    assert rig[2].engine.stats.received == {1: 1}
    assert rig[1].engine.superseded == {1: 1}
