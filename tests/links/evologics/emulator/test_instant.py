"""Instant, synchronous and piggyback messages: what is said, in which order, and when."""

import pytest

from tests.links.evologics.emulator.sea import Sea
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.scenario import LinkSpec, NodeSpec, Scenario, scenario_from_mapping
from zacoustic_evologics.airtime import im_airtime_ns
from zacoustic_evologics.at.notifications import (
    CanceledIm,
    CanceledIms,
    CanceledPbm,
    DeliveredIm,
    ExpiredIms,
    FailedIm,
    RecvEnd,
    RecvFailed,
    RecvIm,
    RecvIms,
    RecvPbm,
    RecvSrv,
    RecvStart,
    SendEnd,
    SendStart,
)
from zacoustic_evologics.emulator import Behaviour, FaultKind, FaultPlan, ScriptedFault

LOUD = {"ZX": 1}


def im(payload: bytes, flag: str = "ack", destination: int = 2) -> bytes:
    return b"AT*SENDIM,%d,%d,%s,%s\n" % (len(payload), destination, flag.encode(), payload)


def lossy(share: float, *, back: float = 0.0, seed: int = 1) -> Scenario:
    """Two modems, 15 m apart; a share of the frames is lost."""
    nodes = tuple(NodeSpec(address=n, position=(15.0 * n, 0.0, 10.0)) for n in (1, 2))
    links = (LinkSpec(source=2, target=1, loss=LossSpec(frame=back)),)
    return Scenario(nodes=nodes, channel="none", loss=LossSpec(frame=share), links=links, seed=seed)


def test_acknowledged_im_of_64_bytes_at_1500_m_takes_3_1_seconds() -> None:
    sea = Sea(settings=LOUD)
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"x" * 64))
    sea.run()
    assert near.at(DeliveredIm) == pytest.approx(0.860338 + 2 * 1.0 + 0.110 + 0.139376)
    assert far.at(RecvIm) == pytest.approx(1.860338)


def test_acknowledged_im_is_reported_in_the_order_of_a_real_modem() -> None:
    sea = Sea(settings=LOUD | {"ZU": 1})
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"test"))
    sea.run()
    names = [type(message).__name__ for message in near.messages]
    assert names == [
        "Reply", "SendStart", "SendEnd", "RecvStart", "RecvEnd", "DeliveredIm",
        "UsblLong", "UsblPhyD", "UsblPhyP",
    ]  # fmt: skip
    there = [type(message).__name__ for message in far.messages]
    assert there == ["RecvStart", "RecvEnd", "RecvIm", "SendStart", "SendEnd", "UsblAngles"]
    assert near.first(SendStart) == SendStart(
        destination=2, kind="im", duration_us=196_696, delay_us=0
    )
    start_of_im, start_of_ack = near.first(SendEnd).clock_us, near.first(RecvEnd).clock_us
    assert (start_of_ack - start_of_im) % 2**32 == 196_696 + 2_000_000 + 110_000
    assert near.at(RecvStart) == pytest.approx(0.196696 + 2.0 + 0.110)


def test_without_extended_notifications_only_the_report_and_the_message_are_said() -> None:
    sea = Sea()
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"hello"))
    sea.run()
    assert near.lines() == ["DELIVEREDIM,2"]
    assert [line.rpartition(",")[2] for line in far.lines()] == ["hello"]


@pytest.mark.parametrize("size", [1, 2, 7, 53, 64])
def test_noack_im_lasts_as_published_and_the_next_one_follows_after_the_gap(size: int) -> None:
    sea = Sea(settings=LOUD)
    near, far = sea.host(1), sea.host(2)
    near.say(im(bytes(size), "noack"))
    sea.run(near_end := im_airtime_ns(size) / 1e9)
    near.say(im(bytes(size), "noack"))
    sea.run()
    assert [at for at, each in near.heard if isinstance(each, SendEnd)] == pytest.approx(
        [near_end, 2 * near_end + 0.0904]
    )
    assert len(far.all_of(RecvIm)) == 2
    assert near.all_of(DeliveredIm) == []


