"""What an observer is told of the water, which no modem knows."""

from tests.links.evologics.emulator.sea import Sea
from zacoustic_evologics.emulator import Observation, SignalArrived, SignalEmitted


def test_who_speaks_into_what_is_coming_loses_it_and_the_observer_knows_why() -> None:
    told: list[Observation] = []
    sea = Sea(2, observer=told.append)
    near, far = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIM,64,2,noack," + b"x" * 64 + b"\n")
    sea.wait(0.5)
    far.say(b"AT*SENDIM,64,1,noack," + b"y" * 64 + b"\n")
    sea.run()
    emitted = [each for each in told if isinstance(each, SignalEmitted)]
    arrived = [each for each in told if isinstance(each, SignalArrived)]
    assert [(each.node, each.signal.content_bytes) for each in emitted] == [(1, 64), (2, 64)]
    outcomes = [(each.source, each.node, each.outcome.value) for each in arrived]
    assert outcomes == [(1, 2, "half_duplex"), (2, 1, "received")]


def test_emissions_of_a_modem_are_counted_and_each_arrival_names_its_own() -> None:
    told: list[Observation] = []
    sea = Sea(3, spacing_m=150.0, observer=told.append)
    host = sea.host(2)
    for _ in range(2):
        host.say(b"AT*SENDIM,1,255,noack,x\n")
        sea.run()
    numbers = [(type(each), each.sequence, each.node) for each in told if each.signal.source == 2]
    first = [(SignalArrived, 0, 1), (SignalArrived, 0, 3)]
    assert numbers[0] == (SignalEmitted, 0, 2)
    assert sorted(numbers[1:3], key=str) == first
    assert numbers[3] == (SignalEmitted, 1, 2)


def test_burst_is_seen_with_what_it_takes_to_connect() -> None:
    told: list[Observation] = []
    sea = Sea(2, observer=told.append)
    host = sea.host(1)
    host.say(b"AT*SEND,100,2," + b"x" * 100 + b"\n")
    sea.run()
    sent = [
        (each.signal.kind.service, each.signal.content_bytes)
        for each in told
        if isinstance(each, SignalEmitted)
    ]
    assert sent == [("connect", 0), ("accept", 0), ("burst", 100), ("burst ack", 0)]
