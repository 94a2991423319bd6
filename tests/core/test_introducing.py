"""How frames to one node introduce their sender, and what a provisional confirm is worth."""

from typing import Final

from tests.core.rig import End, Rig
from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import RequestReceived, ResponseReceived
from zacoustic.core.peers.handshake import SETTLING_UNITS
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import ASSURED, PROVISIONAL, WIRE_VERSION, Confirm, Hello, Tag

ARM: Final = 20


def table(name: str = "arm") -> StreamTable:
    return StreamTable(
        [
            ServiceSpec(stream_id=ARM, name=name, server=2, timeout_s=600),
            TopicSpec(stream_id=11, name="log", qos=Qos(depth=100)),
        ],
        nodes={1: "shore", 2: "auv"},
    )


def unit_s(rig: Rig) -> float:
    return rig.capabilities.airtime_ns(rig.capabilities.mtu_bytes) / NS_PER_S


def old_rig(name: str = "arm") -> Rig:
    """Return two nodes that have said nothing for longer than anything is late."""
    rig = Rig({1: table(name), 2: table(name)})
    rig.run(2.1 * SETTLING_UNITS * unit_s(rig))
    assert rig.frames == []
    return rig


def ask(rig: Rig) -> list[bytes]:
    rig[1].engine.call(ARM, b"?", rig.now)
    return rig.exchange()


def answer(rig: Rig) -> list[bytes]:
    request = rig[2].got(RequestReceived)[-1]
    rig[2].engine.reply(request.call, b"!", rig.now)
    return rig.exchange()


def test_answer_says_that_it_knows_the_caller_in_place_of_its_own_digest() -> None:
    rig = old_rig()
    asked = ask(rig)
    assert asked[0].startswith(Hello(WIRE_VERSION, 1, table().digest).encode())
    (answered, *_) = answer(rig)
    assert answered.startswith(Tag(1).encode() + Confirm(PROVISIONAL, 1).encode())
    assert [event.value for event in rig[1].got(ResponseReceived)] == [b"!"]


def test_a_provisional_confirm_for_an_old_node_is_all_that_it_needs() -> None:
    rig = old_rig()
    ask(rig)
    answer(rig)
    rig.run((SETTLING_UNITS + 2.1) * unit_s(rig))
    said = [(source, sent.frame_bytes) for source, sent in rig.frames]
    assert said[-1] == (1, Confirm(ASSURED, 1).encode())
    # Neither has to introduce itself any more, nor to confirm anything.
    rig.frames.clear()
    rig.run(1)
    assert rig.frames == []
    rig.publish(1, 11, b"a")
    rig.publish(2, 11, b"b")
    assert sorted(rig.exchange()) == [b"\x0ba", b"\x0bb"]


def test_a_provisional_confirm_holds_when_nothing_of_a_former_life_is_under_way() -> None:
    rig = old_rig()
    ask(rig)
    answer(rig)
    # The other end would not decode it yet without a TAG; the digest it needs no more.
    rig.publish(1, 11, b"a")
    (frame,) = rig.exchange()
    assert frame == Tag(1).encode() + b"\x0ba"


def test_a_young_node_decodes_what_is_confirmed_for_now_and_believes_no_more() -> None:
    rig = Rig({1: table(), 2: table()})
    ask(rig)
    answer(rig)
    assert [event.value for event in rig[1].got(ResponseReceived)] == [b"!"]
    assert not rig[1].engine.peers()[2]
    rig.run((SETTLING_UNITS + 2.1) * unit_s(rig))
    assert not rig[1].engine.peers()[2]
    # The CONFIRM that has waited is taken from anybody.
    rig.run(1)
    assert rig[1].engine.peers()[2]


def test_nothing_is_decoded_that_confirms_a_former_life_for_now() -> None:
    rig = old_rig()
    ask(rig)
    request = rig[2].got(RequestReceived)[-1]
    rig.restart(1, table("disarm"))
    rig[2].engine.reply(request.call, b"!", rig.now)
    transmission = rig[2].send(rig.now)
    assert transmission is not None
    assert Confirm(PROVISIONAL, 1).encode() in transmission.frame_bytes
    rig.deliver(2, transmission)
    assert rig[1].got(ResponseReceived) == []
    assert rig[1].engine.stats.dropped["unconfirmed"] == 1
    # It says who it is instead.
    frames = rig.run(2.1 * unit_s(rig))
    assert frames[0].startswith(Hello(WIRE_VERSION, 2, table("disarm").digest).encode())


def test_who_is_asked_for_its_digest_says_it() -> None:
    rig = old_rig()
    ask(rig)
    answer(rig)
    rig[2].hear(bytes.fromhex("b60200"), rig.now, source=1, destination=2)
    frames = rig.run(2.1 * unit_s(rig))
    assert Hello(WIRE_VERSION, 1, table().digest).encode() in b"".join(frames)


def test_a_life_that_has_said_nothing_is_confirmed_by_nobody() -> None:
    rig = old_rig()
    ask(rig)
    request = rig[2].got(RequestReceived)[-1]
    # Without a journal epochs are drawn at random: once in a while it is the one of before.
    rig.ends[1] = End(1, table("disarm"), epoch=1, capabilities=rig.capabilities, now=rig.now)
    rig[2].engine.reply(request.call, b"!", rig.now)
    transmission = rig[2].send(rig.now)
    assert transmission is not None
    rig.deliver(2, transmission)
    assert rig[1].engine.stats.dropped == {"unconfirmed": 1}