def test_sustained_noack_goodput_of_64_bytes_is_that_of_the_published_timing() -> None:
    sea = Sea(settings=LOUD)
    near, far = sea.host(1), sea.host(2)
    sent = 0
    while sent < 50:
        near.say(im(bytes(64), "noack"))
        sent += 1
        while len(near.all_of(SendEnd)) < sent:
            due_at = sea.fleet.poll_timeout()
            assert due_at is not None
            sea.fleet.handle_timeout(due_at)
            sea.collect()
    sea.run()
    assert len(far.all_of(RecvIm)) == 50
    assert 49 * 64 * 8 / (far.at(RecvIm, 49) - far.at(RecvIm, 0)) == pytest.approx(538.5, abs=1)


def test_unanswered_im_fails_after_its_retries() -> None:
    sea = Sea(lossy(1.0), settings=LOUD | {"RI": 2})
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"x"))
    assert near.say(b"AT?DI\n") == ["DELIVERING"]
    sea.run()
    assert len(near.all_of(SendEnd)) == 3
    assert near.messages[-1] == FailedIm(2)
    assert near.say(b"AT?DI\n")[-1] == "FAILED"
    assert far.all_of(RecvIm) == []
    assert len(far.all_of(RecvFailed)) == 3


def test_lost_acknowledgement_makes_a_retry_that_is_received_twice() -> None:
    script = (ScriptedFault(kind=FaultKind.LOST_ACK, at_s=0.0, modem=1),)
    sea = Sea(faults=FaultPlan(script=script), settings=LOUD)
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"twice"))
    sea.run()
    assert [message.payload for message in far.all_of(RecvIm)] == [b"twice"] * 2
    assert near.all_of(DeliveredIm) == [DeliveredIm(2)]
    assert len(near.all_of(RecvFailed)) == 1


def test_without_retries_a_lost_acknowledgement_is_a_failure_of_a_message_that_arrived() -> None:
    sea = Sea(lossy(0.0, back=1.0), settings={"RI": 0})
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"x"))
    sea.run()
    assert near.all_of(FailedIm) == [FailedIm(2)]
    assert len(far.all_of(RecvIm)) == 1


def test_many_ims_over_lossy_medium_are_each_reported_once_and_never_lied_about() -> None:
    for seed in range(5):
        sea = Sea(lossy(0.3, back=0.3, seed=seed), settings={"RI": 3})
        near, far = sea.host(1), sea.host(2)
        for number in range(40):
            assert near.say(im(b"%d" % number)) == ["OK"]
            reported = len(near.all_of(DeliveredIm)) + len(near.all_of(FailedIm))
            assert reported == number
            sea.run()
            got = {message.payload for message in far.all_of(RecvIm)}
            if isinstance(near.messages[-1], DeliveredIm):
                assert b"%d" % number in got
        assert near.all_of(DeliveredIm)
        assert len(far.all_of(RecvIm)) > len({m.payload for m in far.all_of(RecvIm)})


def test_second_im_is_busy_or_takes_the_place_of_the_first() -> None:
    sea = Sea()
    near = sea.host(1)
    near.say(im(b"first"))
    assert near.say(im(b"second")) == ["BUSY DELIVERING INSTANT MESSAGE"]
    sea = Sea(behaviour=Behaviour(second_im="cancel"))
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"first"))
    sea.run(1.0)
    assert near.say(im(b"second")) == ["OK", "CANCELEDIM,2"]
    sea.run()
    assert [m.payload for m in far.all_of(RecvIm)] == [b"first", b"second"]
    assert near.all_of(DeliveredIm) == [DeliveredIm(2)]
    assert near.all_of(CanceledIm) == [CanceledIm(2)]


