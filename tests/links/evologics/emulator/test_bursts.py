"""Burst data: connection, counters, trains, failures."""

import pytest

from tests.links.evologics.emulator.sea import Sea
from tests.links.evologics.emulator.test_instant import lossy
from zacoustic_evologics import Interpreter
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.at.notifications import (
    BitRate,
    Delivered,
    DeliveredIm,
    Failed,
    Recv,
    RemoteAddress,
    Status,
)


def burst(payload: bytes, destination: int = 2) -> bytes:
    return b"AT*SEND,%d,%d,%s\n" % (len(payload), destination, payload)


def test_burst_is_delivered_under_the_counter_that_was_announced() -> None:
    sea = Sea(settings={"ZX": 1})
    near, far = sea.host(1), sea.host(2)
    counter = int(near.say(b"AT?PC\n")[0])
    assert near.say(burst(b"a\r\nb,+++AT" * 100))[0] == "OK"
    assert int(near.say(b"AT?PC\n")[0]) == counter + 1
    assert near.say(b"AT?S\n")[0].splitlines()[2] == "Acoustic Link Status: INITIATION ESTABLISH"
    sea.run()
    assert near.all_of(Delivered) == [Delivered(counter=counter, destination=2)]
    assert far.first(Recv).payload == b"a\r\nb,+++AT" * 100
    assert far.first(Recv).propagation_us == 1_000_000
    assert near.all_of(BitRate)
    assert near.all_of(RemoteAddress)
    assert near.all_of(Status)[-1] == Status("INITIATION", "LISTEN")
    assert sea.unrecognised() == []


def test_queued_bursts_share_a_connection_and_keep_their_order() -> None:
    sea = Sea(3, spacing_m=100.0)
    near, two, three = (sea.host(address) for address in (1, 2, 3))
    for number in range(12):
        near.say(burst(b"%d" % number, 2 + number % 2))
    sea.run()
    assert [m.payload for m in two.all_of(Recv)] == [b"%d" % n for n in range(0, 12, 2)]
    assert [m.payload for m in three.all_of(Recv)] == [b"%d" % n for n in range(1, 12, 2)]
    assert sorted(m.counter for m in near.all_of(Delivered)) == list(range(1, 13))


@pytest.mark.parametrize("seed", range(10))
def test_burst_over_lossy_medium_arrives_once_or_is_reported_failed(seed: int) -> None:
    sea = Sea(lossy(0.3, back=0.3, seed=seed))
    near, far = sea.host(1), sea.host(2)
    for number in range(20):
        assert near.say(burst(b"%d" % number))[0] in ("OK", "BUSY BACKOFF STATE")
        sea.run()
    received = [m.payload for m in far.all_of(Recv)]
    assert len(received) == len(set(received))
    delivered = near.all_of(Delivered)
    assert len(delivered) + len(near.all_of(Failed)) == 20
    assert len(received) >= len(delivered)


def test_unreachable_modem_fails_the_burst_and_makes_the_sender_back_off() -> None:
    sea = Sea(lossy(1.0), settings={"RC": 1, "ZX": 1})
    near = sea.host(1)
    near.say(burst(b"a"))
    near.say(burst(b"b"))
    while not near.all_of(Failed):
        due_at = sea.fleet.poll_timeout()
        assert due_at is not None
        sea.fleet.handle_timeout(due_at)
        sea.collect()
    assert [m.counter for m in near.all_of(Failed)] == [1, 2]
    assert near.say(burst(b"c")) == ["BUSY BACKOFF STATE"]
    assert near.say(b"AT*SENDIM,1,2,noack,x\n") == ["BUSY BACKOFF STATE"]
    assert near.say(b"AT*SENDIM,1,2,force,x\n")[0] == "OK"
    sea.run()
    assert Status("OFFLINE", "CONNECTION_FAILED") in near.messages
    assert near.say(burst(b"c"))[0] == "OK"


def test_instant_message_passes_while_a_burst_is_under_way() -> None:
    sea = Sea()
    near = sea.host(1)
    sea.host(2)
    near.say(burst(b"x" * 1024))
    assert near.say(b"AT*SENDIM,1,2,ack,x\n") == ["OK"]
    sea.run()
    assert near.all_of(DeliveredIm)
    assert near.all_of(Delivered)


def test_full_buffer_refuses_and_clearing_it_fails_what_was_in_it() -> None:
    sea = Sea(settings={"ZL": 8096})
    near = sea.host(1)
    answers = [near.say(burst(b"x" * 1024))[0] for _ in range(9)]
    assert answers == ["OK"] * 7 + ["ERROR BUFFER FULL"] * 2
    assert near.say(b"AT@ZL16384\n") == ["ERROR BUFFERS ARE NOT EMPTY"]
    assert near.say(b"ATZ4\n") == ["OK", *(f"FAILED,{n},2" for n in range(1, 8))]
    assert near.say(b"AT@ZL16384\n") == ["OK"]
    assert near.say(burst(b"x" * 1025)) == ["ERROR WRONG FORMAT"]


def test_raw_data_comes_out_raw_in_data_mode() -> None:
    sea = Sea(interpreter=Interpreter.AT)
    near, far = sea.host(1), sea.host(2)
    near.say(b"+++AT!AR2\n")
    content = bytes(range(256)) * 5
    near.say(content)
    sea.run()
    assert b"".join(m.content for m in far.all_of(RawData)) == content
    assert near.say(b"+++AT?ZE\n") == ["+++AT?ZE:4:1280"]


def test_connection_is_made_and_closed_on_command() -> None:
    sea = Sea(settings={"ZX": 1})
    near, _ = sea.host(1), sea.host(2)
    assert near.say(b"ATD2\n")[0] == "OK"
    sea.run()
    assert Status("ONLINE", "CONNECTED") in near.messages
    near.say(burst(b"x"))
    assert near.say(b"ATH1\n")[:2] == ["OK", "FAILED,1,2"]
