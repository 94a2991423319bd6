"""Composer: what is in a frame, in which order, and how it is delimited."""

import pytest

from tests.core.rig import End, Rig, link
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.linktypes import BROADCAST, LinkCapabilities
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello

NODES = {1: "shore", 2: "auv", 3: "glider"}
MTUS = (8, 32, 64, 512)
TYPES = TypeTable([TypeSpec(name="N", fields=(FieldSpec(name="n", type="uint16"),))])
DEEP = Qos(depth=2000)


def fleet() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="opaque", qos=DEEP),
            TopicSpec(stream_id=2, name="other", qos=DEEP),
            TopicSpec(stream_id=3, name="typed", type_name="N", qos=DEEP),
            TopicSpec(stream_id=4, name="for2", subscribers=(2,), qos=DEEP),
            TopicSpec(stream_id=5, name="for3", subscribers=(1, 3), qos=DEEP),
            TopicSpec(stream_id=6, name="slow", qos=Qos(priority=Priority.BACKGROUND, depth=2000)),
            TopicSpec(stream_id=7, name="alarm", qos=Qos(priority=Priority.REAL_TIME, depth=9)),
            TopicSpec(stream_id=8, name="lingering", qos=Qos(linger_s=5, depth=9)),
            ServiceSpec(stream_id=20, name="arm", server=2),
        ],
        types=TYPES,
        nodes=NODES,
    )


def known(capabilities: LinkCapabilities | None = None) -> Rig:
    """Return three nodes that have confirmed each other."""
    rig = Rig(dict.fromkeys(NODES, fleet()), capabilities=capabilities)
    for _ in range(3):
        for address in NODES:
            rig.publish(address, 2, b"")
        rig.run(1)
    for end in rig.ends.values():
        end.events.clear()
    rig.frames.clear()
    for address in NODES:
        rig.publish(address, 2, b"")
        assert rig.exchange() == [b"\x02"]
    for end in rig.ends.values():
        end.events.clear()
    rig.frames.clear()
    return rig


def heard(rig: Rig, address: int) -> list[tuple[int, object]]:
    return [(event.stream_id, event.value) for event in rig[address].got(SampleReceived)]


def test_several_records_share_a_frame_and_the_last_needs_no_length() -> None:
    rig = known()
    rig.publish(1, 1, b"abc")
    rig.publish(1, 3, {"n": 5})
    rig.publish(1, 2, b"de")
    assert rig.exchange() == [b"\xb2\x04\x01abc" + b"\x03\x05" + b"\x02de"]
    assert heard(rig, 2) == [(1, b"abc"), (3, {"n": 5}), (2, b"de")]


def test_record_that_shows_its_end_may_be_last_beside_one_that_does_not() -> None:
    rig = known()
    rig.publish(1, 1, b"abc")
    rig.publish(1, 3, {"n": 5})
    # The one that shows no end is moved behind, which saves its length.
    assert rig.exchange() == [b"\x03\x05" + b"\x01abc"]


def test_every_record_but_the_last_has_a_length_behind_an_introduction() -> None:
    rig = Rig(dict.fromkeys(NODES, fleet()))
    rig.publish(1, 3, {"n": 5})
    rig.publish(1, 3, {"n": 6})
    rig.now += 1
    rig.publish(1, 1, b"x")
    hello = Hello(WIRE_VERSION, 1, fleet().digest).encode()
    assert rig.exchange()[0] == hello + b"\xb2\x02\x03\x05\xb2\x02\x03\x06\x01x"
    assert heard(rig, 3) == [(3, {"n": 5}), (3, {"n": 6}), (1, b"x")]


@pytest.mark.parametrize("mtu_bytes", MTUS)
def test_largest_record_fits_beside_a_tag_and_one_byte_more_is_refused(mtu_bytes: int) -> None:
    rig = Rig(dict.fromkeys(NODES, fleet()), capabilities=link(mtu_bytes=mtu_bytes))
    rig.publish(1, 1, bytes(mtu_bytes - 4))
    rig.exchange()
    assert (1, bytes(mtu_bytes - 4)) in heard(rig, 2)
    with pytest.raises(Exception, match=f"room for {mtu_bytes - 3}"):
        rig.publish(1, 1, bytes(mtu_bytes - 3))


@pytest.mark.parametrize("mtu_bytes", MTUS)
def test_no_frame_is_larger_than_the_link_takes_and_all_that_fits_goes(mtu_bytes: int) -> None:
    rig = known(link(mtu_bytes=mtu_bytes))
    for number in range(100):
        rig.publish(1, 1, bytes((number, 0)))
        rig.publish(1, 3, {"n": number})
    frames = rig.exchange()
    assert max(map(len, frames)) <= mtu_bytes
    for address in (2, 3):
        got = heard(rig, address)
        assert [value for stream_id, value in got if stream_id == 1] == [
            bytes((number, 0)) for number in range(100)
        ]
        assert [value for stream_id, value in got if stream_id == 3] == [
            {"n": number} for number in range(100)
        ]
    # 200 records of 5 (with LEN) and at most 3 bytes; nothing but the ends of frames is wasted.
    assert len(frames) <= 800 // (mtu_bytes - 4) + 1