def test_im_while_a_signal_comes_in_is_busy_forced_or_sent_afterwards() -> None:
    sea = Sea(spacing_m=15.0)
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"x" * 64, "noack"))
    sea.run(0.5)
    assert far.say(im(b"y", "noack", 1)) == ["BUSY BACKOFF STATE"]
    assert far.say(im(b"y", "force", 1)) == ["OK"]
    sea.run()
    assert far.all_of(RecvIm) == []  # its own transmission has destroyed it
    sea = Sea(spacing_m=15.0, behaviour=Behaviour(while_receiving="wait"))
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"x" * 64, "noack"))
    sea.run(0.5)
    assert far.say(im(b"y", "noack", 1)) == ["OK"]
    assert far.say(b"AT?DI\n") == ["DELIVERING"]
    sea.run()
    assert len(far.all_of(RecvIm)) == len(near.all_of(RecvIm)) == 1


def test_crossing_messages_are_lost_to_half_duplex() -> None:
    sea = Sea(spacing_m=15.0, settings=LOUD)
    near, far = sea.host(1), sea.host(2)
    near.say(im(b"x" * 64, "noack"))
    far.say(im(b"y" * 64, "noack", 1))
    sea.run()
    assert near.all_of(RecvIm) == far.all_of(RecvIm) == []


def test_three_modems_collide_and_a_third_overhears() -> None:
    sea = Sea(3, spacing_m=15.0, settings=LOUD)
    one, two, three = (sea.host(address) for address in (1, 2, 3))
    one.say(im(b"over two"))
    sea.run()
    assert [record.kind for record in three.all_of(RecvSrv)] == ["im", "ack"]
    one.say(im(b"x" * 64, "noack", 2))
    three.say(im(b"y" * 64, "noack", 2))
    sea.run()
    assert len(two.all_of(RecvIm)) == 1


def test_broadcast_reaches_all_and_asks_for_nothing() -> None:
    sea = Sea(3)
    hosts = [sea.host(address) for address in (1, 2, 3)]
    assert hosts[0].say(im(b"all", "noack", 255)) == ["OK"]
    sea.run()
    assert [len(host.all_of(RecvIm)) for host in hosts] == [0, 1, 1]
    assert hosts[0].say(im(b"all", "ack", 255)) == ["ERROR WRONG FORMAT"]


def test_promiscuous_modem_reports_what_is_for_others_and_does_not_acknowledge_it() -> None:
    sea = Sea(3)
    one, _, three = (sea.host(address) for address in (1, 2, 3))
    assert three.say(b"AT!RP1\n") == ["OK"]
    one.say(im(b"secret"))
    sea.run()
    assert [(m.destination, m.payload) for m in three.all_of(RecvIm)] == [(2, b"secret")]
    assert one.all_of(DeliveredIm) == [DeliveredIm(2)]


@pytest.mark.parametrize(("level", "least", "most"), [(0, 0.0, 0.1), (3, 0.9, 1.0)])
def test_loss_that_the_page_promises_is_that_of_source_level_0(
    level: int, least: float, most: float
) -> None:
    places = [{"address": 1, "position": [0, 0, 10]}, {"address": 2, "position": [500, 0, 20]}]
    sea = Sea(
        scenario_from_mapping({"seed": 5, "channel": "sea", "nodes": places}, source="test"),
        settings={"L": level},
    )
    near, far = sea.host(1), sea.host(2)
    frames = 60
    for _ in range(frames):
        assert near.say(im(bytes(64), flag="noack")) == ["OK"]
        sea.run()
    assert least <= 1 - len(far.all_of(RecvIm)) / frames <= most


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (im(bytes(65)), "ERROR WRONG FORMAT"),
        (b"AT*SENDIM,4,2,ack,toolong\n", "ERROR WRONG FORMAT"),
        (im(b"x", destination=0), "ERROR WRONG DESTINATION ADDRESS"),
        (im(b"x", destination=1), "ERROR WRONG DESTINATION ADDRESS"),
        (im(b"x", destination=15), "ERROR WRONG DESTINATION ADDRESS"),
        (b"AT*SENDIM,p8,1,2,ack,x\n", "ERROR PROTOCOL ID"),
        (b"AT*SENDPBM,1,255,x\n", "ERROR WRONG DESTINATION ADDRESS"),
        (b"AT*SEND,1,255,x\n", "ERROR WRONG FORMAT"),
    ],
)
def test_what_cannot_be_sent_is_refused(command: bytes, answer: str) -> None:
    sea = Sea()
    assert sea.host(1).say(command) == [answer]
    sea.run()
    assert sea.fleet.poll_timeout() is None


def test_synchronous_message_begins_at_its_instant_and_stamps_two_way_ranges() -> None:
    sea = Sea(settings=LOUD)
    near, far = sea.host(1), sea.host(2)
    clock_us = int(near.say(b"AT?CLOCK\n")[0])
    start_us = (clock_us + 3_000_000) % 2**32
    assert near.say(b"AT*SENDIMS,4,2,%d,ping\n" % start_us) == ["OK"]
    sea.run(4.3)
    assert near.at(SendStart) == pytest.approx(3.0 - 0.01595, abs=1e-5)
    assert near.first(SendStart).delay_us == 15_950
    assert near.first(SendEnd).clock_us == start_us
    received = far.first(RecvIms)
    far.say(b"AT*SENDIMS,4,1,%d,pong\n" % ((received.timestamp_us + 500_000) % 2**32))
    sea.run()
    elapsed_us = (near.first(RecvIms).timestamp_us - start_us) % 2**32
    assert (elapsed_us - 500_000) / 2 == 1_000_000


def test_synchronous_message_expires_is_replaced_and_is_sent_at_once() -> None:
    sea = Sea()
    near, far = sea.host(1), sea.host(2)
    clock_us = int(near.say(b"AT?CLOCK\n")[0])
    assert near.say(b"AT*SENDIMS,1,2,%d,x\n" % ((clock_us - 1) % 2**32)) == ["OK", "EXPIREDIMS,2"]
    assert near.say(b"AT?DI\n") == ["EXPIRED"]
    later_us = (clock_us + 5_000_000) % 2**32
    near.say(b"AT*SENDIMS,1,2,%d,a\n" % later_us)
    assert near.say(b"AT*SENDIMS,1,2,%d,b\n" % later_us) == ["OK", "CANCELEDIMS,2"]
    sea.run()
    assert [m.payload for m in far.all_of(RecvIms)] == [b"b"]
    near.say(b"AT*SENDIMS,1,2,,now\n")
    assert near.say(b"AT*SENDIMS,3,2,,now\n")[-1] == "OK"
    sea.run()
    assert far.all_of(RecvIms)[-1].payload == b"now"
    assert near.all_of(ExpiredIms)
    assert near.all_of(CanceledIms)


def test_piggyback_message_waits_and_goes_with_an_acknowledgement_or_a_message() -> None:
    sea = Sea()
    near, far = sea.host(1), sea.host(2)
    assert far.say(b"AT*SENDPBM,3,1,old\n") == ["OK"]
    assert far.say(b"AT*SENDPBM,7,1,lowprio\n") == ["OK", "CANCELEDPBM,1"]
    sea.run()
    assert near.messages == []
    near.say(im(b"x"))
    sea.run()
    record = near.first(RecvPbm)
    assert (record.payload, record.source, record.duration_us) == (b"lowprio", 2, 229_467)
    near.say(b"AT*SENDPBM,2,2,go\n")
    near.say(im(b"y", "noack"))
    sea.run()
    assert far.first(RecvPbm).payload == b"go"
    near.say(b"AT*SENDPBM,2,2,no\n")
    assert near.say(b"ATZ3\n") == ["OK", "CANCELEDPBM,2"]
    assert len(far.all_of(CanceledPbm)) == 1


def test_geometry_beyond_the_published_range_is_waited_for() -> None:
    sea = Sea(spacing_m=9000.0, settings={"RI": 0, "L": 0})
    near, _ = sea.host(1), sea.host(2)
    near.say(im(b"far"))
    sea.run()
    assert near.all_of(DeliveredIm) == [DeliveredIm(2)]
    assert near.say(b"AT?T\n")[-1] == "6000000"