def test_records_of_more_than_255_bytes_are_last_and_one_in_a_frame() -> None:
    rig = known(link(mtu_bytes=512))
    rig.publish(1, 1, b"a" * 300)
    rig.publish(1, 2, b"b" * 260)
    rig.publish(1, 1, b"short")
    rig.publish(1, 3, {"n": 1})
    frames = rig.exchange()
    assert [len(frame) for frame in frames] == [301 + 2, 261 + 2 + 6]
    assert heard(rig, 2) == [
        (3, {"n": 1}),
        (1, b"a" * 300),
        (1, b"short"),
        (2, b"b" * 260),
    ]


@pytest.mark.parametrize("size", [253, 254, 255, 256])
def test_length_delimits_255_bytes_and_no_more(size: int) -> None:
    rig = known(link(mtu_bytes=512))
    rig.publish(1, 1, b"a" * size)
    rig.publish(1, 2, b"b")
    rig.publish(1, 1, b"c")
    rig.exchange()
    got = heard(rig, 2)
    assert sorted(got) == sorted([(1, b"a" * size), (2, b"b"), (1, b"c")])
    assert got.index((1, b"a" * size)) < got.index((1, b"c"))


def test_broadcast_frame_carries_what_is_for_one_but_a_unicast_frame_only_what_is_for_it() -> None:
    rig = known()
    rig.publish(1, 4, b"two")
    rig.publish(1, 5, b"three")
    rig.publish(1, 4, b"again")
    rig.exchange()
    assert [sent.destination for _, sent in rig.frames] == [2, 3]
    assert heard(rig, 2) == [(4, b"two"), (4, b"again")]
    assert heard(rig, 3) == [(5, b"three")]
    rig.frames.clear()
    rig.publish(1, 1, b"all")
    rig.publish(1, 4, b"two")
    rig.exchange()
    assert [sent.destination for _, sent in rig.frames] == [BROADCAST]
    assert heard(rig, 3)[-1] == (1, b"all")
    assert heard(rig, 2)[-2:] == [(1, b"all"), (4, b"two")]


def test_answer_of_a_service_never_rides_in_a_broadcast_frame() -> None:
    rig = known()
    rig[1].engine.call(20, b"please", rig.now)
    rig.exchange()
    request = rig[2].events[-1]
    rig.publish(2, 1, b"all")
    rig[2].engine.reply(request.call, b"done", rig.now)  # type: ignore[union-attr]
    rig.frames.clear()
    rig.exchange()
    # The answer to its client, whose confirmation comes later; the sample to all.
    assert sorted(sent.destination for _, sent in rig.frames) == [1, BROADCAST]


def test_real_time_sample_is_in_the_very_next_frame_behind_a_thousand_background_ones() -> None:
    for mtu_bytes in MTUS:
        for introduced in (False, True):
            capabilities = link(mtu_bytes=mtu_bytes)
            rig = (
                known(capabilities)
                if introduced
                else Rig(dict.fromkeys(NODES, fleet()), capabilities=capabilities)
            )
            for number in range(1000):
                rig.publish(1, 6, b"%04d" % number)
            rig[1].send(rig.now)
            rig.publish(1, 7, b"!")
            sent = rig[1].poll(rig.now)
            assert sent is not None
            assert b"\x07!" in sent.frame_bytes


def test_real_time_sample_goes_before_whatever_is_owed() -> None:
    rig = Rig(dict.fromkeys(NODES, fleet()), capabilities=link(mtu_bytes=8))
    for address in (2, 3):
        rig.publish(address, 2, b"?")
        rig.publish(address, 2, b"?")
    for _ in range(4):
        rig.exchange(lambda source, node, transmission: node == 1)
    rig.now += seconds_to_ns(1)
    rig[1].engine.handle_timeout(rig.now)
    rig.publish(1, 7, b"1234")
    sent = rig[1].poll(rig.now)
    assert sent is not None
    assert sent.frame_bytes.endswith(b"\x071234")


def test_lingering_sample_waits_for_company() -> None:
    rig = known()
    rig.publish(1, 8, b"later")
    assert rig.run(4.9) == []
    assert rig.run(0.2) == [b"\x08later"]
    rig.publish(1, 8, b"later")
    rig.now += 1
    rig.publish(1, 1, b"now")
    assert rig.exchange() == [b"\xb2\x06\x08later\x01now"]


def test_confirmations_ride_on_frames_that_go_anyway() -> None:
    rig = Rig(dict.fromkeys(NODES, fleet()))
    rig.publish(1, 2, b"x")
    rig.exchange()
    rig.now += seconds_to_ns(0.0041)
    rig.publish(2, 1, b"mine")
    (frame,) = [sent.frame_bytes for _, sent in [(2, rig[2].send(rig.now))] if sent]
    assert b"\xb5\x01\x00\x01" in frame
    assert frame.endswith(b"\x01mine")


def test_ledger_knows_the_cause_of_every_byte() -> None:
    end = End(1, fleet(), capabilities=link(addressed=False, checked=False))
    end.engine.publish(1, b"abc", 0)
    sent = end.send(0)
    assert sent is not None
    ledger = {
        (entry.stream_id, entry.cause): entry.transmitted_bytes
        for entry in end.engine.stats.ledger()
    }
    assert ledger == {
        (0, Cause.HELLO): 8,
        (0, Cause.ENVELOPE): 6,
        (1, Cause.HEADER): 1,
        (1, Cause.PAYLOAD): 3,
    }
